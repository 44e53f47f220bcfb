"""What one phase-shifted set shows in one look: phase map, mask, noise, period, and its real phase shifts."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from fringecal.errors import PhaseError
from fringecal.phase.demodulation.adapted import demodulate_adapted
from fringecal.phase.demodulation.demodulate import PhaseMap
from fringecal.phase.demodulation.fringe_period import FringePeriod, fringe_period
from fringecal.phase.demodulation.phase_shifts import PhaseShiftEstimate
from fringecal.phase.demodulation.waveform import Waveform
from fringecal.phase.diagnostics.evidence import Evidence, sparse
from fringecal.phase.diagnostics.symptoms_frames import misordered
from fringecal.phase.diagnostics.symptoms_scene import frame_spectra, other_scene

LEAST_VALID = 0.005
"""Share of a picture that must carry fringes; noise alone looks like some at one pixel in 2000."""


@dataclass(frozen=True)
class PhaseSummary:
    """A demodulated set and what is known of it.

    Parameters
    ----------
    map
        The phase map.
    period
        Median fringe period, or None where there are no fringes.
    phase_shifts
        Phase shifts found from the frames, or None where the scene does not allow it.
    undone
        What was corrected, one sentence each; empty where the stated model fits.
    notes
        Why something is missing, or what is uncertain, one sentence each.
    wave
        Waveform of the fringes that was used.
    """

    map: PhaseMap
    period: FringePeriod | None
    phase_shifts: PhaseShiftEstimate | None
    undone: tuple[str, ...]
    notes: tuple[str, ...]
    wave: Waveform | None = None

    @property
    def median_modulation(self) -> float:
        """Return the median modulation of the valid pixels, grey levels; 0 if there are none."""
        return float(np.median(self.map.modulation[self.map.valid])) if self.map.valid.any() else 0.0

    @property
    def median_sigma_rad(self) -> float:
        """Return the median u(phi) of the valid pixels, rad; pi/sqrt(3), no knowledge, if there are none."""
        valid = self.map.valid
        return float(np.median(self.map.sigma[valid])) if valid.any() else float(np.pi / np.sqrt(3))


def summarise(
    frames: ArrayLike, phase_shifts_rad: ArrayLike, *, white_level: float | None = None, wave: Waveform | None = None
) -> PhaseSummary:
    """Demodulate one set, correct what its frames show to differ from the stated model, and look at the fringe period.

    Parameters
    ----------
    frames
        Grey values, (N, H, W).
    phase_shifts_rad
        Stated phase shifts, rad, (N,).
    white_level
        Saturation, grey levels.
    wave
        Waveform of the fringes as found on another set of the same projector.

    Raises
    ------
    PhaseError
        Frames and phase shifts that do not fit, as in `demodulate`; a scene without fringes is not an error.

    Examples
    --------
    >>> phase = 2 * np.pi * np.arange(160) / 16 + np.zeros((120, 1))
    >>> shifts = 2 * np.pi * np.arange(4) / 4
    >>> frames = 100 + 60 * np.cos(phase + shifts[:, None, None])
    >>> frames += np.random.default_rng(1).normal(0, 1, frames.shape)
    >>> found = summarise(np.rint(frames).astype(np.uint8), shifts)
    >>> bool(abs(found.period.period_px - 16) < 0.1)
    True
    """
    adapted = demodulate_adapted(frames, phase_shifts_rad, white_level=white_level, wave=wave)
    notes = list(adapted.notes)
    period = None
    try:
        period = fringe_period(adapted.map.phase, adapted.map.valid)
    except PhaseError as error:
        notes = [str(error)]
    return PhaseSummary(adapted.map, period, adapted.phase_shifts, adapted.undone, tuple(notes), adapted.wave)


def demand_phase(summary: PhaseSummary, frames: ArrayLike, phase_shifts_rad: ArrayLike) -> None:
    """Refuse a set without fringes, with frames of another scene, or with frames in another order than stated.

    Raises
    ------
    PhaseError
        With what was found instead.
    """
    phase_shifts = np.asarray(phase_shifts_rad, np.float64).ravel()
    grey = np.asarray(frames)
    evidence = Evidence(sparse(grey), phase_shifts, summary.map, summary.period, spectra=frame_spectra(grey))
    for foreign in other_scene(evidence):
        raise PhaseError(f"{foreign.what} ({foreign.how_large}): {foreign.remedy}")
    swapped = list(misordered(evidence))
    if swapped and not summary.undone:
        raise PhaseError(f"{swapped[0].what} ({swapped[0].how_large}): {swapped[0].remedy}")
    shares = summary.map.shares()
    if shares["valid"] < LEAST_VALID:
        causes = ", ".join(
            f"{k.replace('_', ' ')} {v:.0%}" for k, v in shares.items() if k != "valid" and v >= LEAST_VALID
        )
        raise PhaseError(
            f"{shares['valid']:.2%} of the pixels carry fringes ({causes or 'none'}). Needed: pictures of one scene "
            "with fringes that move by the stated phase shifts; check exposure, projector and the list of pictures"
        )
