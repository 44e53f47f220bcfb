"""Fringe order from projected Gray code: absolute at every pixel by itself, whatever steps and gaps there are."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fringecal.errors import PhaseError
from fringecal.numerics import TURN

_MOST_BITS = 30  # that an int32 holds with its sign to spare
_CLEAR_BIT = 1 / 8  # of the contrast, off the middle: blur at a bit's edge passes through what lies nearer


def decode_gray(
    frames: ArrayLike, white: ArrayLike, black: ArrayLike, *, least_contrast: float = 5.0
) -> tuple[NDArray[np.int32], NDArray[np.bool_]]:
    """Decode Gray-code frames.

    Parameters
    ----------
    frames
        Grey values, (K, H, W), the most significant bit first; bright is 1.
    white, black
        The same scene fully lit and unlit, (H, W).
    least_contrast
        Grey levels between white and black that a pixel needs; with 5, an eighth of it is more than half a level of
        rounding.

    Returns
    -------
    code, valid
        The number, int32, (H, W), and True where it can be trusted: enough contrast, and every bit at least an
        eighth of it away from the middle.

    Raises
    ------
    PhaseError
        Frames of different size, or more than 30 bits.

    Examples
    --------
    >>> bits = np.array([[0, 0, 1, 1], [0, 1, 1, 0]])[:, None] * 200
    >>> decode_gray(bits, np.full((1, 4), 200), np.zeros((1, 4)))[0].tolist()
    [[0, 1, 2, 3]]
    """
    grey = np.asarray(frames)
    light, dark = np.asarray(white, np.float32), np.asarray(black, np.float32)
    if grey.ndim != 3 or grey.shape[1:] != light.shape or light.shape != dark.shape or not 1 <= len(grey) <= _MOST_BITS:
        raise PhaseError(
            f"found Gray-code frames of shape {grey.shape}, white {light.shape}, black {dark.shape}; "
            f"needed: (bits, height, width) with 1 to {_MOST_BITS} bits, and two pictures of the same size"
        )
    middle, contrast = (light + dark) / 2, light - dark
    valid = contrast >= least_contrast
    code = np.zeros(light.shape, np.int32)
    bit = np.zeros(light.shape, np.int32)
    for frame in grey:
        bit ^= (frame > middle).astype(np.int32)  # binary from Gray: each bit is the sum of all above it
        code = 2 * code + bit
        valid &= np.abs(frame - middle) > _CLEAR_BIT * contrast
    return code, valid


def unwrap_gray(phase: ArrayLike, code: ArrayLike, *, half_code: ArrayLike | None = None) -> NDArray[np.float64]:
    """Give a wrapped phase the order that a Gray code states.

    Parameters
    ----------
    phase
        Wrapped phase in (-pi, pi], rad, (H, W), zero in the middle of each fringe of the code.
    code
        Fringe number, (H, W), changing where the phase jumps.
    half_code
        Complementary code, (H, W): numbers half fringes, `2 code` in the first half of a fringe and
        `2 code + 1` in the second. With it no pixel beside a jump is wrong: edges of the code and jumps of the
        phase never fall on the same pixel exactly.

    Returns
    -------
    numpy.ndarray
        `phase + 2 pi k`, rad, float64; NaN where the phase is.

    Notes
    -----
    k = code in the middle half of a fringe. Within a quarter of the jump `code` may be off by one and
    `half_code`, whose edges lie in the middle, decides: k = (half_code + 1) // 2 at phases below -pi/2 and
    that minus 1 above pi/2 (Zhang et al., Opt. Lasers Eng. 50 (2012) 574).

    Raises
    ------
    PhaseError
        Maps of different shape.
    """
    wrapped, number = np.asarray(phase, np.float64), np.asarray(code, np.float64)
    if wrapped.shape != number.shape:
        raise PhaseError(f"the phase has shape {wrapped.shape}, the code {number.shape}: they must be equal")
    if half_code is None:
        return wrapped + TURN * number
    half = np.asarray(half_code, np.float64)
    if half.shape != wrapped.shape:
        raise PhaseError(f"the phase has shape {wrapped.shape}, the half code {half.shape}: they must be equal")
    between = np.floor((half + 1) / 2)
    order = np.where(wrapped < -np.pi / 2, between, np.where(wrapped > np.pi / 2, between - 1, number))
    return wrapped + TURN * order
