"""The periodic audit: a smaller session against the calibration in force. Nothing is fitted anew in the calibration."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy import special

from fringecal.camera.plate import CAMERA_NAMES
from fringecal.errors import SessionError
from fringecal.procedures.appearance import appearance_of
from fringecal.procedures.artefacts import ArtefactVerification, verify_artefact
from fringecal.procedures.audit_causes import CauseFit, rank_causes
from fringecal.procedures.audit_layout import (
    PLATE_DEGREE,
    STRIPS_DEGREE,
    Blocks,
    Layout,
    camera_quantities,
    coefficients,
)
from fringecal.procedures.audit_observed import (
    GridToday,
    PlateToday,
    StripsToday,
    base_state,
    grid_today,
    plate_today,
    strips_today,
    with_todays_offset,
)
from fringecal.procedures.verification import Verification, demand_same_picture, verify
from fringecal.projection.calibration import RigCalibration
from fringecal.records.calibration import AppearanceRecord, CalibrationRecord
from fringecal.session import Session
from fringecal.targets.models import Zigzag

Array = NDArray[np.float64]
Progress = Callable[[str], None]

CHANCE = 0.01  # of calling a rig changed that is not
_FLOOR_RAD = 5e-4  # ripple and texture that no polynomial and no cause describes
_FLOOR_PX = 0.02  # of the corner, likewise
_U_BLUR_PX = 0.02  # how well one picture of a grid tells its blur: width and blur of a line are fitted together
_U_CONTRAST = 0.01  # relative: lamps and exposures repeat to a percent
_SCATTER = ("phase scatter", "grid crossings")  # causes of doubt that two sessions do not share


@dataclass(frozen=True)
class Audit:
    """What an audit has found.

    Parameters
    ----------
    session, calibration
        The pictures, and the calibration in force.
    grid, plate, strips
        What today's pictures show; None where the session has none.
    layout, change, covariance
        The compared vector: what it holds, observed minus predicted, and the covariance of that.
    appearance, appearance_then
        How the pictures look today and looked at the calibration.
    causes
        Single causes, the likeliest first; empty where nothing has changed.
    bars, artefacts
        Artefacts measured with the calibration in force.
    notes
        What could not be compared, and what was done.
    """

    session: Session
    calibration: RigCalibration
    grid: GridToday | None
    plate: PlateToday | None
    strips: StripsToday | None
    layout: Layout
    change: Array
    covariance: Array
    appearance: AppearanceRecord
    appearance_then: AppearanceRecord | None
    causes: tuple[CauseFit, ...] = ()
    bars: tuple[Verification, ...] = ()
    artefacts: tuple[ArtefactVerification, ...] = ()
    notes: tuple[str, ...] = ()

    @property
    def chi2(self) -> float:
        """Size of the whole change against its covariance."""
        return float(self.change @ np.linalg.solve(self.covariance, self.change))

    @property
    def probability(self) -> float:
        """Chance of a change as large as this on a rig that has not changed."""
        return float(special.chdtrc(self.change.size, self.chi2))

    @property
    def changed(self) -> bool:
        """Whether the rig differs from its calibration by more than chance explains."""
        return self.probability < CHANCE


def audit(
    session: Session,
    calibration: RigCalibration,
    record: CalibrationRecord,
    *,
    progress: Progress = lambda _: None,
) -> Audit:
    """Compare a session with the calibration in force; what is there decides what can be said.

    Parameters
    ----------
    session
        A grid says of the camera; the bare plate of lamp, slide and plate; strips, with the plate, of the angle;
        artefacts of height errors. A grid or the plate is needed.
    calibration, record
        The calibration in force, and the record it comes from.
    progress
        Called with a short sentence before each step.

    Raises
    ------
    SessionError
        Another rig or camera, no grid and no plate, or a capture that does not show what it says.
    DetectionError, PhaseError, FitError
        What the pictures do not show, with the reason.
    """
    _demand(session, calibration, record)
    grid, plate, strips = _observe(session, calibration, record, progress)
    layout = _layout(grid, plate, strips, record.appearance)
    today = appearance_of(None if plate is None else plate.phase, None if grid is None else grid.detection)
    change = _change(layout, calibration, (grid, plate, strips), (record.appearance, today))
    covariance = _covariance(layout, calibration, (grid, plate, strips))
    found = Audit(
        session, calibration, grid, plate, strips, layout, change, covariance, today, record.appearance,
        notes=_notes(session, grid, plate, record),
    )  # fmt: skip
    if found.changed:
        progress("looking for the cause")
        found = replace(found, causes=rank_causes(layout, base_state(calibration), change, covariance))
    return _with_artefacts(found, progress)


def _demand(session: Session, calibration: RigCalibration, record: CalibrationRecord) -> None:
    """Refuse a session that cannot belong to the calibration, or says nothing of it."""
    if session.rig != record.session.rig:
        raise SessionError(
            [
                f"the session is of rig {session.rig!r}, the calibration of {record.session.rig!r}: name the "
                "calibration of this rig, or correct the key rig in session.toml"
            ]
        )
    kinds = {kind for kind in ("grid", "reference", "strips", "artefact") if session.find(kind)}
    if not kinds & {"grid", "reference"}:
        raise SessionError(["an audit needs a grid or the bare plate: add a capture of kind grid or reference"])
    if "strips" in kinds and "reference" not in kinds:
        raise SessionError(['the strips need the bare plate beside them: add a capture of kind "reference"'])
    for kind in kinds:
        for capture in session.find(kind):
            demand_same_picture(capture, calibration)


def _observe(
    session: Session, calibration: RigCalibration, record: CalibrationRecord, progress: Progress
) -> tuple[GridToday | None, PlateToday | None, StripsToday | None]:
    grid = plate = strips = None
    if session.find("grid"):
        progress("finding the grid")
        grid = grid_today(session, session.one("grid"), calibration, record.targets)
    if session.find("reference"):
        progress("phase of the bare plate")
        plate = plate_today(session.one("reference"), calibration)
    if plate is not None and session.find("strips"):
        progress("phase of the strips")
        strips = strips_today(session.find("strips")[0], plate, calibration, record.targets)
    return grid, plate, strips


def _layout(
    grid: GridToday | None, plate: PlateToday | None, strips: StripsToday | None, then: AppearanceRecord | None
) -> Layout:
    blur = None if then is None or grid is None else then.grid_blur_px
    return Layout(
        grid=grid is not None,
        plate=None if plate is None else plate.blocks,
        strips=None if strips is None else strips.blocks,
        strip_height_mm=np.zeros(0) if strips is None else strips.height_mm,
        blur_px=blur,
        contrast=plate is not None and then is not None and then.contrast is not None,
    )


type Observed = tuple[GridToday | None, PlateToday | None, StripsToday | None]


def _change(
    layout: Layout,
    calibration: RigCalibration,
    observed: Observed,
    looks: tuple[AppearanceRecord | None, AppearanceRecord],
) -> Array:
    """Gather observed minus predicted."""
    (grid, plate, strips), (then, now) = observed, looks
    parts = []
    if grid is not None:
        parts.append(camera_quantities(grid.fit.camera) - camera_quantities(calibration.camera))
    if plate is not None:
        parts.append(coefficients(plate.blocks, plate.blocks.value, PLATE_DEGREE)[1:])
    if strips is not None:
        parts.append(coefficients(strips.blocks, strips.blocks.value, STRIPS_DEGREE))
    if layout.blur_px is not None:
        parts.append(np.array([(now.grid_blur_px or 0.0) - layout.blur_px]))
    if layout.contrast and then is not None and then.contrast and now.contrast:
        parts.append(np.array([np.log(now.contrast / then.contrast)]))
    return np.concatenate(parts)


def _covariance(layout: Layout, calibration: RigCalibration, observed: Observed) -> Array:
    """Covariance of the change: today's scatter, the calibration's own, and artefacts that are not the same ones."""
    grid, plate, strips = observed
    parts = layout.parts
    size = max(part.stop for part in parts.values())
    total = np.zeros((size, size))
    if grid is not None:
        total[parts["camera"], parts["camera"]] += _camera_scatter(grid)
    for name, today, degree in (("plate", plate, PLATE_DEGREE), ("strips", strips, STRIPS_DEGREE)):
        if today is not None:
            scatter = _scatter(today.blocks, degree)
            total[parts[name], parts[name]] += scatter[1:, 1:] if name == "plate" else scatter
    total += _calibration_doubt(layout, calibration, observed)
    floors = {"camera": 0.0, "plate": _FLOOR_RAD, "strips": _FLOOR_RAD, "blur": _U_BLUR_PX, "contrast": _U_CONTRAST}
    for name, part in parts.items():
        total[part, part] += floors[name] ** 2 * np.eye(part.stop - part.start)
    if grid is not None:
        corner = parts["camera"].stop - 1
        total[corner, corner] += _FLOOR_PX**2
    return total


def _scatter(blocks: Blocks, degree: int) -> Array:
    """Covariance of the terms from the scatter of the blocks, twice: the calibration's plate is as noisy."""
    design = blocks.design(degree)
    left = blocks.value - design @ np.linalg.lstsq(design, blocks.value, rcond=None)[0]
    variance = float(left @ left) / max(left.size - design.shape[1], 1)
    return 2 * variance * np.linalg.inv(design.T @ design)


def _camera_scatter(grid: GridToday) -> Array:
    """Covariance of the camera's quantities: today's crossings, and the pitch where it is another sheet's."""
    camera = grid.fit.camera
    shared = [e for label, e in grid.fit.causes.items() if not (label == "grid pitch" and not grid.same_sheet)]
    covariance = camera.covariance - sum((np.outer(e, e) for e in shared), np.zeros_like(camera.covariance))
    base = camera_quantities(camera)
    spread = np.sqrt(np.clip(np.diag(covariance), 0.0, None))
    slopes = np.zeros((base.size, len(CAMERA_NAMES)))
    for i in np.flatnonzero(spread):
        step = spread[i] * np.eye(len(CAMERA_NAMES))[i]
        slopes[:, i] = (camera_quantities(camera.replaced(camera.parameters + step)) - base) / spread[i]
    return slopes @ covariance @ slopes.T


def _calibration_doubt(layout: Layout, calibration: RigCalibration, observed: Observed) -> Array:
    """Covariance of what the calibration predicts: causes that today's session does not share."""
    grid, _, strips = observed
    start = layout.predict(base_state(calibration))
    total = np.zeros((start.size, start.size))
    for mode in calibration.modes:
        other_sheet = mode.label == "grid pitch" and grid is not None and not grid.same_sheet
        other_strips = mode.label == "strip height" and strips is not None and not strips.same_strips
        if mode.label in _SCATTER or other_sheet or other_strips:
            effect = layout.predict(base_state(calibration.shifted(mode))) - start
            total += np.outer(effect, effect)
    return total


def _notes(
    session: Session, grid: GridToday | None, plate: PlateToday | None, record: CalibrationRecord
) -> tuple[str, ...]:
    notes = ["The calibration in force was not changed; nothing was fitted anew to it."]
    if plate is not None:
        notes.append(
            f"Today's phase differs from the calibration's by {plate.offset_rad:+.2f} rad everywhere, give or take "
            "whole fringes: where the mirror was left; taken off."
        )
    missing = {
        "camera, scale and distortion: no grid": grid is None,
        "lamp, slide and plate: no bare plate": plate is None,
        "projection angle: no strips": not session.find("strips"),
        "sharpness and contrast: the calibration's record holds none (older version)": record.appearance is None,
    }
    return (*notes, *(f"Not compared: {what}." for what, absent in missing.items() if absent))


def _with_artefacts(found: Audit, progress: Progress) -> Audit:
    """Measure every artefact with the calibration in force; only the constant of the phase is today's."""
    session, plate = found.session, found.plate
    captures = [c for c in session.find("artefact") if c.target is not None and c.use != "calibration"]
    if not captures:
        return found
    rig = found.calibration if plate is None else with_todays_offset(found.calibration, plate.offset_rad)
    bars: tuple[Verification, ...] = ()
    others: tuple[ArtefactVerification, ...] = ()
    for capture in captures:
        progress(f"heights of {capture.name}")
        if isinstance(capture.target, Zigzag):
            bars += (verify(session, capture.name, rig, with_filters=False),)
        else:
            others += (verify_artefact(capture, rig),)
    return replace(found, bars=bars, artefacts=others)
