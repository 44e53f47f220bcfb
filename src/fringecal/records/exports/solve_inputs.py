"""Arrays of numpy's npz, read within limits, and what a `.cameramodel` keeps of its solve: `optimization_inputs`.

That is an archive of arrays (npz) in base 85. Nothing in it is run, and no array is larger than its bytes.
"""

import base64
import io
import re
import zipfile
import zlib
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fringecal.guarded import MIB, Refusal

MOST_UNPACKED = 64 * MIB  # of all arrays together: 2,000 pictures of a board of 30 x 30 corners take 43 MiB
MOST_ARRAYS = 64  # in one archive; mrcal writes about 30
_HEADER = re.compile(
    rb"\s*\{'descr': '(?P<kind>[<>|=]?[a-zA-Z][0-9]*)', 'fortran_order': (?P<order>True|False), "
    rb"'shape': \((?P<shape>[0-9, ]*)\),? ?\}\s*"
)
_MAGIC = b"\x93NUMPY"
_KINDS = "fiubU"  # numbers, truth values and texts; never objects
#: Names that newer versions of mrcal read under another one.
_RENAMED = {
    "do_optimize_intrinsic_core": "do_optimize_intrinsics_core",
    "do_optimize_intrinsic_distortions": "do_optimize_intrinsics_distortions",
    "frames_rt_toref": "rt_ref_frame",
    "extrinsics_rt_fromref": "rt_cam_ref",
}
_DAMAGED = "its optimization_inputs are damaged ({}); export the model anew, or leave the entry out"


def solve_inputs(text: str) -> dict[str, Any]:
    """Return the arrays, numbers and texts of a model's `optimization_inputs`, by mrcal's present names.

    Parameters
    ----------
    text
        The entry: base 85.

    Raises
    ------
    Refusal
        It is no such archive, or holds more than is read.
    """
    try:
        found = archive_of(base64.b85decode(text))
    except Refusal as error:
        raise Refusal(f"its optimization_inputs cannot be used: what is kept {error}") from error
    except (zipfile.BadZipFile, zlib.error, ValueError, OSError, EOFError, RuntimeError) as error:
        raise Refusal(_DAMAGED.format(error)) from error
    return {_RENAMED.get(name, name): value for name, value in found.items()}


def archive_of(content: bytes) -> dict[str, Any]:
    """Return the arrays, numbers and texts of an npz, within limits; None for the empty text.

    Raises
    ------
    Refusal
        It holds more than is read.
    ValueError, OSError, EOFError, RuntimeError, zipfile.BadZipFile, zlib.error
        It is damaged.
    """
    archive = zipfile.ZipFile(io.BytesIO(content))
    members = archive.infolist()
    if len(members) > MOST_ARRAYS or sum(each.file_size for each in members) > MOST_UNPACKED:
        raise Refusal(f"holds more than the {MOST_ARRAYS} arrays or {MOST_UNPACKED // MIB} MiB that are read")
    return {each.filename.removesuffix(".npy"): _value(archive.read(each)) for each in members}


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
    if not content.startswith(_MAGIC) or found is None:
        raise ValueError("no array where one was expected")
    kind = np.dtype(found["kind"].decode())
    shape = tuple(int(side) for side in found["shape"].replace(b" ", b"").split(b",") if side)
    rest = content[8 + width + length :]
    if kind.kind not in _KINDS or len(rest) != kind.itemsize * _product(shape):
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
