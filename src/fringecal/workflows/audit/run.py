"""The periodic audit: a smaller session against the calibration in force, which itself is not fitted again."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from datetime import UTC

import numpy as np
from numpy.typing import NDArray
from scipy import special

from fringecal.errors import SessionError
from fringecal.projector import RigCalibration
from fringecal.records import AppearanceRecord, CalibrationRecord
from fringecal.session import Session
from fringecal.workflows.audit.change_covariance import Observed, covariance_of, light_uncertainty
from fringecal.workflows.audit.layout import PLATE_DEGREE, STRIPS_DEGREE, Layout, camera_quantities, terms_of_map
from fringecal.workflows.audit.observed import (
    GridFound,
    PlateFound,
    StripsFound,
    base_state,
    measured_grid,
    measured_plate,
    measured_strips,
    with_todays_offset,
)
from fringecal.workflows.audit.ranked_causes import CauseFit, rank_causes
from fringecal.workflows.shared import BLUR_FROM, appearance_of, demand_same_picture, demand_same_rig
from fringecal.workflows.verify import ArtefactVerification, Verification, independent, verify_capture

Array = NDArray[np.float64]
Progress = Callable[[str], None]

_COMPARED = ("grid", "reference", "strips", "artefact")
CHANCE = 0.01  # of calling a rig changed that is not: with monthly audits, once in eight years


@dataclass(frozen=True)
class Audit:
    """What an audit has found.

    Parameters
    ----------
    session, calibration
        The pictures, and the calibration in force.
    grid, plate, strips
        What today's pictures show; None or empty where the session has none.
    layout, change, covariance
        The compared vector: what it holds, observed minus predicted, and the covariance of that.
    appearance, appearance_then
        Image quality today and at the calibration.
    causes
        Single causes, the likeliest first; empty where nothing has changed.
    bars, artefacts
        Artefacts measured with the calibration in force.
    notes
        What could not be compared, and what was done.
    reused
        Captures of which a picture stands in the calibration's own session.
    """

    session: Session
    calibration: RigCalibration
    grid: GridFound | None
    plate: PlateFound | None
    strips: tuple[StripsFound, ...]
    layout: Layout
    change: Array
    covariance: Array
    appearance: AppearanceRecord
    appearance_then: AppearanceRecord | None
    causes: tuple[CauseFit, ...] = ()
    bars: tuple[Verification, ...] = ()
    artefacts: tuple[ArtefactVerification, ...] = ()
    notes: tuple[str, ...] = ()
    reused: tuple[str, ...] = ()

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
        A grid shows changes of the camera; the bare plate those of projector, slide and plate; strips, with the plate,
        that of the angle; artefacts show height errors. A grid or the plate is needed.
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
    layout = _layout((grid, plate, strips), record.appearance)
    today = appearance_of(None if plate is None else plate.phase, None if grid is None else grid.detection)
    change = _change(layout, calibration, (grid, plate, strips), (record.appearance, today))
    then = record.appearance or AppearanceRecord()
    covariance = covariance_of(layout, calibration, (grid, plate, strips), light_uncertainty("contrast", then, today))
    found = Audit(
        session, calibration, grid, plate, strips, layout, change, covariance, today, record.appearance,
        notes=_notes(session, grid, plate, record), reused=_reused(session, record),
    )  # fmt: skip
    if found.changed:
        progress("looking for the cause")
        found = replace(found, causes=rank_causes(layout, base_state(calibration), change, covariance))
    return _with_artefacts(found, progress)


def _demand(session: Session, calibration: RigCalibration, record: CalibrationRecord) -> None:
    """Refuse a session that cannot belong to the calibration, or says nothing of it."""
    demand_same_rig(session, record.session.rig)
    kinds = {kind for kind in _COMPARED if session.find(kind)}
    if not kinds & {"grid", "reference"}:
        raise SessionError(["an audit needs a grid or the bare plate: add a capture of kind grid or reference"])
    if "strips" in kinds and "reference" not in kinds:
        raise SessionError(['the strips need the bare plate beside them: add a capture of kind "reference"'])
    for kind in kinds:
        for capture in session.find(kind):
            demand_same_picture(capture, calibration)


def _reused(session: Session, record: CalibrationRecord) -> tuple[str, ...]:
    """Name the compared captures that hold a picture of the calibration's session, by its hash."""
    known = {file.sha256 for file in record.inputs if file.capture}
    return tuple(
        capture.name
        for kind in _COMPARED
        for capture in session.find(kind)
        if known & {sha256 for _, sha256 in capture.files}
    )


def _observe(session: Session, calibration: RigCalibration, record: CalibrationRecord, progress: Progress) -> Observed:
    grid = plate = None
    strips: tuple[StripsFound, ...] = ()
    if session.find("grid"):
        progress("finding the grid")
        grid = measured_grid(session, session.one("grid"), calibration, record.targets)
    if session.find("reference"):
        progress("phase of the bare plate")
        plate = measured_plate(session.one("reference"), calibration)
        for capture in session.find("strips"):
            progress(f"phase of {capture.name}")
            strips += (measured_strips(capture, plate, calibration, record.targets),)
    return grid, plate, strips


def _layout(observed: Observed, then: AppearanceRecord | None) -> Layout:
    grid, plate, strips = observed
    # A blur that was fitted to sections through the lines, as before, is another number than one from raw pixels.
    alike = then is not None and then.grid_blur_from == BLUR_FROM
    blur = then.grid_blur_px if then is not None and alike and grid is not None else None
    return Layout(
        grid=grid is not None,
        plate=None if plate is None else plate.blocks,
        strips=tuple(one.tops for one in strips),
        blur_px=blur,
        contrast=plate is not None and then is not None and then.contrast is not None,
    )


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
        parts.append(terms_of_map(plate.change_rad, PLATE_DEGREE)[1:])
    parts += [terms_of_map(one.change_rad, STRIPS_DEGREE) for one in strips]
    if layout.blur_px is not None:
        parts.append(np.array([(now.grid_blur_px or 0.0) - layout.blur_px]))
    if layout.contrast and then is not None and then.contrast and now.contrast:
        parts.append(np.array([np.log(now.contrast / then.contrast)]))
    return np.concatenate(parts)


def _notes(
    session: Session, grid: GridFound | None, plate: PlateFound | None, record: CalibrationRecord
) -> tuple[str, ...]:
    notes = ["The calibration in force was not changed."]
    then = record.session.captured
    if then is not None and session.captured.astimezone(UTC) < then:
        notes.append(
            f"The session was captured on {session.captured:%Y-%m-%d}, before the calibration's "
            f"({then:%Y-%m-%d}): what changed since then it cannot say; check its date."
        )
    if plate is not None:
        notes.append(
            f"Today's phase differs from the calibration's by {plate.offset_rad:+z.2f} rad everywhere, up to "
            "whole fringes: it depends on where the mirror was left, and is subtracted."
        )
    missing = {
        "camera, scale and distortion: no grid": grid is None,
        "projector, slide and plate: no bare plate": plate is None,
        "projection angle: no strips": not session.find("strips"),
        "sharpness and contrast: the calibration's record holds none (older version)": record.appearance is None,
    }
    return (*notes, *(f"Not compared: {what}." for what, absent in missing.items() if absent))


def _with_artefacts(found: Audit, progress: Progress) -> Audit:
    """Measure every artefact with the calibration in force; only the constant of the phase is today's."""
    session, plate = found.session, found.plate
    captures = independent(session)
    if not captures:
        return found
    rig = found.calibration if plate is None else with_todays_offset(found.calibration, plate.offset_rad)
    measured: list[Verification | ArtefactVerification] = []
    for capture in captures:
        progress(f"heights of {capture.name}")
        measured.append(verify_capture(session, capture, rig))
    bars = tuple(one for one in measured if isinstance(one, Verification))
    artefacts = tuple(one for one in measured if isinstance(one, ArtefactVerification))
    return replace(found, bars=bars, artefacts=artefacts)
