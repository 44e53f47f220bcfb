"""The projection angle by theory, from stated positions; and the displacement of the projector from its stated one."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import special

from fringecal.camera import PlateCamera
from fringecal.errors import FitError
from fringecal.projector.angle.projection_angle import ProjectorPosition, across_fringe, theoretical_tangent
from fringecal.projector.rig_calibration import RigCalibration
from fringecal.projector.rig_model import RigModel, projector_line
from fringecal.uncertainty import Estimate

Array = NDArray[np.float64]

DISPLACEMENT_PROBABILITY = 0.05  # a displacement that chance explains less often than this is found
_ALONG = 0.71  # share of a coordinate in the line's direction beyond which the line runs along it: cos 45 deg
_SURE = 2.0  # standard uncertainties, 95 %, by which a coordinate must differ to be named by itself
_UNSEEN_MM2 = 1e12  # variance put along the line, (1 km)^2: whatever lies that way is never the surest direction
_NEGLIGIBLE = 1e-9  # of the largest eigenvalue, below which a direction has no variance: the line's own, by rounding
_WORDS = (("right", "left"), ("up", "down"), ("higher", "lower"))


@dataclass(frozen=True)
class Displacement:
    """Displacement of the projector: position found minus stated position.

    Parameters
    ----------
    found_mm
        Point of the projector's line nearest to the stated position: along the line, which runs along the fringes,
        the position is not determined.
    difference_mm
        Found minus stated, plate frame.
    covariance
        Of the difference, mm^2: the fit's and the stated position's together.
    line
        Unit vector along the line.
    probability
        Chance of a difference as large as this if the position is as stated (chi-squared, two degrees of freedom).
    others
        What else would make the projector seem displaced like this, each with its size, as it stands in a sentence.
    """

    found_mm: Array
    difference_mm: Array
    covariance: Array
    line: Array
    probability: float
    others: tuple[str, ...] = ()

    @property
    def agrees(self) -> bool:
        """Whether chance explains the difference, at 5 %."""
        return self.probability >= DISPLACEMENT_PROBABILITY

    @property
    def u_mm(self) -> Array:
        """Standard uncertainty of each coordinate of the difference."""
        return np.asarray(np.sqrt(np.diag(self.covariance)))

    def sentence(self) -> str:
        """State whether the projector is where it is stated to be; if not, by how much and which way it deviates."""
        chance = f"chance {self.probability:.2g}"
        if self.agrees:
            return f"The measured geometry agrees with the stated position of the projector ({chance})."
        seen = [i for i in range(3) if abs(self.line[i]) < _ALONG]
        sure = [i for i in seen if abs(self.difference_mm[i]) > _SURE * self.u_mm[i]]
        if sure:
            parts = " and ".join(_named(i, self.difference_mm[i], self.u_mm[i]) for i in sure)
            return f"The projector stands {parts} than stated ({chance}); {self._or_else}."
        size, axis = self._surest()
        parts = " or ".join(f"{abs(size / axis[i]):.0f} mm {_word(i, size * axis[i])}" for i in _largest(axis))
        return (
            f"The projector stands about {abs(size):.0f} mm from its stated position, across its line to the plate: "
            f"about {parts} than stated, which of the two the breaks do not determine ({chance}); "
            f"{self._or_else}."
        )

    @property
    def _or_else(self) -> str:
        return ", or ".join(("or the strips' height is not as stated", *self.others))

    def significance(self, effect_mm: Array) -> float:
        """Return the chi-squared (two degrees of freedom) of a displacement, (3,) mm, as far as it is seen.

        ``d' C^-1 d``, d the displacement across the projector's line and C the covariance.
        """
        effect = (np.eye(3) - np.outer(self.line, self.line)) @ effect_mm
        return float(effect @ np.linalg.pinv(self.covariance, rcond=_NEGLIGIBLE, hermitian=True) @ effect)

    def fraction(self, effect_mm: Array) -> float | None:
        """Return how much of a cause explains the displacement alone; None where no amount of it does, at 5 %.

        Parameters
        ----------
        effect_mm
            By how much the cause displaces the projector, (3,).
        """
        across = np.eye(3) - np.outer(self.line, self.line)
        inverse = np.linalg.pinv(self.covariance, rcond=_NEGLIGIBLE, hermitian=True)
        effect = across @ effect_mm
        size = float(effect @ inverse @ effect)
        if not size > 0:
            return None
        amount = float(effect @ inverse @ self.difference_mm) / size
        left = self.difference_mm - amount * effect
        return amount if special.chdtrc(1, float(left @ inverse @ left)) >= DISPLACEMENT_PROBABILITY else None

    def _surest(self) -> tuple[float, Array]:
        """Size of the difference along the direction in which it is most significant, and that direction."""
        values, vectors = np.linalg.eigh(self.covariance + _UNSEEN_MM2 * np.outer(self.line, self.line))
        along = vectors.T @ self.difference_mm
        best = int(np.argmax(along**2 / values))
        return float(along[best]), vectors[:, best]


def displacement(calibration: RigCalibration, stated: ProjectorPosition) -> Displacement:
    """Compare the projector found with its stated position.

    Raises
    ------
    FitError
        Parallel light: there is no position to be compared.
    """
    point, line = projector_line(calibration.model.parameters)
    if not np.all(np.isfinite(point)) or not np.all(np.isfinite(line)):
        raise FitError("The light is parallel within the uncertainty: the projector has no position to compare.")
    found = _nearest(point, line, stated.value_mm)
    across = np.eye(3) - np.outer(line, line)
    effects = [across @ displaced_by(calibration, c.effect, stated) for c in calibration.components]
    covariance = sum((np.outer(e, e) for e in effects), np.diag(stated.u_mm**2))
    covariance = across @ covariance @ across
    difference = found - stated.value_mm
    squared = float(difference @ np.linalg.pinv(covariance, rcond=_NEGLIGIBLE, hermitian=True) @ difference)
    return Displacement(found, difference, covariance, line, float(special.chdtrc(2, squared)))


def displaced_by(calibration: RigCalibration, effect: Array, stated: ProjectorPosition) -> Array:
    """Return by how much a change of all parameters displaces the projector found, mm, (3,).

    Parameters
    ----------
    calibration, stated
        The rig, and where its projector is stated to stand.
    effect
        Change of the parameter vector.
    """
    before, after = (
        _nearest(*projector_line(one.model.parameters), stated.value_mm)
        for one in (calibration, calibration.replaced(calibration.vector + effect))
    )
    return np.asarray(after - before)


def seen_axes(model: RigModel) -> tuple[bool, ...]:
    """Tell which coordinates (x, y, z) of the projector its fringes see: not the one along which its line runs.

    Examples
    --------
    >>> seen_axes(RigModel(np.array([0.6, 0, -0.7, 0, 0, 0, -0.001]), np.array([1200.0, 0, 1000])))
    (True, False, True)
    """
    _, line = projector_line(model.parameters)
    return tuple(bool(abs(part) < _ALONG) for part in line)


def projector_estimates(calibration: RigCalibration, stated: ProjectorPosition | None = None) -> tuple[Estimate, ...]:
    """Return x, y and z of the projector's point, mm; none where its light is parallel.

    The coordinate along which its line runs is not seen by the fringes: it has the stated value and uncertainty.
    """
    if not np.all(np.isfinite(calibration.model.projector_mm)):
        return ()
    fitted = (
        calibration.budget(lambda c, i=i: float(c.model.projector_mm[i]), unit="mm", label=f"projector {axis}").result  # type: ignore[misc]
        for i, axis in enumerate("xyz")
    )
    if stated is None:
        return tuple(fitted)
    kinds = zip(fitted, seen_axes(calibration.model), stated.u_mm, strict=True)
    return tuple(e if seen else Estimate(e.value, float(u), "mm", f"{e.label}, stated") for e, seen, u in kinds)


def reflected_source(
    projector: ProjectorPosition, mirror_point: ProjectorPosition, normal: ArrayLike
) -> ProjectorPosition:
    """Return where a plane mirror makes the projector appear to stand.

    Parameters
    ----------
    projector
        The projector's own position, plate frame.
    mirror_point
        Any point of the mirror's surface; its uncertainty along the normal counts twice.
    normal
        Direction across the mirror, (3,), of any length; taken as exact.

    Notes
    -----
    `P' = P - 2 ((P - M) . n) n`; covariances are turned likewise.

    Raises
    ------
    FitError
        A normal without direction.

    Examples
    --------
    >>> projector = ProjectorPosition(np.array([0.0, 200.0, 1000.0]), np.full(3, 2.0))
    >>> mirror = ProjectorPosition(np.array([0.0, 700.0, 1000.0]), np.full(3, 2.0))
    >>> reflected_source(projector, mirror, (0, 1, 0)).value_mm
    array([   0., 1200., 1000.])
    """
    n = np.asarray(normal, float)
    if n.shape != (3,) or not np.isfinite(n).all() or not np.linalg.norm(n) > 0:
        raise FitError(f"the mirror's normal {np.asarray(normal).tolist()} has no direction; three numbers are needed")
    n = n / np.linalg.norm(n)
    turn = np.eye(3) - 2 * np.outer(n, n)
    value = turn @ projector.value_mm + 2 * float(mirror_point.value_mm @ n) * n
    covariance = turn @ np.diag(projector.u_mm**2) @ turn.T
    covariance += 4 * float((mirror_point.u_mm * n) @ (mirror_point.u_mm * n)) * np.outer(n, n)
    return ProjectorPosition(value, np.sqrt(np.diag(covariance)))


def theoretical_apparent(
    model: RigModel, projector: ProjectorPosition, camera: PlateCamera, x_mm: float, y_mm: float
) -> Estimate:
    """Return the angle in deg that breaks should show to the camera: the projector's and the camera's own.

    `tan = m . ((P - X) / P_z - (C - X) / C_z)`, P the projector, C the camera, m the unit vector across the fringe: the
    projector's ray through X less the line of sight, for a low strip.
    """
    tangent, u = theoretical_tangent(model, projector, x_mm, y_mm)
    rays = camera.rays(*camera.project(x_mm, y_mm))
    mx, my = across_fringe(model, np.asarray(x_mm, float), np.asarray(y_mm, float))
    seen = float(tangent) - float(mx * rays.bx + my * rays.by)
    slope = 1 / (1 + seen**2)
    return Estimate(math.degrees(math.atan(seen)), math.degrees(slope * float(u)), "deg", "apparent, theory")


def _nearest(point: Array, line: Array, to: Array) -> Array:
    return point + line * float(line @ (to - point))


def _word(axis: int, sign: float) -> str:
    return ("further " if axis < 2 else "") + _WORDS[axis][0 if sign > 0 else 1]


def _named(axis: int, value: float, u: float) -> str:
    return f"about {abs(value):.0f} mm (u = {u:.0f} mm) {_word(axis, value)}"


def _largest(axis: Array) -> list[int]:
    """Return the two coordinates in which a direction is longest."""
    return sorted(np.argsort(-np.abs(axis))[:2].tolist())
