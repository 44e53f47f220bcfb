"""The plate's smooth phase in one picture that also shows strips: two levels that a comb distinguishes.

On bare plate and on strip tops the phase is smooth, with a step between the two. Which level is the plate's cannot be
seen in the phase alone: both are offered.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.polynomial import legendre
from numpy.typing import NDArray

from fringecal.errors import PhaseError
from fringecal.numerics import DRAW_SEED, by_powers, powers_up_to, products_up_to, wrap
from fringecal.phase.single_frame.line_carrier import LineCarrier

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

_DEGREE = (
    4  # of the polynomial over the picture: perspective and the distortion of a lens, as far as noise lets them be seen
)
_POINTS = 20_000  # pixels that are fitted, for fifteen coefficients
_LEAST_PIXELS = 1000  # with fringes: fewer do not show the plate beside the strips
_MODULATION_SHARE = 0.25  # of the picture's own, below which a pixel carries no fringes
_MODULATION_PERCENTILE = 75  # of the pixels' modulation, that is the picture's own: half of them may be dark
# Weights of robust fits: Tukey's biweight, cut at so many times the median absolute residual, or at least, rad.
_SLOPE_CUT, _LEAST_CUT_RAD = 6.0, 1e-4
_SLOPE_ROUNDS, _LEVEL_ROUNDS, _PLATE_ROUNDS = 6, 3, 4  # of robust fits: each takes the weights of the one before
_RIDGE = 1e-3  # added to normal equations whose weights sum to thousands: terms that few pixels tell stay near 0


@dataclass(frozen=True)
class LevelSearch:
    """How the two levels of phase, plate and strip tops, are distinguished and followed over the picture.

    Parameters
    ----------
    places
        Where, as shares of the picture across the fringes, they are first distinguished, in turn.
    reach_periods
        Half width of the region about such a place, in fringe periods: a few strips.
    growth
        Times by which the region widens at each step: the polynomial is continued by less than half of what it knows.
    least_pixels
        In the region, below which there is one level.
    directions, rounds
        Starts, evenly over half a turn, and iterations of the division into two levels.
    least_difference_rad
        Between the levels, rad; nearer ones are one level with noise.
    cut_share, cut_rad
        Residual from which a pixel is on the other level: this share of the step, within these limits, rad.
    plate_cut_rad
        The same where all pixels are known to be plate, rad.
    """

    places: tuple[float, ...] = (0.5, 0.3, 0.7)
    reach_periods: float = 2.5
    growth: float = 1.4
    least_pixels: int = 50
    directions: int = 12
    rounds: int = 8
    least_difference_rad: float = 0.4
    cut_share: float = 0.45
    cut_rad: tuple[float, float] = (0.25, 1.2)
    plate_cut_rad: float = 1.2


LEVEL_SEARCH = LevelSearch()


@dataclass(frozen=True)
class SmoothPhase:
    """A phase that is a polynomial over the picture: Legendre terms of total degree 4 over the box of the picture."""

    coefficients: Array
    shape: tuple[int, int]

    def at(self, u_px: Array, v_px: Array) -> Array:
        """Return the phase in rad at pixels."""
        s, t = _unit(u_px, v_px, self.shape)
        return np.asarray(legendre.legval2d(s, t, by_powers(self.coefficients, _DEGREE)))

    def map(self) -> Array:
        """Return the phase of all pixels, (H, W)."""
        u, v = np.meshgrid(np.arange(self.shape[1], dtype=float), np.arange(self.shape[0], dtype=float))
        return self.at(u, v)


def fringed(carrier: LineCarrier) -> Mask:
    """Tell which pixels carry fringes, a window's half inside the picture."""
    size = np.abs(carrier.signal)
    inside = np.zeros(size.shape, bool)
    rim = round(carrier.period_px)
    part = (slice(rim, -rim), slice(None)) if carrier.along == "rows" else (slice(None), slice(rim, -rim))
    inside[part] = True
    return inside & (size > _MODULATION_SHARE * float(np.percentile(size, _MODULATION_PERCENTILE)))


def plate_phases(
    carrier: LineCarrier, valid: Mask, *, search: LevelSearch = LEVEL_SEARCH, seed: int = DRAW_SEED
) -> Iterator[SmoothPhase]:
    """Offer the smooth phases that may be the plate's: both levels, as distinguished at several places.

    Parameters
    ----------
    carrier
        The demodulated picture.
    valid
        Pixels that carry fringes.
    search
        How the levels are distinguished.
    seed
        Of the draw of pixels that are fitted.

    Raises
    ------
    PhaseError
        Too few pixels carry fringes.
    """
    points = _Points.of(carrier, valid, seed)
    slopes = points.from_slopes(carrier)
    reach_px = search.reach_periods * carrier.period_px
    for place in search.places:
        near = np.abs(points.across - place * points.extent) < reach_px
        levels = _two_levels(points.signal[near] * np.exp(-1j * points.phase(slopes)[near]), search)
        for level in levels:
            start = slopes.copy()
            start[0] += level
            apart = abs(float(wrap(levels[0] - levels[-1])))
            limit = float(np.clip(search.cut_share * apart, *search.cut_rad))
            yield SmoothPhase(points.grown(start, place, limit, reach_px, search.growth), carrier.signal.shape)


def plate_phase_on(
    carrier: LineCarrier,
    plate: Mask,
    start: SmoothPhase,
    *,
    search: LevelSearch = LEVEL_SEARCH,
    seed: int = DRAW_SEED,
) -> SmoothPhase:
    """Fit the plate's phase anew to the pixels that are known to be plate."""
    points = _Points.of(carrier, plate, seed)
    coefficients = start.coefficients
    everywhere = np.ones(points.signal.size, bool)
    for _ in range(_PLATE_ROUNDS):
        coefficients = points.improved(coefficients, everywhere, _DEGREE, search.plate_cut_rad)
    return SmoothPhase(coefficients, start.shape)


@dataclass(frozen=True)
class _Points:
    """A draw of pixels: their signal of size 1 at most, design of the polynomial, place across the fringes."""

    u: NDArray[np.intp]
    v: NDArray[np.intp]
    signal: NDArray[np.complex128]
    design: Array
    across: NDArray[np.intp]
    extent: int

    @classmethod
    def of(cls, carrier: LineCarrier, valid: Mask, seed: int) -> "_Points":
        v, u = np.nonzero(valid)
        if v.size < _LEAST_PIXELS:
            raise PhaseError(f"only {v.size} pixels of the picture carry fringes: more light on the plate is needed")
        chosen = np.random.default_rng(seed).permutation(v.size)[:_POINTS]
        u, v = u[chosen], v[chosen]
        signal = carrier.signal[v, u] / np.abs(carrier.signal[v, u])
        s, t = _unit(u, v, carrier.signal.shape)
        across, extent = (v, valid.shape[0]) if carrier.along == "rows" else (u, valid.shape[1])
        return cls(u, v, signal, _design(s, t), across, extent)

    def phase(self, coefficients: Array) -> Array:
        return self.design @ coefficients

    def from_slopes(self, carrier: LineCarrier) -> Array:
        """Coefficients, but for the first, from the phase's differences to the next pixels; edges are outliers."""
        rows, right = [], []
        shape = carrier.signal.shape
        for du, dv in ((1, 0), (0, 1)):
            u, v = np.minimum(self.u + du, shape[1] - 1), np.minimum(self.v + dv, shape[0] - 1)
            rows.append(_design(*_unit(u, v, shape)) - self.design)
            right.append(np.angle(carrier.signal[v, u] * np.conj(self.signal)))
        design, slope = np.concatenate(rows)[:, 1:], np.concatenate(right)
        weights = np.ones(slope.size)
        for _ in range(_SLOPE_ROUNDS):
            root = np.sqrt(weights)
            solution = np.linalg.lstsq(design * root[:, None], slope * root, rcond=None)[0]
            left = slope - design @ solution
            weights = _tukey(left, max(_SLOPE_CUT * float(np.median(np.abs(left))), _LEAST_CUT_RAD))
        return np.concatenate([[0.0], solution])

    def grown(self, start: Array, place: float, limit_rad: float, reach_px: float, growth: float) -> Array:
        """Follow one level from a place over the whole picture, with more terms as the region grows."""
        coefficients, reach = start, reach_px
        while reach < 2 * self.extent:
            near = np.abs(self.across - place * self.extent) < reach
            degree = min(_DEGREE, 1 + int(_DEGREE * reach / self.extent))
            for _ in range(_LEVEL_ROUNDS):
                coefficients = self.improved(coefficients, near, degree, limit_rad)
            reach *= growth
        return coefficients

    def improved(self, coefficients: Array, near: Mask, degree: int, limit_rad: float) -> Array:
        """One step of a robust fit to the wrapped residuals of the pixels near."""
        count = len(powers_up_to(degree))  # terms are in the order of their degree
        design = self.design[near][:, :count]
        left = np.angle(self.signal[near] * np.exp(-1j * (self.design[near] @ coefficients)))
        weights = _tukey(left, limit_rad)
        normal = design.T @ (design * weights[:, None]) + _RIDGE * np.eye(design.shape[1])
        changed = coefficients.copy()
        changed[:count] += np.linalg.solve(normal, design.T @ (weights * left))
        return changed


def _two_levels(signal: NDArray[np.complex128], search: LevelSearch) -> tuple[float, ...]:
    """Return the two phases about which a signal gathers, or the one."""
    if signal.size < search.least_pixels:
        return (0.0,)
    angle = np.angle(signal)
    best: tuple[float, tuple[float, ...]] = (-1.0, ())
    for turn in np.linspace(0, np.pi, search.directions, endpoint=False):
        side = np.cos(angle - turn) > 0
        for _ in range(search.rounds):
            means = [signal[part].mean() if part.any() else 0j for part in (side, ~side)]
            side = np.abs(signal - means[0]) < np.abs(signal - means[1])
        gathered = float(sum(abs(m) * np.count_nonzero(p) for m, p in zip(means, (side, ~side), strict=True)))
        if gathered > best[0]:
            best = gathered, tuple(float(np.angle(m)) for m in means)
    one, other = best[1]
    if abs(wrap(one - other)) < search.least_difference_rad:
        return (float(np.angle(signal.mean())),)
    return one, other


def _tukey(residual: Array, limit: float) -> Array:
    """Tukey's biweight."""
    return np.clip(1 - (residual / limit) ** 2, 0, None) ** 2


def _design(s: Array, t: Array) -> Array:
    return products_up_to(legendre.legvander(s, _DEGREE), legendre.legvander(t, _DEGREE))


def _unit(u: NDArray, v: NDArray, shape: tuple[int, ...]) -> tuple[Array, Array]:
    return 2 * np.asarray(u, float) / (shape[1] - 1) - 1, 2 * np.asarray(v, float) / (shape[0] - 1) - 1
