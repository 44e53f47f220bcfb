"""Why strips or artefacts could not be found: faults of the frames are named in place of their consequences."""

from collections.abc import Iterator

from fringecal.errors import FringecalError
from fringecal.phase import FindingKind, PhaseMap, diagnose
from fringecal.session import Capture
from fringecal.workflows.shared.capture_phase import CapturePhase, shortest_period

_LEAST_SHARE = 0.3  # of the picture: with fewer fringes the row of strips falls into pieces
_REMEDIES = {
    "saturated": "expose shorter, or reduce the projector's brightness",
    "dark": "more light is needed",
    "low_modulation": "the projector's light must carry fringes there: check slide, focus and ambient light",
    "outside": "let the fringes fill the field",
    "misfit": "the frames do not belong to one phase-shifted set: take it again",
}


def caused_by_frames(error: FringecalError, reference: CapturePhase, strips: CapturePhase) -> FringecalError:
    """Return an error that names the faults of the frames; the given error where they have none.

    The error about the strips lists possible causes, which no longer matter once the cause is known.

    Parameters
    ----------
    error
        The error raised when the strips were looked for.
    reference, strips
        The two captures.
    """
    causes = [*too_few_pixels(reference), *too_few_pixels(strips), *_faults(strips, reference)]
    return error if not causes else type(error)(" ".join([*causes, "Because of that the strips cannot be found."]))


def caused_by_frames_of(error: FringecalError, phase: CapturePhase, plate: Capture | None = None) -> FringecalError:
    """Return an error that names the faults of an artefact's frames; the given error where they have none.

    Parameters
    ----------
    error
        The error raised when the surface was looked for.
    phase
        The artefact's capture.
    plate
        The bare plate's capture of the same session, if there is one.
    """
    causes = [*too_few_pixels(phase), *_faults_of(phase, plate, set())]
    return error if not causes else type(error)(" ".join([*causes, "Because of that its heights cannot be measured."]))


def too_few_pixels(phase: CapturePhase) -> Iterator[str]:
    """Say why few pixels of a capture carry fringes, if so."""
    shares = phase.map.shares()
    if shares["valid"] < _LEAST_SHARE:
        reason = main_reason(phase.map)
        yield (
            f"Capture {phase.capture.name!r}: only {100 * shares['valid']:.0f} % of the picture carries fringes, "
            f"{100 * shares[reason]:.0f} % is {reason.replace('_', ' ')}; {_REMEDIES[reason]}."
        )


def main_reason(phase: PhaseMap) -> str:
    """Return why most of the pixels without a phase have none."""
    shares = phase.shares()
    return max((name for name in shares if name != "valid"), key=lambda name: shares[name])


def _faults(strips: CapturePhase, reference: CapturePhase) -> Iterator[str]:
    """Look for frames in another order, or with equal phase shifts, in either capture."""
    seen: set[FindingKind] = set()
    for phase, beside in ((reference, None), (strips, reference.capture)):
        yield from _faults_of(phase, beside, seen)


def _faults_of(phase: CapturePhase, beside: Capture | None, seen: set[FindingKind]) -> Iterator[str]:
    """Name the findings that cannot be corrected in one capture, except those in `seen`."""
    capture = phase.capture
    frames = capture.read_set(period=shortest_period(capture))
    plate = None if beside is None else beside.read_set(period=shortest_period(beside))
    if plate is not None and plate.shape != frames.shape:
        plate = None
    found = diagnose(frames, capture.phase_shifts_rad, white_level=capture.white_level, reference=plate)
    for finding in found.findings:
        if finding.kind.fatal and finding.kind not in seen:
            seen.add(finding.kind)
            named = f"Capture {capture.name!r}, {finding.kind.text}"
            yield f"{named}: {finding.what} ({finding.how_large}); {finding.remedy}."
