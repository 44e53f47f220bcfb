"""How phases of neighbouring pixels scatter: what their stated noise says, if every pixel has noise of its own."""

import numpy as np
from numpy.typing import NDArray

from fringecal.numerics import MAD_TO_SD, wrap
from fringecal.phase.demodulation.demodulate import PhaseMap

_SECOND_DIFFERENCE_SD = 6**0.5  # of independent noise of unit standard deviation: 1 + 4 + 1
_SAMPLES = 40_000
_LEAST = 1000  # pixels: a median known to 4 %


def neighbour_scatter(
    seen: PhaseMap, v_px: NDArray[np.intp] | None = None, u_px: NDArray[np.intp] | None = None
) -> tuple[float, float]:
    """Return the scatter of neighbours' phases over what their uncertainty says, and its standard uncertainty.

    It is 1 where noise differs from pixel to pixel and its size is right. Smoothed, compressed and interpolated
    pictures share noise between neighbours: their scatter is no longer what the noise says.

    Parameters
    ----------
    seen
        A phase map.
    v_px, u_px
        Rows and columns of the pixels to look at, (n,), on a smooth surface; evenly over the picture by default.

    Returns
    -------
    tuple of float
        NaN and infinity where too few pixels are seen.

    Notes
    -----
    The median of `|phi(u-1) - 2 phi(u) + phi(u+1)| / u(phi)` over `sqrt(6) / 1.4826`.
    """
    v, u = _even(seen.phase.shape) if v_px is None or u_px is None else (v_px, u_px)
    inside = (u > 0) & (u < seen.phase.shape[1] - 1)
    v, u = v[inside], u[inside]
    bend = seen.phase[v, u - 1] - 2 * seen.phase[v, u] + seen.phase[v, u + 1]
    scores = np.abs(np.asarray(wrap(bend))) / seen.sigma[v, u]
    scores = scores[np.isfinite(scores)]
    if scores.size < _LEAST:
        return float("nan"), float("inf")
    scatter = float(np.median(scores)) * MAD_TO_SD / _SECOND_DIFFERENCE_SD
    return scatter, scatter * 1.2 / float(np.sqrt(scores.size))


def _even(shape: tuple[int, ...]) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    stride = max(1, int(np.sqrt(shape[0] * shape[1] / _SAMPLES)))
    v, u = np.mgrid[: shape[0] : stride, : shape[1] : stride]
    return v.ravel(), u.ravel()
