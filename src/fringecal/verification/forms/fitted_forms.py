"""Spheres and planes through points, and the form errors of acceptance tests that follow from them.

The definitions follow VDI/VDE 2634 part 2 and ISO 10360-13 as commonly described; no conformity is claimed. The two
differ by 1.5 on the same noise, and a range over all points grows with their number: a form error means something
only with its definition, the number of points and the discarded share, so all three are part of the result.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fringecal.errors import FitError

Floats = NDArray[np.float64]
Definition = Literal["vdi2634-2", "iso10360-13"]

VDI_DISCARDED = 0.003
"""Share of the measured points that VDI/VDE 2634-2 lets a test leave out."""

ISO_DISCARDED = 0.05
"""Share outside the shell that holds 95 % of the points (ISO 10360-13)."""

_ROUNDS = 50  # Gauss-Newton steps at most; a cap of 30 deg takes some ten
_SETTLED = 1e-10  # step, of the radius or of 1 mm: far below any measured point's noise
_FLAT = 1e-9  # of the largest singular value: points that spread less than this in a direction lie in a plane, or line


@dataclass(frozen=True)
class SphereFit:
    """A least-squares sphere: centre and radius in mm, signed radial residuals in mm, and their Jacobian.

    `jacobian` is d(residual)/d(centre, radius), (n, 4), or (n, 3) where the radius was fixed.
    """

    centre_mm: Floats
    radius_mm: float
    residual_mm: Floats
    jacobian: Floats

    @property
    def diameter_mm(self) -> float:
        """Diameter of the sphere."""
        return 2 * self.radius_mm


@dataclass(frozen=True)
class PlaneFit:
    """A least-squares plane: a point on it, its unit normal (z up), signed distances in mm."""

    point_mm: Floats
    normal: Floats
    residual_mm: Floats


@dataclass(frozen=True)
class Form:
    """A form error in mm, with what it means: the definition, the number of points, the discarded share."""

    value_mm: float
    definition: Definition
    points: int
    discarded_share: float


def fit_sphere(points_mm: ArrayLike, *, radius_mm: float | None = None) -> SphereFit:
    """Fit a sphere by least squares of the distances from its surface.

    Parameters
    ----------
    points_mm
        (n, 3), n >= 4.
    radius_mm
        Fixes the radius, for the centre of a calibrated ball: on a small cap a free radius and the centre's height
        cannot be distinguished (a cap of 30 deg half-angle loses a factor of 20).

    Raises
    ------
    FitError
        Too few points, or points in a plane.

    Examples
    --------
    >>> axes = np.vstack([np.eye(3), -np.eye(3)])
    >>> fit = fit_sphere(5 * axes + [1, 2, 3])
    >>> fit.centre_mm.round(9).tolist(), round(fit.radius_mm, 9)
    ([1.0, 2.0, 3.0], 5.0)
    """
    points = _points(points_mm, least=4, what="sphere")
    shift = points.mean(axis=0)
    local = points - shift
    centre, radius = _algebraic_sphere(local)
    if radius_mm is not None:
        radius = radius_mm
    for _ in range(_ROUNDS):
        residual, jacobian = _radial(local, centre, radius, free=radius_mm is None)
        step = np.linalg.lstsq(jacobian, -residual, rcond=None)[0]
        centre, radius = centre + step[:3], radius + (float(step[3]) if radius_mm is None else 0.0)
        if float(np.max(np.abs(step))) < _SETTLED * max(1.0, radius):
            break
    residual, jacobian = _radial(local, centre, radius, free=radius_mm is None)
    return SphereFit(centre + shift, float(radius), residual, jacobian)


def fit_plane(points_mm: ArrayLike) -> PlaneFit:
    """Fit a plane by least squares of the distances from it.

    Raises
    ------
    FitError
        Too few points, or points on a line.
    """
    points = _points(points_mm, least=3, what="plane")
    middle = points.mean(axis=0)
    _, sizes, axes = np.linalg.svd(points - middle, full_matrices=False)
    if sizes[1] <= _FLAT * max(float(sizes[0]), 1e-300):
        raise FitError("the points lie on a line, which determines no plane; take points over an area")
    normal = axes[2] if axes[2, 2] >= 0 else -axes[2]
    return PlaneFit(middle, normal, (points - middle) @ normal)


def sphere_form(
    points_mm: ArrayLike, *, definition: Definition = "vdi2634-2", discard: float | None = None
) -> tuple[Form, SphereFit]:
    """Return the form error of a sphere with free radius: range or 95 % shell of the radial residuals.

    Parameters
    ----------
    points_mm
        (n, 3) measured points of one ball.
    definition
        ``"vdi2634-2"``: range after the worst points are left out and the sphere is fitted anew;
        ``"iso10360-13"``: width of the narrowest concentric shell that holds the rest of the points.
    discard
        Share left out; by default 3 per mille and 5 % in turn.
    """
    points = _points(points_mm, least=4, what="sphere")
    return _form(points, fit_sphere, definition, discard)


def flatness(
    points_mm: ArrayLike, *, definition: Definition = "vdi2634-2", discard: float | None = None
) -> tuple[Form, PlaneFit]:
    """Return the flatness error: range, or 95 % width, of the distances from the least-squares plane.

    Parameters as in `sphere_form`.
    """
    points = _points(points_mm, least=3, what="plane")
    return _form(points, fit_plane, definition, discard)


def sphere_size(points_mm: ArrayLike, diameter_mm: float) -> float:
    """Return the size error of a sphere in mm: least-squares diameter of all points minus the calibrated one."""
    return fit_sphere(points_mm).diameter_mm - diameter_mm


def sphere_spacing(
    first_mm: ArrayLike, second_mm: ArrayLike, diameters_mm: tuple[float, float], spacing_mm: float
) -> float:
    """Return the spacing error of two spheres in mm: distance of their centres minus the calibrated one.

    The radii are fixed at the calibrated ones, as single views see caps only.
    """
    centres = [
        fit_sphere(points, radius_mm=diameter / 2).centre_mm
        for points, diameter in zip((first_mm, second_mm), diameters_mm, strict=True)
    ]
    return float(np.linalg.norm(centres[1] - centres[0])) - spacing_mm


def narrowest_width(values: ArrayLike, share: float) -> float:
    """Return the width of the narrowest interval that holds at least this share of the values.

    Examples
    --------
    >>> round(narrowest_width([0, 1, 1.1, 1.2, 9], 0.6), 9)
    0.2
    """
    ordered = np.sort(np.asarray(values, float))
    inside = min(ordered.size, math.ceil(share * ordered.size - 1e-9))
    return float(np.min(ordered[inside - 1 :] - ordered[: ordered.size - inside + 1]))


def _form[Fit: (SphereFit, PlaneFit)](
    points: Floats, fit: Callable[[Floats], Fit], definition: Definition, discard: float | None
) -> tuple[Form, Fit]:
    """Return the form error and the fit that it refers to."""
    if definition not in ("vdi2634-2", "iso10360-13"):
        raise ValueError(f"no definition {definition!r}; known: vdi2634-2, iso10360-13")
    share = (VDI_DISCARDED if definition == "vdi2634-2" else ISO_DISCARDED) if discard is None else discard
    if not 0 <= share < 0.5:
        raise ValueError(f"the discarded share must be at least 0 and below 0.5, found {share}")
    found = fit(points)
    if definition == "iso10360-13":
        width = narrowest_width(found.residual_mm, 1 - share)
        return Form(width, definition, len(points), share), found
    left_out = math.floor(share * len(points))
    if left_out:
        worst = np.argpartition(np.abs(found.residual_mm), -left_out)[-left_out:]
        found = fit(np.delete(points, worst, axis=0))
    return Form(float(np.ptp(found.residual_mm)), definition, len(points), left_out / len(points)), found


def _points(points_mm: ArrayLike, *, least: int, what: str) -> Floats:
    points = np.asarray(points_mm, float)
    if points.ndim != 2 or points.shape[1] != 3:
        raise ValueError(f"points of a {what} must be (n, 3), found {points.shape}")
    if len(points) < least or not np.isfinite(points).all():
        raise FitError(f"a {what} needs at least {least} finite points; found {int(np.isfinite(points).all(1).sum())}")
    return points


def _algebraic_sphere(points: Floats) -> tuple[Floats, float]:
    """Return a first sphere from `|p|^2 = 2 c.p + (r^2 - |c|^2)`, which is linear in what is sought."""
    scale = float(np.sqrt(np.mean(points**2))) or 1.0
    unit = points / scale
    design = np.column_stack([2 * unit, np.ones(len(unit))])
    sizes = np.linalg.svd(design, compute_uv=False)
    if sizes[-1] < _FLAT * sizes[0]:
        raise FitError("the points lie in a plane, which determines no sphere; take points over a cap")
    solution = np.linalg.lstsq(design, np.sum(unit**2, axis=1), rcond=None)[0]
    return solution[:3] * scale, math.sqrt(max(float(solution[3] + solution[:3] @ solution[:3]), 0.0)) * scale


def _radial(points: Floats, centre: Floats, radius: float, *, free: bool) -> tuple[Floats, Floats]:
    away = points - centre
    distance = np.linalg.norm(away, axis=1)
    jacobian = -away / np.maximum(distance, 1e-300)[:, None]
    if free:
        jacobian = np.column_stack([jacobian, -np.ones(len(points))])
    return distance - radius, jacobian
