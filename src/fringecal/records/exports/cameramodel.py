"""Cameras as files that others read and write: `.cameramodel` (mrcal) and OpenCV's YAML."""

import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from fringecal.camera import LENS_NAMES, RATIONAL, Lens, PlateCamera, RichLens, brown_over_picture, solve_covariance
from fringecal.errors import FitError, RecordError
from fringecal.guarded import Refusal, shortened
from fringecal.records.exports.solve_inputs import solve_inputs
from fringecal.records.files import write_text
from fringecal.records.parts import is_covariance

Array = NDArray[np.float64]

CAMERAMODEL_FILE = "camera.cameramodel"
#: Numbers of distortion terms of mrcal's models that a `Lens` can hold.
_MODELS = {"LENSMODEL_PINHOLE": 0, "LENSMODEL_OPENCV4": 4, "LENSMODEL_OPENCV5": 5, "LENSMODEL_OPENCV8": 8}
_OURS = "lens_covariance"  # an entry of our own, which mrcal skips
_SIZE = len(LENS_NAMES)
_SPLINED = "LENSMODEL_SPLINED_STEREOGRAPHIC_"
_SPLINED_NAME = re.compile(
    _SPLINED + r"order=[23]_Nx=(?P<nx>[0-9]{1,4})_Ny=(?P<ny>[0-9]{1,4})_fov_x_deg=[1-9][0-9]{0,2}"
)
MOST_KNOTS = 200  # along a side; mrcal's own examples have 30
MOST_SIDE_PX = 65_535  # of a picture: no sensor has more, and remapping counts in 16 bit
#: What Brown's lens may leave of a richer one that a file states, rms over the picture: twice what crossings are found
#: to. A larger limit would bend the picture unnoticed, a smaller one refuse lenses that heights do not tell apart.
MAX_LEFT_PX = 0.1
_ON_PLATE = "Reference frame: the plate, mm, z toward the camera."


def cameramodel_text(camera: PlateCamera) -> str:
    """Return a pinhole camera on the plate as the text of a `.cameramodel` (LENSMODEL_OPENCV5).

    The reference frame is the plate frame in mm; `extrinsics` map it to the camera's frame (Rodrigues
    rotation, translation), as mrcal has it.

    Raises
    ------
    RecordError
        A telecentric camera: the format has no model for parallel rays.
    """
    if camera.telecentric:
        raise RecordError("a telecentric camera cannot be written as a .cameramodel: the format knows pinholes only")
    turn = Rotation.from_matrix(camera.rotation).as_rotvec()
    shift = -camera.rotation @ camera.position_mm
    return _text(
        _lens_values(camera), (camera.width_px, camera.height_px), np.concatenate([turn, shift]), None, _ON_PLATE
    )


def lens_text(lens: Lens) -> str:
    """Return a lens without pose as the text of a `.cameramodel`, with its covariance where it is known."""
    covariance = lens.covariance if lens.covariance_known else None
    return _text(lens.values, (lens.width_px, lens.height_px), np.zeros(6), covariance, "A lens without pose.")


def model_text(lens: Lens, pose: Array, what: str, *, region: Array | None = None) -> str:
    """Return a lens with a pose as the text of a `.cameramodel`.

    Parameters
    ----------
    lens
        With its covariance, where it is known.
    pose
        Turn (Rodrigues) and shift from the reference frame to the lens's, (6,).
    what
        A sentence for the file's head: which frame, which unit.
    region
        Closed contour (n, 2), px, inside which the lens holds.
    """
    covariance = lens.covariance if lens.covariance_known else None
    return _text(lens.values, (lens.width_px, lens.height_px), pose, covariance, what, region=region)


def opencv_text(lens: Lens) -> str:
    """Return a lens as OpenCV's calibration YAML, with the covariance of fx, fy, cx, cy, k1, k2, p1, p2, k3."""
    fx, fy, cx, cy, *distortion = lens.values
    matrices = {
        "camera_matrix": np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]]),
        "distortion_coefficients": np.array([distortion]).T,
    }
    if lens.covariance_known:
        matrices[_OURS] = lens.covariance
    parts = [f"image_width: {lens.width_px}\nimage_height: {lens.height_px}\n"]
    for name, matrix in matrices.items():
        rows, columns = matrix.shape
        parts.append(
            f"{name}: !!opencv-matrix\n   rows: {rows}\n   cols: {columns}\n   dt: d\n"
            f"   data: [ {_numbers(matrix.ravel())} ]\n"
        )
    return "%YAML:1.0\n---\n" + "".join(parts)


def write_cameramodel(path: str | Path, camera: PlateCamera) -> Path:
    """Write a camera on the plate as a `.cameramodel`, whole or not at all."""
    return write_text(path, cameramodel_text(camera))


def write_lens(path: str | Path, lens: Lens) -> Path:
    """Write a lens, as OpenCV's YAML if the name ends so, else as a `.cameramodel`."""
    yaml = Path(path).suffix.lower() in (".yml", ".yaml")
    return write_text(path, opencv_text(lens) if yaml else lens_text(lens))


def rich_lens_text(rich: RichLens) -> str:
    """Return a lens of mrcal's further models, which Brown's follows in the rig, as the text of a `.cameramodel`.

    Its covariance stays with Brown's lens: mrcal's files have no place for it.
    """
    size = rich.width_px, rich.height_px
    return _text(rich.values, size, np.zeros(6), None, "A lens without pose.", model=rich.model)


def lens_of_model(entries: dict[str, Any]) -> Lens:
    """Return the lens of a `.cameramodel` from its entries; its pose, if any, is left aside.

    Raises
    ------
    RecordError
        A value is not what its name says, or the model has no Brown's distortion.
    """
    model = str(entries.get("lensmodel", entries.get("lens_model", "none")))
    splined = model.startswith(_SPLINED) and _SPLINED_NAME.fullmatch(model) is not None
    if model not in _MODELS and not splined:
        raise RecordError(
            f"the lens model {shortened(model)} cannot be used: rays here are straight with Brown's distortion; "
            "convert it with mrcal-convert-lensmodel to LENSMODEL_OPENCV5"
        )
    try:
        values = np.array(entries["intrinsics"], dtype=float)
        width, height = (_side(n) for n in entries["imagersize"])
    except (KeyError, TypeError, ValueError, OverflowError) as error:
        raise RecordError(
            "intrinsics or imagersize is missing or no list of numbers; export the camera anew"
        ) from error
    demand_size(width, height)
    if splined:
        _demand_knots(model, values.size if values.ndim == 1 else -1)
    elif values.shape != (4 + _MODELS[model],):
        raise RecordError(f"{model} has {4 + _MODELS[model]} intrinsics, found {values.size}; export the camera anew")
    solved = None if _OURS in entries else _solved_covariance(entries, model, values)
    if splined:
        return _followed(_rich(model, values, solved, (width, height)), known=solved is not None)
    stated = entries.get(_OURS)
    if solved is not None and model != RATIONAL:
        stated = np.pad(solved, (0, _SIZE - len(solved)))
    return lens_of_values(values[:4], values[4:], (width, height), stated, solved)


def _solved_covariance(entries: dict[str, Any], model: str, values: Array) -> Array | None:
    """Covariance that a model's solve gives its intrinsics; None for a model that keeps no solve."""
    kept = entries.get("optimization_inputs")
    if kept is None:
        return None
    camera = entries.get("icam_intrinsics", entries.get("icam_intrinsics_optimization_inputs"))
    if not isinstance(kept, str) or isinstance(camera, bool) or not isinstance(camera, int):
        raise RecordError("optimization_inputs is no text, or icam_intrinsics no whole number; export the model anew")
    try:
        return solve_covariance(solve_inputs(kept), camera, model, values)
    except Refusal as error:
        raise RecordError(str(error)) from error
    except FitError as error:
        raise RecordError(
            f"{error}. Without it its uncertainty is not known; to count the lens as exact, take the entry "
            "optimization_inputs out of the file"
        ) from error


def _rich(model: str, values: Array, covariance: Array | None, size: tuple[int, int]) -> RichLens:
    """Return a richer lens as its file states it."""
    return RichLens(model, values, np.zeros((values.size,) * 2) if covariance is None else covariance, *size)


def lens_of_values(
    core: Array, distortion: Array, size: tuple[int, int], covariance: Any, rational: Array | None = None
) -> Lens:
    """Build the lens and refuse what cannot be one; `rational` is the covariance of all terms of a rational one."""
    if np.any(distortion[5:]):
        if len(distortion) != _MODELS[RATIONAL]:
            raise RecordError(
                f"its {len(distortion)} distortion terms are not Brown's five or the rational model's eight; calibrate "
                "with k1, k2, p1, p2, k3 alone"
            )
        values = np.concatenate([core, distortion])
        return _followed(_rich(RATIONAL, values, rational, size), known=rational is not None)
    values = np.concatenate([core, distortion[:5], np.zeros(max(0, len(LENS_NAMES) - 4 - len(distortion)))])
    if not (np.isfinite(values).all() and min(values[:2]) > 0 and min(size) > 0):
        raise RecordError("a focal length or size is not positive, or a number is not finite; export the camera anew")
    if covariance is None:
        return Lens(values, np.zeros((_SIZE, _SIZE)), *size, covariance_known=False)
    return Lens(values, _covariance(covariance), *size)


def _covariance(stated: Any) -> Array:
    """Read the covariance of a lens: finite, symmetric, and no variance of any combination negative."""
    try:
        table = np.asarray(stated, dtype=float)
    except (TypeError, ValueError, OverflowError):  # ragged, or no numbers
        table = np.zeros(0)
    if table.shape != (_SIZE, _SIZE) or not np.isfinite(table).all() or not is_covariance(table.tolist(), _SIZE):
        raise RecordError(
            f"{_OURS} is no covariance of {_SIZE} x {_SIZE} finite numbers, symmetric and positive semi-definite; "
            "leave it out or write it anew"
        )
    return table


def _side(number: Any) -> int:
    """Return a side of the picture, a whole number of px."""
    if isinstance(number, bool) or int(number) != number:
        raise ValueError(f"{number} is no number of px")
    return int(number)


def demand_size(width: int, height: int) -> None:
    """Refuse a picture that no camera takes."""
    if not (0 < width <= MOST_SIDE_PX and 0 < height <= MOST_SIDE_PX):
        raise RecordError(f"a picture of {width} x {height} px: each side must be 1 to {MOST_SIDE_PX} px")


def _demand_knots(model: str, count: int) -> None:
    """See that a splined model has as many numbers as its name says: mrcal trusts it."""
    found = _SPLINED_NAME.fullmatch(model)
    columns, rows = (int(found[name]) for name in ("nx", "ny")) if found else (0, 0)
    needed = 4 + 2 * columns * rows
    if not (4 <= columns <= MOST_KNOTS and 4 <= rows <= MOST_KNOTS) or count != needed:
        raise RecordError(
            f"{model} has {needed} intrinsics, found {count}, and each side 4 to {MOST_KNOTS} knots; export it anew"
        )


def _followed(rich: RichLens, *, known: bool) -> Lens:
    """Brown's lens in place of a richer one, if it follows that over the whole picture."""
    try:
        if not (np.isfinite(rich.values).all() and min(rich.values[:2]) > 0):
            raise ValueError("a focal length is not positive, or a number is not finite")
        found = brown_over_picture(rich)
        left = float(np.sqrt(np.mean(found.left_px**2)))
    except (FitError, ValueError, RuntimeError) as error:
        raise RecordError(f"its {rich.model.removeprefix('LENSMODEL_')} lens cannot be used: {error}") from error
    if not left < MAX_LEFT_PX:
        raise RecordError(
            f"Brown's lens, which the rig's camera has, follows its {rich.model.removeprefix('LENSMODEL_')} lens to "
            f"{left:.2g} px rms only, {MAX_LEFT_PX} are allowed; calibrate with k1, k2, p1, p2, k3 alone"
        )
    return replace(found.lens, covariance_known=known)


def _lens_values(camera: PlateCamera) -> Array:
    """Lens parameters of a camera on the plate in the order of `LENS_NAMES`."""
    (u0, v0), focal = camera.centre_px, camera.focal_px
    distortion = [camera[name] for name in ("k1", "k2", "p1", "p2", "k3")]
    return np.array([focal, focal / camera["aspect"], u0 + camera["cu_px"], v0 + camera["cv_px"], *distortion])


def _text(
    values: Array,
    size: tuple[int, int],
    pose: Array,
    covariance: Array | None,
    what: str,
    *,
    model: str = "LENSMODEL_OPENCV5",
    region: Array | None = None,
) -> str:
    rows = "" if covariance is None else "".join(f"                    [ {_numbers(row)} ],\n" for row in covariance)
    ours = f"    '{_OURS}': [\n{rows}    ],\n" if rows else ""
    if region is not None:
        places = "".join(f"                    [ {_numbers(place)} ],\n" for place in region)
        ours += f"    'valid_intrinsics_region': [\n{places}    ],\n"
    return (
        f"# Written by fringecal. {what}\n"
        "{\n"
        f"    'lensmodel':  '{model}',\n"
        f"    'intrinsics': [ {_numbers(values)} ],\n"
        f"    'extrinsics': [ {_numbers(pose)} ],\n"
        f"{ours}"
        f"    'imagersize': [ {size[0]}, {size[1]} ]\n"
        "}\n"
    )


def _numbers(values: Array | list[float]) -> str:
    return ", ".join(f"{value:.12g}" for value in values)
