"""A capture's frames become a phase map: with the steps as stated, or as the frames show them."""

import math
from dataclasses import dataclass

import numpy as np

from fringecal.errors import SessionError
from fringecal.phase.demodulate import PhaseMap, demodulate
from fringecal.phase.steps import StepEstimate, estimate_steps
from fringecal.session import Capture


@dataclass(frozen=True)
class CapturePhase:
    """The phase of one capture, the steps used and what the frames say of the steps."""

    capture: Capture
    map: PhaseMap
    steps_rad: tuple[float, ...]
    estimated: StepEstimate | None

    @property
    def used(self) -> str:
        """Which steps were used: "stated" or "estimated"."""
        return "stated" if self.steps_rad == tuple(self.capture.steps_rad) else "estimated"

    def sentence(self) -> str:
        """Say plainly which steps were used and why."""
        stated = ", ".join(f"{math.degrees(s):.1f}" for s in self.capture.steps_rad)
        if self.used == "stated":
            return f"{self.capture.name}: steps as stated ({stated} deg)."
        used = ", ".join(f"{math.degrees(s):.2f}" for s in self.steps_rad)
        return f"{self.capture.name}: the frames do not fit the stated steps ({stated} deg); {used} deg were used."


def phase_of_capture(
    capture: Capture, *, plate: bool = False, like: CapturePhase | None = None
) -> CapturePhase:
    """Demodulate a capture, with steps estimated from its frames where the stated ones do not fit.

    Parameters
    ----------
    capture
        A phase-shifted capture.
    plate
        The capture shows a plate over all the picture.
    like
        A capture of the bare plate, taken in the same way.

    Raises
    ------
    SessionError
        The capture has no steps.
    """
    del plate, like
    if not capture.steps_rad:
        raise SessionError(
            [f"capture {capture.name!r}: no phase steps; state steps_deg under [phase] or in the capture"]
        )
    frames = capture.read_set()
    estimate = _estimated(frames, capture)
    steps = tuple(capture.steps_rad)
    if estimate is not None and estimate.significant:
        steps = tuple(float(s) for s in estimate.steps_rad)
    phase_map = demodulate(frames, steps, white_level=capture.white_level)
    return CapturePhase(capture, phase_map, steps, estimate)


def _estimated(frames: np.ndarray, capture: Capture) -> StepEstimate | None:
    return estimate_steps(frames, capture.steps_rad)
