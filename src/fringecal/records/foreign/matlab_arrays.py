"""The numeric arrays of a MATLAB file (level 5, `save -v6` and `-v7`), read within limits; everything else is skipped.

Level 5 is laid out as its format document says: elements of a type, a size and as many bytes, some of them deflated.
"""

import math
import struct
import zlib
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from fringecal.guarded import MIB, Refusal

Array = NDArray[np.float64]

MOST_UNPACKED = 64 * MIB  # of all arrays together: Bouguet's toolbox keeps its pictures in memory, not in its results
MOST_ARRAYS = 4000  # Bouguet's toolbox writes about ten for each picture of the board
_HEADER = 128  # bytes
_COMPRESSED, _MATRIX = 15, 14
_NUMBERS = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 9: "f8", 12: "i8", 13: "u8"}
_NUMERIC_CLASSES = range(6, 16)  # double to uint64; not cells, structures, objects, texts, sparse matrices
_CUT = "is no whole MATLAB file (level 5); it may be cut short"


def matlab_of(content: bytes) -> dict[str, Array]:
    """Return the numeric arrays of a MATLAB file by name.

    Raises
    ------
    Refusal
        It is of another level, damaged, or holds more than is read.
    """
    if content.startswith(b"MATLAB 7.3") or content.startswith(b"\x89HDF"):
        raise Refusal("is a MATLAB file of version 7.3, which is not read; write it with save('-v7', ...)")
    order = {b"IM": "<", b"MI": ">"}.get(content[126:128])
    if order is None:
        raise Refusal("is no MATLAB file of level 5; write it with save('-v7', ...)")
    try:
        return dict(_arrays(content[_HEADER:], order))
    except (struct.error, zlib.error, ValueError, OverflowError) as error:
        if isinstance(error, Refusal):
            raise
        raise Refusal(f"{_CUT} ({error})") from error


def _arrays(content: bytes, order: str) -> Iterator[tuple[str, Array]]:
    left = MOST_UNPACKED
    for count, (kind, body) in enumerate(_elements(content, order)):
        if count >= MOST_ARRAYS:
            raise Refusal(f"holds more than the {MOST_ARRAYS} arrays that are read")
        if kind == _COMPRESSED:
            stream = zlib.decompressobj()
            unpacked = stream.decompress(body, left)
            left -= len(unpacked)
            if left <= 0 or stream.unconsumed_tail:
                raise Refusal(f"holds more than the {MOST_UNPACKED // MIB} MiB that are read")
            kind, body = next(_elements(unpacked, order), (0, b""))
        if kind == _MATRIX:
            yield from _matrix(body, order)


def _elements(content: bytes, order: str) -> Iterator[tuple[int, bytes]]:
    """Give type and bytes of each element in a row; small ones keep their bytes in the place of the size."""
    place = 0
    while place + 8 <= len(content):
        (word,) = struct.unpack_from(order + "I", content, place)
        if word >> 16:
            size, kind, begin, step = word >> 16, word & 0xFFFF, place + 4, 8
        else:
            (size,) = struct.unpack_from(order + "I", content, place + 4)
            kind, begin = word, place + 8
            step = 8 + (size if kind == _COMPRESSED else -(-size // 8) * 8)
        if begin + size > len(content):
            raise Refusal(_CUT)
        yield kind, content[begin : begin + size]
        place += step


def _matrix(body: bytes, order: str) -> Iterator[tuple[str, Array]]:
    """Give an array with its name, if it is one of real numbers."""
    parts = _elements(body, order)
    flags, shape, name, real = (next(parts, (0, b"")) for _ in range(4))
    if len(flags[1]) < 8 or struct.unpack_from(order + "I", flags[1])[0] & 0xFF not in _NUMERIC_CLASSES:
        return
    sides = np.frombuffer(shape[1], order + "i4").tolist()
    if real[0] not in _NUMBERS or min(sides, default=0) < 0:
        return
    values = np.frombuffer(real[1], order + _NUMBERS[real[0]]).astype(float)
    if values.size != math.prod(sides):
        raise Refusal(_CUT)
    yield name[1].decode("latin-1"), values.reshape(sides, order="F")
