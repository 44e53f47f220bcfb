"""Angle bars found in a measured surface: position and direction, and never a scale."""

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from fringecal.errors import FitError
from fringecal.numerics import robust_sd
from fringecal.targets import Zigzag
from fringecal.verification.forms.block_planes import Facets, fit_facets
from fringecal.verification.zigzag.placement import TOLERANCE, place_footprint
from fringecal.verification.zigzag.pose import ZigzagPose
from fringecal.verification.zigzag.zigzag_shape import (
    Floats,
    Surface,
    ZigzagShape,
    edge_distance,
    ridge_offset,
    zigzag_height,
    zigzag_shape,
)

SEATINGS = ("on-plate", "free")
_MAX_PIXELS = 60_000  # in a fit: more do not change the pose, whose uncertainty is systematic
_MAX_POINTS = 500_000  # that vote for the footprint: some thousand on every bin of it
_LEAST_PIXELS = 500  # valid ones: fewer are no surface that a shape could be found in
_MAX_CENTRES = 300  # facets' middles for the first place: it has to be right within a part of a bar only
_GOLDEN = (math.sqrt(5) - 1) / 2
_ROTATION_DOF = 2  # of a pose that only lies on the plate: place across, and rotation


@dataclass(frozen=True)
class _FlankSearch:
    """How the flanks' direction and angle are found among facets of the surface.

    Parameters
    ----------
    block_px, least_block_px, unknown_block_px
        Pixels along a side of a facet: eight are enough for a plane, four the least; six where no two neighbours are
        valid, so that nobody knows the size of a pixel.
    blocks_per_base
        Facets along the base of a bar: a third of a flank each, so that some lie wholly on it in whatever direction.
    window_rad
        Facets this near the target's flank angle count as flanks.
    angle_limit_rad
        By which their median may be off; a height scale wrong by 10 % turns a 45 deg flank by 2.7 deg.
    flat_rad
        What is less steep is plate, or a block across a ridge.
    plane_share
        Of full height: a block that departs more from its plane holds an edge.
    bins, heading_windows_rad
        Directions that are voted on, 3 deg each, and how near the winner a facet must lie, first and then.
    least_facets
        Of one direction: a few agree by chance.
    least_agreeing
        Share of the steep facets that must be flanks, and of these that must agree on the direction; an object that is
        no zig-zag has its slopes in all directions.
    """

    block_px: int = 8
    least_block_px: int = 4
    unknown_block_px: int = 6
    blocks_per_base: int = 6
    window_rad: float = math.radians(12)
    angle_limit_rad: float = math.radians(4)
    flat_rad: float = math.radians(10)
    plane_share: float = 0.03
    bins: int = 60
    heading_windows_rad: tuple[float, ...] = (math.radians(12), math.radians(6))
    least_facets: int = 8
    least_agreeing: float = 0.4


@dataclass(frozen=True)
class _PeriodSearch:
    """How bars of the right angle and another size are found out.

    Parameters
    ----------
    smallest, largest, sizes
        Periods tried, over the stated one: in steps of 2 %.
    shifts
        Over one period: an eighteenth of a flank apart, over which heights differ by a fifth of the cap.
    cap
        Of full height: a facet that is further off says no more than that it is.
    least_change
        Of the period, below which the lateral scale may be at fault and is not judged here.
    better
        Share of the stated period's residual that another one must stay below.
    """

    smallest: float = 0.7
    largest: float = 1.4
    sizes: int = 36
    shifts: int = 36
    cap: float = 0.3
    least_change: float = 0.04
    better: float = 0.5


@dataclass(frozen=True)
class _Refinement:
    """How the pose is fitted to the flanks.

    Parameters
    ----------
    edge_share, end_share
        Left out: so much of a bar's base about ridges and valleys, and what is further from the middle than so much
        of its length.
    tukey
        Robust standard deviations at which Tukey's weight vanishes: 95 % efficient for normal residuals (P. W. Holland,
        R. E. Welsch, Commun. Stat. A 6 (1977) 813).
    least_scale
        Of full height: heights drawn without noise scatter by rounding alone.
    worst_condition
        Of the scaled normal matrix: beyond it six of float64's sixteen digits are left.
    rounds, settled_across, settled_rad
        At most, and until a step is as small: of a bar's base, and rad.
    least_inliers
        Share of the flanks' pixels that must lie near the target's surface.
    """

    edge_share: float = 0.06
    end_share: float = 0.48
    tukey: float = 4.685
    least_scale: float = 1e-6
    worst_condition: float = 1e10
    rounds: int = 12
    settled_across: float = 1e-7
    settled_rad: float = 1e-9
    least_inliers: float = 0.7


_FLANKS, _PERIOD, _REFINEMENT = _FlankSearch(), _PeriodSearch(), _Refinement()


@dataclass(frozen=True)
class _Points:
    x: Floats
    y: Floats
    z: Floats

    def where(self, chosen: NDArray[np.bool_]) -> "_Points":
        """Points chosen."""
        return _Points(self.x[chosen], self.y[chosen], self.z[chosen])

    def thinned(self, most: int) -> "_Points":
        """At most so many points, by golden steps: an even stride could fall in step with the columns."""
        if self.z.size <= most:
            return self
        index = np.floor(np.arange(most) * _GOLDEN % 1.0 * self.z.size).astype(np.int64)
        return _Points(self.x[index], self.y[index], self.z[index])


def register_zigzag(
    surface: Surface, target: Zigzag | ZigzagShape, *, seating: str = "on-plate", start: ZigzagPose | None = None
) -> ZigzagPose:
    """Find the bars of a zig-zag target in a measured surface.

    Facets give the direction, the target's period the place across, the plate beside the bars
    and their ends the count and the place along; a Tukey-weighted fit to the flanks refines.
    Size and shape are never fitted, so that an error of scale stays in the heights.

    Parameters
    ----------
    surface
        Height map with maps x, y, z in mm and mask, each (H, W).
    target
        Zig-zag target, or its `ZigzagShape`.
    seating
        "on-plate": the bars stand on z = 0, and a mean error of height stays an error. "free":
        height and two tilts of the seat are fitted and reported as well.
    start
        Where the bars lie to within a fifth of a bar, where that is known: facets need not be searched then.

    Raises
    ------
    FitError
        The surface is no zig-zag, or one of another period, apex or number of bars.
    """
    if seating not in SEATINGS:
        raise ValueError(f"seating {seating!r} is not one of {SEATINGS}")
    shape = target if isinstance(target, ZigzagShape) else zigzag_shape(target)
    valid = _usable(surface)
    maps = (surface.x, surface.y, surface.z)
    points = _Points(*(np.asarray(m, float)[valid] for m in maps)).thinned(_MAX_POINTS)
    pose = _searched(surface, valid, shape) if start is None else start
    for free in (False, seating == "free"):
        pose = _placed(pose, points, shape)
        flank_points = points.where(_flank_points(pose, points, shape)).thinned(_MAX_PIXELS)
        pose = _refined(pose, flank_points, shape, free=free)
    return _judged(_placed(pose, points, shape), points, shape)


def _searched(surface: Surface, valid: NDArray[np.bool_], shape: ZigzagShape) -> ZigzagPose:
    """Find the flanks' direction and place among facets of the surface."""
    side = _block_px(surface, valid, shape)
    thin = slice(None, None, max(1, side // _FLANKS.block_px))  # a facet needs no more pixels than this leaves
    x, y, z = (np.asarray(m)[thin, thin] for m in (surface.x, surface.y, surface.z))
    facets = fit_facets(x, y, z, valid[thin, thin], block_px=max(_FLANKS.least_block_px, side // thin.step))
    rotation, flanks = _direction(facets, shape)
    _check_apex(flanks, shape)
    centres = _Points(flanks.x, flanks.y, flanks.z).thinned(_MAX_CENTRES)
    _check_period(centres, rotation, shape)
    return _refined(_first_place(centres, rotation, shape), centres, shape)


def _usable(surface: Surface) -> NDArray[np.bool_]:
    shapes = {np.shape(m) for m in (surface.x, surface.y, surface.z, surface.mask)}
    if len(shapes) > 1 or len(next(iter(shapes))) != 2:
        raise FitError(f"the surface's maps x, y, z and mask differ in shape: {sorted(shapes)}; one is needed")
    finite = np.isfinite(surface.x) & np.isfinite(surface.y) & np.isfinite(surface.z)
    valid = np.asarray(surface.mask, bool) & finite
    if np.count_nonzero(valid) < _LEAST_PIXELS:
        raise FitError(
            f"only {np.count_nonzero(valid)} valid pixels in the surface, at least {_LEAST_PIXELS} are needed; "
            "look at the mask's reasons before registering the bars"
        )
    return valid


def _block_px(surface: Surface, valid: NDArray[np.bool_], shape: ZigzagShape) -> int:
    """Side of a facet: a third of a flank, so that some lie wholly on it whatever the direction."""
    step = np.hypot(np.diff(surface.x, axis=1), np.diff(surface.y, axis=1))[valid[:, 1:] & valid[:, :-1]]
    if not step.size:
        return _FLANKS.unknown_block_px
    facet_mm = shape.base_mm / _FLANKS.blocks_per_base
    return max(_FLANKS.least_block_px, round(facet_mm / max(float(np.median(step)), 1e-9)))


def _direction(facets: Facets, shape: ZigzagShape) -> tuple[float, Facets]:
    """Direction across the ridges by a vote of the flanks' gradients, and the flanks that agree."""
    flank_angle = math.atan(shape.slope)
    plane = facets.residual < _FLANKS.plane_share * shape.height_mm
    steep = plane & (np.abs(facets.angle_rad - flank_angle) < _FLANKS.window_rad)
    heading = np.arctan2(facets.q, facets.p)
    least, share = _FLANKS.least_facets, _FLANKS.least_agreeing
    if steep.sum() >= max(least, share * np.sum(plane & (facets.angle_rad > _FLANKS.flat_rad))):
        votes, edges = np.histogram(np.mod(heading[steep], math.pi), bins=_FLANKS.bins, range=(0, math.pi))
        votes = votes + np.roll(votes, 1) + np.roll(votes, -1)
        rotation = float(edges[np.argmax(votes)] + (edges[1] - edges[0]) / 2)
        agree = steep
        for window in _FLANKS.heading_windows_rad:
            agree = steep & (np.abs(_half_turn(heading - rotation)) < window)
            rotation += float(np.median(_half_turn(heading[agree] - rotation)))
        if agree.sum() >= max(least, share * steep.sum()):
            return float(_half_turn(rotation)), facets.where(agree)
    raise FitError(
        f"no zig-zag: {int(steep.sum())} of {steep.size} facets have the target's flank angle of "
        f"{math.degrees(flank_angle):.1f} deg and no direction wins among them{_steepness(facets)}; "
        "check that the capture shows the bars and that the target states their apex angle"
    )


def _half_turn(angle: NDArray[np.floating] | float) -> NDArray[np.floating] | float:
    """Angle of an undirected line, in (-pi/2, pi/2]."""
    return math.pi / 2 - np.mod(math.pi / 2 - angle, math.pi)


def _steepness(facets: Facets) -> str:
    steep = facets.angle_rad[facets.angle_rad > _FLANKS.flat_rad]
    if steep.size < _FLANKS.least_facets:
        return " (the surface is flat)"
    return f" (the steep ones stand at {math.degrees(float(np.median(steep))):.1f} deg)"


def _check_apex(flanks: Facets, shape: ZigzagShape) -> None:
    measured = float(np.median(flanks.angle_rad))
    if abs(measured - math.atan(shape.slope)) > _FLANKS.angle_limit_rad:
        raise FitError(
            f"the flanks stand at {math.degrees(measured):.1f} deg, an apex of "
            f"{180 - 2 * math.degrees(measured):.1f} deg, where the target states {shape.apex_deg:g} deg; "
            "check the target's apex angle, then the height calibration"
        )


def _check_period(flanks: _Points, rotation: float, shape: ZigzagShape) -> None:
    """Refuse bars of the right angle and another size, by trying other periods."""
    across = ZigzagPose(0.0, 0.0, rotation).across_along(flanks.x, flanks.y)[0]
    factors = np.linspace(_PERIOD.smallest, _PERIOD.largest, _PERIOD.sizes)
    sizes = [replace(shape, leg_mm=shape.leg_mm * f, ridge_radius_mm=0.0) for f in factors]
    residual = np.array([_shift_residuals(across, flanks.z, size)[1].min() for size in sizes])
    best = int(np.argmin(residual))
    stated = float(residual[np.argmin(np.abs(factors - 1))])
    if abs(factors[best] - 1) > _PERIOD.least_change and residual[best] < _PERIOD.better * stated:
        raise FitError(
            f"the surface repeats every {sizes[best].base_mm:.1f} mm where the target repeats every "
            f"{shape.base_mm:.1f} mm; check the target's leg_mm, then the lateral scale"
        )


def _shift_residuals(across: Floats, z: Floats, shape: ZigzagShape) -> tuple[Floats, Floats]:
    """Mean distance to the endless zig-zag, capped, for shifts over one period."""
    shifts = np.arange(_PERIOD.shifts) / _PERIOD.shifts * shape.base_mm
    residual = np.abs(z - zigzag_height(across - shifts[:, None], shape))
    return shifts, np.minimum(residual, _PERIOD.cap * shape.height_mm).mean(axis=1)


def _first_place(flanks: _Points, rotation: float, shape: ZigzagShape) -> ZigzagPose:
    start = ZigzagPose(float(np.median(flanks.x)), float(np.median(flanks.y)), rotation)
    shifts, residual = _shift_residuals(start.across_along(flanks.x, flanks.y)[0], flanks.z, shape)
    return _shifted(start, across_mm=float(shifts[np.argmin(residual)]))


def _shifted(pose: ZigzagPose, *, across_mm: float = 0.0, along_mm: float = 0.0) -> ZigzagPose:
    c, s = math.cos(pose.rotation_rad), math.sin(pose.rotation_rad)
    dx, dy = c * across_mm - s * along_mm, s * across_mm + c * along_mm
    x, y = pose.x_mm + dx, pose.y_mm + dy
    z = pose.z_mm + pose.tilt_x_rad * dx + pose.tilt_y_rad * dy
    return replace(pose, x_mm=x, y_mm=y, z_mm=z)


def _placed(pose: ZigzagPose, points: _Points, shape: ZigzagShape) -> ZigzagPose:
    across, along = pose.across_along(points.x, points.y)
    place = place_footprint(across, along, points.z - pose.seat_height(points.x, points.y), shape)
    moved = _shifted(pose, across_mm=place.bars * shape.base_mm, along_mm=place.along_mm)
    return replace(moved, u_along_mm=place.u_along_mm, bars_seen=place.bars_seen)


def _flank_points(pose: ZigzagPose, points: _Points, shape: ZigzagShape) -> NDArray[np.bool_]:
    """Points of the flanks, clear of ridges, valleys and the bars' ends."""
    across, along = pose.across_along(points.x, points.y)
    clear = edge_distance(across, shape) > _REFINEMENT.edge_share * shape.base_mm
    within = np.abs(along) < _REFINEMENT.end_share * shape.length_mm
    return clear & within & (np.abs(across) < shape.count * shape.base_mm / 2)


def _refined(pose: ZigzagPose, points: _Points, shape: ZigzagShape, *, free: bool = False) -> ZigzagPose:
    """Gauss-Newton with Tukey weights for place across and rotation, and the seat if `free`."""
    if points.z.size < _FLANKS.least_facets:
        raise FitError("almost no lit flank lies where the bars were found; more of the bars must be lit")
    covariance = np.zeros((0, 0))
    scale = math.inf
    for _ in range(_REFINEMENT.rounds):
        residual, jacobian = _linearised(pose, points, shape, free=free)
        scale = max(robust_sd(residual, about=0), _REFINEMENT.least_scale * shape.height_mm)
        weight = np.maximum(1 - (residual / (_REFINEMENT.tukey * scale)) ** 2, 0.0) ** 2
        normal = jacobian.T @ (weight[:, None] * jacobian)
        if np.linalg.cond(normal / np.outer(*[np.sqrt(np.diag(normal))] * 2)) > _REFINEMENT.worst_condition:
            raise FitError("the visible flanks do not determine the bars' position; more of the bars must be lit")
        step = np.linalg.solve(normal, jacobian.T @ (weight * residual))
        pose = _stepped(pose, step)
        covariance = scale**2 * np.linalg.inv(normal)
        across_settled = abs(step[0]) < _REFINEMENT.settled_across * shape.base_mm
        if across_settled and abs(step[1]) < _REFINEMENT.settled_rad:
            break
    names = ("across_mm", "rotation_rad", "z_mm", "tilt_x_rad", "tilt_y_rad")[: len(covariance)]
    return replace(pose, names=names, covariance=covariance, residual_sd_mm=scale)


def _linearised(pose: ZigzagPose, points: _Points, shape: ZigzagShape, *, free: bool) -> tuple[Floats, Floats]:
    across, along = pose.across_along(points.x, points.y)
    residual = points.z - zigzag_height(across, shape) - pose.seat_height(points.x, points.y)
    slope = -np.sign(ridge_offset(across, shape)) * shape.slope
    columns = [-slope, slope * along]
    if free:
        columns += [np.ones_like(along), points.x - pose.x_mm, points.y - pose.y_mm]
    return residual, np.stack(columns, axis=1)


def _stepped(pose: ZigzagPose, step: Floats) -> ZigzagPose:
    moved = _shifted(pose, across_mm=float(step[0]))
    moved = replace(moved, rotation_rad=float(_half_turn(pose.rotation_rad + step[1])))
    if len(step) == _ROTATION_DOF:
        return moved
    return replace(
        moved,
        z_mm=moved.z_mm + float(step[2]),
        tilt_x_rad=pose.tilt_x_rad + float(step[3]),
        tilt_y_rad=pose.tilt_y_rad + float(step[4]),
    )


def _judged(pose: ZigzagPose, points: _Points, shape: ZigzagShape) -> ZigzagPose:
    inside = points.where(_flank_points(pose, points, shape))
    residual = inside.z - pose.reference_height(inside.x, inside.y, shape)
    share = float(np.mean(np.abs(residual) < TOLERANCE * shape.height_mm))
    if share < _REFINEMENT.least_inliers:
        raise FitError(
            f"the surface is not this zig-zag: {100 * share:.0f} % of the flank pixels lie within "
            f"{100 * TOLERANCE:.0f} % of full height of it, {100 * _REFINEMENT.least_inliers:.0f} % are needed; "
            "look for regions of wrong fringe order, or a bar that is not of this kind"
        )
    return replace(pose, inlier_share=share)
