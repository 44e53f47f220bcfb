"""Whether frames were compressed in squares of 8 px, as JPEG does, after which neighbouring pixels tell no noise."""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray
from scipy import fft

from fringecal.phase.diagnostics.evidence import Evidence, Finding
from fringecal.phase.diagnostics.finding_kinds import FindingKind

_SIDE = 8  # px, of the squares in which JPEG compresses
_FINE = np.add.outer(np.arange(_SIDE), np.arange(_SIDE)) >= _SIDE  # the finer half of a square's cosines
_MOST = 3_000  # squares of a frame that are looked at: a mean over so many is known to a per cent
_LEAST = 60  # below which nothing is said
_USUAL = 0.3  # quantile of squares that lie athwart, up to which a square's power counts: an edge counts as that
_ROUNDING = 1 / 12  # grey levels squared: what rounding alone leaves in each cosine, unless the squares were flattened
_FLAT = 0.06  # of that, on average, below which squares were flattened


def square_contrast(frames: NDArray) -> float:
    """Return how much more fine power squares of 8 px hold where they lie athwart the frames' own, 1 if there are none.

    JPEG leaves out fine cosines within each square of 8 px that begins at multiples of 8. A square that lies across
    two or four of these holds the steps between them: its fine power is larger. Where nothing was compressed, squares
    are alike wherever they begin, edges and ridges included. The power over each of the seven other places along either
    axis is compared with that in place; the smallest ratio of each axis counts, and their geometric mean is returned,
    so that strips whose distance is a multiple of 8 px look like nothing of the kind.

    Parameters
    ----------
    frames
        Grey levels, (N, H, W), at their own pixels: neither cut out nor turned since they were compressed.

    Returns
    -------
    ratio
        0.99 to 1.02 for frames as the camera gives them; 1.1 and more after JPEG of a quality of 95 and less; infinite
        where squares hold less than rounding leaves. NaN for pictures that are too small.
    """
    athwart = _fine_power(frames, _SIDE // 2, _SIDE // 2)
    if athwart.size < _LEAST:
        return float("nan")
    most = max(float(np.quantile(athwart, _USUAL)), _ROUNDING / 2)

    def typical(right: int, down: int) -> float:
        return float(np.minimum(_fine_power(frames, right, down), most).mean())

    own = typical(0, 0)
    if own < _FLAT * _ROUNDING:
        return float("inf")
    across = min(typical(k, 0) for k in range(1, _SIDE)) / own
    down = min(typical(0, k) for k in range(1, _SIDE)) / own
    return float(np.sqrt(across * down))


def _fine_power(frames: NDArray, right: int, down: int) -> NDArray[np.float64]:
    """Mean power of the finer cosines of squares that begin so many px to the right and down, of all frames."""
    height, width = ((n - _SIDE + 1) // _SIDE for n in frames.shape[1:])
    step = max(1, int(np.sqrt(height * width / _MOST)))
    shown = frames[:, down : down + height * _SIDE, right : right + width * _SIDE]
    squares = shown.reshape(len(frames), height, _SIDE, width, _SIDE)[:, ::step, :, ::step].astype(np.float32)
    cosines = fft.dctn(squares, axes=(2, 4), norm="ortho").swapaxes(2, 3)
    return np.asarray(np.mean(cosines[..., _FINE] ** 2, axis=-1), np.float64).ravel()


def compressed(evidence: Evidence) -> Iterator[Finding]:
    """Find squares of 8 px in which noise is missing: u(phase), from neighbouring pixels, is too small."""
    contrast = evidence.square_contrast
    if contrast is None or not contrast > evidence.limits.square_contrast:
        return
    found = evidence.phase_shifts
    cost, by = None, ""
    if found is not None:
        cost = float(np.sqrt(2 / len(evidence.phase_shifts_rad)) * found.quiet_noise / found.modulation_level)
        noise = float(evidence.map.noise.sigma(found.background_level))
        by = f", by about {found.quiet_noise / noise:.1f} times"
    yield Finding(
        FindingKind.COMPRESSED,
        "squares of 8 px hold less noise than pixels across their borders: the frames were compressed (JPEG)",
        f"{contrast:.2f} times less, and u(phase), which rests on neighbouring pixels, is too small{by}",
        cost,
        "keep the camera's frames without loss (PNG, TIFF, raw); a JPEG file that was saved as PNG stays what it was",
    )
