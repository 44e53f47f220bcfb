"""Diagnostics in a procedure: what is wrong with a capture's frames, the error in mm, and what was corrected."""

from dataclasses import dataclass, replace

import numpy as np

from fringecal.errors import PhaseError
from fringecal.phase import Diagnosis, Finding, FindingKind, compare_repeats, diagnose, findings_of_repeats
from fringecal.projector import RigCalibration
from fringecal.session import Capture, Session
from fringecal.workflows.shared.capture_phase import CapturePhase, shortest_period


@dataclass(frozen=True)
class CaptureDiagnosis:
    """The findings of the diagnostics in one capture, and those for which the phase used is corrected."""

    phase: CapturePhase
    diagnosis: Diagnosis
    corrected: frozenset[FindingKind]

    @property
    def findings(self) -> tuple[Finding, ...]:
        """What is wrong, the largest phase error first."""
        return self.diagnosis.findings

    def sentences(self) -> tuple[str, ...]:
        """Say each finding in one sentence: what, how large, the error it causes, what was or is to be done."""
        return tuple(self._sentence(finding) for finding in self.findings)

    def _sentence(self, finding: Finding) -> str:
        effect = "it masks pixels"
        if finding.cost_rad is not None:
            height = "" if finding.cost_mm is None else f", {finding.cost_mm:.3f} mm of height"
            effect = f"it causes a phase error of {finding.cost_rad:.3f} rad rms{height}"
        done = f"corrected in the phase used; to remove the cause: {finding.remedy}"
        what = done if finding.kind in self.corrected else finding.remedy
        name = self.phase.capture.name
        return f"{name}: {finding.kind.text}: {finding.what} ({finding.how_large}); {effect}; {what}."


def diagnose_capture(
    phase: CapturePhase, calibration: RigCalibration, *, plate: Capture | None = None
) -> CaptureDiagnosis:
    """Diagnose a capture's frames.

    Parameters
    ----------
    phase
        The capture as demodulated.
    calibration
        The rig: it turns phase errors into height errors.
    plate
        The bare plate's capture of the same session, where `phase` shows something else.
    """
    capture = phase.capture
    period = shortest_period(capture)
    frames = capture.read_set(period=period)
    bare = None if plate is None else plate.read_set(period=period)
    found = diagnose(
        frames,
        capture.phase_shifts_rad,
        white_level=capture.white_level,
        reference=None if bare is None or bare.shape != frames.shape else bare,
        mm_per_rad=height_per_rad_mm(calibration),
    )
    return CaptureDiagnosis(phase, _with_repeats(found, capture, calibration), _corrected(phase))


def plate_beside(session: Session, capture: Capture) -> Capture | None:
    """Return the session's capture of the bare plate that another capture can be compared with, if there is one."""
    plates = [one for one in session.find("reference") if one.name != capture.name]
    same = [
        one for one in plates if one.phase_shifts_rad == capture.phase_shifts_rad and one.periods == capture.periods
    ]
    return same[0] if len(same) == 1 else None


def height_per_rad_mm(calibration: RigCalibration) -> float:
    """Return the height that one radian stands for at the plate-frame origin, mm."""
    centre = np.array([calibration.camera.centre_px])
    rays = calibration.camera.rays(centre[:, 0], centre[:, 1])
    along_x, along_y, along_z = calibration.model.gradient(rays.ax, rays.ay, 0.0)
    return float(1 / np.abs(along_z + along_x * rays.bx + along_y * rays.by)[0])


def _with_repeats(found: Diagnosis, capture: Capture, calibration: RigCalibration) -> Diagnosis:
    """Add what repeats of the set show."""
    if capture.repeat < 2:
        return found
    sets = np.stack([capture.read_set(repeat=k, period=shortest_period(capture)) for k in range(capture.repeat)])
    try:
        scatter = compare_repeats(sets, capture.phase_shifts_rad, white_level=capture.white_level)
    except PhaseError as error:
        return replace(found, notes=(*found.notes, f"repeats could not be compared: {error}"))
    scale = height_per_rad_mm(calibration)
    more = tuple(
        finding if finding.cost_rad is None else replace(finding, cost_mm=finding.cost_rad * scale)
        for finding in findings_of_repeats(scatter)
    )
    return replace(found, findings=(*found.findings, *more))


def _corrected(phase: CapturePhase) -> frozenset[FindingKind]:
    """Return the kinds of findings that the phase used is corrected for."""
    used = phase.adapted
    kinds = set()
    if phase.used == "estimated":
        kinds.add(FindingKind.WRONG_PHASE_SHIFTS)
    if used.scheme.name == "equalised":
        kinds |= {FindingKind.LAMP_DRIFT, FindingKind.VIBRATION}
    if used.change_rad_px.any():
        kinds.add(FindingKind.UNEVEN_PHASE_SHIFTS)
    if used.wave is not None and used.wave.matters(used.scheme):
        kinds |= {FindingKind.GAMMA, FindingKind.CLIPPED_SLIDE}
    return frozenset(kinds)
