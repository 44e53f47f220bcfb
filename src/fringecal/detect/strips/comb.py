"""Lay a comb of known teeth over a picture: direction, place and pitch at which teeth and gaps differ most.

The criterion is the sum of squares between two classes, teeth and everything else: the best least-squares
description of the picture by two levels.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fringecal.errors import DetectionError
from fringecal.numerics import DRAW_SEED

Array = NDArray[np.float64]

LEAST_CONTRAST = 0.12
"""Share of unchanged phase by which plate and strips must differ: below, noise would pass for strips; above, strips
that noise nearly hides would be refused."""

# Factors of size, up and down, with which a wrong pitch is looked for, and how many: twice as large is not told from
# every other strip; steps of 0.6 %.
_MOST_SIZE, _SIZES = 1.6, 161
_FAR_BETTER = 1.5  # times the explained sum of squares, from which another size is believed
_LEAST_OVERLAP = 0.5  # of the comb, or all of the picture, that must lie over one another
_SAME_PX = 0.5  # within which a comb is the same turned round
_UPRIGHT_RAD = 1e-9  # rounding of a direction of 135 deg


@dataclass(frozen=True)
class CombSearch:
    """How finely a comb is sought. A comb's *least* is the narrowest of its teeth and gaps, px.

    Parameters
    ----------
    sample, fine_sample
        Pixels looked at while the comb is turned, and while its place is refined.
    turn
        Step of the direction as a share of that by which one end of the picture moves by `least`: between two steps
        a tooth loses a third of its width.
    profile_bins, coarse_bins, fine_bins, finest_bins
        Bins over `least` of the profile across: while directions are compared, the comb is turned, refined, and
        refined once more.
    finest_px
        Narrowest bin, px: the raster of pixels shows in narrower ones.
    directions
        Best directions in which the comb is laid.
    stretch
        Share by which the gaps as laid may differ from the target's: an oblique view, a lens.
    coarse_stretches, fine_stretches, finest_stretches
        Steps of the stretch that are tried in the three rounds.
    angles
        Steps of the direction in the second and the third round.
    finest_turn
        Range of the third round as a share of the second's.
    """

    sample: int = 24_000
    fine_sample: int = 120_000
    turn: float = 0.35
    profile_bins: int = 5
    coarse_bins: int = 6
    fine_bins: int = 10
    finest_bins: int = 24
    finest_px: float = 0.25
    directions: int = 10
    stretch: float = 0.035
    coarse_stretches: int = 3
    fine_stretches: int = 9
    finest_stretches: int = 15
    angles: int = 9
    finest_turn: float = 0.25

    def stretches(self, number: int) -> Array:
        """Return so many factors by which a comb is stretched."""
        return 1 + np.linspace(-self.stretch, self.stretch, number)


COMB_SEARCH = CombSearch()


@dataclass(frozen=True)
class EdgeSearch:
    """How the edge of a tooth is measured, on the slope of the likeness across it.

    Parameters
    ----------
    bin_px
        Bins of the profile across, px.
    smoothing
        Bins of the Hann window that it is smoothed with.
    strong_quantile
        Quantile of the slopes' size that stands for a strong edge.
    least_slope
        Share of a strong edge's slope below which there is no edge, and it stays where the comb puts it.
    core
        Share of the edge's own largest slope below which a bin does not count for its middle.
    """

    bin_px: float = 0.5
    smoothing: int = 7
    strong_quantile: float = 0.98
    least_slope: float = 0.15
    core: float = 0.3


EDGE_SEARCH = EdgeSearch()


@dataclass(frozen=True)
class Pixels:
    """Pixels with their coordinates and how much they look like bare plate (0..1)."""

    u_px: Array
    v_px: Array
    likeness: Array

    def across(self, direction_rad: float) -> Array:
        """Coordinate along a direction."""
        return self.u_px * math.cos(direction_rad) + self.v_px * math.sin(direction_rad)

    def sample(self, number: int, *, seed: int = DRAW_SEED) -> "Pixels":
        """Return so many pixels drawn at random: a stride would beat with the strips."""
        if self.likeness.size <= number:
            return self
        chosen = np.random.default_rng(seed).choice(self.likeness.size, number, replace=False)
        return Pixels(self.u_px[chosen], self.v_px[chosen], self.likeness[chosen])


@dataclass(frozen=True)
class Comb:
    """A comb laid on a picture: direction across its teeth, and the teeth's edges, shape (count, 2)."""

    direction_rad: float
    edges_px: Array
    contrast: float


@dataclass(frozen=True)
class _Profile:
    """Sums of likeness and of pixels over lines, cumulated, in bins of `bin_px` from `start_px`."""

    start_px: float
    bin_px: float
    total: Array
    number: Array

    @classmethod
    def of(cls, across: Array, likeness: Array, bin_px: float) -> "_Profile":
        start = float(across.min())
        index = ((across - start) / bin_px).astype(np.intp)
        number = np.bincount(index).astype(float)
        total = np.bincount(index, weights=likeness)
        return cls(
            start,
            bin_px,
            np.concatenate([[0.0], np.cumsum(total)]),
            np.concatenate([[0.0], np.cumsum(number)]),
        )

    def between_bins(self) -> float:
        """Sum of squares that the lines' means explain."""
        total, number = np.diff(self.total), np.diff(self.number)
        means = total[number > 0] ** 2 / number[number > 0]
        return float(means.sum() - self.total[-1] ** 2 / self.number[-1])

    def split(self, low_px: Array, high_px: Array) -> tuple[Array, Array]:
        """Return pixels and likeness inside the zones, summed over the last axis."""
        last = self.number.size - 1
        low = np.clip(np.rint((low_px - self.start_px) / self.bin_px), 0, last).astype(np.intp)
        high = np.clip(np.rint((high_px - self.start_px) / self.bin_px), 0, last).astype(np.intp)
        number = (self.number[high] - self.number[low]).sum(axis=-1)
        return number, (self.total[high] - self.total[low]).sum(axis=-1)

    def places(self, layout: Array) -> tuple[Array, Array, Array]:
        """Score every place of a comb: place in px, sum of squares between the classes, contrast."""
        length = float(layout[-1, 1])
        extent = (self.number.size - 1) * self.bin_px
        spare = _LEAST_OVERLAP * min(length, extent)
        place = np.arange(self.start_px - length + spare, self.start_px + extent - spare + self.bin_px, self.bin_px)
        edges = place[:, None, None] + layout[None]
        inside, plate = self.split(edges[..., 0], edges[..., 1])
        outside = self.number[-1] - inside
        contrast = (self.total[-1] - plate) / np.maximum(outside, 1) - plate / np.maximum(inside, 1)
        score = inside * outside / self.number[-1] * contrast**2
        return place, np.where(contrast > 0, score, -1.0), contrast


def find_comb(pixels: Pixels, layout: Array, least_px: float, *, search: CombSearch = COMB_SEARCH) -> Comb:
    """Find direction, place and pitch of a comb whose teeth are not plate.

    Parameters
    ----------
    pixels
        The picture.
    layout
        Edges of the teeth in px, the first at 0, shape (count, 2).
    least_px
        Narrowest tooth or gap, in px.
    search
        How finely.

    Raises
    ------
    DetectionError
        Nothing that differs from plate, or nothing like the comb.
    """
    few = pixels.sample(search.sample)
    reach = max(float(np.ptp(few.u_px)), float(np.ptp(few.v_px)), 1.0)
    turn = search.turn * least_px / reach
    layouts = _both_ways(layout)
    best = max(
        (
            _best_place(few, d, shape, least_px / search.coarse_bins, search.stretches(search.coarse_stretches))
            for d in _directions(few, turn, least_px, search)
            for shape in layouts
        ),
        key=lambda found: found[0],
    )
    many = pixels.sample(search.fine_sample)
    direction, shape = best[1], best[4]
    finest_px = max(least_px / search.finest_bins, search.finest_px)
    for half, bin_px, number in (
        (turn, least_px / search.fine_bins, search.fine_stretches),
        (search.finest_turn * turn, finest_px, search.finest_stretches),
    ):
        angles = direction + np.linspace(-half, half, search.angles)
        stretches = search.stretches(number)
        best = max((_best_place(many, a, shape, bin_px, stretches) for a in angles), key=lambda found: found[0])
        direction = best[1]
    _, direction, place, stretch, shape, contrast = best
    if contrast < LEAST_CONTRAST:
        raise DetectionError(
            f"no strips show in the phase: between where {len(layout)} strips would fit best and the rest the share of "
            f"unchanged phase differs by {contrast:.2f}, at least {LEAST_CONTRAST} is needed. Either strips and "
            "reference are the same pictures, or projector or plate moved between them, or the fringes do not cross "
            "the strips, or the fringe shift is a whole number of fringes everywhere (then change the fringe pitch)."
        )
    return _normal(Comb(direction, place + stretch * shape, contrast))


def better_size(
    pixels: Pixels, comb: Comb, layout: Array, least_px: float, *, search: CombSearch = COMB_SEARCH
) -> float:
    """Return by which factor a comb of another size fits far better along the same direction, 1 where none does.

    Parameters
    ----------
    pixels
        The picture.
    comb
        The comb as found.
    layout
        Edges of its teeth as expected, px, shape (count, 2).
    least_px
        Narrowest tooth or gap as expected, px.
    search
        How finely.
    """
    few = pixels.sample(search.sample)
    profile = _Profile.of(few.across(comb.direction_rad), few.likeness, least_px / (2 * search.coarse_bins))
    sizes = np.geomspace(1 / _MOST_SIZE, _MOST_SIZE, _SIZES)
    scores = np.array([max(profile.places(shape * size)[1].max() for shape in _both_ways(layout)) for size in sizes])
    near = np.abs(np.log(sizes)) <= math.log(1 + 1.5 * search.stretch)  # and a little more
    best = int(np.argmax(scores))
    return float(sizes[best]) if scores[best] > _FAR_BETTER * scores[near].max() else 1.0


def _normal(comb: Comb) -> Comb:
    """Bring the direction into (-45, 135] deg by turning the coordinate round, teeth in rising order."""
    direction, edges = comb.direction_rad % (2 * math.pi), comb.edges_px
    if not (direction <= 0.75 * math.pi + _UPRIGHT_RAD or direction > 1.75 * math.pi):
        direction, edges = direction - math.pi, -edges[::-1, ::-1]
    if direction > math.pi:
        direction -= 2 * math.pi
    return Comb(direction, edges, comb.contrast)


def _both_ways(layout: Array) -> list[Array]:
    turned = layout[-1, 1] - layout[::-1, ::-1]
    return [layout] if np.allclose(turned, layout, atol=_SAME_PX) else [layout, turned]


def _directions(pixels: Pixels, turn: float, least_px: float, search: CombSearch) -> list[float]:
    """Return the directions in which lines differ most from each other, one per peak."""
    angles = np.arange(0, math.pi, turn)
    bin_px = least_px / search.profile_bins
    scores = np.array([_Profile.of(pixels.across(a), pixels.likeness, bin_px).between_bins() for a in angles])
    peaks = (scores >= np.roll(scores, 1)) & (scores >= np.roll(scores, -1))
    order = np.flatnonzero(peaks)[np.argsort(-scores[peaks])][: search.directions]
    # The comb is finer than the peak is wide: its neighbours are tried as well.
    return [float(a) for i in order for a in (angles[i] - 0.5 * turn, angles[i], angles[i] + 0.5 * turn)]


def _best_place(
    pixels: Pixels, direction: float, layout: Array, bin_px: float, stretches: Array
) -> tuple[float, float, float, float, Array, float]:
    """Return score, direction, place, stretch, layout and contrast of the best place for one direction."""
    profile = _Profile.of(pixels.across(direction), pixels.likeness, bin_px)
    best = (-math.inf, direction, 0.0, 1.0, layout, 0.0)
    for stretch in stretches:
        place, score, contrast = profile.places(layout * stretch)
        i = int(np.argmax(score))
        if score[i] > best[0]:
            best = (float(score[i]), direction, float(place[i]), float(stretch), layout, float(contrast[i]))
    return best


def refined_edges(pixels: Pixels, comb: Comb, reach_px: float, *, search: EdgeSearch = EDGE_SEARCH) -> Array:
    """Move each edge to where the likeness changes; edges without a change stay where the comb puts them."""
    bin_px = search.bin_px
    across = pixels.across(comb.direction_rad)
    start = float(across.min())
    index = ((across - start) / bin_px).astype(np.intp)
    number = np.bincount(index)
    mean = np.bincount(index, weights=pixels.likeness) / np.maximum(number, 1)
    kernel = np.hanning(search.smoothing)[1:-1] / np.hanning(search.smoothing).sum()
    slope = np.gradient(np.convolve(np.where(number > 0, mean, np.nan), kernel, mode="same"))
    slope = np.nan_to_num(slope)
    strongest = float(np.quantile(np.abs(slope), search.strong_quantile))
    edges = comb.edges_px.copy()
    for (tooth, side), edge in np.ndenumerate(comb.edges_px):
        centre = (edge - start) / bin_px
        low, high = (int(np.clip(centre + s * reach_px / bin_px, 0, slope.size)) for s in (-1, 1))
        weights = np.clip(slope[low:high] * (1 if side else -1), 0, None)
        if weights.size and weights.max() > search.least_slope * strongest > 0:
            weights = np.where(weights > search.core * weights.max(), weights, 0)
            edges[tooth, side] = start + bin_px * (float(np.sum(np.arange(low, high) * weights) / weights.sum()) + 0.5)
    return edges
