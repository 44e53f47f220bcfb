"""Arrays from outside (`.npy`, `.npz`, `.mat` of level 5), read within stated limits; nothing in them is run.

Every reader of arrays goes through here: what is damaged is refused with a sentence, whatever it breaks in what takes
it apart, and no array is larger than its bytes. MATLAB's level 5 is laid out as its format document says:
elements of a type, a size and as many bytes, some of them deflated.
"""

import io
import math
import re
import struct
import zipfile
import zlib
from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fringecal.guarded import MIB, Refusal, shortened

Array = NDArray[np.float64]

MAGIC_NPY, MAGIC_ZIP, MAGIC_HDF5 = b"\x93NUMPY", b"PK", b"\x89HDF"
MAGIC_MATLAB = b"MATLAB"
MOST_UNPACKED = 64 * MIB  # of all arrays: solves of 2,000 pictures of 30 x 30 corners take 43 MiB; no results more
MOST_ARRAYS = 64  # in one archive; mrcal writes about 30
MOST_OF_MATLAB = 4000  # Bouguet's toolbox writes about ten for each picture of the board
_HEADER = re.compile(
    rb"\s*\{'descr': '(?P<kind>[<>|=]?[a-zA-Z][0-9]*)', 'fortran_order': (?P<order>True|False), "
    rb"'shape': \((?P<shape>[0-9, ]*)\),? ?\}\s*"
)
_KINDS = "fiubU"  # numbers, truth values and texts; never objects
_MATLAB_HEADER = 128  # bytes
_COMPRESSED, _MATRIX = 15, 14
_NUMBERS = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 9: "f8", 12: "i8", 13: "u8"}
_NUMERIC_CLASSES = range(6, 16)  # double to uint64; not cells, structures, objects, texts, sparse matrices
_CUT = "is no whole MATLAB file (level 5); it may be cut short"
_DAMAGE = (zipfile.BadZipFile, zlib.error, struct.error, ValueError, OSError, EOFError, RuntimeError, OverflowError)


def array_of(content: bytes) -> NDArray[Any]:
    """Return the array of a `.npy`.

    Raises
    ------
    Refusal
        It is none, or damaged.
    """
    try:
        return _array(content)
    except (ValueError, TypeError, OverflowError) as error:
        raise Refusal(f"cannot be read as arrays; it may be damaged ({shortened(error)})") from error


def archive_of(content: bytes, most: int = MOST_UNPACKED) -> dict[str, Any]:
    """Return the arrays, numbers and texts of an npz, within limits; None for the empty text.

    Parameters
    ----------
    content
        The file's.
    most
        Bytes of all of them together, unpacked.

    Raises
    ------
    Refusal
        It is damaged, or holds more than is read.
    """
    try:
        archive = zipfile.ZipFile(io.BytesIO(content))
        members = archive.infolist()
        if len(members) > MOST_ARRAYS or sum(each.file_size for each in members) > most:
            raise Refusal(f"holds more than the {MOST_ARRAYS} arrays or {most // MIB} MiB that are read")
        return {each.filename.removesuffix(".npy"): _value(archive.read(each)) for each in members}
    except Refusal:
        raise
    except (*_DAMAGE, TypeError, KeyError) as error:
        raise Refusal(f"cannot be read as arrays; it may be damaged ({shortened(error)})") from error


def matlab_of(content: bytes, most: int = MOST_UNPACKED) -> dict[str, Array]:
    """Return the numeric arrays of a MATLAB file by name.

    Parameters
    ----------
    content
        The file's.
    most
        Bytes of all of them together, unpacked, as numbers of 64 bit.

    Raises
    ------
    Refusal
        It is of another level, damaged, or holds more than is read.
    """
    if content.startswith((b"MATLAB 7.3", MAGIC_HDF5)):
        raise Refusal("is a MATLAB file of version 7.3, which is not read; write it with save('-v7', ...)")
    order = {b"IM": "<", b"MI": ">"}.get(content[126:128])
    if order is None:
        raise Refusal("is no MATLAB file of level 5; write it with save('-v7', ...)")
    try:
        return dict(_arrays(content[_MATLAB_HEADER:], order, most))
    except Refusal:
        raise
    except _DAMAGE as error:
        raise Refusal(f"{_CUT} ({shortened(error)})") from error


def _value(content: bytes) -> Any:
    """Return an array, or the number or text that it holds alone; None for the empty text, as mrcal writes it."""
    array = _array(content)
    if array.shape:
        return array
    value = array.item()
    return None if value == "" else value


def _array(content: bytes) -> NDArray[Any]:
    version = content[6:7]
    width = 2 if version == b"\x01" else 4
    length = int.from_bytes(content[8 : 8 + width], "little")
    found = _HEADER.fullmatch(content[8 + width : 8 + width + length])
    if not content.startswith(MAGIC_NPY) or found is None:
        raise ValueError("no array where one was expected")
    kind = np.dtype(found["kind"].decode())
    shape = tuple(int(side) for side in found["shape"].replace(b" ", b"").split(b",") if side)
    rest = content[8 + width + length :]
    if kind.kind not in _KINDS:
        raise ValueError(f"an array of {kind}; numbers were needed")
    if len(rest) != kind.itemsize * _product(shape):
        raise ValueError("an array that is not as its header says")
    if not kind.itemsize:  # the empty text
        return np.zeros(shape, dtype=kind)
    values = np.frombuffer(rest, dtype=kind)
    return (values.reshape(shape[::-1]).T if found["order"] == b"True" else values.reshape(shape)).copy()


def _product(shape: tuple[int, ...]) -> int:
    product = 1
    for side in shape:
        product *= side
    return product


def _arrays(content: bytes, order: str, most: int) -> Iterator[tuple[str, Array]]:
    left = most
    for count, (kind, body) in enumerate(_elements(content, order)):
        if count >= MOST_OF_MATLAB:
            raise Refusal(f"holds more than the {MOST_OF_MATLAB} arrays that are read")
        if kind == _COMPRESSED:
            stream = zlib.decompressobj()
            unpacked = stream.decompress(body, left)
            if len(unpacked) >= left or stream.unconsumed_tail:
                raise Refusal(f"holds more than the {most // MIB} MiB that are read")
            kind, body = next(_elements(unpacked, order), (0, b""))
        if kind == _MATRIX:
            for name, values in _matrix(body, order, left):
                left -= values.nbytes
                yield name, values


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


def _matrix(body: bytes, order: str, most: int) -> Iterator[tuple[str, Array]]:
    """Give an array with its name, if it is one of real numbers."""
    parts = _elements(body, order)
    flags, shape, name, real = (next(parts, (0, b"")) for _ in range(4))
    if len(flags[1]) < 8 or struct.unpack_from(order + "I", flags[1])[0] & 0xFF not in _NUMERIC_CLASSES:
        return
    sides = np.frombuffer(shape[1], order + "i4").tolist()
    if real[0] not in _NUMBERS or min(sides, default=0) < 0:
        return
    stored = np.frombuffer(real[1], order + _NUMBERS[real[0]])
    if stored.size * np.dtype(float).itemsize > most:
        raise Refusal(f"holds more than the {most // MIB} MiB that are left to be read")
    values = stored.astype(float)
    if values.size != math.prod(sides):
        raise Refusal(_CUT)
    yield name[1].decode("latin-1"), values.reshape(sides, order="F")
