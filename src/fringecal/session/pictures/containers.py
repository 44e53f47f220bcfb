"""What a picture file says of itself; and whether a BMP is whole.

Decoders are lenient: libjpeg fills the lower half of a truncated picture with grey and returns it as
if nothing had happened. A measuring instrument cannot be; the container is walked before it is decoded.
"""

import struct
from dataclasses import dataclass

from fringecal.session.faults import PictureError
from fringecal.session.pictures.size_limits import check_size

_ORIENTATION_TAG, _ORIENTATIONS = 274, range(1, 9)  # of EXIF
_BMP_HEADER = 54  # bytes of both headers
_PLAIN = (0, 3)  # ways of packing a BMP in which every pixel is there: as it is, and by stated bits
_BMP_UNPACKED = 4  # bytes of a pixel, unpacked, at most: blue, green, red and one more
_IFD_ENTRY, _LEAST_TIFF = 12, 10  # bytes of an entry of a TIFF directory, and of a block that holds one at all


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


def inspect_bmp(data: bytes) -> Container:
    """See that a BMP holds all the rows that its header announces."""
    if len(data) < _BMP_HEADER:
        raise PictureError(f"truncated BMP: {len(data)} bytes, shorter than a header")
    offset = struct.unpack_from("<I", data, 10)[0]
    width, height, depth, compression = struct.unpack_from("<ii2xHI", data, 18)
    check_size(width, abs(height), _BMP_UNPACKED, len(data))
    if compression not in _PLAIN:
        raise PictureError(f"a BMP packed in way {compression}", "save it unpacked, or as PNG or TIFF")
    # Rows are padded to four bytes.
    needed = offset + abs(height) * ((width * depth + 31) // 32 * 4)
    if len(data) < needed:
        raise PictureError(f"truncated BMP: {len(data)} bytes, needed {needed}")
    return Container("BMP")


def exif_orientation(tiff: bytes) -> int:
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
