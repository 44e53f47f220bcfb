"""What the diagnostics look at, and what they say of it."""

from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fringecal.numerics import TURN
from fringecal.phase.demodulation.blocks import Block
from fringecal.phase.demodulation.demodulate import TYPICAL_PERCENTILE, PhaseMap
from fringecal.phase.demodulation.fringe_period import FringePeriod
from fringecal.phase.demodulation.phase_shifts import PhaseShiftEstimate
from fringecal.phase.demodulation.waveform import Waveform
from fringecal.phase.diagnostics.finding_kinds import FindingKind
from fringecal.phase.diagnostics.finding_limits import FINDING_LIMITS, FindingLimits
from fringecal.phase.diagnostics.frame_spectra import FrameSpectra

_SAMPLES_ALONG = 160  # along each axis of the sparse sample: 25 000 pixels
_LIT = 0.2  # of the picture's better part, above which a pixel is lit


@dataclass(frozen=True)
class Finding:
    """One thing that is wrong.

    Parameters
    ----------
    kind
        What it is.
    what
        What the frames show.
    how_large
        Its size, in words and numbers.
    cost_rad
        What it does to the phase, rms over a fringe, rad; None where pixels are lost rather than wrong.
    remedy
        What to do.
    cost_mm
        The same as height, mm, where the scale is known.
    """

    kind: FindingKind
    what: str
    how_large: str
    cost_rad: float | None
    remedy: str
    cost_mm: float | None = None

    def document(self) -> dict[str, Any]:
        """Return it as files hold it, its kind under the key `name`."""
        fields = asdict(self)
        return {"name": fields.pop("kind").value, **fields}


@dataclass(frozen=True)
class Evidence:
    """What the tests look at; what could not be measured is None or empty.

    Parameters
    ----------
    frames
        Sparse sample of the lit part of the picture, grey levels, (N, M).
    phase_shifts_rad
        Stated phase shifts, rad, (N,).
    map
        The set demodulated with them.
    period, phase_shifts, blocks, wave
        As measured.
    reference, reference_period
        The same sample of the reference frames, (N, M), and their fringe period.
    limits
        From which size on a fault is named.
    spectra
        The frames' spectra, compared; None where the pictures are too small.
    white_level
        Grey level of saturated pixels; None where it is not known.
    of_several
        Whether the set is one of the longer periods of several.
    square_contrast
        Fine power of squares of 8 px athwart over that of squares in place; None where not measured.
    """

    frames: NDArray[np.float64]
    phase_shifts_rad: NDArray[np.float64]
    map: PhaseMap
    period: FringePeriod | None = None
    phase_shifts: PhaseShiftEstimate | None = None
    blocks: list[Block] = field(default_factory=list)
    wave: Waveform | None = None
    reference: NDArray[np.float64] | None = None
    reference_period: FringePeriod | None = None
    limits: FindingLimits = FINDING_LIMITS
    spectra: FrameSpectra | None = None
    white_level: float | None = None
    of_several: bool = False
    square_contrast: float | None = None

    @property
    def fringes(self) -> float:
        """Return the fringes in the picture: by their period, or by the highest peak of the frames' spectra."""
        by_spectrum = 0.0 if self.spectra is None else self.spectra.cycles
        if self.period is None:
            return by_spectrum
        height, width = self.map.phase.shape
        along_u, along_v = np.abs(self.period.gradient_rad_px)
        return max(by_spectrum, float(width * along_u + height * along_v) / TURN)


def sparse(frames: NDArray) -> NDArray[np.float64]:
    """Return every so many pixels that are lit and finite, grey levels, (N, M)."""
    step = max(1, -(-max(frames.shape[1:]) // _SAMPLES_ALONG))
    sample = frames[:, ::step, ::step].reshape(len(frames), -1).astype(np.float64)
    level = sample.mean(axis=0)
    finite = np.isfinite(level)
    if not finite.any():
        return np.zeros((len(sample), 1))
    lit = finite & (level > _LIT * np.percentile(level[finite], TYPICAL_PERCENTILE))
    return sample[:, lit if lit.any() else finite]
