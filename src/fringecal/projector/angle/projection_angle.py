"""The projection angle: from the plate's normal, in the plane across the local fringe.

`tan(theta) = -(dphi/dz) / |grad_xy phi|`. What a fringe's break shows to a camera at finite height is this angle
and the camera's own together (the apparent angle); both are reported, never mixed.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fringecal.camera import PlateCamera
from fringecal.projector.joint_fit import PhasePoints
from fringecal.projector.rig_calibration import RigCalibration
from fringecal.projector.rig_model import RigModel
from fringecal.uncertainty import Budget, Estimate, en_score

Array = NDArray[np.float64]

NEWTON_ROUNDS = 4
"""Steps of Newton's method on the plate, where phase and rays are nearly straight: each doubles the number of right
digits, so that four lead from one digit to all that float64 has."""


@dataclass(frozen=True)
class ProjectorPosition:
    """The stated position of the projector: plate frame, mm, with standard uncertainties."""

    value_mm: Array
    u_mm: Array


def projection_tangent(model: RigModel, x_mm: ArrayLike, y_mm: ArrayLike) -> Array:
    """Return the tangent of the projection angle at plate points; positive at the origin."""
    gx, gy, gz = model.gradient(x_mm, y_mm, 0.0)
    return -_handed(model) * gz / np.hypot(gx, gy)


def projection_angle(model: RigModel, x_mm: ArrayLike, y_mm: ArrayLike) -> Array:
    """Return the projection angle in rad at plate points; positive at the origin.

    Examples
    --------
    >>> model = RigModel(np.array([0.5, 0.0, 0.5, 0.0, 0.0, 0.0, 0.0]), np.full(3, np.inf))  # light from 45 deg
    >>> round(float(np.rad2deg(projection_angle(model, 0.0, 0.0))), 6)
    45.0
    """
    return np.arctan(projection_tangent(model, x_mm, y_mm))


def apparent_angle(model: RigModel, camera: PlateCamera, x_mm: ArrayLike, y_mm: ArrayLike) -> Array:
    """Return the angle in rad that a small fringe break shows to the camera at plate points.

    Examples
    --------
    >>> camera = PlateCamera.from_values({"scale_mm_per_px": 0.8, "height_mm": 1100.0}, (480, 640))
    >>> model = RigModel(np.array([0.5, 0.0, 0.5, 0.0, 0.0, 0.0, 0.0]), np.full(3, np.inf))  # light from 45 deg
    >>> round(float(np.rad2deg(apparent_angle(model, camera, 0.0, 0.0))), 3)  # seen from above, as it is
    45.0
    """
    gx, gy, gz = model.gradient(x_mm, y_mm, 0.0)
    rays = camera.rays(*camera.project(x_mm, y_mm))
    seen = gz + gx * rays.bx + gy * rays.by
    return np.arctan2(-_handed(model) * seen, np.hypot(gx, gy))


def theoretical_tangent(
    model: RigModel, projector: ProjectorPosition, x_mm: ArrayLike, y_mm: ArrayLike
) -> tuple[Array, Array]:
    """Return tan(theta) that the stated projector position asks for, and its standard uncertainty.

    `tan(theta) = m . (P - X) / P_z` with P the projector and m the unit vector across the fringe: by similar triangles,
    a ray from P that meets the plate at X runs `m . (P - X)` sideways while it falls by P_z.
    """
    x, y = np.asarray(x_mm, float), np.asarray(y_mm, float)
    mx, my = across_fringe(model, x, y)
    px, py, pz = projector.value_mm
    tangent = (mx * (px - x) + my * (py - y)) / pz
    u = np.sqrt((mx * projector.u_mm[0]) ** 2 + (my * projector.u_mm[1]) ** 2 + (tangent * projector.u_mm[2]) ** 2)
    return tangent, u / pz


def theoretical_angle(
    model: RigModel, projector: ProjectorPosition, x_mm: float, y_mm: float, *, label: str = "theory"
) -> Estimate:
    """Return the projection angle in deg that the stated projector position asks for."""
    tangent, u = theoretical_tangent(model, projector, x_mm, y_mm)
    slope = 1 / (1 + float(tangent) ** 2)
    return Estimate(math.degrees(math.atan(float(tangent))), math.degrees(slope * float(u)), "deg", label)


def angle_budget(
    calibration: RigCalibration, x_mm: float = 0.0, y_mm: float = 0.0, *, apparent: bool = False
) -> Budget:
    """Return the angle at a plate point in deg, with its budget.

    Examples
    --------
    >>> camera = PlateCamera.from_values({"scale_mm_per_px": 0.8, "height_mm": 1100.0}, (480, 640))
    >>> model = RigModel(np.array([0.5, 0.0, 0.5, 0.0, 0.0, 0.0, 0.0]), np.full(3, np.inf))  # light from 45 deg
    >>> budget = angle_budget(RigCalibration(camera, model, ()))
    >>> round(budget.result.value, 6), budget.result.u
    (45.0, 0.0)
    """

    def angle(c: RigCalibration) -> float:
        if apparent:
            return math.degrees(float(apparent_angle(c.model, c.camera, x_mm, y_mm)))
        return math.degrees(float(projection_angle(c.model, x_mm, y_mm)))

    label = "apparent projection angle" if apparent else "projection angle"
    return calibration.budget(angle, unit="deg", label=label)


@dataclass(frozen=True)
class OriginAngles:
    """The angles at the plate's origin, deg; the budget is the true angle's, theory None without a stated position."""

    angle: Estimate
    budget: Budget
    apparent: Estimate
    theory: Estimate | None

    @property
    def en(self) -> float | None:
        """Measured against theoretical angle, `en_score`; None without theory."""
        return None if self.theory is None else en_score(self.angle, self.theory)

    @property
    def sentence(self) -> str:
        """Say plainly whether the measured geometry agrees with the stated one."""
        if self.theory is None or self.en is None:
            return "The session states no projector position: the angle cannot be compared with a theoretical one."
        difference = self.angle.value - self.theory.value
        if abs(self.en) <= 1:
            return f"The measured geometry agrees with the stated one ({difference:+z.2f} deg, En {self.en:+z.2f})."
        return (
            f"The measured angle differs from the stated geometry by {difference:+z.2f} deg "
            f"(En {self.en:+z.2f}): the projector stands elsewhere, or the strips are not as high as their "
            "target says."
        )


def angles_at_origin(calibration: RigCalibration, stated: ProjectorPosition | None) -> OriginAngles:
    """Return measured, apparent and theoretical angle at the plate's origin.

    Examples
    --------
    >>> camera = PlateCamera.from_values({"scale_mm_per_px": 0.8, "height_mm": 1100.0}, (480, 640))
    >>> model = RigModel(np.array([0.5, 0.0, 0.5, 0.0, 0.0, 0.0, 0.0]), np.full(3, np.inf))  # light from 45 deg
    >>> found = angles_at_origin(RigCalibration(camera, model, ()), None)
    >>> round(found.angle.value, 6), found.theory
    (45.0, None)
    """
    angle = angle_budget(calibration)
    theory = None if stated is None else theoretical_angle(calibration.model, stated, 0.0, 0.0)
    return OriginAngles(angle.result, angle, angle_budget(calibration, apparent=True).result, theory)


def angles_from_breaks(model: RigModel, surface: PhasePoints) -> tuple[Array, Array, Array]:
    """Return tan(theta) that each pixel on a strip's top shows by itself, and the plate point it belongs to.

    The phase on the top at `X` is that of the plate where the projector's ray ends; the distance between the two
    across the fringe, over the strip's height, is the tangent. Solved by Newton's method on the plate's phase.

    Returns
    -------
    tangent, x_mm, y_mm
        Arrays of the points' shape; x and y are the foot of the projector's ray.
    """
    x, y = surface.rays.at(surface.z_mm)
    mx, my = across_fringe(model, x, y)
    t = np.zeros_like(x)
    for _ in range(NEWTON_ROUNDS):
        gx, gy, _ = model.gradient(x + t * mx, y + t * my, 0.0)
        t = t + (surface.phase_rad - model.phase(x + t * mx, y + t * my, 0.0)) / (gx * mx + gy * my)
    return -t / surface.z_mm, x + t * mx, y + t * my


def fringe_pitch_mm(model: RigModel, x_mm: ArrayLike = 0.0, y_mm: ArrayLike = 0.0) -> Array:
    """Return the fringes' pitch on the plate, across the fringe, in mm.

    Examples
    --------
    >>> model = RigModel(np.array([2 * np.pi / 8, 0.0, 0.5, 0.0, 0.0, 0.0, 0.0]), np.full(3, np.inf))
    >>> round(float(fringe_pitch_mm(model)), 6)
    8.0
    """
    gx, gy, _ = model.gradient(x_mm, y_mm, 0.0)
    return 2 * math.pi / np.hypot(gx, gy)


def _handed(model: RigModel) -> float:
    """+1 or -1, so that the angle at the origin is positive."""
    _, _, gz = model.gradient(0.0, 0.0, 0.0)
    return -1.0 if float(gz) > 0 else 1.0


def across_fringe(model: RigModel, x: Array, y: Array) -> tuple[Array, Array]:
    """Return the unit vector across the fringe at plate points, toward the projector."""
    gx, gy, _ = model.gradient(x, y, 0.0)
    length = np.hypot(gx, gy) * _handed(model)
    return gx / length, gy / length
