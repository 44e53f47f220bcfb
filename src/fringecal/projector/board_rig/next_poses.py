"""Which poses of the board to add next, by what each would do to the uncertainty in the volume."""

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import product

import numpy as np
from numpy.typing import NDArray

from fringecal.projector.board_rig.board_fit import BoardRigFit
from fringecal.projector.board_rig.board_problem import RIG, BoardState, residuals, subset, summed, without_poses
from fringecal.projector.board_rig.board_solve import inverse_of
from fringecal.projector.board_rig.rig_value import turn_matrix
from fringecal.projector.board_rig.triangulation import rig_points

Array = NDArray[np.float64]

_TILT_DEG = 30.0  # of a proposed board: more is hard to see for both devices, less says little of the focal lengths
_TILTS = {"its left edge nearer": (0, 1), "its right edge nearer": (0, -1), "its upper edge nearer": (-1, 0),
          "its lower edge nearer": (1, 0)}  # fmt: skip
_PLACES = {"in the middle": (0, 0), "at the upper left": (-1, -1), "at the upper right": (1, -1),
           "at the lower left": (-1, 1), "at the lower right": (1, 1)}  # fmt: skip
_OFF_MIDDLE = 0.6  # of the way from the field's middle to its rim
_DEPTHS = {"near": 0.05, "half-way": 0.5, "far": 0.95}  # quantiles of the depths where boards were
_LEAST_SEEN = 0.6  # share of the board's points that both devices must see
_VOLUME_POINTS = 150  # of the boards' own, at which the uncertainty is judged


@dataclass(frozen=True)
class PoseAdvice:
    """One pose to add.

    Parameters
    ----------
    text
        How to hold the board, as the camera sees it.
    rotation, shift_mm
        Of the board in the camera's frame.
    ratio
        Median uncertainty of points in the volume after over before it is added, the print's scale left aside.
    """

    text: str
    rotation: Array
    shift_mm: Array
    ratio: float


def advise_poses(fit: BoardRigFit, *, count: int = 3) -> tuple[PoseAdvice, ...]:
    """Propose poses, the most useful first; each counts as if it were added alone.

    Parameters
    ----------
    fit
        A fitted rig.
    count
        How many.

    Notes
    -----
    A proposed pose adds the equations that its points would give, with the scatter that the rig's points have. The
    print's scale is left aside: no pose tells it.
    """
    by_rig = _in_volume(fit)
    before = _median_u(by_rig, fit.solution.covariance)
    found = []
    for text, rotation, shift in _candidates(fit):
        covariance = _covariance_with(fit, rotation, shift)
        if covariance is not None:
            found.append(PoseAdvice(text, rotation, shift, _median_u(by_rig, covariance) / before))
    return tuple(sorted(found, key=lambda one: one.ratio)[:count])


def _in_volume(fit: BoardRigFit) -> Array:
    """What each parameter does to points of the volume, (n, 3, 24)."""
    rig = fit.rig
    points = rig.volume_mm[:: max(1, len(rig.volume_mm) // _VOLUME_POINTS)]
    places = np.where([axis in rig.axes for axis in "uv"], rig.project(points), np.nan)
    return rig_points(rig, rig.camera.project(points), places).by_rig


def _median_u(by_rig: Array, covariance: Array) -> float:
    inner = covariance[:RIG, :RIG]
    return float(np.median(np.sqrt(np.einsum("nij,jk,nik->n", by_rig, inner, by_rig))))


def _candidates(fit: BoardRigFit) -> Iterator[tuple[str, Array, Array]]:
    """Boards tilted to four sides, at five places of the field and three depths, turned as the boards mostly were."""
    rig, depths = fit.rig, fit.rig.volume_mm[:, 2]
    middle = np.array([rig.camera.width_px - 1, rig.camera.height_px - 1]) / 2
    board_middle = (fit.data.board.min(axis=0) + fit.data.board.max(axis=0)) / 2
    for (depth, part), (place, off), (tilt, axis) in product(_DEPTHS.items(), _PLACES.items(), _TILTS.items()):
        ray = rig.camera.unproject((middle * (1 + _OFF_MIDDLE * np.array(off)))[None])[0]
        rotation = turn_matrix(math.radians(_TILT_DEG) * np.array([*axis, 0.0]))
        shift = float(np.quantile(depths, part)) * ray - rotation @ board_middle
        yield f"{depth}, {place} of the picture, {tilt} by {_TILT_DEG:.0f} deg", rotation, shift


def _covariance_with(fit: BoardRigFit, rotation: Array, shift: Array) -> Array | None:
    """Covariance of the shared parameters with a pose added; None where the devices would not see it."""
    fullest = int(np.argmax(np.diff(fit.data.starts)))
    data = subset(fit.data, [fullest])
    state = BoardState(fit.solution.state.shared, fit.solution.state.rotation, rotation[None], shift[None])
    data = replace(data, camera=0 * data.camera, projector=0 * data.projector)
    everywhere = np.ones_like(data.in_camera)
    places = -residuals(state, replace(data, in_camera=everywhere, in_projector=everywhere))
    seen = _within(places[:, :2], fit.rig.camera.width_px, fit.rig.camera.height_px)
    known = np.array([axis in fit.rig.axes for axis in "uv"])
    size = (fit.rig.projector.width_px, fit.rig.projector.height_px)
    lit = seen & (
        _within(places[:, 2:], *size) if known.all() else _within(places[:, 2:][:, known], size[int(known[1])])
    )
    if lit.mean() < _LEAST_SEEN:
        return None
    s = np.median(fit.solution.s_px, axis=0)
    weights = np.hstack([seen[:, None] / (data.camera_u * s[0]), lit[:, None] * known / (data.projector_u * s[1])])
    added = without_poses(summed(state, data, weights)).matrix
    return inverse_of(fit.solution.normal.matrix + added, fit.expected.free)


def _within(places: Array, *sizes: int) -> NDArray[np.bool_]:
    return np.asarray(((places >= 0) & (places <= np.array(sizes) - 1)).all(axis=1))
