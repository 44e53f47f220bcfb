"""A pose that disagrees with the others, and whether it agrees once its points or fringes are arranged like theirs."""

import math
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from fringecal.projector.board_rig.board_fit import BoardRigFit
from fringecal.projector.board_rig.board_problem import POSE, BoardData, residuals, subset
from fringecal.projector.board_rig.board_solve import Expected, minimise, of_points
from fringecal.projector.board_rig.board_start import pose_start
from fringecal.projector.board_rig.fault_kinds import RigFault, RigFaultKind

Array = NDArray[np.float64]

_MUCH_BETTER = 0.3  # of the residuals as they are numbered: a wrong numbering is off by whole pitches
_LIKE_OTHERS = 2.5
"""Standard deviations, rms, within which a rearranged pose agrees. A flat board's place has a second solution, tilted
the other way, that a wrong arrangement may lead to: it leaves more."""
_OTHERWISE, _EXCHANGED = RigFaultKind.NUMBERED_OTHERWISE, RigFaultKind.AXES_EXCHANGED
_NUMBER_ALIKE = "number them alike, or use a board that tells its ends apart (ChArUco)"


def pose_arrangement(fit: BoardRigFit, number: int) -> RigFault | None:
    """Tell whether a pose agrees with the others once its points, pictures or fringes are arranged otherwise.

    Parameters
    ----------
    fit
        A fitted rig.
    number
        Of the pose, which disagrees.

    Returns
    -------
    RigFault or None
        What was arranged otherwise in it; None where no arrangement agrees.
    """
    name, data = fit.poses[number].name, subset(fit.data, [number])
    tries = [(_rms_of(fit, one), how, kind) for how, kind, one in _arrangements(fit, data)]
    rms, how, kind = min(tries, key=lambda one: one[0], default=(math.inf, "", RigFaultKind.POSE_DISAGREES))
    if rms < min(_LIKE_OTHERS, _MUCH_BETTER * _rms_of(fit, data)):
        return RigFault(kind, f"pose {name}: {how}", (name,))
    return None


def _arrangements(fit: BoardRigFit, data: BoardData) -> Iterator[tuple[str, RigFaultKind, BoardData]]:
    """Give a pose's points as they would be had its lists, pictures or fringes been arranged like the others'."""
    orders = _renumberings(data.board)
    for how, order in orders:
        for which, lists in (
            ("projector", "the projector's points"),
            ("camera", "the camera's points"),
            ("", "its points"),
        ):
            yield (
                f"{lists} are numbered otherwise than in the other poses ({how}); {_NUMBER_ALIKE}",
                _OTHERWISE,
                _taken(data, order, camera=which != "projector", projector=which != "camera"),
            )
    same = np.arange(len(data.board))
    for how, flip in (("turned by 180 degrees", (1, 1)), ("mirrored left to right", (1, 0)), ("mirrored", (0, 1))):
        size = np.array([fit.rig.camera.width_px - 1, fit.rig.camera.height_px - 1])
        camera = np.where(np.array(flip, bool), size - data.camera, data.camera)
        for _, order in (("", same), *orders):
            turned = _taken(replace(data, camera=camera), order, camera=True, projector=True)
            yield f"its pictures are {how} against those of the other poses; store all alike", _OTHERWISE, turned
    yield from _other_fringes(fit, data)


def _other_fringes(fit: BoardRigFit, data: BoardData) -> Iterator[tuple[str, RigFaultKind, BoardData]]:
    """Give a pose's points with its axes exchanged, or its phase counted the other way."""
    size = np.array([fit.rig.projector.width_px, fit.rig.projector.height_px], float)
    if data.in_projector.all(axis=1).any():
        exchanged = replace(
            data, projector=(data.projector / size)[:, ::-1] * size, in_projector=data.in_projector[:, ::-1]
        )
        yield (
            "its axes are exchanged against those of the other poses; state them in its own order",
            _EXCHANGED,
            exchanged,
        )
    for how, flip in (("u", (1, 0)), ("v", (0, 1)), ("u and v", (1, 1))):
        falling = replace(data, projector=np.where(np.array(flip, bool), size - data.projector, data.projector))
        text = (
            f"its phase falls along {how} where that of the other poses rises; its frames stand in the reverse "
            "order of their phase shifts"
        )
        yield text, _OTHERWISE, falling


def _taken(data: BoardData, order: NDArray[np.intp], *, camera: bool, projector: bool) -> BoardData:
    """Points with one list or both in another order."""
    seen = {"camera": camera, "in_camera": camera, "projector": projector, "in_projector": projector}
    return replace(data, **{name: getattr(data, name)[order] for name, change in seen.items() if change})


def _renumberings(board: Array) -> list[tuple[str, NDArray[np.intp]]]:
    """Other ways to number a grid's points, as the new number of each; only whole rearrangements of what is there."""
    low, high = board[:, :2].min(axis=0), board[:, :2].max(axis=0)
    turned = low + high - board[:, :2]
    ways = {
        "turned by 180 degrees": turned,
        "mirrored left to right": np.column_stack([turned[:, 0], board[:, 1]]),
        "mirrored top to bottom": np.column_stack([board[:, 0], turned[:, 1]]),
        "rows and columns exchanged": (board[:, :2] - low)[:, ::-1] + low,
        "rows and columns exchanged, turned by 180 degrees": (turned - low)[:, ::-1] + low,
        "turned by 90 degrees": np.column_stack([turned[:, 1] - low[1] + low[0], board[:, 0] - low[0] + low[1]]),
        "turned by 270 degrees": np.column_stack([board[:, 1] - low[1] + low[0], turned[:, 0] - low[0] + low[1]]),
    }
    ways |= {"numbered along columns": _by_columns(board)}
    found = []
    for how, wanted in ways.items():
        distance = np.linalg.norm(wanted[:, None] - board[None, :, :2], axis=2)
        order = distance.argmin(axis=1)
        if len(set(order.tolist())) == len(board) and distance.min(axis=1).max() < 1e-3 * float((high - low).max()):
            found.append((how, order))
    return found


def _by_columns(board: Array) -> Array:
    """Places of the points if they had been listed column by column."""
    order = np.lexsort((board[:, 1], board[:, 0]))
    back = np.lexsort((board[:, 0], board[:, 1]))
    found = np.empty((len(board), 2))
    found[back] = board[order, :2]
    return found


def _rms_of(fit: BoardRigFit, data: BoardData) -> float:
    """Root mean square of a pose's residuals over their standard deviations, its points arranged anew, the rig held."""
    data = replace(data, coupled=np.zeros_like(data.coupled))
    known = data.in_camera.all(axis=1)
    if known.sum() < POSE:
        return math.inf
    state = fit.solution.state
    rotation, shift = pose_start(data.board[known, :2], data.camera[known], state.shared[:4])
    state = replace(state, pose_rotations=rotation[None], pose_shifts=shift[None])
    s = np.median(fit.solution.s_px, axis=0)
    weights = np.hstack([data.in_camera / (data.camera_u * s[0]), data.in_projector / (data.projector_u * s[1])])
    held = Expected(state.shared, np.zeros(len(state.shared)))
    state, _ = minimise(state, data, weights, held)
    rest = residuals(state, data) * weights
    # Where the phase was read at the corner, the corner's own error is in the projector's coordinate too.
    dof = max(int((weights > 0).sum()) - POSE, 1)
    return math.sqrt(float((rest**2).sum()) / dof) / max(1.0, _corner_share(fit))


def _corner_share(fit: BoardRigFit) -> float:
    """By how much a projector's raw residual is larger than its own standard deviation: by the corners' errors."""
    raw = residuals(fit.solution.state, fit.data)[:, 2:] / (
        fit.data.projector_u * of_points(fit.solution.s_px, fit.data)[:, 2:]
    )
    used = fit.solution.used[:, 2:]
    return float(np.sqrt((raw[used] ** 2).mean())) if used.any() else 1.0
