"""The camera on the plate from the detected grid, with what is known of lens and height."""

import math
from dataclasses import dataclass, replace

import numpy as np

from fringecal.calibration.board_lens import KnownLens
from fringecal.camera import (
    CameraFit,
    DistortionTest,
    Lens,
    ThesisScale,
    camera_height,
    examine_distortion,
    fit_grid_camera,
    thesis_scale,
)
from fringecal.detect import GridDetection
from fringecal.errors import FitError
from fringecal.projector import PlateForm
from fringecal.uncertainty import Budget, Estimate, Influence, UncertaintyComponent

#: Height of a camera over the diagonal of its field, where nobody states it: lenses see 71 deg (0.7) to 14 deg (4).
_USUAL_HEIGHT, _USUAL_REL_U = 1.7, 0.6
_WIDEST = 3.0  # field over height: beyond 113 deg of view a pinhole with Brown's terms is no model either


@dataclass(frozen=True)
class CameraFindings:
    """What the grid picture says of the camera: `pitch` of the grid in mm, the crossings found, and what follows.

    `height_seen` is the camera's height by lens and grid alone, where another one is stated: their relative difference
    is the error of the grid's stated pitch. Without a lens a wrong pitch cannot be distinguished from another height.
    `assumed_height` is the height used where neither it nor a lens is stated.
    """

    pitch: Estimate
    detection: GridDetection
    fit: CameraFit
    distortion: DistortionTest
    tables: ThesisScale
    lens: KnownLens | None = None
    height_seen: Estimate | None = None
    assumed_height: Estimate | None = None

    @property
    def notes(self) -> tuple[str, ...]:
        """What a reader should know of the camera besides the numbers."""
        lens = () if self.lens is None else self.lens.notes
        if self.assumed_height is None:
            return lens
        low, high = (self.assumed_height.value + sign * self.assumed_height.u for sign in (-1, 1))
        return (
            *lens,
            f"The camera's height is not stated, and a grid seen square-on cannot show it: a usual lens is assumed, "
            f"{low:.0f} to {high:.0f} mm up. Scale and apparent angle hardly change with it; projection angles beside "
            "the middle and heights far above the strips do, as their uncertainties show. Measure it and state "
            "camera.height_mm = { value, u }: the entrance pupil above the plate.",
        )

    @property
    def height_origin(self) -> str:
        """Say where the camera's height comes from."""
        if self.assumed_height is not None:
            return "not stated: a usual lens is assumed"
        return "as stated; a grid alone does not show it" if self.lens is None else "by lens and grid"

    def on_plate(self, form: PlateForm | None) -> "CameraFindings":
        """Return the same with what the form of the plate, on which the sheet lay, does to the camera."""
        if form is None or not form.axes_mm:
            return self
        numbers = range(len(form.axes_mm))
        effects = self.fit.changed_by_heights(lambda x, y: np.stack([form.change(k, x, y) for k in numbers]))
        covariance = self.fit.camera.covariance + effects.T @ effects
        added = (UncertaintyComponent(Influence.PLATE_FLATNESS, effect, form.dof) for effect in effects)
        camera = self.fit.camera.replaced(self.fit.camera.parameters, covariance)
        return replace(self, fit=replace(self.fit, camera=camera, components=(*self.fit.components, *added)))

    @property
    def scales(self) -> dict[str, Estimate]:
        """Scale on the plate at the image centre, mm/px: mean, horizontal and vertical."""
        return {name: self.fit.camera.scale(name) for name in ("mean", "horizontal", "vertical")}

    @property
    def scale_budget(self) -> Budget:
        """The mean scale in mm/px with the components of its uncertainty."""
        camera, mean = self.fit.camera, self.fit.camera.scale("mean")
        stated = [
            replace(one, effect=camera.replaced(camera.parameters + one.effect).scale("mean").value - mean.value)
            for one in self.fit.components
        ]
        left = mean.u**2 - sum(one.effect**2 for one in stated)
        crossings = UncertaintyComponent(Influence.GRID_CROSSINGS, math.sqrt(max(0.0, left)), self.fit.dof)
        return Budget(mean, (*stated, crossings))


@dataclass(frozen=True)
class CameraKnowledge:
    """What is known of the camera before its grid picture is looked at.

    Parameters
    ----------
    height_mm
        Entrance pupil above the plate with its standard uncertainty, mm; None where it is not known.
    telecentric
        Whether all rays are parallel.
    lens
        The full lens, from a file or from board pictures; None where it is not known.
    """

    height_mm: Estimate | None = None
    telecentric: bool = False
    lens: KnownLens | None = None


def camera_from_grid(
    detection: GridDetection, pitch: Estimate, known: CameraKnowledge, *, thermal_rel_u: float = 0.0
) -> CameraFindings:
    """Fit the camera on the plate to a detected grid, test it for distortion, and measure the thesis's scale.

    Parameters
    ----------
    detection
        The grid as found in its picture.
    pitch
        Distance of neighbouring lines, mm.
    known
        What is known of the camera; where it is neither its height nor its lens, a usual lens is assumed.
    thermal_rel_u
        Relative standard uncertainty of the pitch by temperature, beside that of `pitch`.

    Raises
    ------
    FitError
        The grid does not determine the camera, or the stated height cannot be.
    """
    lens = None if known.lens is None else known.lens.lens
    stated = known.height_mm is not None or known.telecentric or lens is not None
    assumed = None if stated else usual_height(detection, pitch.value)
    thermal_mm = thermal_rel_u * pitch.value
    whole = replace(pitch, u=math.hypot(pitch.u, thermal_mm))
    fit = fit_camera(detection, whole, known, assumed=assumed)
    fit = _with_what_is_stated(fit, pitch, thermal_mm, known.height_mm)
    test = examine_distortion(detection)
    tables = thesis_scale(detection, pitch).beside(test.scale_at_centre(pitch))
    seen = None
    if lens is not None and known.height_mm is not None and not known.telecentric:
        seen = camera_height(fit_grid_camera(detection, pitch, lens=lens))
    return CameraFindings(pitch, detection, fit, test, tables, known.lens, seen, assumed)


def _with_what_is_stated(fit: CameraFit, pitch: Estimate, thermal_mm: float, height: Estimate | None) -> CameraFit:
    """Give components the degrees of freedom that are stated, and take what temperature does out of the pitch's."""
    stated = {Influence.GRID_PITCH: pitch.dof, Influence.CAMERA_HEIGHT: math.inf if height is None else height.dof}
    found: list[UncertaintyComponent] = []
    for one in fit.components:
        dof = stated.get(one.influence, math.inf)
        known = replace(one, dof=dof) if math.isfinite(dof) else one
        if one.influence is Influence.GRID_PITCH and thermal_mm > 0:
            whole = math.hypot(pitch.u, thermal_mm)
            found.append(replace(known, effect=one.effect * (pitch.u / whole)))
            found.append(UncertaintyComponent(Influence.TEMPERATURE, one.effect * (thermal_mm / whole)))
        else:
            found.append(known)
    return replace(fit, components=tuple(found))


def usual_height(detection: GridDetection, pitch_mm: float) -> Estimate:
    """Return the height at which a camera with a usual lens stands over the field of a grid's picture."""
    rows, columns = detection.shape
    height = _USUAL_HEIGHT * _field_mm(detection, pitch_mm) * math.hypot(rows, columns) / max(rows, columns)
    return Estimate(height, _USUAL_REL_U * height, "mm", influence=Influence.CAMERA_HEIGHT)


def fit_camera(
    detection: GridDetection, pitch: Estimate, known: CameraKnowledge, *, assumed: Estimate | None = None
) -> CameraFit:
    """Fit the camera to a detected grid with what is known of it, or with a height that is assumed.

    Raises
    ------
    FitError
        As `camera_from_grid`.
    """
    height = assumed if known.height_mm is None else known.height_mm
    if height is not None:
        demand_possible_height(height.value, _field_mm(detection, pitch.value))
    lens: Lens | None = None if known.lens is None else known.lens.lens
    return fit_grid_camera(detection, pitch, height_mm=height, telecentric=known.telecentric, lens=lens)


def _field_mm(detection: GridDetection, pitch_mm: float) -> float:
    """Return the picture's longer side on the plate by the grid's own size in it."""
    lines = math.hypot(np.ptp(detection.column), np.ptp(detection.row)) * pitch_mm
    pixels = math.hypot(np.ptp(detection.u_px), np.ptp(detection.v_px))
    return lines / pixels * max(detection.shape)


def demand_possible_height(height_mm: float, field_mm: float) -> None:
    """Refuse a camera height over which no lens could see so wide a field.

    Raises
    ------
    FitError
        The field is wider than three heights: a lens of 113 deg.

    Examples
    --------
    >>> demand_possible_height(1100.0, 470.0)
    """
    if field_mm > _WIDEST * height_mm:
        raise FitError(
            f"The camera's stated height of {height_mm:g} mm is impossible: the field is {field_mm:.0f} mm wide on the "
            f"plate, {field_mm / height_mm:.1f} times that, and no lens sees a field so wide. State camera.height_mm, "
            f"entrance pupil above the plate, in mm (is it {10 * height_mm:g}?), or correct the pitch of the grid."
        )
