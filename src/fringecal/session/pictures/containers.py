"""Return whether a PNG, JPEG or BMP file is whole, and what it says of its bits and orientation.

Decoders are lenient: libjpeg fills the lower half of a truncated picture with grey and returns it as
if nothing had happened. A measuring instrument cannot be; the container is walked before it is decoded.
"""

import struct
import zlib
from collections.abc import Iterator
from dataclasses import dataclass

from fringecal.session.faults import PictureError

# 16k x 16k: ten times the largest machine-vision sensor, and small enough not to exhaust memory.
MAX_PIXELS = 1 << 28

PNG_SIGNATURE = b"\x89PNG\r\n\x1a\n"
_PNG_CHANNELS = {0: 1, 2: 3, 3: 1, 4: 2, 6: 4}
_ORIENTATION_TAG, _ORIENTATIONS = 274, range(1, 9)  # of EXIF
_IHDR_SIZE, _CHUNK_FRAME = 13, 12  # bytes of a PNG's header chunk; of a chunk's length, name and checksum
_LEAST_DEPTH = 8  # bits per channel: fewer levels show no phase
_BMP_HEADER = 54  # bytes of both headers
_IFD_ENTRY, _LEAST_TIFF = 12, 10  # bytes of an entry of a TIFF directory, and of a block that holds one at all
# Markers of a JPEG (ITU-T T.81, annex B): fill byte, start of scan, APP1 (EXIF), start of frame (baseline, extended,
# progressive).
_FILL, _SCAN, _APP1, _FRAMES = 0xFF, 0xDA, 0xE1, (0xC0, 0xC1, 0xC2)


@dataclass(frozen=True)
class Container:
    """What a picture file says of itself.

    Parameters
    ----------
    format
        ``"PNG"``, ``"TIFF"``, ``"BMP"`` or ``"JPEG"``.
    white_level
        Value of a saturated pixel where the file states one, else None.
    orientation
        EXIF orientation, 1 = as stored. It is reported, never applied.
    """

    format: str
    white_level: int | None = None
    orientation: int = 1


def inspect_png(data: bytes) -> Container:
    """Walk the chunks of a PNG: every checksum, all pixel rows, the end mark (ISO/IEC 15948)."""
    chunks = list(_png_chunks(data))
    if not chunks or chunks[0][0] != b"IHDR" or len(chunks[0][1]) != _IHDR_SIZE:
        raise PictureError("a PNG without its header chunk IHDR")
    width, height, depth, colour, _, _, interlaced = struct.unpack(">IIBBBBB", chunks[0][1])
    check_size(width, height)
    if depth < _LEAST_DEPTH:
        raise PictureError(f"{depth} bit per pixel, needed {_LEAST_DEPTH} to 16", "save the camera's picture unreduced")
    pixel_data = b"".join(body for kind, body in chunks if kind == b"IDAT")
    row = 1 + width * _PNG_CHANNELS.get(colour, 1) * depth // 8
    _check_deflated(pixel_data, None if interlaced else height * row)
    significant = next((body[0] for kind, body in chunks if kind == b"sBIT" and body), depth)
    # sBIT samples are shifted up to fill the container (ISO/IEC 15948, 11.3.3.4 and 12.4).
    white = ((1 << significant) - 1) << (depth - significant) if _LEAST_DEPTH <= significant < depth else None
    exif = next((body for kind, body in chunks if kind == b"eXIf"), b"")
    return Container("PNG", white, _exif_orientation(exif))


def _png_chunks(data: bytes) -> Iterator[tuple[bytes, bytes]]:
    at = len(PNG_SIGNATURE)
    while at + _CHUNK_FRAME <= len(data):
        length = int.from_bytes(data[at : at + 4])
        kind, body = data[at + 4 : at + 8], data[at + 8 : at + 8 + length]
        checksum = data[at + 8 + length : at + 12 + length]
        if len(checksum) < 4:
            break
        if zlib.crc32(kind + body) != int.from_bytes(checksum):
            raise PictureError(f"damaged PNG: checksum of the chunk at byte {at} is wrong")
        yield kind, body
        if kind == b"IEND":
            return
        at += 12 + length
    raise PictureError(f"truncated PNG: {len(data)} bytes, and the end mark IEND is missing")


def _check_deflated(pixel_data: bytes, expected: int | None) -> None:
    inflater = zlib.decompressobj()
    try:
        found = len(inflater.decompress(pixel_data, expected + 1 if expected else 0))
    except zlib.error as error:
        raise PictureError(f"damaged PNG: its pixel data do not unpack ({error})") from error
    if expected is not None and found != expected:
        raise PictureError(f"damaged PNG: {found} bytes of pixels, needed {expected}")


def inspect_jpeg(data: bytes) -> Container:
    """Walk the segments of a JPEG to its scan and see that the scan ends (ITU-T T.81, annex B)."""
    at, orientation = 2, 1
    while at + 4 <= len(data):
        if data[at] != _FILL:
            raise PictureError(f"damaged JPEG: no marker at byte {at}")
        marker = data[at + 1]
        if marker == _FILL:
            at += 1
            continue
        body = data[at + 4 : at + 2 + int.from_bytes(data[at + 2 : at + 4])]
        if marker == _SCAN:
            if data.find(b"\xff\xd9", at) < 0:
                raise PictureError(f"truncated JPEG: {len(data)} bytes, and the end mark is missing")
            return Container("JPEG", orientation=orientation)
        if marker == _APP1 and body.startswith(b"Exif\0\0"):
            orientation = _exif_orientation(body[6:])
        if marker in _FRAMES and len(body) >= 5:
            check_size(int.from_bytes(body[3:5]), int.from_bytes(body[1:3]))
        at += 2 + max(2, int.from_bytes(data[at + 2 : at + 4]))
    raise PictureError(f"truncated JPEG: {len(data)} bytes, and no picture in them")


def inspect_bmp(data: bytes) -> Container:
    """See that a BMP holds all the rows that its header announces."""
    if len(data) < _BMP_HEADER:
        raise PictureError(f"truncated BMP: {len(data)} bytes, shorter than a header")
    announced, offset = struct.unpack_from("<I4xI", data, 2)
    width, height, depth, compression = struct.unpack_from("<ii2xHI", data, 18)
    check_size(width, abs(height))
    # Rows are padded to four bytes; only an unpacked BMP tells its length by its size.
    rows = abs(height) * ((width * depth + 31) // 32 * 4)
    needed = offset + rows if compression in (0, 3) else announced
    if len(data) < needed:
        raise PictureError(f"truncated BMP: {len(data)} bytes, needed {needed}")
    return Container("BMP")


def check_size(width: int, height: int) -> None:
    """Refuse sizes that no camera has, before anything is unpacked."""
    if width <= 0 or height <= 0 or width * height > MAX_PIXELS:
        raise PictureError(f"a header that announces {width} x {height} px")


def _exif_orientation(tiff: bytes) -> int:
    """Find tag 274 in the first directory of an EXIF block; 1 if there is none."""
    order = {b"II": "<", b"MM": ">"}.get(tiff[:2])
    if order is None or len(tiff) < _LEAST_TIFF:
        return 1
    start = struct.unpack_from(order + "I", tiff, 4)[0]
    count = struct.unpack_from(order + "H", tiff, start)[0] if start + 2 <= len(tiff) else 0
    for entry in range(start + 2, start + 2 + _IFD_ENTRY * count, _IFD_ENTRY):
        if entry + _IFD_ENTRY > len(tiff):
            break
        tag, _, _, value = struct.unpack_from(order + "HHIH", tiff, entry)
        if tag == _ORIENTATION_TAG:
            return int(value) if value in _ORIENTATIONS else 1
    return 1
