"""Walk a PNG before it is decoded: checksums, rows, end mark; and leave out what is no pixel (ISO/IEC 15948)."""

import struct
import zlib
from collections.abc import Iterator, Sequence

from fringecal.session.faults import PictureError
from fringecal.session.pictures.containers import Container, exif_orientation
from fringecal.session.pictures.size_limits import check_size

PNG_SIGNATURE = b"\x89PNG\r\n\x1a\n"
_CHANNELS = {0: 1, 2: 3, 3: 1, 4: 2, 6: 4}  # samples in a pixel as stored, by kind of colour
_PALETTE, _PALETTE_UNPACKED = 3, 4  # kind of colour, and the bytes that a pixel of it becomes: red, green, blue, alpha
_IHDR_SIZE, _CHUNK_FRAME = 13, 12  # bytes of the header chunk; of a chunk's length, name and checksum
_LEAST_DEPTH = 8  # bits per channel: fewer levels show no phase
# libpng writes the pixels of the largest picture in 131,072 chunks of 8 kB; each costs a step of a loop here.
_MOST_CHUNKS = 1 << 18
_NEEDED = (b"IHDR", b"PLTE", b"tRNS", b"IDAT", b"IEND")  # for pixels as stored; the rest may hold anything
_PIECE, _PACKED_PIECE = 1 << 20, 1 << 16  # bytes that are unpacked at a time, and forgotten; and from how many
# Passes of an interlaced picture (8.2): first column and row, and the steps from one to the next.
_ADAM7 = ((0, 0, 8, 8), (4, 0, 8, 8), (0, 4, 4, 8), (2, 0, 4, 4), (0, 2, 2, 4), (1, 0, 2, 2), (0, 1, 1, 2))

Chunk = tuple[bytes, memoryview]


def inspect_png(data: bytes) -> tuple[bytes, Container]:
    """Walk the chunks of a PNG: every checksum, all pixel rows, the end mark.

    Returns
    -------
    bytes
        The same picture with nothing beside its pixels: no profile, text or animation reaches a decoder.
    container
        What the file says of itself.

    Raises
    ------
    PictureError
        It is not whole, or larger than what is read.
    """
    chunks = list(_chunks(data))
    if not chunks or chunks[0][0] != b"IHDR" or len(chunks[0][1]) != _IHDR_SIZE:
        raise PictureError("a PNG without its header chunk IHDR")
    width, height, depth, colour, _, _, interlaced = struct.unpack(">IIBBBBB", chunks[0][1])
    channels = _PALETTE_UNPACKED if colour == _PALETTE else _CHANNELS.get(colour, 1)
    check_size(width, height, channels * depth // 8 or 1, len(data))
    if depth < _LEAST_DEPTH:
        raise PictureError(f"{depth} bit per pixel, needed {_LEAST_DEPTH} to 16", "save the camera's picture unreduced")
    pixel_bytes = _CHANNELS.get(colour, 1) * depth // 8
    _check_deflated(chunks, _stored(width, height, pixel_bytes, is_interlaced=bool(interlaced)))
    exif = next((bytes(body) for kind, body in chunks if kind == b"eXIf"), b"")
    return _pixels_alone(data, chunks), Container("PNG", _white_level(chunks, depth), exif_orientation(exif))


def _chunks(data: bytes) -> Iterator[Chunk]:
    """Yield name and content of every chunk to the end mark, each with its checksum seen to be right."""
    view, at = memoryview(data), len(PNG_SIGNATURE)
    for _ in range(_MOST_CHUNKS):
        if at + _CHUNK_FRAME > len(data):
            break
        length = int.from_bytes(data[at : at + 4])
        end = at + 8 + length
        if end + 4 > len(data):
            break
        if zlib.crc32(view[at + 4 : end]) != int.from_bytes(data[end : end + 4]):
            raise PictureError(f"damaged PNG: checksum of the chunk at byte {at} is wrong")
        kind = data[at + 4 : at + 8]
        yield kind, view[at + 8 : end]
        if kind == b"IEND":
            return
        at = end + 4
    else:
        raise PictureError(f"a PNG of more than {_MOST_CHUNKS} chunks", "save it again as PNG or TIFF")
    raise PictureError(f"truncated PNG: {len(data)} bytes, and the end mark IEND is missing")


def _stored(width: int, height: int, pixel_bytes: int, *, is_interlaced: bool) -> int:
    """Bytes of all rows before packing, each with the byte that names its filter.

    Examples
    --------
    >>> _stored(100, 100, 1, is_interlaced=False), _stored(1, 1, 2, is_interlaced=True)
    (10100, 3)
    """
    sizes = [(width, height)]
    if is_interlaced:
        sizes = [(-((x - width) // dx), -((y - height) // dy)) for x, y, dx, dy in _ADAM7]
    return sum(rows * (1 + columns * pixel_bytes) for columns, rows in sizes if columns > 0 and rows > 0)


def _check_deflated(chunks: Sequence[Chunk], expected: int) -> None:
    """See that the pixel data unpack to as many bytes as the header needs, no more of them at a time than a piece."""
    inflater, found = zlib.decompressobj(), 0
    try:
        for kind, body in chunks:
            if kind == b"IDAT":
                found += unpacked_size(inflater, body, expected - found)
    except zlib.error as error:
        raise PictureError(f"damaged PNG: its pixel data do not unpack ({error})") from error
    if found != expected:
        least = "more than " if found > expected else ""
        raise PictureError(f"damaged PNG: {least}{min(found, expected)} bytes of pixels, needed {expected}")


def unpacked_size(inflater: "zlib._Decompress", packed: bytes | memoryview, most: int) -> int:
    """Count the bytes that deflated data unpack to, in pieces, and stop as soon as they are more than `most`.

    Parameters
    ----------
    inflater
        Where earlier data of the same stream have gone.
    packed
        The data.
    most
        Bytes, 0 or more.
    """
    found = 0
    for at in range(0, len(packed), _PACKED_PIECE):
        found += _unpacked_piece(inflater, packed[at : at + _PACKED_PIECE], most - found)
    return found


def _unpacked_piece(inflater: "zlib._Decompress", packed: bytes | memoryview, most: int) -> int:
    found, piece = 0, _PIECE
    while found <= most and not inflater.eof and (piece == _PIECE or packed):
        piece = len(inflater.decompress(packed, _PIECE))
        packed = inflater.unconsumed_tail
        found += piece
    return found


def _white_level(chunks: Sequence[Chunk], depth: int) -> int | None:
    """Read the white level off sBIT: samples are shifted up to fill the container (11.3.3.4 and 12.4)."""
    significant = next((body[0] for kind, body in chunks if kind == b"sBIT" and body), depth)
    return ((1 << significant) - 1) << (depth - significant) if _LEAST_DEPTH <= significant < depth else None


def _pixels_alone(data: bytes, chunks: Sequence[Chunk]) -> bytes:
    if all(kind in _NEEDED for kind, _ in chunks):
        return data
    kept = (_framed(kind, body) for kind, body in chunks if kind in _NEEDED)
    return PNG_SIGNATURE + b"".join(part for parts in kept for part in parts)


def _framed(kind: bytes, body: memoryview) -> tuple[bytes, ...]:
    checksum = zlib.crc32(body, zlib.crc32(kind))
    return len(body).to_bytes(4), kind, bytes(body), checksum.to_bytes(4)
