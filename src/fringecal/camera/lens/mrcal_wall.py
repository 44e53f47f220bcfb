"""The wall to mrcal: the only module that knows it. Without mrcal everything but this module's work goes on."""

import importlib.util
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fringecal.errors import FitError

Array = NDArray[np.float64]

_MM_PER_M = 1000.0
_MM_POSE = np.array([1.0, 1.0, 1.0, _MM_PER_M, _MM_PER_M, _MM_PER_M])
_SPLINED = "LENSMODEL_SPLINED"


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


def _covariance(mrcal: Any, inputs: dict[str, Any]) -> Array:
    """Covariance of the lens parameters for points of unit variance; zero for what was kept."""
    packed, _, _, factor = mrcal.optimizer_callback(**inputs)
    size = inputs["intrinsics"].shape[1]
    first = 0 if inputs["do_optimize_intrinsics_core"] else 4
    free = size - first
    unit = np.zeros((free, len(packed)))
    unit[np.arange(free), np.arange(free)] = 1.0
    inverse = factor.solve_xt_JtJ_bt(unit)[:, :free]
    scale = np.ones(len(packed))
    mrcal.unpack_state(scale, **inputs)
    covariance = np.zeros((size, size))
    covariance[first:, first:] = inverse * np.outer(scale[:free], scale[:free])
    return covariance
