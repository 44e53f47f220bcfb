"""What the spectra of a set's frames say of one another."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class FrameSpectra:
    """Spectra of the frames, compared.

    Parameters
    ----------
    apart
        1 less the overlap of two frames' amplitudes, 0 for the same fringes at any phase shift, (N, N).
    period_px
        Period of each frame's highest peak, px, (N,).
    fringed
        Whether most of its power lies near that peak, (N,).
    cycles_per_frame
        Cycles along the picture of the same, (N,).
    """

    apart: NDArray[np.float64]
    period_px: NDArray[np.float64]
    fringed: NDArray[np.bool_]
    cycles_per_frame: NDArray[np.float64]

    @property
    def cycles(self) -> float:
        """Return the median of the frames' cycles: fringes in the picture."""
        return float(np.median(self.cycles_per_frame))
