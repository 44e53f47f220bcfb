"""Ridges, valleys and folds of a pleated surface, from its sections: where, how far apart, how deep, how sharp."""

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy import signal

from fringecal.errors import FitError
from fringecal.reconstruct import Section

Array = NDArray[np.float64]

_PROMINENCE = 0.2  # of the section's range of heights: smaller bumps are no folds
_RANGE = (0.02, 0.98)  # quantiles of the heights between which that range is taken: single wrong pixels lie outside
_NOISE_SIGMAS = 6.0  # standard deviations of a point's noise that a crest must rise at least: thousands of points, none
_SMOOTHED = 7  # points of a local parabola: less than a crest is wide
_CREST = 0.15  # a crest's parabola reaches so far toward its nearer neighbour: beyond it flanks are straight
_LEAST_REACH = 2  # points on either side: five for a parabola's three numbers
_RESAMPLED = 101  # places along a flank's straight part: closer than points
_FLANK = (0.25, 0.75)  # a flank's straight part, of the way from crest to crest


@dataclass(frozen=True)
class ValueU:
    """A value with its standard uncertainty, in the unit that its name says."""

    value: float
    u: float


@dataclass(frozen=True)
class Fold:
    """A ridge between two valleys, cut by a section.

    Parameters
    ----------
    x_mm, y_mm, z_mm
        Its crest.
    depth_mm
        Its height over the mean of both valleys.
    angle_deg
        Angle between both flanks, 180 for a flat sheet; each flank is the straight line through its middle half.
    spacing_mm, along_mm
        Distance to the next ridge, straight and along the surface; None for the last.
    """

    x_mm: ValueU
    y_mm: float
    z_mm: ValueU
    depth_mm: ValueU
    angle_deg: ValueU
    spacing_mm: ValueU | None
    along_mm: ValueU | None


def folds_of(section: Section) -> tuple[Fold, ...]:
    """Find the ridges of a section and measure their folds.

    Crests are the vertices of parabolas through the points near them, by least squares. What the noise of the points
    does to each is propagated through these fits; what a cause of the calibration does is found by measuring the same
    folds on the points that it moves.

    Parameters
    ----------
    section
        A section across the pleats.

    Raises
    ------
    FitError
        The section has no ridge between two valleys.
    """
    s, z = section.points_mm[:, 0], section.points_mm[:, 2]
    crests = _crests(s, z, least_mm=_NOISE_SIGMAS * float(np.median(section.u_random_mm)))
    ridges = [k for k in range(1, len(crests) - 1) if crests[k].upward]
    if not ridges:
        raise FitError(
            f"row {section.row_px}: no ridge between two valleys that rises over {_PROMINENCE:.0%} of the section's "
            "heights and its noise; choose rows that cross the pleats"
        )
    values = _measured(s, z, crests, ridges)
    variance = _noise(section, crests, ridges) ** 2
    for moved in section.moved_mm:
        variance += (_measured(moved[:, 0], moved[:, 2], crests, ridges) - values) ** 2
    y = np.interp(values[:, 0], s, section.points_mm[:, 1])
    return tuple(_fold(*row) for row in zip(values, np.sqrt(variance), y, strict=True))


def folds_table(folds: Mapping[int, tuple[Fold, ...]]) -> pd.DataFrame:
    """Tabulate the folds of several rows, from left to right; NaN where a row has no next ridge.

    Parameters
    ----------
    folds
        Folds by picture row.
    """
    rows = [
        {"row / px": row, "fold": number} | {f"{name} / {unit}": value for name, unit, value in _cells(fold)}
        for row, found in folds.items()
        for number, fold in enumerate(found, start=1)
    ]
    return pd.DataFrame(rows)


def _cells(fold: Fold) -> Iterator[tuple[str, str, float]]:
    yield "y", "mm", fold.y_mm
    for name in ("x_mm", "z_mm", "depth_mm", "angle_deg", "spacing_mm", "along_mm"):
        symbol, unit = name.split("_")
        found = getattr(fold, name) or ValueU(math.nan, math.nan)
        yield symbol, unit, found.value
        yield f"u({symbol})", unit, found.u


def _fold(values: Array, u: Array, y_mm: float) -> Fold:
    x, z, depth, angle, spacing, along = (
        ValueU(float(v), float(d)) if math.isfinite(v) else None for v, d in zip(values, u, strict=True)
    )
    assert x is not None
    assert z is not None
    assert depth is not None
    assert angle is not None
    return Fold(x, float(y_mm), z, depth, angle, spacing, along)


@dataclass(frozen=True)
class _Crest:
    """A ridge or valley: the points of its parabola, and the middle of that stretch."""

    upward: bool
    points: NDArray[np.intp]


def _crests(s: Array, z: Array, *, least_mm: float) -> list[_Crest]:
    """Find ridges and valleys by prominence, and the points through which each one's parabola goes."""
    smooth = _smoothed(z)
    least = max(least_mm, _PROMINENCE * float(np.ptp(np.quantile(smooth, _RANGE))))
    found = [
        (int(p), up) for up in (True, False) for p in signal.find_peaks(smooth if up else -smooth, prominence=least)[0]
    ]
    found.sort()
    gaps = np.full(len(found) + 1, np.inf)
    gaps[1:-1] = np.diff(s[[place for place, _ in found]]) if found else []
    near = np.minimum(gaps[:-1], gaps[1:])
    crests = []
    for (place, up), distance in zip(found, near, strict=True):
        reach = max(_LEAST_REACH, int(np.count_nonzero(np.abs(s - s[place]) <= _CREST * distance)) // 2)
        points = np.arange(max(0, place - reach), min(s.size, place + reach + 1))
        crests.append(_Crest(up, points))
    return crests


def _smoothed(z: Array) -> Array:
    """Local parabolas: noise falls to 0.6 of itself, and what is left of it is no crest by its prominence."""
    return np.asarray(signal.savgol_filter(z, min(_SMOOTHED, z.size - 1 + z.size % 2), 2))


def _vertex(s: Array, z: Array, crest: _Crest) -> tuple[float, float]:
    """Place and height of a crest, by a parabola through its points."""
    middle = s[crest.points].mean()
    c, b, a = np.polyfit(s[crest.points] - middle, z[crest.points], 2)
    at = -b / (2 * c)
    return middle + at, a + at * (b + at * c)


def _flank(s: Array, left: tuple[float, float], right: tuple[float, float]) -> NDArray[np.intp]:
    """Points of the straight part of a flank between two vertices."""
    low, high = (left[0] + share * (right[0] - left[0]) for share in _FLANK)
    points = np.flatnonzero((s >= low) & (s <= high))
    return points if points.size >= 2 else np.array([np.argmin(np.abs(s - left[0])), np.argmin(np.abs(s - right[0]))])


def _measured(s: Array, z: Array, crests: list[_Crest], ridges: list[int]) -> Array:
    """Return x, z, depth, angle, spacing, spacing along the surface of every ridge, (ridges, 6)."""
    vertices = [_vertex(s, z, crest) for crest in crests]
    rows = []
    for number, k in enumerate(ridges):
        (x, top), left, right = vertices[k], vertices[k - 1], vertices[k + 1]
        slopes = [_slope(s, z, vertices[k - 1], vertices[k]), _slope(s, z, vertices[k], vertices[k + 1])]
        angle = 180 - math.degrees(math.atan(slopes[0]) - math.atan(slopes[1]))
        following = vertices[ridges[number + 1]] if number + 1 < len(ridges) else (math.nan, math.nan)
        depth = top - (left[1] + right[1]) / 2
        rows.append([x, top, depth, angle, following[0] - x, _arc(s, z, x, following[0])])
    return np.array(rows)


def _slope(s: Array, z: Array, left: tuple[float, float], right: tuple[float, float]) -> float:
    """Slope of the straight line through a flank's middle half, resampled so that its ends fall between points."""
    share = np.linspace(*_FLANK, _RESAMPLED)
    places = left[0] + share * (right[0] - left[0])
    return float(np.polyfit(places - places.mean(), np.interp(places, s, z), 1)[0])


def _arc(s: Array, z: Array, start: float, end: float) -> float:
    """Length along the smoothed section between two places; NaN without an end."""
    if not math.isfinite(end):
        return math.nan
    inside = (s > start) & (s < end)
    places = np.concatenate([[start], s[inside], [end]])
    heights = np.interp(places, s, _smoothed(z))
    return float(np.hypot(np.diff(places), np.diff(heights)).sum())


def _noise(section: Section, crests: list[_Crest], ridges: list[int]) -> Array:
    """Return what the points' noise does to the quantities of `_measured`, first order."""
    s, z, u = section.points_mm[:, 0], section.points_mm[:, 2], section.u_random_mm
    vertices = [_vertex(s, z, crest) for crest in crests]
    u_x, u_z = np.array([_vertex_noise(s, z, u, crest) for crest in crests]).T
    rows = []
    for number, k in enumerate(ridges):
        angles = [_slope_noise(s, z, u, vertices[k - 1 + side], vertices[k + side]) for side in (0, 1)]
        spacing = math.hypot(u_x[k], u_x[ridges[number + 1]]) if number + 1 < len(ridges) else math.nan
        depth = math.sqrt(u_z[k] ** 2 + (u_z[k - 1] ** 2 + u_z[k + 1] ** 2) / 4)
        rows.append([u_x[k], u_z[k], depth, math.degrees(math.hypot(*angles)), spacing, spacing])
    return np.array(rows)


def _vertex_noise(s: Array, z: Array, u: Array, crest: _Crest) -> tuple[float, float]:
    """Standard uncertainty of a vertex's place and height."""
    t = s[crest.points] - s[crest.points].mean()
    design = np.stack([np.ones_like(t), t, t**2], axis=1)
    solve = np.linalg.pinv(design)
    covariance = (solve * u[crest.points] ** 2) @ solve.T
    _, b, c = solve @ z[crest.points]
    at = -b / (2 * c)
    place = np.array([0.0, -1 / (2 * c), b / (2 * c**2)])
    height = np.array([1.0, at, at**2])
    return math.sqrt(place @ covariance @ place), math.sqrt(height @ covariance @ height)


def _slope_noise(s: Array, z: Array, u: Array, left: tuple[float, float], right: tuple[float, float]) -> float:
    """Standard uncertainty of a flank's angle, rad."""
    points = _flank(s, left, right)
    t = s[points] - s[points].mean()
    slope = float(t @ z[points] / (t @ t))
    return float(np.sqrt(np.sum((t * u[points]) ** 2)) / (t @ t) / (1 + slope**2))
