"""The rig model: phase in space, for any diverging or collimated projector.

`phi(X) = (n . X + n0) / (d . X + 1) + rho(foot(X))`: a ratio of two linear forms (a pinhole and one slide
coordinate), and a smooth residual that is measured on the plate and carried up along the projector's rays,
because along a ray the phase does not change whatever the lens and the slide did to it.
"""

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.polynomial import chebyshev
from numpy.typing import ArrayLike, NDArray

from fringecal.camera import Rays
from fringecal.numerics import by_powers, over_bands, products_up_to
from fringecal.projector import rig_kernels as kernels

Array = NDArray[np.float64]

#: Parameters of the ratio, in the order of every vector and covariance; phase in rad, lengths in mm.
RIG_NAMES = ("nx", "ny", "nz", "n0", "dx", "dy", "dz")
RESIDUAL_DEGREE = 5
"""Total degree of the plate's smooth residual: that of Brown's k2 in a projector's lens. A lower one leaves its bend in
the phase, a higher one follows dirt and texture of the plate."""
_FEW_POINTS = 10_000  # for one thread: fewer take less time than starting another
_LIFT_ROUNDS = 3  # the residual is smooth: each round gains two to three digits
_RIDGE = 1e-9  # of the number of points, which is the size of a term's own sum: takes off no more than the ninth digit
_STEP_MM = 0.05  # of central differences: they neglect its square, 2e-9 rad/mm for light from 1 m away
_PARALLEL = 1e-12  # |n x d| over |n|, 1/mm: below it the planes of equal phase meet nowhere, and light is collimated


@dataclass(frozen=True)
class PlateResidual:
    """A smooth phase residual on the plate: Chebyshev polynomials of total degree `degree` over a box.

    `box` is (x_low, x_high, y_low, y_high) in mm; points outside are evaluated at its edge, because a
    polynomial says nothing there.
    """

    degree: int = 0
    coefficients: Array = field(default_factory=lambda: np.zeros(1))
    box: tuple[float, float, float, float] = (-1.0, 1.0, -1.0, 1.0)

    def __call__(self, x_mm: ArrayLike, y_mm: ArrayLike) -> Array:
        """Return the residual phase in rad at plate points."""
        x, y = np.broadcast_arrays(np.asarray(x_mm, float), np.asarray(y_mm, float))
        out = np.zeros(x.shape)
        if not np.any(self.coefficients):
            return out
        flat = (np.ascontiguousarray(c).ravel() for c in (x, y))
        rest = self.grid, np.array(self.box), out.reshape(-1)
        over_bands(kernels.residual_at, x.size, *flat, *rest, least=_FEW_POINTS)
        return out

    @property
    def grid(self) -> Array:
        """Coefficients by degree along x and along y, shape (degree + 1, degree + 1)."""
        return by_powers(self.coefficients, self.degree)

    def design(self, x_mm: Array, y_mm: Array) -> Array:
        """Return the matrix whose columns are the polynomial's terms at plate points."""
        s, t = self._unit(x_mm, y_mm)
        return products_up_to(chebyshev.chebvander(s, self.degree), chebyshev.chebvander(t, self.degree))

    def _unit(self, x: Array, y: Array) -> tuple[Array, Array]:
        x0, x1, y0, y1 = self.box
        s = np.clip((2 * x - x0 - x1) / (x1 - x0), -1, 1)
        t = np.clip((2 * y - y0 - y1) / (y1 - y0), -1, 1)
        return s, t


def fit_residual(x_mm: Array, y_mm: Array, left_rad: Array, degree: int) -> PlateResidual:
    """Fit the smooth residual to what a rig's ratio leaves at plate points, over the box that they span.

    Parameters
    ----------
    x_mm, y_mm, left_rad
        Plate points and measured minus modelled phase there, shape (n,).
    degree
        Total degree of the polynomial.
    """
    box = (float(x_mm.min()), float(x_mm.max()), float(y_mm.min()), float(y_mm.max()))
    design = PlateResidual(degree, np.zeros(1), box).design(x_mm, y_mm)
    # Chebyshev terms over their own box are nearly orthogonal: normal equations lose nothing and are quick.
    ridge = _RIDGE * left_rad.size * np.eye(design.shape[1])
    coefficients = np.linalg.solve(design.T @ design + ridge, design.T @ left_rad)
    return PlateResidual(degree, coefficients, box)


@dataclass(frozen=True)
class RigModel:
    """Phase in space, and the projector's position by which plate points are lifted.

    Parameters
    ----------
    parameters
        The seven numbers in the order of `RIG_NAMES`.
    projector_mm
        A point (x, y, z) on the line that all planes of equal phase share; infinite when collimated.
    residual
        What slide and lens add to the phase on the plate.
    """

    parameters: Array
    projector_mm: Array
    residual: PlateResidual = field(default_factory=PlateResidual)

    def ratio(self, x_mm: ArrayLike, y_mm: ArrayLike, z_mm: ArrayLike) -> Array:
        """Return the pinhole part of the phase in rad."""
        nx, ny, nz, n0, dx, dy, dz = self.parameters
        x, y, z = (np.asarray(c, float) for c in (x_mm, y_mm, z_mm))
        return (nx * x + ny * y + nz * z + n0) / (dx * x + dy * y + dz * z + 1)

    def foot(self, x_mm: ArrayLike, y_mm: ArrayLike, z_mm: ArrayLike) -> tuple[Array, Array]:
        """Return where the projector's ray through a point meets the plate."""
        return foot_on_plate(x_mm, y_mm, z_mm, self.projector_mm)

    def phase(self, x_mm: ArrayLike, y_mm: ArrayLike, z_mm: ArrayLike = 0.0) -> Array:
        """Return the phase in rad at points of the plate frame."""
        return self.ratio(x_mm, y_mm, z_mm) + self.residual(*self.foot(x_mm, y_mm, z_mm))

    def height(self, phase_rad: Array, rays: Rays) -> Array:
        """Return z in mm where rays meet their phase: one linear equation, lifted for the residual.

        NaN where the phase is NaN, and where a ray runs along a plane of equal phase.
        """
        maps = np.broadcast_arrays(np.asarray(phase_rad, float), rays.ax, rays.ay, rays.bx, rays.by)
        out = np.empty(maps[0].shape)
        rounds = _LIFT_ROUNDS if np.any(self.residual.coefficients) else 0
        over_bands(
            kernels.height_at,
            out.size,
            *(np.ascontiguousarray(m).ravel() for m in maps),
            self.parameters,
            self.projector_mm,
            self.residual.grid,
            np.array(self.residual.box),
            rounds,
            out.reshape(-1),
            least=_FEW_POINTS,
        )
        return out

    def gradient(self, x_mm: ArrayLike, y_mm: ArrayLike, z_mm: ArrayLike = 0.0) -> tuple[Array, Array, Array]:
        """Return (dphi/dx, dphi/dy, dphi/dz) in rad/mm, the residual's share included."""
        step = _STEP_MM
        x, y, z = (np.asarray(c, float) for c in (x_mm, y_mm, z_mm))
        along_x = self.phase(x + step, y, z) - self.phase(x - step, y, z)
        along_y = self.phase(x, y + step, z) - self.phase(x, y - step, z)
        along_z = self.phase(x, y, z + step) - self.phase(x, y, z - step)
        return along_x / (2 * step), along_y / (2 * step), along_z / (2 * step)

    def with_parameters(self, parameters: Array) -> "RigModel":
        """Return the same model with other numbers; the projector follows them."""
        model = replace(self, parameters=np.asarray(parameters, float))
        return replace(model, projector_mm=projector_point(model.parameters, near=self.projector_mm))


def foot_on_plate(x_mm: ArrayLike, y_mm: ArrayLike, z_mm: ArrayLike, projector_mm: ArrayLike) -> tuple[Array, Array]:
    """Return where the ray from the projector through a point meets the plate (z = 0).

    `X + (X - P) z / (P_z - z)` with P the projector. A projector at infinity gives the point's own x and y: its light
    has a direction that its place does not tell.

    Parameters
    ----------
    x_mm, y_mm, z_mm
        Points of the plate frame.
    projector_mm
        The projector's position (x, y, z).

    Examples
    --------
    >>> x, y = foot_on_plate(10.0, 0.0, 50.0, [-1000.0, 0.0, 1000.0])
    >>> round(float(x), 6), float(y)
    (63.157895, 0.0)
    """
    x, y, z, projector = (np.asarray(c, float) for c in (x_mm, y_mm, z_mm, projector_mm))
    return kernels.foot_of_ray.py_func(x, y, z, projector) if np.isfinite(projector[2]) else (x, y)


def projector_line(parameters: Array) -> tuple[Array, Array]:
    """Return a point and the unit direction of the line that all planes of equal phase share.

    The line is where numerator and denominator both vanish; the projector's pupil lies on it, where along it
    the fringes of one slide coordinate cannot tell.
    """
    n, n0 = parameters[:3], parameters[3]
    d = parameters[4:7]
    direction = np.cross(n, d)
    length = np.linalg.norm(direction)
    if length < _PARALLEL * max(np.linalg.norm(n), 1e-30):
        return np.full(3, np.inf), np.array([np.nan] * 3)
    direction /= length
    point, *_ = np.linalg.lstsq(np.vstack([n, d, direction]), np.array([-n0, -1.0, 0.0]), rcond=None)
    return point, direction


def projector_point(parameters: Array, *, near: ArrayLike | None = None) -> Array:
    """Return the point of the projector's line nearest to `near`, or nearest to the plate's origin."""
    point, direction = projector_line(parameters)
    if not np.all(np.isfinite(point)):
        return point
    target = np.zeros(3) if near is None or not np.all(np.isfinite(near)) else np.asarray(near, float)
    return point + direction * float(direction @ (target - point))
