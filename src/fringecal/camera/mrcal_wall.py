"""The wall to mrcal: the only module that knows it. Without mrcal everything but `solve` works."""

import importlib.util
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fringecal.camera.bundle import Bundle
from fringecal.errors import FitError

Array = NDArray[np.float64]

_MM_PER_M = 1000.0
_MM_POSE = np.array([1.0, 1.0, 1.0, _MM_PER_M, _MM_PER_M, _MM_PER_M])
# By the number of lens parameters; the missing one of the first is k3.
_MODELS = {8: "LENSMODEL_OPENCV4", 9: "LENSMODEL_OPENCV5"}
_ALL = 9


def available() -> bool:
    """Tell whether mrcal is installed."""
    return importlib.util.find_spec("mrcal") is not None


def solve(
    views: Sequence[Array],
    spacing_mm: float,
    values: Array,
    poses: Array,
    shape: tuple[int, int],
    *,
    flat_board: bool = False,
) -> Bundle:
    """Solve for lens, poses and the board's warp, with mrcal's outlier rejection.

    Parameters
    ----------
    views
        Points of the board (rows, columns, 2), px, NaN where hidden, per view.
    spacing_mm
        Distance of neighbouring points, mm.
    values
        Lens parameters to start from: 8 of them, or 9 with k3.
    poses
        Board in the camera's frame to start from: turn (Rodrigues) and shift in mm, (n, 6).
    shape
        Image shape (rows, columns).
    flat_board
        Whether the board has no warp.

    Raises
    ------
    FitError
        mrcal is not installed, or the solve failed.
    """
    inputs = _inputs(views, spacing_mm, values, poses, shape, bowed=not flat_board)
    mrcal = _mrcal()
    try:
        stats = mrcal.optimize(**inputs)
    except Exception as error:
        raise FitError(f"mrcal cannot solve for the lens: {error}") from error
    used = inputs["observations_board"][..., 2] > 0
    rest = -np.reshape(stats["x"][: 2 * used.size], (*used.shape, 2))
    dof = max(1, 2 * int(used.sum()) - len(stats["b_packed"]))
    variance = float((rest[used] ** 2).sum()) / dof
    warp, missing = inputs["calobject_warp"], (0, _ALL - len(values))
    known = [np.pad(np.isfinite(v).all(axis=-1), _room(v, used.shape[1:])) for v in views]
    return Bundle(
        np.pad(inputs["intrinsics"][0], missing),
        np.pad(_covariance(mrcal, inputs) * variance, missing),
        inputs["rt_ref_frame"] * _MM_POSE,
        None if warp is None else (float(warp[0] * _MM_PER_M), float(warp[1] * _MM_PER_M)),
        tuple(each[k] for each, k in zip(rest, known, strict=True)),
        tuple(each[k] for each, k in zip(used, known, strict=True)),
        dof,
    )


def _mrcal() -> Any:
    """Import mrcal when it is first needed: it is optional."""
    try:
        import mrcal  # noqa: PLC0415
    except ImportError as error:
        raise FitError('mrcal is not installed; install fringecal[mrcal], or ask for solver = "opencv"') from error
    return mrcal


def _room(view: Array, shape: tuple[int, ...]) -> list[tuple[int, int]]:
    """What a view's grid lacks beside the largest one, after its last row and column."""
    return [(0, most - own) for most, own in zip(shape, view.shape[:2], strict=True)]


def _inputs(
    views: Sequence[Array], spacing_mm: float, values: Array, poses: Array, shape: tuple[int, int], *, bowed: bool
) -> dict[str, Any]:
    """Everything `mrcal.optimize` wants; lengths in metres. Hidden points have a negative weight."""
    rows, columns = (max(view.shape[axis] for view in views) for axis in (0, 1))
    board = np.full((len(views), rows, columns, 3), -1.0)
    for k, view in enumerate(views):
        part = board[k, : view.shape[0], : view.shape[1]]
        known = np.isfinite(view).all(axis=-1)
        part[known, :2], part[known, 2] = view[known], 1.0
    numbers = np.arange(len(views), dtype=np.int32)
    return {
        "intrinsics": np.ascontiguousarray(values[None], dtype=float),
        "rt_cam_ref": np.zeros((0, 6)),
        "rt_ref_frame": np.ascontiguousarray(poses / _MM_POSE),
        "points": None,
        "observations_board": board,
        "indices_frame_camintrinsics_camextrinsics": np.stack(
            [numbers, np.zeros_like(numbers), np.full_like(numbers, -1)], axis=1
        ),
        "observations_point": None,
        "indices_point_camintrinsics_camextrinsics": None,
        "lensmodel": _MODELS[len(values)],
        "imagersizes": np.array([[shape[1], shape[0]]], dtype=np.int32),
        "calibration_object_spacing": spacing_mm / _MM_PER_M,
        "calobject_warp": np.zeros(2) if bowed else None,
        "do_optimize_intrinsics_core": True,
        "do_optimize_intrinsics_distortions": True,
        "do_optimize_extrinsics": False,
        "do_optimize_frames": True,
        "do_optimize_calobject_warp": bowed,
        "do_apply_outlier_rejection": True,
        "do_apply_regularization": False,
        "verbose": False,
    }


def _covariance(mrcal: Any, inputs: dict[str, Any]) -> Array:
    """Covariance of the lens parameters for points of unit variance."""
    packed, _, _, factor = mrcal.optimizer_callback(**inputs)
    size = inputs["intrinsics"].shape[1]
    unit = np.zeros((size, len(packed)))
    unit[np.arange(size), np.arange(size)] = 1.0
    inverse = factor.solve_xt_JtJ_bt(unit)[:, :size]
    scale = np.ones(len(packed))
    mrcal.unpack_state(scale, **inputs)
    return np.asarray(inverse * np.outer(scale[:size], scale[:size]), dtype=float)
