"""What one phase-shifted set shows in one look: phase map, mask, noise, period, and its real steps."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from fringecal.errors import PhaseError
from fringecal.phase.demodulate import PhaseMap, demodulate
from fringecal.phase.period import FringePeriod, fringe_period
from fringecal.phase.steps import StepEstimate, estimate_steps


@dataclass(frozen=True)
class PhaseSummary:
    """A demodulated set and what can be said of it.

    Parameters
    ----------
    map
        The phase map.
    period
        Median fringe period, or None where there are no fringes.
    steps
        Steps found from the frames, or None where the scene does not allow it.
    notes
        Why something is missing, one sentence each.
    """

    map: PhaseMap
    period: FringePeriod | None
    steps: StepEstimate | None
    notes: tuple[str, ...]

    @property
    def median_modulation(self) -> float:
        """Return the median modulation of the valid pixels, grey levels; 0 if there are none."""
        return float(np.median(self.map.modulation[self.map.valid])) if self.map.valid.any() else 0.0

    @property
    def median_sigma_rad(self) -> float:
        """Return the median u(phi) of the valid pixels, rad; pi/sqrt(3), no knowledge, if there are none."""
        valid = self.map.valid
        return float(np.median(self.map.sigma[valid])) if valid.any() else float(np.pi / np.sqrt(3))


def summarise(frames: ArrayLike, steps_rad: ArrayLike, *, white_level: float | None = None) -> PhaseSummary:
    """Demodulate one set with its stated steps and look at fringe period and actual steps.

    Parameters
    ----------
    frames
        Grey values, (N, H, W).
    steps_rad
        Stated steps, rad, (N,).
    white_level
        Saturation, grey levels.

    Raises
    ------
    PhaseError
        Frames and steps that do not fit, as in `demodulate`; a scene without fringes is not an error.
    """
    map_ = demodulate(frames, steps_rad, white_level=white_level)
    notes = []
    period, steps = None, None
    try:
        period = fringe_period(map_.phase, map_.valid)
        steps = estimate_steps(frames, steps_rad, white_level=white_level)
    except PhaseError as error:
        notes.append(str(error))
    return PhaseSummary(map_, period, steps, tuple(notes))
