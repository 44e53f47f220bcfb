"""From the names by which programs write a calibration to lenses and poses: one row for each way of naming."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from fringecal.camera import Lens
from fringecal.errors import RecordError
from fringecal.guarded import MOST_SHOWN, quoted
from fringecal.projector import StatedPair
from fringecal.records.exports.cameramodel import MAX_LEFT_PX, demand_size, lens_of_values

Array = NDArray[np.float64]
Size = tuple[int, int]

_NO_ROTATION = 1e-3  # departure of R'R from the unit matrix: six printed decimals leave 1e-6, a wrong matrix 1
_WHOLE_PX = 1e-6  # of a size that a file writes as a float
MM_PER_M = 1000.0


@dataclass(frozen=True)
class Layout:
    """Names by which one program writes a camera and a projector."""

    kind: str
    camera: tuple[str, str]
    projector: tuple[str, str]
    pose: tuple[str, str]
    camera_size: tuple[str, ...] = ()
    projector_size: tuple[str, ...] = ()


LAYOUTS = (
    Layout(
        "SLStudio",
        ("Kc", "kc"),
        ("Kp", "kp"),
        ("Rp", "Tp"),
        ("frameWidth", "frameHeight"),
        ("screenResX", "screenResY"),
    ),
    Layout("SLMaster", ("M1", "D1"), ("M4", "D4"), ("Rlp", "Tlp"), ("S",)),
    Layout("scan3d-capture", ("cam_K", "cam_kc"), ("proj_K", "proj_kc"), ("R", "T")),
    Layout("OpenCV", ("M1", "D1"), ("M2", "D2"), ("R", "T"), ("image_width", "image_height")),
    Layout("OpenCV", ("K1", "D1"), ("K2", "D2"), ("R", "T"), ("image_width", "image_height")),
    Layout(
        "OpenCV",
        ("cameraMatrix1", "distCoeffs1"),
        ("cameraMatrix2", "distCoeffs2"),
        ("R", "T"),
        ("image_width", "image_height"),
    ),
    Layout(
        "OpenCV",
        ("camera_matrix1", "distortion_coefficients1"),
        ("camera_matrix2", "distortion_coefficients2"),
        ("R", "T"),
        ("image_width", "image_height"),
        ("projector_width", "projector_height"),
    ),
)
_ERRORS = {
    "cam_error": "camera",
    "proj_error": "projector",
    "stereo_error": "pair",
    "avg_reprojection_error_cam1": "camera",
    "avg_reprojection_error_cam2": "projector",
}
#: Single lenses: matrix, terms, width and height.
_SINGLE = (
    ("camera_matrix", "distortion_coefficients", "image_width", "image_height"),
    ("camera_matrix", "distortion_coefficients", "width", "height"),
    ("cameraMatrix", "distCoeffs", "image_width", "image_height"),
    ("K", "D", "width", "height"),
    ("k", "d", "width", "height"),
    ("K", "D", "image_width", "image_height"),
)
_MODELS_OF_ROS = ("plumb_bob", "rational_polynomial", "none", "")


def array_of(entries: Mapping[str, Any], name: str) -> Array | None:
    """Return the numbers of an entry, in the shape that it states; None where there is no such entry.

    Raises
    ------
    RecordError
        It holds no numbers, or not as many as it says.
    """
    value = entries.get(name)
    if value is None:
        return None
    try:
        if not isinstance(value, Mapping):
            return np.asarray(value, dtype=float)
        found = np.asarray(value.get("data", []), dtype=float)
        return found.reshape(int(value["rows"]), int(value["cols"])) if "rows" in value and "cols" in value else found
    except (KeyError, TypeError, ValueError, OverflowError) as error:
        raise RecordError(f"{name}: not as many numbers as rows and columns say; export it anew") from error


def pair_of_entries(
    entries: Mapping[str, Any], *, camera_size: Size | None, projector_size: Size | None, unit_mm: float
) -> StatedPair:
    """Return a camera and a projector from the entries of OpenCV's kind of file.

    Parameters
    ----------
    entries
        As read from YAML or XML.
    camera_size, projector_size
        Width and height, px, where the file states none.
    unit_mm
        Millimetres of the file's unit of length.

    Raises
    ------
    RecordError
        No way of naming fits, a size is missing, or a value is not what its name says.
    """
    layout = next((each for each in LAYOUTS if all(name in entries for name in (*each.camera, *each.projector))), None)
    if layout is None or ("Rlr" in entries and layout.kind != "SLMaster"):
        raise RecordError(_unknown(entries))
    rotation, shift = (array_of(entries, name) for name in layout.pose)
    if rotation is None or shift is None:
        raise RecordError(
            f"{' and '.join(layout.pose)} are missing: how the projector stands to the camera is not said"
        )
    errors = {who: float(entries[name]) for name, who in _ERRORS.items() if isinstance(entries.get(name), int | float)}
    return StatedPair(
        _device(entries, layout.camera, layout.camera_size, camera_size, "camera"),
        _device(entries, layout.projector, layout.projector_size, projector_size, "projector"),
        rotation_of(rotation),
        shift_of(shift) * unit_mm,
        layout.kind,
        errors,
    )


def lens_of_entries(entries: Mapping[str, Any], size: Size | None = None) -> Lens:
    """Return a single lens, or a pair's camera, from the entries of OpenCV's or ROS's kind of file.

    Raises
    ------
    RecordError
        No way of naming fits, the model is none of Brown's, or a size is missing.
    """
    for matrix, terms, width, height in _SINGLE:
        if matrix in entries and terms in entries:
            return _device(entries, (matrix, terms), (width, height), size, "picture")
    for layout in LAYOUTS:
        if all(name in entries for name in layout.camera):
            return _device(entries, layout.camera, layout.camera_size, size, "camera")
    raise RecordError(_unknown(entries))


def rotation_of(stated: Array) -> Array:
    """Return a rotation matrix (3, 3) from one that was printed, or from a turn (Rodrigues).

    Raises
    ------
    RecordError
        It is none: mirrored, scaled, or no 3 x 3 numbers.
    """
    if not np.isfinite(stated).all() or stated.size not in (3, 9):
        raise RecordError("the rotation is no 3 x 3 matrix and no turn of three finite numbers; export it anew")
    if stated.size == 3:
        return np.asarray(Rotation.from_rotvec(stated.ravel()).as_matrix())
    matrix = stated.reshape(3, 3)
    left, sizes, right = np.linalg.svd(matrix)
    if np.abs(sizes - 1).max() > _NO_ROTATION or np.linalg.det(matrix) < 0:
        raise RecordError("the rotation matrix is none: it mirrors or scales; export the calibration anew")
    return np.asarray(left @ right)


def shift_of(stated: Array) -> Array:
    """Return a shift of three finite numbers, or refuse it."""
    if stated.size != 3 or not np.isfinite(stated).all():
        raise RecordError("the translation is no three finite numbers; export the calibration anew")
    return np.asarray(stated.ravel())


def lens_from_matrix(matrix: Array, terms: Array, size: Size, covariance: Array | None = None) -> Lens:
    """Return a lens from OpenCV's or Bouguet's camera matrix (3, 3) and distortion terms.

    Raises
    ------
    RecordError
        The matrix is none, its axes are skewed, or the terms are not Brown's.
    """
    if matrix.shape != (3, 3) or not np.isfinite(matrix).all() or not matrix[2, 2]:
        raise RecordError("a camera matrix of 3 x 3 finite numbers was needed; export the calibration anew")
    if not (terms.size and np.isfinite(terms).all()):
        raise RecordError("distortion terms that are finite numbers were needed; export the calibration anew")
    matrix = matrix / matrix[2, 2]
    if min(matrix[0, 0], matrix[1, 1]) > 0:
        rows = (np.array([0.0, size[1] - 1.0]) - matrix[1, 2]) / matrix[1, 1]
        skew_px = abs(matrix[0, 1]) * float(np.sqrt(np.mean(rows**2)))
        if skew_px > MAX_LEFT_PX:
            raise RecordError(
                f"its axes are skewed, by {skew_px:.2g} px at the edge of the picture, and pixels here are rectangles; "
                "calibrate without skew (alpha_c = 0)"
            )
    return lens_of_values(matrix[[0, 1, 0, 1], [0, 1, 2, 2]], terms.ravel(), size, covariance)


def demand_known_model(entries: Mapping[str, Any]) -> None:
    """Refuse a distortion model of ROS that is not Brown's or the rational one."""
    model = str(entries.get("distortion_model") or "")
    if model not in _MODELS_OF_ROS:
        raise RecordError(
            f"its distortion model {quoted(model)} cannot be used: rays here are straight with Brown's distortion "
            "(plumb_bob); calibrate with that model"
        )


def _device(
    entries: Mapping[str, Any], names: Sequence[str], size_names: Sequence[str], size: Size | None, who: str
) -> Lens:
    demand_known_model(entries)
    matrix, terms = (array_of(entries, name) for name in names)
    if matrix is None or terms is None:
        raise RecordError(f"{names[0]} (3 x 3) or {names[1]} is missing; export the calibration anew")
    if matrix.size == 9:
        matrix = matrix.reshape(3, 3)
    terms = terms if terms.size else np.zeros(5)  # ROS writes no terms for a lens without distortion
    covariance = array_of(entries, "lens_covariance") if names[0] == "camera_matrix" else None
    return lens_from_matrix(matrix, terms, size or _size(entries, size_names, who), covariance)


def _size(entries: Mapping[str, Any], names: Sequence[str], who: str) -> Size:
    """Return the size that a file states by two numbers or by one list of two."""
    stated = [array_of(entries, name) for name in names]
    numbers = [number for each in stated if each is not None for number in each.ravel().tolist()]
    if len(numbers) != 2 or not all(np.isfinite(numbers)):
        option = "--camera-size" if who != "projector" else "--projector-size"
        raise RecordError(f"the size of the {who} is not stated ({' and '.join(names) or 'no entry'}); give {option}")
    sides = [round(number) for number in numbers]
    if max(abs(number - side) for number, side in zip(numbers, sides, strict=True)) > _WHOLE_PX:
        raise RecordError(f"{' and '.join(names)}: no whole numbers of px")
    demand_size(*sides)
    return sides[0], sides[1]


def _unknown(entries: Mapping[str, Any]) -> str:
    if "Rlr" in entries and "M4" not in entries:
        return (
            "is SLMaster's calibration of two cameras; a camera and a projector (M1, D1, M4, D4, Rlp, Tlp) were needed"
        )
    found = ", ".join(list(entries)[:20])[:MOST_SHOWN] or "none"
    return f"holds no calibration by names that are known here (found: {found}); docs/camera.md lists them"
