"""Every artefact of a session that took no part in the calibration, measured with that calibration."""

from collections.abc import Callable
from dataclasses import dataclass

from fringecal.errors import FringecalError
from fringecal.projector import RigCalibration
from fringecal.session import Capture, Session
from fringecal.targets import Zigzag
from fringecal.verification import ZigzagErrors
from fringecal.workflows.verify.artefacts import ArtefactVerification, verify_artefact
from fringecal.workflows.verify.run import VERIFIED, Verification, verify

Progress = Callable[[str], None]


@dataclass(frozen=True)
class Verified:
    """The artefacts of a session, measured with its calibration.

    Parameters
    ----------
    bars, artefacts
        Zig-zags and all other artefacts that could be measured.
    failures
        By capture, why an artefact could not be measured.
    """

    bars: tuple[Verification, ...] = ()
    artefacts: tuple[ArtefactVerification, ...] = ()
    failures: tuple[tuple[str, str], ...] = ()

    @property
    def sentences(self) -> tuple[str, ...]:
        """Give the result of each artefact, or why there is none."""
        bars = (f"{one.capture.name}: {_bars_sentence(one.errors)}" for one in self.bars)
        artefacts = (f"{one.capture.name}: {one.sentence}" for one in self.artefacts)
        failed = (f"{name}: not verified: {reason}" for name, reason in self.failures)
        return (*bars, *artefacts, *failed)


def _bars_sentence(errors: ZigzagErrors) -> str:
    ens = [abs(p.en) for p in (*errors.profiles, errors.pooled) if p.en is not None]
    pooled = errors.pooled
    head = f"mean error {pooled.mean_percent:+z.3f} %, largest {pooled.max_percent:.2f} % of the full height"
    if not ens:
        return f"{head}; not judged, since no uncertainty is known."
    return f"{head}; largest |En| {max(ens):.2f}. {errors.sentence}"


def verify_session(session: Session, calibration: RigCalibration, *, progress: Progress = lambda _: None) -> Verified:
    """Measure every artefact that the calibration has not seen; one that cannot be measured stops no other.

    Parameters
    ----------
    session
        A checked session.
    calibration
        The rig as calibrated.
    progress
        Called with a short sentence before each artefact.
    """
    found: list[Verification | ArtefactVerification] = []
    failures = []
    for capture in independent(session):
        progress(f"heights of {capture.name}")
        try:
            found.append(verify_capture(session, capture, calibration))
        except FringecalError as error:
            failures.append((capture.name, str(error)))
    bars = tuple(one for one in found if isinstance(one, Verification))
    artefacts = tuple(one for one in found if isinstance(one, ArtefactVerification))
    return Verified(bars, artefacts, tuple(failures))


def independent(session: Session) -> tuple[Capture, ...]:
    """Return the captures of artefacts with a surface to verify on that the rig is not fitted to."""
    return tuple(
        capture
        for capture in session.find("artefact")
        if isinstance(capture.target, VERIFIED) and capture.use != "calibration"
    )


def verify_capture(
    session: Session, capture: Capture, calibration: RigCalibration
) -> Verification | ArtefactVerification:
    """Measure one artefact as its target asks for, without studies of filters and height models.

    Raises
    ------
    SessionError, PhaseError, DetectionError, FitError
        As `verify` and `verify_artefact`.
    """
    if isinstance(capture.target, Zigzag):
        return verify(session, capture.name, calibration, with_filters=False, with_models=False)
    return verify_artefact(capture, calibration)
