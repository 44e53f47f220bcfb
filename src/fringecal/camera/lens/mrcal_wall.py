"""The wall to mrcal: the only module that knows it. Without mrcal everything but this module's work goes on."""

import importlib.util
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fringecal.errors import FitError

Array = NDArray[np.float64]

_MM_PER_M = 1000.0
_MM_POSE = np.array([1.0, 1.0, 1.0, _MM_PER_M, _MM_PER_M, _MM_PER_M])
_SPLINED = "LENSMODEL_SPLINED"
_WRITTEN = 1e-8  # relative: mrcal writes ten digits of an intrinsic into a file, and all of it into the solve
_NEEDED = {
    "intrinsics": float,
    "rt_cam_ref": float,
    "rt_ref_frame": float,
    "observations_board": float,
    "indices_frame_camintrinsics_camextrinsics": np.int32,
    "imagersizes": np.int32,
}
_SWITCHES = (
    "do_optimize_intrinsics_core",
    "do_optimize_intrinsics_distortions",
    "do_optimize_extrinsics",
    "do_optimize_frames",
    "do_optimize_calobject_warp",
    "do_apply_regularization",
)
_OTHER_POINTS = ("points", "observations_point", "observations_point_triangulated")


@dataclass(frozen=True)
class MrcalSolution:
    """What mrcal found.

    Parameters
    ----------
    values, covariance
        Parameters of its lens model.
    poses
        Turn (Rodrigues) and shift in mm of the board in the camera's frame, (n, 6).
    warp_mm
        Bow of the board across its columns and rows; None if it was taken as flat.
    residuals
        Seen minus modelled, px, (rows, columns, 2) per view; meaningless where a point is hidden.
    dof
        Degrees of freedom.
    """

    values: Array
    covariance: Array
    poses: Array
    warp_mm: tuple[float, float] | None
    residuals: tuple[Array, ...]
    dof: int


def available() -> bool:
    """Return whether mrcal is installed."""
    return importlib.util.find_spec("mrcal") is not None


def solve(
    views: Sequence[Array],
    spacing_mm: float,
    start: tuple[Array, Array],
    shape: tuple[int, int],
    *,
    model: str,
    warped: bool = True,
) -> MrcalSolution:
    """Solve for lens, poses and the board's warp; every point that is shown counts.

    Parameters
    ----------
    views
        Points of the board (rows, columns, 2), px, NaN where hidden or wrong, per view.
    spacing_mm
        Distance of neighbouring points, mm.
    start
        Lens parameters of the model, and turn (Rodrigues) with shift in mm of the board in the camera's frame, (n, 6).
    shape
        Image shape (rows, columns).
    model
        mrcal's name of the lens model. A splined one keeps its core (its surface takes all that the core could)
        and is kept smooth by mrcal's regularisation.
    warped
        Whether the board may have a warp.

    Raises
    ------
    FitError
        mrcal is not installed, or the solve failed.
    """
    mrcal = _mrcal()
    inputs = _inputs(views, spacing_mm, *start, shape) | _choices(model, warped=warped)
    try:
        stats = mrcal.optimize(**inputs)
    except Exception as error:
        raise FitError(f"mrcal cannot solve for the lens: {error}") from error
    used = inputs["observations_board"][..., 2] > 0
    rest = -np.reshape(stats["x"][: 2 * used.size], (*used.shape, 2))
    dof = max(1, 2 * int(used.sum()) - len(stats["b_packed"]))
    warp = inputs["calobject_warp"]
    return MrcalSolution(
        inputs["intrinsics"][0],
        _covariance(mrcal, inputs) * float((rest[used] ** 2).sum()) / dof,
        inputs["rt_ref_frame"] * _MM_POSE,
        None if warp is None else (float(warp[0] * _MM_PER_M), float(warp[1] * _MM_PER_M)),
        tuple(each[: len(view), : view.shape[1]] for each, view in zip(rest, views, strict=True)),
        dof,
    )


def project(model: str, values: Array, rays: Array) -> Array:
    """Pixels (n, 2) of directions (n, 3) by one of mrcal's lens models."""
    return np.asarray(_mrcal().project(np.ascontiguousarray(rays), model, np.ascontiguousarray(values)), dtype=float)


def unproject(model: str, values: Array, pixels: Array) -> Array:
    """Directions (n, 3) seen at pixels (n, 2) by one of mrcal's lens models."""
    mrcal = _mrcal()
    try:
        seen = mrcal.unproject(np.ascontiguousarray(pixels), model, np.ascontiguousarray(values), normalize=True)
    except Exception as error:  # mrcal raises the base class for names it does not know
        raise FitError(f"mrcal refuses the lens ({error}); export the camera anew") from error
    return np.asarray(seen, dtype=float)


def solve_covariance(inputs: Mapping[str, Any], camera: int, model: str, values: Array) -> Array:
    """Covariance of the intrinsics of one camera of a solve that mrcal made and a file keeps.

    Parameters
    ----------
    inputs
        The solve's `optimization_inputs` at its optimum, as the file holds them.
    camera
        Number of the camera among those solved together.
    model, values
        Lens model and intrinsics that the file states: what the solve must have ended in.

    Returns
    -------
    Covariance of `values`, zero for those that the solve held; scaled by the solve's own residuals.

    Raises
    ------
    FitError
        mrcal is not installed; the inputs are not those of this lens; or they leave it undetermined.
    """
    mrcal = _mrcal()
    kept = _checked(inputs, camera, model, values)
    try:
        factor = mrcal.optimizer_callback(**kept)[3]
        rest = np.asarray(mrcal.measurements_board(kept), dtype=float).ravel()
        first = mrcal.state_index_intrinsics(camera, **kept)
        count = mrcal.num_states(**kept)
    except Exception as error:  # mrcal raises the base class
        raise FitError(f"mrcal cannot take up the solve that the file keeps: {error}") from error
    dof = rest.size - count
    if first is None or factor is None or dof <= 0:
        raise FitError("the solve that the file keeps held the intrinsics, or has no more observations than unknowns")
    return _covariance(mrcal, kept, camera=camera) * float(rest @ rest) / dof


def _checked(inputs: Mapping[str, Any], camera: int, model: str, values: Array) -> dict[str, Any]:
    """Return what mrcal needs of a file's solve; refuse what it could stumble over, and the solve of another lens."""
    try:
        kept: dict[str, Any] = {name: np.ascontiguousarray(inputs[name], dtype=kind) for name, kind in _NEEDED.items()}
        kept |= {name: bool(inputs.get(name, False)) for name in _SWITCHES}
        warp = inputs.get("calobject_warp")
        kept["calobject_warp"] = None if warp is None else np.ascontiguousarray(warp, dtype=float)
        kept["calibration_object_spacing"] = float(inputs["calibration_object_spacing"])
    except (KeyError, TypeError, ValueError, OverflowError) as error:
        raise FitError(
            f"the solve that the file keeps lacks {error}, or states it otherwise than mrcal does"
        ) from error
    if any(np.size(inputs[name]) for name in _OTHER_POINTS if inputs.get(name) is not None):
        raise FitError("the solve that the file keeps holds points beside boards, which is not read")
    fits = str(inputs.get("lensmodel")) == model and _is_in_shape(kept, values.size)
    if not (fits and 0 <= camera < len(kept["intrinsics"]) and _are_numbered(kept)):
        raise FitError("the solve that the file keeps is not one of its lens model, or its arrays do not fit together")
    if not np.allclose(kept["intrinsics"][camera], values, rtol=_WRITTEN, atol=_WRITTEN):
        raise FitError("the intrinsics were changed after the solve that the file keeps; export the model anew")
    unused = {"points": None, "observations_point": None, "indices_point_camintrinsics_camextrinsics": None}
    return kept | unused | {"lensmodel": model, "verbose": False}


def _is_in_shape(kept: Mapping[str, Any], size: int) -> bool:
    """Whether all arrays of a solve have the shapes that belong together, and finite numbers."""
    board, warp = kept["observations_board"], kept["calobject_warp"]
    shapes = (
        kept["intrinsics"].ndim == 2 and kept["intrinsics"].shape[1] == size,
        kept["imagersizes"].shape == (len(kept["intrinsics"]), 2),
        all(kept[name].ndim == 2 and kept[name].shape[1] == 6 for name in ("rt_ref_frame", "rt_cam_ref")),
        board.ndim == 4 and board.shape[3] == 3 and min(board.shape) > 0,
        kept["indices_frame_camintrinsics_camextrinsics"].shape == (len(board), 3),
        warp is None or warp.shape == (2,),
        kept["calibration_object_spacing"] > 0,
    )
    finite = all(np.isfinite(value).all() for value in kept.values() if value is not None)
    return all(shapes) and finite


def _are_numbered(kept: Mapping[str, Any]) -> bool:
    """Whether every picture of a solve belongs to a frame, a camera and a pose that are there."""
    numbers = kept["indices_frame_camintrinsics_camextrinsics"]
    most = [len(kept[name]) for name in ("rt_ref_frame", "intrinsics", "rt_cam_ref")]
    return bool((numbers >= [0, 0, -1]).all() and (numbers < most).all() and (np.diff(numbers[:, 0]) >= 0).all())


def _mrcal() -> Any:
    """Import mrcal when it is first needed: it is optional."""
    try:
        import mrcal  # noqa: PLC0415
    except ImportError as error:
        raise FitError('mrcal is not installed; install fringecal[mrcal], or ask for solver = "opencv"') from error
    return mrcal


def _inputs(
    views: Sequence[Array], spacing_mm: float, values: Array, poses: Array, shape: tuple[int, int]
) -> dict[str, Any]:
    """What `mrcal.optimize` wants to know; lengths in metres. Hidden points have a negative weight."""
    rows, columns = (max(view.shape[axis] for view in views) for axis in (0, 1))
    board = np.full((len(views), rows, columns, 3), -1.0)
    for k, view in enumerate(views):
        part = board[k, : view.shape[0], : view.shape[1]]
        known = np.isfinite(view).all(axis=-1)
        part[known, :2], part[known, 2] = view[known], 1.0
    numbers = np.arange(len(views), dtype=np.int32)
    return {
        "intrinsics": np.array(values[None], dtype=float),
        "rt_cam_ref": np.zeros((0, 6)),
        "rt_ref_frame": np.ascontiguousarray(poses / _MM_POSE),
        "points": None,
        "observations_board": board,
        "indices_frame_camintrinsics_camextrinsics": np.stack(
            [numbers, np.zeros_like(numbers), np.full_like(numbers, -1)], axis=1
        ),
        "observations_point": None,
        "indices_point_camintrinsics_camextrinsics": None,
        "imagersizes": np.array([[shape[1], shape[0]]], dtype=np.int32),
        "calibration_object_spacing": spacing_mm / _MM_PER_M,
    }


def _choices(model: str, *, warped: bool) -> dict[str, Any]:
    """What `mrcal.optimize` is to solve for."""
    splined = model.startswith(_SPLINED)
    return {
        "lensmodel": model,
        "calobject_warp": np.zeros(2) if warped else None,
        "do_optimize_intrinsics_core": not splined,
        "do_optimize_intrinsics_distortions": True,
        "do_optimize_extrinsics": False,
        "do_optimize_frames": True,
        "do_optimize_calobject_warp": warped,
        "do_apply_outlier_rejection": False,
        "do_apply_regularization": splined,
        "verbose": False,
    }


def _covariance(mrcal: Any, inputs: dict[str, Any], *, camera: int = 0) -> Array:
    """Covariance of the lens parameters for points of unit variance; zero for what was kept."""
    packed, _, _, factor = mrcal.optimizer_callback(**inputs)
    size = inputs["intrinsics"].shape[1]
    first = 0 if inputs["do_optimize_intrinsics_core"] else 4
    last = size if inputs["do_optimize_intrinsics_distortions"] else 4
    place = mrcal.state_index_intrinsics(camera, **inputs)
    among = slice(place, place + last - first)
    unit = np.zeros((last - first, len(packed)))
    unit[:, among] = np.eye(last - first)
    inverse = factor.solve_xt_JtJ_bt(unit)[:, among]
    scale = np.ones(len(packed))
    mrcal.unpack_state(scale, **inputs)
    covariance = np.zeros((size, size))
    covariance[first:last, first:last] = inverse * np.outer(scale[among], scale[among])
    return (covariance + covariance.T) / 2
