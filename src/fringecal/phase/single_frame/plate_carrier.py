"""The plate's smooth phase in one picture that also shows strips: two levels that a comb tells apart.

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

_DEGREE = 4
_POINTS = 20_000
_SEEDS = (0.5, 0.3, 0.7)  # where, across the fringes, the two levels are first told apart
_LEAST_STEP_RAD = 0.4  # between the levels at a seed; nearer ones are one level with noise
_MODULATION_SHARE = 0.25  # of the picture's own, below which a pixel carries no fringes


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
    return inside & (size > _MODULATION_SHARE * float(np.percentile(size, 75)))


def plate_phases(carrier: LineCarrier, valid: Mask, *, seed: int = DRAW_SEED) -> Iterator[SmoothPhase]:
    """Offer the smooth phases that may be the plate's: both levels, as told apart at several places.

    Parameters
    ----------
    carrier
        The demodulated picture.
    valid
        Pixels that carry fringes.
    seed
        Of the draw of pixels that are fitted.

    Raises
    ------
    PhaseError
        Too few pixels carry fringes.
    """
    points = _Points.of(carrier, valid, seed)
    slopes = points.from_slopes(carrier)
    for place in _SEEDS:
        near = np.abs(points.across - place * points.extent) < 2.5 * carrier.period_px
        levels = _two_levels(points.signal[near] * np.exp(-1j * points.phase(slopes)[near]))
        for level in levels:
            start = slopes.copy()
            start[0] += level
            apart = abs(float(wrap(levels[0] - levels[-1])))
            yield SmoothPhase(points.grown(start, place, apart, carrier.period_px), carrier.signal.shape)


def plate_phase_on(carrier: LineCarrier, plate: Mask, start: SmoothPhase, *, seed: int = DRAW_SEED) -> SmoothPhase:
    """Fit the plate's phase anew to the pixels that are known to be plate."""
    points = _Points.of(carrier, plate, seed)
    coefficients = start.coefficients
    for _ in range(4):
        coefficients = points.improved(coefficients, np.ones(points.signal.size, bool), _DEGREE, 1.2)
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
        if v.size < 1000:
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
        for _ in range(6):
            root = np.sqrt(weights)
            solution = np.linalg.lstsq(design * root[:, None], slope * root, rcond=None)[0]
            left = slope - design @ solution
            weights = _tukey(left, max(6 * float(np.median(np.abs(left))), 1e-4))
        return np.concatenate([[0.0], solution])

    def grown(self, start: Array, place: float, apart_rad: float, period_px: float) -> Array:
        """Follow one level from a seed over the whole picture, with more terms as the region grows."""
        limit = float(np.clip(0.45 * apart_rad, 0.25, 1.2))
        coefficients, reach = start, 2.5 * period_px
        while reach < 2 * self.extent:
            near = np.abs(self.across - place * self.extent) < reach
            degree = min(_DEGREE, 1 + int(4 * reach / self.extent))
            for _ in range(3):
                coefficients = self.improved(coefficients, near, degree, limit)
            reach *= 1.4
        return coefficients

    def improved(self, coefficients: Array, near: Mask, degree: int, limit_rad: float) -> Array:
        """One step of a robust fit to the wrapped residuals of the pixels near."""
        count = len(powers_up_to(degree))  # terms are in the order of their degree
        design = self.design[near][:, :count]
        left = np.angle(self.signal[near] * np.exp(-1j * (self.design[near] @ coefficients)))
        weights = _tukey(left, limit_rad)
        normal = design.T @ (design * weights[:, None]) + 1e-3 * np.eye(design.shape[1])
        changed = coefficients.copy()
        changed[:count] += np.linalg.solve(normal, design.T @ (weights * left))
        return changed


def _two_levels(signal: NDArray[np.complex128]) -> tuple[float, ...]:
    """Return the two phases about which a signal gathers, or the one."""
    if signal.size < 50:
        return (0.0,)
    angle = np.angle(signal)
    best: tuple[float, tuple[float, ...]] = (-1.0, ())
    for turn in np.linspace(0, np.pi, 12, endpoint=False):
        side = np.cos(angle - turn) > 0
        for _ in range(8):
            means = [signal[part].mean() if part.any() else 0j for part in (side, ~side)]
            side = np.abs(signal - means[0]) < np.abs(signal - means[1])
        gathered = float(sum(abs(m) * np.count_nonzero(p) for m, p in zip(means, (side, ~side), strict=True)))
        if gathered > best[0]:
            best = gathered, tuple(float(np.angle(m)) for m in means)
    one, other = best[1]
    if abs(wrap(one - other)) < _LEAST_STEP_RAD:
        return (float(np.angle(signal.mean())),)
    return one, other


def _tukey(residual: Array, limit: float) -> Array:
    """Tukey's biweight."""
    return np.clip(1 - (residual / limit) ** 2, 0, None) ** 2


def _design(s: Array, t: Array) -> Array:
    return products_up_to(legendre.legvander(s, _DEGREE), legendre.legvander(t, _DEGREE))


def _unit(u: NDArray, v: NDArray, shape: tuple[int, ...]) -> tuple[Array, Array]:
    return 2 * np.asarray(u, float) / (shape[1] - 1) - 1, 2 * np.asarray(v, float) / (shape[0] - 1) - 1
