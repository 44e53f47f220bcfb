"""From phase-shifted frames to wrapped phase, with a standard uncertainty and a reason at every pixel."""

from dataclasses import dataclass
from enum import IntFlag

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fringecal.errors import PhaseError
from fringecal.phase.demodulation import pixel_kernels as kernels
from fringecal.phase.demodulation.noise import LEAST_SIDE_PX, ROUNDING_SIGMA, Noise, estimate_noise
from fringecal.phase.demodulation.schemes import Scheme, least_squares
from fringecal.phase.orders.multi_period import FringeOrders

MAX_SIGMA_RAD = 0.25
"""Noise alone passes the test of modulation in a share exp(-1/(2 u^2)) of fringeless pixels: 0.03 %."""

MIN_MODULATION_LEVELS = 3.0
"""Least modulation of integer frames: below it, rounding is no longer like noise."""

MIN_MODULATION_SHARE = 0.05
"""Least modulation as a share of what the picture's better part has (95th percentile): below it, stray light
and the ringing of compressed pictures, whose noise cannot be seen between neighbours, look like fringes."""

RESIDUAL_SIGMAS, RESIDUAL_SHARE = 5.0, 0.15
"""An rms residual is too large beyond five sigma and beyond 15 % of the modulation; a projector's gamma is less."""

TYPICAL_PERCENTILE = 95
"""Percentile of a picture's modulation or brightness that stands for its better part: no hot pixel, no shadow."""

_DARK_SIGMAS = 4.0  # standard deviations of the read noise: a background below may as well be none
_LEAST_MODULATION = 1e-15  # squares of less are lost in float32
_SAMPLES_ALONG = 100  # along each axis of the sparse sample: 10 000 pixels know a percentile to 1 %
_LEAST_VARIANCE = 1e-3  # of the constant variance of C and S, below which rounding in float32 may bring a difference


class Reason(IntFlag):
    """Why a pixel carries no phase; the flags of `PhaseMap.reasons`, 0 = valid."""

    SATURATED = kernels.SATURATED
    DARK = kernels.DARK
    LOW_MODULATION = kernels.LOW_MODULATION
    OUTSIDE = kernels.OUTSIDE
    MISFIT = kernels.MISFIT


@dataclass(frozen=True)
class PhaseMap:
    """A demodulated set of frames; all maps are (H, W).

    Parameters
    ----------
    phase
        Wrapped phase in (-pi, pi], rad, float32; NaN where masked.
    modulation, background
        B and A of `I = A + B cos(phi + delta)`, grey levels, float32.
    sigma
        u(phi), the random part, rad, float32; NaN where masked.
    reasons
        Flags of `Reason`, uint8; 0 = valid.
    noise
        The camera's noise that `sigma` follows from.
    orders
        Orders of the fringes where further periods of the same scene decide them.
    """

    phase: NDArray[np.float32]
    modulation: NDArray[np.float32]
    background: NDArray[np.float32]
    sigma: NDArray[np.float32]
    reasons: NDArray[np.uint8]
    noise: Noise
    orders: FringeOrders | None = None

    @property
    def valid(self) -> NDArray[np.bool_]:
        """Return the mask of pixels that carry a phase."""
        return self.reasons == 0

    def shares(self) -> dict[str, float]:
        """Return the share of valid pixels and of each reason (a pixel may have several)."""
        flags = {reason.name or "": float((self.reasons & reason).astype(bool).mean()) for reason in Reason}
        return {"valid": float(self.valid.mean())} | {name.lower(): share for name, share in flags.items()}


def demodulate(
    frames: ArrayLike,
    phase_shifts_rad: ArrayLike | Scheme,
    *,
    white_level: float | None = None,
    dark_level: float | None = None,
    noise: Noise | None = None,
    min_modulation: float | None = None,
    max_residual: float = RESIDUAL_SHARE,
    out: PhaseMap | None = None,
) -> PhaseMap:
    """Demodulate N phase-shifted frames by least squares, or by a named scheme.

    Parameters
    ----------
    frames
        Grey values, (N, H, W), N >= 3: uint8 and uint16 are read as they are, others as float32.
    phase_shifts_rad
        Phase shifts delta_n in frame order, rad, (N,), or a `Scheme`.
    white_level
        Grey value of saturation; by default the largest of an integer type, none for floats.
    dark_level
        Background below which a pixel is dark, grey levels; by default four sigma of the noise.
    noise
        The camera's noise; by default estimated from the frames.
    min_modulation
        Least modulation, grey levels; by default 5 % of the 95th percentile over the picture, and 3 for
        integers. In any case u(phi) <= 0.25 rad.
    max_residual
        Rms residual of four frames and more, as a share of the modulation, that a pixel may have (it may have
        five sigma of the noise in any case); infinity to keep all.
    out
        A `PhaseMap` of the same shape whose buffers are overwritten and returned in the answer.

    Notes
    -----
    With weights `w` of C = B cos(phi) and S = B sin(phi) and var(I) = gain I + r^2 at each frame's own I:
    `u^2(phi) = sum_n (cos(phi) wS_n - sin(phi) wC_n)^2 var(I_n) / B^2`; for N equal phase shifts and white noise
    this is `sqrt(2/N) sigma/B`. Valid while u(phi) is well below 1 rad.

    Raises
    ------
    PhaseError
        Shapes that do not fit together, or phase shifts that determine no phase.

    Examples
    --------
    >>> delta = np.deg2rad([0, 120, 240])
    >>> frames = 100 + 50 * np.cos(0.7 + delta)[:, None, None] * np.ones((3, 4, 4))
    >>> map_ = demodulate(frames, delta, noise=Noise(1.0))
    >>> f"{map_.phase[0, 0]:.4f} rad, B = {map_.modulation[0, 0]:.2f}, u = {map_.sigma[0, 0]:.5f} rad"
    '0.7000 rad, B = 50.00, u = 0.01633 rad'
    """
    scheme = phase_shifts_rad if isinstance(phase_shifts_rad, Scheme) else least_squares(phase_shifts_rad)
    grey = _as_frames(frames, len(scheme.phase_shifts_rad))
    white = _white_level(grey.dtype, white_level)
    if noise is None:
        noise = _noise_of(grey, scheme, white)
    if min_modulation is None:
        min_modulation = least_modulation(grey, scheme)
    read_sigma = float(noise.read_sigma)
    limits = kernels.Limits(
        _brightest(grey.dtype, white),
        np.float32(_DARK_SIGMAS * read_sigma if dark_level is None else dark_level),
        np.float32(max(min_modulation, _LEAST_MODULATION)),
        np.float32(MAX_SIGMA_RAD),
        np.float32(RESIDUAL_SIGMAS * noise.sigma(_typical_grey(grey))),
        np.float32(max_residual),
    )
    result = _buffers(grey.shape[1:], noise, out)
    _run(grey, scheme, limits, result)
    return result


def _as_frames(frames: ArrayLike, n_steps: int) -> NDArray:
    """Return frames as a contiguous (N, H, W) array of uint8, uint16 or float32."""
    grey = np.asarray(frames)
    if grey.ndim != 3 or grey.shape[0] != n_steps or 0 in grey.shape:
        raise PhaseError(
            f"found frames of shape {grey.shape} for {n_steps} phase shifts; needed: ({n_steps}, height, width), "
            "one frame per phase shift and none empty"
        )
    if grey.dtype.kind not in "uif":
        raise PhaseError(f"found frames of type {grey.dtype}; grey values must be integers or real numbers")
    if grey.dtype not in (np.uint8, np.uint16):
        grey = grey.astype(np.float32)
    return np.ascontiguousarray(grey)


def _white_level(dtype: np.dtype, white_level: float | None) -> float:
    """Return the stated saturation, or that of the type."""
    if white_level is not None:
        return float(white_level)
    return float(np.iinfo(dtype).max) if np.issubdtype(dtype, np.integer) else np.inf


def _brightest(dtype: np.dtype, white_level: float) -> np.uint8 | np.uint16 | np.float32:
    """Return the largest grey value that is not saturated, of the frames' own type."""
    if not np.issubdtype(dtype, np.integer):
        return np.nextafter(np.float32(white_level), np.float32(-np.inf))
    return dtype.type(np.clip(np.ceil(white_level) - 1, 0, np.iinfo(dtype).max))


def _noise_of(grey: NDArray, scheme: Scheme, white_level: float) -> Noise:
    """Estimate the noise; pictures too small for that get the noise of rounding."""
    if min(grey.shape[1:]) < LEAST_SIDE_PX:
        return Noise(ROUNDING_SIGMA if np.issubdtype(grey.dtype, np.integer) else 0.0)
    return estimate_noise(grey, scheme, white_level=white_level)


def single_precision(phase_rad: NDArray) -> NDArray[np.float32]:
    """Return wrapped phase as float32 in (-pi, pi]: where rounding reaches -pi, it becomes pi."""
    single = phase_rad.astype(np.float32)
    single[single <= -np.float32(np.pi)] = np.float32(np.pi)
    return single


def least_modulation(grey: NDArray, scheme: Scheme) -> float:
    """Return the modulation below which fringes are not believed, from a sparse sample of the picture."""
    sample = _sparse(grey).astype(np.float32)
    cosine, sine = np.tensordot(scheme.weights[1:].astype(np.float32), sample, axes=1)
    modulation = np.hypot(cosine, sine)
    finite = modulation[np.isfinite(modulation)]
    typical = float(np.percentile(finite, TYPICAL_PERCENTILE)) if finite.size else 0.0
    floor = MIN_MODULATION_LEVELS if np.issubdtype(grey.dtype, np.integer) else 0.0
    return max(floor, MIN_MODULATION_SHARE * typical)


def _sparse(grey: NDArray) -> NDArray:
    """Return every so many rows and columns: some 100 of each."""
    strides = [max(1, length // _SAMPLES_ALONG) for length in grey.shape[1:]]
    return grey[:, :: strides[0], :: strides[1]]


def _typical_grey(grey: NDArray) -> float:
    """Return the mean grey value of a sparse sample; enough for the level of the residuals' test."""
    mean = float(np.mean(_sparse(grey), dtype=np.float64))
    return mean if np.isfinite(mean) else 0.0


def _buffers(shape: tuple[int, ...], noise: Noise, out: PhaseMap | None) -> PhaseMap:
    """Return fresh maps, or the caller's."""
    if out is None:
        phase, modulation, background, sigma = (np.empty(shape, np.float32) for _ in range(4))
        return PhaseMap(phase, modulation, background, sigma, np.empty(shape, np.uint8), noise)
    if out.phase.shape != shape:
        raise PhaseError(f"out has maps of shape {out.phase.shape}; the frames are {shape}")
    return PhaseMap(out.phase, out.modulation, out.background, out.sigma, out.reasons, noise)


def _run(grey: NDArray, scheme: Scheme, limits: kernels.Limits, result: PhaseMap) -> None:
    """Prepare the kernel's small tables and call it on flat views."""
    noise, w = result.noise, scheme.weights
    products = np.stack([w[1] * w[1], w[2] * w[2], w[1] * w[2]])
    constant = noise.read_sigma**2 * products.sum(axis=1)
    least = _LEAST_VARIANCE * min(constant[0], constant[1])
    rows = np.column_stack([w, scheme.zero])
    shot = np.column_stack([noise.gain * products, np.zeros(3)])
    kernels.demodulate_full(
        grey.reshape(len(grey), -1),
        np.concatenate([rows, shot] if noise.gain else [rows]).astype(np.float32),
        scheme.model.astype(np.float32),
        np.array([*constant, least], np.float32),
        limits,
        result.phase.reshape(-1),
        result.modulation.reshape(-1),
        result.background.reshape(-1),
        result.sigma.reshape(-1),
        result.reasons.reshape(-1),
    )
