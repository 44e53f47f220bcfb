"""A capture's frames become a phase map: with the steps as stated, or as the frames show them."""

import math
from dataclasses import dataclass

import numpy as np

from fringecal.errors import PhaseError, SessionError
from fringecal.phase.demodulate import PhaseMap, demodulate
from fringecal.phase.steps import StepEstimate, estimate_steps
from fringecal.session import Capture


@dataclass(frozen=True)
class CapturePhase:
    """The phase of one capture, the steps used and what the frames say of the steps.

    `estimated` is None where the frames say nothing, with the reason in `note`.
    """

    capture: Capture
    map: PhaseMap
    steps_rad: tuple[float, ...]
    estimated: StepEstimate | None
    note: str = ""

    @property
    def used(self) -> str:
        """Which steps were used: "stated" or "estimated"."""
        return "stated" if self.steps_rad == tuple(self.capture.steps_rad) else "estimated"

    def sentence(self) -> str:
        """Say plainly which steps were used and why."""
        stated = ", ".join(f"{math.degrees(s):.1f}" for s in self.capture.steps_rad)
        name = self.capture.name
        if self.used == "stated":
            return f"{name}: steps as stated ({stated} deg){'; ' + self.note if self.note else ''}."
        used = ", ".join(f"{math.degrees(s):.2f}" for s in self.steps_rad)
        return f"{name}: the frames do not fit the stated steps ({stated} deg); {used} deg were used."


def phase_of_capture(capture: Capture, *, set_number: int = 0) -> CapturePhase:
    """Demodulate a capture, with steps estimated from its frames where the stated ones do not fit.

    Parameters
    ----------
    capture
        A phase-shifted capture.
    set_number
        Which fringe period of a multi-frequency capture.

    Raises
    ------
    SessionError
        The capture has no steps.
    PhaseError
        The frames hold no phase.
    """
    if not capture.steps_rad:
        raise SessionError(
            [f"capture {capture.name!r}: no phase steps; state steps_deg under [phase] or in the capture"]
        )
    frames = capture.read_set(period=set_number)
    estimate, note = _estimated(frames, capture)
    steps = tuple(capture.steps_rad)
    if estimate is not None and estimate.significant:
        steps = tuple(float(s) for s in estimate.steps_rad)
    phase_map = demodulate(frames, steps, white_level=capture.white_level)
    if not phase_map.valid.any():
        raise PhaseError(
            f"capture {capture.name!r}: no pixel carries fringes ({_why(phase_map)}). Check lamp, focus and exposure, "
            "and that the frames are those of a phase-shifted set."
        )
    return CapturePhase(capture, phase_map, steps, estimate, note)


def _estimated(frames: np.ndarray, capture: Capture) -> tuple[StepEstimate | None, str]:
    try:
        return estimate_steps(frames, capture.steps_rad, white_level=capture.white_level), ""
    except PhaseError as error:
        return None, f"they could not be checked ({str(error).split('.')[0].rstrip(',;:')})"


def _why(phase_map: PhaseMap) -> str:
    shares = {name: share for name, share in phase_map.shares().items() if name != "valid" and share > 0}
    return ", ".join(f"{name.replace('_', ' ')} {100 * share:.0f} %" for name, share in shares.items())
