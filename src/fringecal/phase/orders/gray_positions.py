"""Where a pixel lies in a Gray code, between the edges of its bits: blurred edges are read as places, not as doubts."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fringecal.errors import PhaseError

_MOST_BITS = 30  # that an int32 holds with its sign to spare
_LEAST_CONTRAST = 5.0  # grey levels between white and black: less is rounding and noise
_OPPOSITE = -0.8  # correlation of a frame with its complement, below; blurred and noisy complements still pass
_NO_RANGE = 1e-6  # instead of a division by 0
_BINS = 256  # of brightness, for the threshold: each is narrower than noise
_RANGE = (0.5, 99.5)  # percentiles of brightness between which the threshold lies: no glint decides


def gray_positions(
    frames: ArrayLike, background: NDArray, modulation: NDArray
) -> tuple[NDArray[np.int32], NDArray[np.float32], NDArray[np.bool_], int]:
    """Decode Gray-code frames to numbers, and to where between its edges each pixel lies.

    Parameters
    ----------
    frames
        Grey values, (K, H, W), the most significant bit first, bright is 1; or each bit followed by its complement, or
        all complements after all bits.
    background, modulation
        Those of the fringes, (H, W), grey levels: what a pixel's light and surface make of any pattern.

    Returns
    -------
    code, position, valid, bits
        Number, int32; position, float32: whole at the edges of a number, number + 1/2 clear of them; where the light
        suffices; number of bits.

    Notes
    -----
    Black and white of the code are the two heaps of (I - A) / B over all pixels and frames, the threshold lies midway:
    a projector's response moves A and B from there, blur makes B smaller, and neither shifts it. With complements the
    threshold is where both are equal. Between numbers n and n + 1 a Gray code changes one bit; with t its brightness
    off the threshold, from -1/2 to 1/2, the position is n + 1/2 + (a_upper - a_lower) / 2 with a = 1 - 2 abs(t). At the
    middle of a blurred edge it is the same whichever way the bit falls.

    Raises
    ------
    PhaseError
        Frames of another size than the fringes, or more than 30 bits.
    """
    grey = np.asarray(frames, np.float32)
    if grey.ndim != 3 or grey.shape[1:] != background.shape or not len(grey):
        raise PhaseError(f"found Gray-code frames of shape {grey.shape}, needed (bits, *{background.shape})")
    valid = np.isfinite(background) & (2 * modulation >= _LEAST_CONTRAST)
    scale = np.where(valid, modulation, 1.0).astype(np.float32)
    seen = (grey - np.where(valid, background, 0.0).astype(np.float32)) / scale
    off = _off_threshold(seen, valid)
    if len(off) > _MOST_BITS:
        raise PhaseError(f"found {len(off)} bits of Gray code; {_MOST_BITS} at most are possible")
    code = _numbers(off > 0)
    return (
        code,
        (code + 0.5 + (_nearness(off, code + 1) - _nearness(off, code)) / 2).astype(np.float32),
        valid,
        len(off),
    )


def _off_threshold(seen: NDArray[np.float32], valid: NDArray[np.bool_]) -> NDArray[np.float32]:
    """Return the bits' brightness off the threshold, about -1/2 where black and 1/2 where white, (bits, H, W)."""
    if not valid.any():
        return seen
    half = len(seen) // 2
    for first, second in ((seen[0::2], seen[1::2]), (seen[:half], seen[half:])):
        if len(first) == len(second) and _complementary(first[:, valid], second[:, valid]):
            difference = (first - second) / 2
            _, black, white = _two_heaps(difference[:, valid])
            return np.asarray(difference / max(white - black, _NO_RANGE), np.float32)
    middle, black, white = _two_heaps(seen[:, valid])
    return np.asarray((seen - middle) / max(white - black, _NO_RANGE), np.float32)


def _complementary(first: NDArray, second: NDArray) -> bool:
    """Tell whether frames are dark where their partners are bright; a bit that is the same everywhere adds little."""
    one, other = (part - part.mean(axis=1, keepdims=True) for part in (first, second))
    least = _OPPOSITE * np.sqrt(np.sum(one * one) * np.sum(other * other))
    return bool(np.sum(one * other) < least)


def _two_heaps(values: NDArray) -> tuple[float, float, float]:
    """Return the threshold between two heaps of values, and the median of each: Otsu's, then midway, twice."""
    low, high = np.percentile(values, _RANGE)
    count, edges = np.histogram(values, _BINS, (low, max(high, low + _NO_RANGE)))
    centre = (edges[1:] + edges[:-1]) / 2
    below, total = np.cumsum(count), np.cumsum(count * centre)
    above = below[-1] - below
    with np.errstate(invalid="ignore", divide="ignore"):
        apart = below * above * (total / below - (total[-1] - total) / above) ** 2
    threshold = float(centre[int(np.nanargmax(apart))])
    black = white = threshold
    for _ in range(2):
        black = float(np.median(values[values <= threshold]))
        white = float(np.median(values[values > threshold])) if (values > threshold).any() else threshold
        threshold = (black + white) / 2
    return threshold, black, white


def _numbers(bright: NDArray[np.bool_]) -> NDArray[np.int32]:
    """Return binary numbers from Gray bits: each bit is the sum of all above it."""
    code = np.zeros(bright.shape[1:], np.int32)
    bit = np.zeros(bright.shape[1:], np.int32)
    for one in bright:
        bit ^= one.astype(np.int32)
        code = 2 * code + bit
    return code


def _nearness(off: NDArray[np.float32], edge: NDArray[np.int32]) -> NDArray[np.float32]:
    """Return 1 - 2 abs(t), from 0 to 1, of the bit that changes between numbers `edge` - 1 and `edge`."""
    bits = len(off)
    lowest = edge & -edge  # the power of two that divides it: Gray codes change this bit there
    found = np.zeros(edge.shape, np.float32)
    for k in range(bits):
        at = lowest == 1 << (bits - 1 - k)
        found[at] = np.clip(1 - 2 * np.abs(off[k][at]), 0, 1)
    return found
