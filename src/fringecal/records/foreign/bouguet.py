"""Results of Bouguet's calibration toolbox for MATLAB: one camera, or two that stand to each other.

Its errors are about three standard deviations, as its pages say, without correlations between parameters.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fringecal.camera import Lens
from fringecal.errors import RecordError
from fringecal.projector import StatedPair
from fringecal.records.exports.cameramodel import demand_size
from fringecal.records.foreign.named_values import Size, lens_from_matrix, rotation_of, shift_of

Array = NDArray[np.float64]

ERRORS_IN_U = 3.0  # "the numerical errors are approximately three times the standard deviations"
_NOTE = "The toolbox states each parameter's error without correlations: u of what depends on several is rough."
_NAMES = "fc, cc, kc, or fc_left, cc_left, kc_left, fc_right, cc_right, kc_right, R, T"


def bouguet_lens(entries: Mapping[str, Any], size: Size | None = None) -> Lens:
    """Return the lens of `Calib_Results.mat`, or the left one of `Calib_Results_stereo.mat`.

    Raises
    ------
    RecordError
        It holds neither, or a value that is none.
    """
    return _lens(entries, "" if "fc" in entries else "_left", size, "--camera-size")


def bouguet_pair(
    entries: Mapping[str, Any], *, camera_size: Size | None, projector_size: Size | None, unit_mm: float
) -> StatedPair:
    """Return camera (left) and projector (right) of `Calib_Results_stereo.mat`.

    The file has one size for both; a projector of another raster needs `projector_size`.

    Raises
    ------
    RecordError
        It holds no two cameras, or a value that is none.
    """
    if "R" not in entries or "T" not in entries:
        raise RecordError(f"holds no results of Bouguet's toolbox for a camera and a projector ({_NAMES})")
    camera = _lens(entries, "_left", camera_size, "--camera-size")
    projector = _lens(entries, "_right", projector_size, "--projector-size")
    notes = (_NOTE,) if camera.covariance_known else ()
    rotation, shift = rotation_of(entries["R"]), shift_of(entries["T"]) * unit_mm
    return StatedPair(camera, projector, rotation, shift, "Bouguet", notes=notes)


def bouguet_entries(pair: StatedPair) -> dict[str, Any]:
    """Return the arrays of `Calib_Results_stereo.mat`: what the toolbox and its users look for."""
    entries: dict[str, Any] = {"R": pair.rotation, "T": pair.shift_mm[:, None]}
    for lens, side in ((pair.camera, "left"), (pair.projector, "right")):
        fx, fy, cx, cy, *terms = lens.values
        entries |= {
            f"fc_{side}": np.array([[fx], [fy]]),
            f"cc_{side}": np.array([[cx], [cy]]),
            f"alpha_c_{side}": 0.0,
            f"kc_{side}": np.array([terms]).T,
            f"nx_{side}": float(lens.width_px),
            f"ny_{side}": float(lens.height_px),
        }
        if lens.covariance_known:
            errors = ERRORS_IN_U * np.sqrt(np.diag(lens.covariance))[:, None]
            entries |= {f"fc_{side}_error": errors[:2], f"cc_{side}_error": errors[2:4], f"kc_{side}_error": errors[4:]}
    return entries | {"nx": float(pair.camera.width_px), "ny": float(pair.camera.height_px)}


def _lens(entries: Mapping[str, Any], side: str, size: Size | None, option: str) -> Lens:
    try:
        focal, centre, terms = (np.ravel(entries[f"{name}{side}"]) for name in ("fc", "cc", "kc"))
    except KeyError as error:
        raise RecordError(f"holds no results of Bouguet's toolbox: {error} is missing (needed: {_NAMES})") from error
    if focal.size != 2 or centre.size != 2 or terms.size not in (4, 5):
        raise RecordError(f"fc{side} and cc{side} are two numbers each and kc{side} five; export the calibration anew")
    skew = (
        float(np.ravel(entries.get(f"alpha_c{side}", 0.0))[0]) if np.size(entries.get(f"alpha_c{side}", 0.0)) else 0.0
    )
    matrix = np.array([[focal[0], skew * focal[0], centre[0]], [0, focal[1], centre[1]], [0, 0, 1]])
    shape = size or _size(entries, side, option)
    return lens_from_matrix(matrix, terms, shape, _covariance(entries, side))


def _size(entries: Mapping[str, Any], side: str, option: str) -> Size:
    sides = [np.ravel(entries.get(f"{name}{side}", entries.get(name, []))) for name in ("nx", "ny")]
    if any(each.size != 1 or not np.isfinite(each[0]) for each in sides):
        raise RecordError(f"nx and ny, the size of the picture, are not stated; give {option}")
    width, height = (round(float(each[0])) for each in sides)
    demand_size(width, height)
    return width, height


def _covariance(entries: Mapping[str, Any], side: str) -> Array | None:
    """Diagonal covariance from the stated errors; None where they are not stated, or are all zero."""
    stated = [np.ravel(entries.get(f"{name}{side}_error", [])) for name in ("fc", "cc", "kc")]
    errors = np.concatenate(stated)
    if (
        [each.size for each in stated] not in ([2, 2, 4], [2, 2, 5])
        or not np.isfinite(errors).all()
        or not errors.any()
    ):
        return None
    return np.asarray(np.diag(np.pad(errors / ERRORS_IN_U, (0, 9 - errors.size)) ** 2))
