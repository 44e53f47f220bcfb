"""What a `.cameramodel` keeps of its solve, `optimization_inputs`: an archive of arrays (npz) in base 85."""

import base64
from typing import Any

from fringecal.guarded import Refusal
from fringecal.guarded_arrays import archive_of

#: Names that newer versions of mrcal read under another one.
_RENAMED = {
    "do_optimize_intrinsic_core": "do_optimize_intrinsics_core",
    "do_optimize_intrinsic_distortions": "do_optimize_intrinsics_distortions",
    "frames_rt_toref": "rt_ref_frame",
    "extrinsics_rt_fromref": "rt_cam_ref",
}
_REMEDY = "export the model anew, or leave the entry out"
_DAMAGED = f"its optimization_inputs are damaged ({{}}); {_REMEDY}"


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
        raise Refusal(f"its optimization_inputs cannot be used: what is kept {error}; {_REMEDY}") from error
    except ValueError as error:
        raise Refusal(_DAMAGED.format(error)) from error
    return {_RENAMED.get(name, name): value for name, value in found.items()}
