"""Breaks of fringes at strips: where, by how much, and the angle that each shows by itself.

A break is one fringe on one strip: its place on the strip's top against the place of the same fringe on the plate,
carried across the strip from both sides.
"""

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fringecal.camera import PlateCamera
from fringecal.detect import Centres, StripRegions
from fringecal.numerics import robust_sd
from fringecal.projector.angle.projection_angle import across_fringe
from fringecal.projector.rig_model import RigModel
from fringecal.projector.sampling import OUTLIER_SDS

Array = NDArray[np.float64]
Index = NDArray[np.intp]

#: What a break's status says: used as it is; base from one side only; far off the others and left out.
OK, ONE_SIDE, OFF = "ok", "one-side", "off"
FAR, NOWHERE = -10_000, -20_000  # numbers of zones: below those of any plate between strips
_BLOCK_PX = 24  # length along a fringe over which its points are taken together on wide plate: about a strip's width
_LEAST_POINTS = 3  # centres of one fringe in one zone: fewer are specks, and say little of their scatter
_LEAST_SPREAD = 1e-9  # of tangents: drawn breaks without noise scatter by rounding alone; nothing is an outlier of that
_PIXEL_BESIDE = 1.1  # px from the middle of a strip or gap: one pixel on either side of it, however narrow
_APART_PX = 1.0  # along the fringe, over which two of its points must lie apart to give a slope


TOLERANCE_RAD = 1.3
"""By how much a centre's coarse phase may be off: bright and dark centres lie pi apart, pi/2 is as far as can be told,
and the rest is left for what belongs to neither."""


@dataclass(frozen=True)
class FringePoints:
    """Fringes' centres gathered by zone and fringe: one point each.

    Parameters
    ----------
    zone
        Number of the strip (1..) or, negative or 0, of the plate's zone: -k lies between strips k and k + 1; `FAR`
        is plate beside no strip.
    fringe
        Number of the fringe: whole for bright, half for dark.
    u_px, v_px, sigma_px
        Mean place in the picture, and its standard uncertainty across the fringe.
    number
        How many centres the point is the mean of.
    """

    zone: Index
    fringe: Array
    u_px: Array
    v_px: Array
    sigma_px: Array
    number: Index

    def take(self, chosen: NDArray[np.bool_]) -> "FringePoints":
        """Return a selection of the points."""
        return FringePoints(**{name: value[chosen] for name, value in vars(self).items()})

    @property
    def phase_rad(self) -> Array:
        """Phase of the points."""
        return 2 * np.pi * self.fringe


@dataclass(frozen=True)
class Breaks:
    """Breaks, one per fringe and strip; arrays of one length.

    Parameters
    ----------
    strip, fringe
        Number of the strip and of the fringe.
    u_px, v_px
        Where the fringe is on the strip.
    shift_px, sigma_px
        Shift of the fringe across itself in the picture (down, or to the right, is positive), and its standard
        uncertainty.
    shift_mm
        The shift as seen, on the plate, across the fringe, toward the lamp.
    tangent, apparent
        Tangents of the projection angle, and of the angle that the camera's own is part of.
    x_mm, y_mm
        Foot of the projector's ray on the plate.
    status
        "ok", "one-side" (the base is seen on one side only), "off" (left out of means).
    """

    strip: Index
    fringe: Array
    u_px: Array
    v_px: Array
    shift_px: Array
    sigma_px: Array
    shift_mm: Array
    tangent: Array
    apparent: Array
    x_mm: Array
    y_mm: Array
    status: NDArray[np.str_]

    @property
    def used(self) -> NDArray[np.bool_]:
        """Tell which breaks count."""
        return self.status != OFF

    @property
    def angle_deg(self) -> Array:
        """Projection angle that each break shows, from the plate's normal."""
        return np.degrees(np.arctan(self.tangent))

    def columns(self) -> dict[str, Any]:
        """Return the table, column by column, under names with units."""
        own = {name: value for name, value in vars(self).items() if name not in ("tangent", "apparent")}
        return own | {"angle_deg": self.angle_deg, "apparent_deg": np.degrees(np.arctan(self.apparent))}

    def without_outliers(self, expected: Array) -> "Breaks":
        """Mark breaks whose tangent is further off the expected than chance would have it (`OUTLIER_SDS`)."""
        off = self.tangent - expected
        far = np.abs(off - np.median(off)) > OUTLIER_SDS * max(robust_sd(off), _LEAST_SPREAD)
        return replace(self, status=np.where(far, OFF, self.status))


def zones_of(regions: StripRegions, *, middle: float = 1.0) -> NDArray[np.intp]:
    """Map each pixel's zone: its strip, the plate between two strips, or plate further off.

    With `middle` below 1 only that share of a strip's or gap's width counts, about its middle.
    """
    edges = regions.edges_px
    between = edges[1:, 0] - edges[:-1, 1]
    reach = float(np.median(between)) if between.size else float(np.ptp(edges))
    below = np.searchsorted(edges.mean(axis=1), regions.across_px)
    zone = -below.astype(np.intp)
    outside = (regions.across_px < edges[0, 0] - reach) | (regions.across_px > edges[-1, 1] + reach)
    zone[outside] = FAR
    zone[regions.labels > 0] = regions.labels[regions.labels > 0]
    zone[regions.labels < 0] = NOWHERE
    if middle < 1:
        zone[(zone != FAR) & ~_in_the_middle(regions, middle)] = NOWHERE
    return zone


def _in_the_middle(regions: StripRegions, share: float) -> NDArray[np.bool_]:
    """Find pixels near the middle of a strip or of a gap: at least one on either side of it."""
    edges = regions.edges_px
    gap = float(np.median(edges[1:, 0] - edges[:-1, 1])) if len(edges) > 1 else float(np.ptp(edges))
    lines = np.concatenate([[edges[0, 0] - gap], edges.ravel(), [edges[-1, 1] + gap]])
    centres, widths = (lines[1:] + lines[:-1]) / 2, np.diff(lines)
    index = np.clip(np.searchsorted(lines, regions.across_px) - 1, 0, centres.size - 1)
    off = np.abs(regions.across_px - centres[index])
    return np.asarray(off <= np.maximum(share * widths[index] / 2, _PIXEL_BESIDE))


def gather_centres(
    centres: Centres,
    phase_rad: Array,
    zones: NDArray[np.intp],
    *,
    independent_px: float,
    tolerance_rad: float = TOLERANCE_RAD,
) -> FringePoints:
    """Number centres by a coarse phase and take those of one fringe in one zone together.

    Parameters
    ----------
    centres
        Points of fringes that run along rows.
    phase_rad
        Map of the phase, coarse, absolute; NaN where there is none.
    zones
        Map of zones, see `FringePoints`; `NOWHERE` where pixels do not count.
    independent_px
        Length along a fringe over which the centres' errors are correlated.
    tolerance_rad
        A centre whose coarse phase is further off is no fringe's.
    """
    u = np.clip(np.rint(centres.u_px).astype(np.intp), 0, phase_rad.shape[1] - 1)
    v = np.clip(np.rint(centres.v_px).astype(np.intp), 0, phase_rad.shape[0] - 1)
    turns = phase_rad[v, u] / (2 * np.pi)
    half = np.where(centres.bright, 0.0, 0.5)
    with np.errstate(invalid="ignore"):
        fringe = np.rint(turns - half) + half
        good = (np.abs(turns - fringe) * 2 * np.pi < tolerance_rad) & (zones[v, u] != NOWHERE)
    u, fringe, zone = u[good], fringe[good], zones[v, u][good]
    keys = np.column_stack([zone, np.rint(2 * fringe).astype(np.intp), np.where(zone == FAR, u // _BLOCK_PX, 0)])
    unique, index, number = np.unique(keys, axis=0, return_inverse=True, return_counts=True)
    index = index.ravel()

    def mean(values: Array) -> Array:
        return np.bincount(index, weights=values) / number

    place = mean(centres.v_px[good])
    spread = np.sqrt(mean((centres.v_px[good] - place[index]) ** 2))
    sigma = np.maximum(mean(centres.sigma_px[good]), spread)
    points = FringePoints(
        unique[:, 0],
        unique[:, 1] / 2.0,
        mean(centres.u_px[good]),
        place,
        sigma / np.sqrt(np.maximum(number / independent_px, 1.0)),
        number,
    )
    return points.take(number >= _LEAST_POINTS)


@dataclass(frozen=True)
class PixelBreaks:
    """Breaks in pixels, of fringes that run along rows: strip and fringe, place, base, and whether both sides show."""

    strip: Index
    fringe: Array
    u_px: Array
    v_px: Array
    base_px: Array
    sigma_px: Array
    both: NDArray[np.bool_]


def breaks_of_points(points: FringePoints) -> PixelBreaks:
    """Compare each fringe on a strip with the same fringe on the plate at the strip's two sides.

    From both sides the base is carried across by a straight line; from one side it is carried along with the slope
    that the fringe has on the other strips.
    """
    gaps = np.flatnonzero((points.zone <= 0) & (points.zone != FAR))
    near = {(int(points.zone[i]), float(points.fringe[i])): int(i) for i in gaps}
    slope = _slope(points, near)
    rows = []
    for i in np.flatnonzero(points.zone > 0):
        strip, fringe = int(points.zone[i]), float(points.fringe[i])
        sides = [near[zone, fringe] for zone in (1 - strip, -strip) if (zone, fringe) in near]
        if sides:
            base, u_base = _carried(points, sides, float(points.u_px[i]), slope)
            sigma = math.hypot(float(points.sigma_px[i]), u_base)
            rows.append((strip, fringe, points.u_px[i], points.v_px[i], base, sigma, len(sides) == 2))
    table = np.array(rows, float).reshape(-1, 7).T
    return PixelBreaks(table[0].astype(np.intp), table[1], table[2], table[3], table[4], table[5], table[6] > 0)


def _carried(points: FringePoints, sides: list[int], u_px: float, slope: float) -> tuple[float, float]:
    """Return where a fringe lies at a column, from its points on one or two sides, and the standard uncertainty."""
    if len(sides) == 1:
        beside = sides[0]
        place = float(points.v_px[beside]) + slope * (u_px - float(points.u_px[beside]))
        return place, float(points.sigma_px[beside])
    sides = sorted(sides, key=lambda j: points.u_px[j])
    place = float(np.interp(u_px, points.u_px[sides], points.v_px[sides]))
    return place, float(np.hypot(*points.sigma_px[sides])) / 2


def _slope(points: FringePoints, near: dict[tuple[int, float], int]) -> float:
    """Usual slope of the fringes on the plate, from one zone to the next."""
    slopes = []
    for (zone, fringe), i in near.items():
        j = near.get((zone - 1, fringe))
        if j is not None and abs(points.u_px[j] - points.u_px[i]) > _APART_PX:
            slopes.append((points.v_px[j] - points.v_px[i]) / (points.u_px[j] - points.u_px[i]))
    return float(np.median(slopes)) if slopes else 0.0


def breaks_on_plate(
    found: PixelBreaks, model: RigModel, camera: PlateCamera, height_mm: Array, *, along: str = "rows"
) -> Breaks:
    """Turn breaks in pixels into angles, with the camera's rays and the strips' heights.

    Parameters
    ----------
    found
        Breaks; u and v as if the fringes ran along rows.
    model
        The rig: only the direction across its fringes counts.
    camera
        The camera on the plate.
    height_mm
        Height of each break's strip.
    along
        What the fringes run along in the picture; for "columns" u and v change places.

    Notes
    -----
    With X_s the point on the strip's top, X_b that on the plate, m the unit vector across the fringe toward the lamp:
    `tan(theta) = m . (X_s - X_b) / h`; the apparent one takes X_s as if it lay on the plate.
    """
    straight = along == "rows"
    top = camera.rays(*((found.u_px, found.v_px) if straight else (found.v_px, found.u_px)))
    base = camera.rays(*((found.u_px, found.base_px) if straight else (found.base_px, found.u_px)))
    mx, my = across_fringe(model, base.ax, base.ay)
    x, y = top.at(height_mm)
    true = mx * (x - base.ax) + my * (y - base.ay)
    seen = mx * (top.ax - base.ax) + my * (top.ay - base.ay)
    u, v = (found.u_px, found.v_px) if straight else (found.v_px, found.u_px)
    status = np.where(found.both, OK, ONE_SIDE).astype("<U8")
    return Breaks(
        found.strip, found.fringe, u, v, found.v_px - found.base_px, found.sigma_px, seen,
        true / height_mm, seen / height_mm, x - true * mx, y - true * my, status,
    )  # fmt: skip
