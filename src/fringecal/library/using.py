"""Use a calibration: measure an object, verify on an artefact, audit with a later session."""

import math
from collections.abc import Sequence
from pathlib import Path

from numpy.typing import ArrayLike

from fringecal.errors import SessionError
from fringecal.library.calibration_value import Calibration
from fringecal.library.known_values import target_of
from fringecal.library.surface_value import Surface
from fringecal.library.verdicts import AuditResult, VerificationResult
from fringecal.session import Capture, Session, capture_of_arrays, load_session, session_of_captures
from fringecal.targets import Target
from fringecal.workflows.audit import audit as audit_session
from fringecal.workflows.reconstruct import causes_in_words, measurement_checks, reconstruct
from fringecal.workflows.verify import VERIFIED, verify_capture


def measure(
    calibration: Calibration,
    frames: ArrayLike,
    *,
    phase_shifts_deg: Sequence[float] = (),
    periods: Sequence[float] = (),
    height_range_mm: tuple[float, float] | None = None,
    tie_to_plate: bool = False,
    model: str = "projective",
    white_level: int | None = None,
) -> Surface:
    """Measure an object's surface.

    Parameters
    ----------
    calibration
        The rig's calibration.
    frames
        Phase-shifted frames of the object on the plate, (N, H, W), uint8 or uint16, in the order period, phase shift.
    phase_shifts_deg, periods
        Phase shift of each frame of one set, deg, and fringe periods; by default the phase shifts of the bare plate
        in the calibration.
    height_range_mm
        Heights that the object can have, where known: pixels beyond are masked.
    tie_to_plate
        Take the plane of the plate that is seen beside the object off the heights, with its uncertainty.
    model
        Height model; "projective" is the rig model.
    white_level
        Grey value of a saturated pixel; by default that of the array's type.

    Returns
    -------
    Surface
        x, y, z, u_z in mm and a mask, one value per pixel: ``phi = (n.X + n0) / (d.X + 1)`` along the pixel's ray
        solved for z.

    Raises
    ------
    SessionError
        Frames of another size or number than the calibration's, or no phase shifts.
    PhaseError, FitError
        No phase in the frames, or no fringe order could be decided anywhere.

    Examples
    --------
    From the root of the source tree, with the smallest of its sessions:

    >>> import fringecal
    >>> calibration = fringecal.Calibration.load("tests/records/archive/0.1.0")
    >>> session = fringecal.load_session("tests/records/archive/0.1.0/session")
    >>> surface = fringecal.measure(calibration, session.named("bars").read(), height_range_mm=(-5, 35))
    >>> surface.z.shape, bool(surface.mask.mean() > 0.9)
    ((200, 280), True)
    """
    capture = _capture(calibration, "object", "object", frames, None, phase_shifts_deg, periods, white_level)
    session = session_of_captures([capture], rig=calibration.record.session.rig)
    found = reconstruct(
        session,
        capture.name,
        calibration.rig,
        model=model,
        height_range_mm=height_range_mm,
        tie_to_plate=tie_to_plate,
    )
    notes = (found.phase.sentence(), *causes_in_words(found), *found.diagnosed.sentences())
    return Surface(found.surface, notes, measurement_checks(found))


def verify(
    calibration: Calibration,
    frames: ArrayLike,
    target: Target | str | Path,
    *,
    phase_shifts_deg: Sequence[float] = (),
    periods: Sequence[float] = (),
    white_level: int | None = None,
) -> VerificationResult:
    """Measure an artefact that took no part in the calibration, and compare it with its certificate.

    Parameters
    ----------
    calibration
        The rig's calibration.
    frames, phase_shifts_deg, periods, white_level
        As in `measure`.
    target
        The artefact: angle bars, flat, steps, wedge, box, sphere or ball bar; by name, file or value.

    Raises
    ------
    SessionError
        The target has no surface to verify on, or the frames do not fit the calibration.
    PhaseError, FitError
        No phase in the frames, or the surface does not show the artefact.

    Examples
    --------
    >>> import fringecal
    >>> calibration = fringecal.Calibration.load("tests/records/archive/0.1.0")
    >>> bars = fringecal.load_session("tests/records/archive/0.1.0/session").named("bars")
    >>> result = fringecal.verify(calibration, bars.read(), bars.target)
    >>> list(result.table["name"])
    ['A', 'B', 'C', 'D', 'E', 'pooled']
    """
    shown = target_of(target)
    if not isinstance(shown, VERIFIED):
        raise SessionError(
            [f"{shown.name}: heights cannot be verified on it; name bars, steps, a flat or another form"]
        )
    capture = _capture(calibration, "artefact", "artefact", frames, shown, phase_shifts_deg, periods, white_level)
    session = session_of_captures([capture], rig=calibration.record.session.rig)
    return VerificationResult(verify_capture(session, capture, calibration.rig))


def audit(calibration: Calibration, session: Session | str | Path) -> AuditResult:
    """Compare a later session with the calibration in force: what changed, and what probably moved.

    Parameters
    ----------
    calibration
        The calibration in force.
    session
        A checked session or its folder; a grid or the bare plate is needed, strips and artefacts say more.

    Raises
    ------
    SessionError
        Another rig or camera, or neither grid nor plate.
    DetectionError, PhaseError, FitError
        What the pictures do not show, with the reason.

    Examples
    --------
    The calibration's own pictures say nothing of time, and the audit says so:

    >>> import fringecal
    >>> calibration = fringecal.Calibration.load("tests/records/archive/0.1.0")
    >>> result = fringecal.audit(calibration, "tests/records/archive/0.1.0/session")
    >>> result.found.changed, result.verdict
    (False, 'conditionalPass')
    """
    given = load_session(session) if isinstance(session, str | Path) else session
    return AuditResult(audit_session(given, calibration.rig, calibration.record))


def _capture(  # noqa: PLR0913, PLR0917 -- private: what the callers were asked for
    calibration: Calibration,
    name: str,
    kind: str,
    frames: ArrayLike,
    target: Target | None,
    phase_shifts_deg: Sequence[float],
    periods: Sequence[float],
    white_level: int | None,
) -> Capture:
    return capture_of_arrays(
        name,
        kind,
        frames,
        target=target,
        phase_shifts_deg=phase_shifts_deg or _stated_shifts_deg(calibration),
        periods=periods,
        white_level=white_level,
    )


def _stated_shifts_deg(calibration: Calibration) -> tuple[float, ...]:
    """Return the phase shifts that the calibration's plate was stated to have."""
    steps = calibration.record.steps
    return tuple(math.degrees(shift) for shift in steps[0].stated_rad) if steps else ()
