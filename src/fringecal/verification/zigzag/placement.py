"""Which of the ridges are the target's, and where along them the bars end."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fringecal.errors import FitError
from fringecal.numerics import UNIFORM_SD
from fringecal.verification.zigzag.zigzag_shape import Floats, ZigzagShape, bar_number, zigzag_height

TOLERANCE = 0.15  # of full height: a pixel further off is an outlier. A rig read with one constant
# angle is off by 12 % at its edges and must still register; a wrong fringe order is off by more.
_PLATE_WEIGHT = 0.25  # of plate against bar when places compete: too few bars still find their place
_TELLING = 0.35  # of full height: above this the target's surface cannot be taken for the plate


@dataclass(frozen=True)
class _Counting:
    """How votes for the footprint's place are counted and judged.

    Parameters
    ----------
    bins_per_length, most_bins, least_bin_mm
        Bins along the ridges: a four-hundredth of the bars' length or, where the surface is far longer than they are,
        a two-thousandth of the surface's; the least only keeps a surface without extent from dividing by nothing.
    bar_tie
        Share of one bar's part of the best score within which two places across are equally good.
    along_tie
        Share of the best score within which two places along are: rounding, and the shadow's ragged end.
    bar
        Share of the typical bar's votes from which on a strip of the surface is a bar too many, or plate where a bar
        should be.
    seen
        Share of them from which on a bar counts as seen.
    misplaced
        Share of all the bars' votes that may lie beyond their stated length, or plate within it.
    """

    bins_per_length: int = 400
    most_bins: int = 2000
    least_bin_mm: float = 1e-6
    bar_tie: float = 0.02
    along_tie: float = 1e-3
    bar: float = 0.3
    seen: float = 0.1
    misplaced: float = 0.1


_COUNTING = _Counting()


@dataclass(frozen=True)
class Placement:
    """Shift of the footprint in whole bars and along the ridges, and the bars that support it."""

    bars: int
    along_mm: float
    u_along_mm: float
    bars_seen: int


@dataclass(frozen=True)
class _Votes:
    """Votes by bar and place along the ridges: +1 surface of a bar, -1 plate, 0 neither."""

    votes: Floats
    first_bar: int
    along_start: float
    bin_mm: float


def place_footprint(
    across: NDArray[np.floating], along: NDArray[np.floating], z: NDArray[np.floating], shape: ZigzagShape
) -> Placement:
    """Place the rectangle of `count` bars by `length_mm` where it holds most bar and least plate.

    Every pixel whose place on the endless zig-zag is well above the plate votes: on that surface
    +1, on the plate -1. Ends in shadow leave a plateau of equally good places; its middle is
    taken and its width becomes the uncertainty.

    Parameters
    ----------
    across, along, z
        (n,) coordinates and height above the seat, mm; `across` right but for whole bars.

    Raises
    ------
    FitError
        More or fewer bars than the target states.
    """
    counted = _count_votes(across, along, z, shape)
    window = max(1, round(shape.length_mm / counted.bin_mm))
    padded = np.pad(counted.votes, ((shape.count, shape.count), (window, window)))
    by_bar = _moving_sum(padded, window, axis=1)
    score = _moving_sum(np.where(by_bar < 0, _PLATE_WEIGHT * by_bar, by_bar), shape.count, axis=0)
    bar, place, half_width = _middle_of_best(score, shape.count)
    if not np.any(by_bar[bar : bar + shape.count, place] > 0):
        raise FitError(
            "no bars stand out of the plate where the flanks are; check that the capture shows the zig-zag "
            "and that heights count toward the camera"
        )
    seen = _check_bars(by_bar[:, place], bar, shape.count)
    _check_length(padded[bar : bar + shape.count], place, window, shape)
    along_mm = counted.along_start + (place - window + window / 2) * counted.bin_mm
    u_along = math.hypot(half_width / math.sqrt(3), UNIFORM_SD) * counted.bin_mm
    return Placement(counted.first_bar - shape.count + bar, along_mm, u_along, seen)


def _count_votes(
    across: NDArray[np.floating], along: NDArray[np.floating], z: NDArray[np.floating], shape: ZigzagShape
) -> _Votes:
    full = shape.height_mm
    target = zigzag_height(across, shape)
    telling = target > _TELLING * full
    vote = (np.abs(z - target) < TOLERANCE * full).astype(float) - (np.abs(z) < TOLERANCE * full)
    extent_mm = float(np.ptp(along))
    bin_mm = max(shape.length_mm / _COUNTING.bins_per_length, extent_mm / _COUNTING.most_bins, _COUNTING.least_bin_mm)
    number = bar_number(across[telling], shape)
    place = np.floor((along[telling] - along.min()) / bin_mm).astype(np.int64)
    if number.size == 0:
        raise FitError("no pixel of the surface lies where a flank could be; nothing to register")
    first = int(number.min())
    votes = np.zeros((int(number.max()) - first + 1, int(place.max()) + 1))
    np.add.at(votes, (number - first, place), vote[telling])
    return _Votes(votes, first, float(along.min()), bin_mm)


def _moving_sum(values: Floats, window: int, *, axis: int) -> Floats:
    summed = np.cumsum(np.insert(values, 0, 0.0, axis=axis), axis=axis)
    size = summed.shape[axis]
    return summed.take(range(window, size), axis=axis) - summed.take(range(size - window), axis=axis)


def _middle_of_best(score: Floats, count: int) -> tuple[int, int, float]:
    """Middle of the plateau of the best score: bar, place along, half its width in bins."""
    bars = np.flatnonzero(score.max(axis=1) >= score.max() - _COUNTING.bar_tie / count * abs(score.max()))
    bar = int(bars[len(bars) // 2])
    row = score[bar]
    best = int(np.argmax(row))
    lower = np.flatnonzero(row < row[best] - _COUNTING.along_tie * abs(row[best]))
    first = int(lower[lower < best].max(initial=-1)) + 1
    last = int(lower[lower > best].min(initial=row.size)) - 1
    return bar, (first + last) // 2, (last - first) / 2


def _check_bars(votes: Floats, bar: int, count: int) -> int:
    inside = votes[bar : bar + count]
    typical = float(np.median(inside[inside > 0]))
    enough = _COUNTING.bar * typical
    missing = int(np.sum(inside < -enough))
    extra = int(np.sum(votes > enough) - np.sum(inside > enough))
    if missing or extra:
        raise FitError(
            f"the surface shows {count - missing + extra} bars where the target states {count}; "
            "correct the target's count, or photograph the bars it describes with plate free around them"
        )
    return int(np.sum(inside > _COUNTING.seen * typical))


def _check_length(votes: Floats, place: int, window: int, shape: ZigzagShape) -> None:
    inside = votes[:, place : place + window]
    bar, plate = inside[inside > 0].sum(), -inside[inside < 0].sum()
    beyond = votes[votes > 0].sum() - bar
    if max(plate, beyond) > _COUNTING.misplaced * bar:
        raise FitError(
            f"the bars are {'longer' if beyond > plate else 'shorter'} than the {shape.length_mm:g} mm "
            "that the target states; correct the target's length"
        )
