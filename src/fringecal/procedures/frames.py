"""A capture's frames become a phase map: with the model as stated, or as the frames show it."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fringecal.errors import PhaseError, SessionError
from fringecal.phase.adapted import Adapted, demodulate_adapted
from fringecal.phase.demodulate import PhaseMap
from fringecal.phase.repeats import mean_of_repeats
from fringecal.phase.steps import StepEstimate
from fringecal.phase.waveform import Waveform
from fringecal.session import Capture


@dataclass(frozen=True)
class CapturePhase:
    """The phase of one capture, and how its frames differ from what is stated of them."""

    capture: Capture
    adapted: Adapted

    @property
    def map(self) -> PhaseMap:
        """The phase map, corrected."""
        return self.adapted.map

    @property
    def steps_rad(self) -> tuple[float, ...]:
        """Steps that were used, rad."""
        return self.adapted.scheme.steps_rad

    @property
    def estimated(self) -> StepEstimate | None:
        """What the frames say of the steps; None where they say nothing, with the reason in the notes."""
        return self.adapted.steps

    @property
    def used(self) -> str:
        """Which steps were used: "stated" or "estimated"."""
        return "stated" if self.steps_rad == tuple(self.capture.steps_rad) else "estimated"

    def sentence(self) -> str:
        """Say plainly which model was used and why."""
        stated = ", ".join(f"{math.degrees(s):.1f}" for s in self.capture.steps_rad)
        notes = "".join(f"; {note}" for note in self.adapted.notes)
        if not self.adapted.undone:
            return f"{self.capture.name}: steps as stated ({stated} deg){notes}."
        undone = "; ".join(self.adapted.undone)
        return f"{self.capture.name}: the frames do not fit the stated model ({stated} deg): {undone}{notes}."


def phase_of_capture(capture: Capture, *, set_number: int = 0, wave: Waveform | None = None) -> CapturePhase:
    """Demodulate a capture; where the stated steps, even light and cosine do not fit, as its frames show them.

    Parameters
    ----------
    capture
        A phase-shifted capture.
    set_number
        Which fringe period of a multi-frequency capture.
    wave
        Shape of the fringes as found on the bare plate.

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
    frames = frames_of(capture, period=set_number)
    adapted = demodulate_adapted(frames, capture.steps_rad, white_level=capture.white_level, wave=wave)
    if not adapted.map.valid.any():
        raise PhaseError(
            f"capture {capture.name!r}: no pixel carries fringes ({_why(adapted.map)}). Check lamp, focus and "
            "exposure, and that the frames are those of a phase-shifted set."
        )
    return CapturePhase(capture, adapted)


def frames_of(capture: Capture, *, period: int = 0) -> NDArray[np.generic]:
    """Return the frames of one fringe period: as taken, or the mean of the repeats."""
    if capture.repeat < 2:
        return capture.read_set(period=period)
    sets = np.stack([capture.read_set(repeat=k, period=period) for k in range(capture.repeat)])
    return mean_of_repeats(sets, white_level=capture.white_level)


def _why(phase_map: PhaseMap) -> str:
    shares = {name: share for name, share in phase_map.shares().items() if name != "valid" and share > 0}
    return ", ".join(f"{name.replace('_', ' ')} {100 * share:.0f} %" for name, share in shares.items())
