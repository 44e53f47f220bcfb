"""Fringe orders from a Gray code taken beside the fringes: how code and fringes lie to one another is found."""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from fringecal.errors import PhaseError
from fringecal.numerics import TURN, wrap
from fringecal.phase.demodulation.demodulate import PhaseMap
from fringecal.phase.orders import order_kernels
from fringecal.phase.orders.gray_positions import gray_positions
from fringecal.phase.orders.multi_period import FringeOrders


@dataclass(frozen=True)
class GrayRules:
    """When a Gray code and fringes belong together, and how near to the code's edges it is not asked.

    Parameters
    ----------
    least_edges
        Pixels at which the code goes on by one; from fewer, the mean phase there is no better than 1 / sqrt(50) of a
        radian if they scatter by one.
    least_agreement
        Length of the mean direction of the phases at the code's edges, 0 to 1: that of phases spread evenly over half
        a turn is 0.64, over a whole turn 0.
    beside_edge_rad
        Phase about an edge of the code within which neighbours decide, rad: a seventh of a fringe, more than blur and
        noise move an edge by. Towards half a turn nothing would be left that the code decides.
    least_decided
        Share of the pixels with a phase that the code must decide: below half, more is open than known, and the code
        is of another scene or its bits are in another order.
    rounds
        Passes in which pixels beside an edge continue their neighbours, where those are of one order.
    numbers_from, numbers_to
        Numbers of the code counted for each fringe, over the nearest whole number: edges that a slanting surface hides
        make fewer, noise makes more.
    """

    least_edges: int = 50
    least_agreement: float = 0.5
    beside_edge_rad: float = 0.9
    least_decided: float = 0.5
    rounds: int = 3
    numbers_from: float = 0.6
    numbers_to: float = 1.5


GRAY_RULES = GrayRules()
_AROUND_PX = 9  # square over which the phase rises one way: noise of neighbours averages to a ninth
_LEAST_PART = 1e-3  # of a square that has a phase: a single pixel is an eightieth
# Around a pixel beside an edge of the code pixels are asked up to so far beyond it, within these bounds.
_BEYOND_PX, _REACHES_PX = 2, (3, 7)
_NO_CHANGE_RAD = 1e-9  # of the phase, instead of a division by 0


def orders_by_gray(map_: PhaseMap, frames: ArrayLike, *, rules: GrayRules = GRAY_RULES) -> FringeOrders:
    """Decide the order of fringes by a Gray code.

    Parameters
    ----------
    map_
        The fringes' phase; background and modulation say what is bright and dark in the code's frames.
    frames
        Gray-code frames, (K, H, W), the coarsest bit first.
    rules
        When code and fringes belong together.

    Notes
    -----
    A code of one number for each fringe goes on at one phase, whatever it is: that is found at its edges, and pixels
    within 0.9 rad of it take the order that continues their neighbours, where nine in ten of these agree: beside an
    edge of the surface they stay open. A code of m numbers for each fringe needs no neighbours.

    Raises
    ------
    PhaseError
        Frames of another size, or a code that does not go with the fringes.
    """
    code, position, valid, bits = gray_positions(frames, map_.background, map_.modulation)
    valid &= map_.valid
    edge_phase = _edges(code, valid, map_.phase, rules)
    per_fringe = _numbers_per_fringe(code, valid, map_.phase, rules)
    place = position if per_fringe > 0 else 1 - position
    if abs(per_fringe) == 1:
        # Counted from the phase at which the code goes on; its turn is cut where no sensible code has its edges.
        rough = TURN * place + _cut(_mean_angle(edge_phase, rules))
    else:
        rough = TURN * place / abs(per_fringe)
        rough = rough + _cut(_mean_angle((map_.phase - rough)[valid], rules))
    turns = (rough - map_.phase) / TURN
    beside = rules.beside_edge_rad / TURN * (abs(per_fringe) == 1)
    clear = valid & (np.abs(turns - np.rint(turns)) < 0.5 - beside)
    cycle = max(2**bits // abs(per_fringe), 1)
    lower = np.where(valid, map_.phase + TURN * np.floor(turns), np.nan)
    return _orders(np.where(clear, map_.phase + TURN * np.rint(turns), np.nan), lower, map_, cycle, rules)


def _orders(clear: NDArray, lower: NDArray, map_: PhaseMap, cycle: int, rules: GrayRules) -> FringeOrders:
    """Let pixels beside the code's edges continue their neighbours, and count what stays open."""
    known = clear.astype(np.float32)
    slopes = _slopes(map_)
    rise = float(np.median(np.hypot(*slopes)[map_.valid])) if map_.valid.any() else 1.0
    reach = int(np.clip(np.ceil(rules.beside_edge_rad / max(rise, _NO_CHANGE_RAD)) + _BEYOND_PX, *_REACHES_PX))
    for _ in range(rules.rounds):
        known = order_kernels.continued(known, lower.astype(np.float32), slopes, reach)
    known[order_kernels.alone(known, TURN * cycle)] = np.nan
    count = max(int(map_.valid.sum()), 1)
    decided = np.isfinite(known)
    if decided.sum() < rules.least_decided * count:
        raise PhaseError(
            f"the Gray code decides the order of {decided.sum() / count:.0%} of the pixels only: check that it was "
            "taken of the same scene, the coarsest bit first, bright where the bit is 1"
        )
    asked = float((decided & np.isnan(clear)).sum() / count)
    undecided = float((map_.valid & ~decided).sum() / count)
    return FringeOrders(known, cycle, (), (), 0.0, asked, undecided, numbers_all=True)


def _slopes(map_: PhaseMap) -> NDArray[np.float32]:
    """Return how the phase rises along u and v around each pixel, (2, H, W), rad/px."""
    found = np.zeros((2, *map_.phase.shape), np.float32)
    for k, axis in enumerate((1, 0)):
        step = wrap(np.diff(map_.phase, axis=axis, append=np.nan))
        there = np.isfinite(step)
        total, count = (
            cv2.blur(part.astype(np.float32), (_AROUND_PX, _AROUND_PX)) for part in (np.where(there, step, 0.0), there)
        )
        found[k] = total / np.maximum(count, _LEAST_PART)
    return found


def _edges(code: NDArray, valid: NDArray[np.bool_], phase: NDArray, rules: GrayRules) -> NDArray:
    """Return the phase at steps of one of the code between neighbours."""
    phases = []
    for axis in (0, 1):
        first, second = (np.take(code, range(k, code.shape[axis] - 1 + k), axis) for k in (0, 1))
        here, there = (np.take(phase, range(k, code.shape[axis] - 1 + k), axis) for k in (0, 1))
        both = np.take(valid, range(code.shape[axis] - 1), axis) & np.take(valid, range(1, code.shape[axis]), axis)
        at = both & (np.abs(second - first) == 1)
        phases.append(here[at] + wrap(there[at] - here[at]) / 2)
    found = np.concatenate(phases)
    if found.size < rules.least_edges:
        raise PhaseError(
            f"the Gray code increases by one at {found.size} pixels only: check that its frames show the same scene, "
            "the coarsest bit first"
        )
    return found


def _numbers_per_fringe(code: NDArray, valid: NDArray[np.bool_], phase: NDArray, rules: GrayRules) -> int:
    """Return the code's numbers for each fringe, negative if it falls where the phase rises."""
    total = code_steps = 0.0
    for axis in (0, 1):
        both = np.take(valid, range(code.shape[axis] - 1), axis) & np.take(valid, range(1, code.shape[axis]), axis)
        change, step = wrap(np.diff(phase, axis=axis)), np.diff(code, axis=axis)
        small = both & (np.abs(step) <= 1)  # over an edge of the surface nothing is to be learned
        # Along the way in which the phase rises around: what noise adds at an edge one way it takes off the other.
        change = np.where(small, change, 0.0)
        way = np.sign(cv2.blur(change, (_AROUND_PX, _AROUND_PX)))
        total += float((change * way)[small].sum())
        code_steps += float((step * way)[small].sum())
    ratio, sign = TURN * abs(code_steps) / max(total, _NO_CHANGE_RAD), 1 if code_steps >= 0 else -1
    nearest = max(1, round(ratio))
    if not rules.numbers_from < ratio / nearest < rules.numbers_to:
        raise PhaseError(
            f"the Gray code has {ratio:.2f} numbers for each fringe; needed: one, or a whole number of them"
        )
    return sign * nearest


def _mean_angle(phase: NDArray, rules: GrayRules) -> float:
    """Return the mean direction of phases, rad.

    Raises
    ------
    PhaseError
        They have none: code and fringes do not belong together.
    """
    mean = np.mean(np.exp(1j * phase))
    if abs(mean) < rules.least_agreement:
        raise PhaseError(
            "the Gray code increases at any phase of the fringes: check that both were taken of one scene, and the "
            "order of the code's frames (the coarsest bit first)"
        )
    return float(np.angle(mean))


def _cut(angle: float) -> float:
    """Return an angle in (-3/2 pi, pi/2]: codes begin where the phase is 0, or where it jumps, and never at the cut."""
    return angle - TURN if angle > np.pi / 2 else angle
