"""The phase shifts that the frames really have, found from the frames themselves.

Three frames determine three unknowns per pixel, so a wrong phase shift cannot be seen in any one pixel. It is
seen over a few fringes: there the phase is smooth, while a wrong phase shift makes it ripple. In each block of
the picture the smooth phase is taken as the carrier, and every frame's own phase against it is measured;
what is wrong with the carrier is the same for all frames and drops out of their differences.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import stats

from fringecal.errors import PhaseError
from fringecal.numerics import UNIFORM_SD, median_and_u, robust_sd
from fringecal.phase.demodulation.blocks import BLOCK_FRINGES, Block, measure_blocks
from fringecal.phase.demodulation.demodulate import demodulate
from fringecal.phase.demodulation.noise import Noise

SIGNIFICANT = 4.0
"""Standard uncertainties beyond which a deviation is believed: by chance once in 16 000."""

OUTLIER_SIGMAS = 4.0
"""Robust standard deviations beyond which a block is left out: one good block in 16 000."""

NO_SCATTER = 1e-12
"""Added to limits of outliers, in the unit of the values: perfect pictures have no scatter, only rounding."""

RARE = 1e-4
"""Probability of chance below which the frames are believed against what is stated of them, or blamed."""

_QUIET = 0.2  # share of the blocks that ridges and edges leave smooth on the artefacts of a session
_CHANCE = 0.0027  # three standard deviations of a normal distribution
_LEAST_BLOCKS = 4  # one more than a plane over the field has coefficients
_LEAST_PLACES = 4  # along an axis, for a change of the phase shifts to be seen along it: as above
_PLACES_ALONG = 8  # parts of the picture's length that count as places
_CLEARLY = 0.8  # times the residual of a factor: an offset must explain the backgrounds by a fifth better
_ROUNDS, _CONVERGED_RAD = (
    3,
    1e-5,
)  # demodulated anew with the phase shifts found; 1e-5 rad is a thousandth of a good pixel's noise


@dataclass(frozen=True)
class PhaseShiftEstimate:
    """Phase shifts found from the frames, with what else differs between the frames.

    Parameters
    ----------
    phase_shifts_rad
        Phase shifts, rad, (N,); the first is as stated, for only differences can be seen.
    u_rad
        Standard uncertainties, rad, (N,), from the scatter over the blocks; the first is 0.
    stated_rad
        Phase shifts as stated, rad, (N,).
    gradient_rad_px
        Change of each phase shift over the field, rad/px along u and v, (N, 2), zero for the first.
    u_gradient_rad_px
        Standard uncertainties of the same, (N, 2); infinite along an axis with blocks at three places or fewer.
    gain_per_frame, u_gain
        Modulation of each frame against the mean over the frames, and its standard uncertainty, (N,).
    background_per_frame, u_background
        Background of each frame against the mean over the frames, and its standard uncertainty, (N,); the gain
        where `offset_per_frame` says the rest.
    offset_per_frame
        What is added to each frame alike on bright and on dark parts, grey levels, (N,); 0 unless that explains
        the backgrounds better than a factor does.
    background_level, modulation_level
        Medians over the blocks, grey levels.
    rms_residual
        Residual of the frames against carrier, harmonics and shading, rms, grey levels.
    frame_noise
        The part of it that is not texture: noise, the codec's errors, and roughness, grey levels; median.
    quiet_noise
        The same in the smoothest fifth of the blocks: what ridges, edges and roughness of single parts add is missing.
    n_blocks
        Blocks of the picture that were smooth enough to be used.
    """

    phase_shifts_rad: NDArray[np.float64]
    u_rad: NDArray[np.float64]
    stated_rad: NDArray[np.float64]
    gradient_rad_px: NDArray[np.float64]
    u_gradient_rad_px: NDArray[np.float64]
    gain_per_frame: NDArray[np.float64]
    u_gain: NDArray[np.float64]
    background_per_frame: NDArray[np.float64]
    u_background: NDArray[np.float64]
    offset_per_frame: NDArray[np.float64]
    background_level: float
    modulation_level: float
    rms_residual: float
    frame_noise: float
    quiet_noise: float
    n_blocks: int

    @property
    def errors_rad(self) -> NDArray[np.float64]:
        """Return found minus stated phase shifts, rad, (N,)."""
        return self.phase_shifts_rad - self.stated_rad

    @property
    def significant(self) -> bool:
        """Return whether any phase shift differs from the stated one by more than chance allows (0.27 %, Student)."""
        return bool((np.abs(self.errors_rad[1:]) > self.coverage(_CHANCE) * self.u_rad[1:]).any())

    @property
    def uneven(self) -> bool:
        """Return whether gain or background of any frame differs from the mean by more than chance allows."""
        limit = self.coverage(_CHANCE / len(self.u_gain))
        gains = np.abs(self.gain_per_frame - 1) > limit * self.u_gain
        backgrounds = np.abs(self.level_per_frame / self.background_level - 1) > limit * self.u_background
        return bool((gains | backgrounds).any())

    @property
    def level_per_frame(self) -> NDArray[np.float64]:
        """Return the background of each frame on a typical part, grey levels, (N,)."""
        return self.background_level * self.background_per_frame + self.offset_per_frame

    def field_change_rad_px(self, shape: tuple[int, ...]) -> NDArray[np.float64]:
        """Return the change of each phase shift over the field, rad/px along u and v, (N, 2), 0 where it is not sure.

        A slope among blocks that scatter as much as it rises may as well be the object's doing.
        """
        known = np.abs(self.gradient_rad_px) > self.coverage(RARE) * self.u_gradient_rad_px
        over_field = np.abs(self.gradient_rad_px) * [shape[1], shape[0]]
        known &= over_field * UNIFORM_SD > self.u_rad[:, None] * np.sqrt(self.n_blocks)
        return np.where(known, self.gradient_rad_px, 0.0)

    def coverage(self, chance: float) -> float:
        """Return how many standard uncertainties a deviation exceeds by chance with this probability."""
        return float(stats.t.isf(chance / 2, max(self.n_blocks - 3, 1)))


def estimate_phase_shifts(
    frames: ArrayLike,
    phase_shifts_rad: ArrayLike,
    *,
    mask: ArrayLike | None = None,
    white_level: float | None = None,
) -> PhaseShiftEstimate:
    """Estimate the actual phase shifts of N frames of a surface that is smooth over a few fringes.

    Parameters
    ----------
    frames
        Grey values, (N, H, W), N >= 3.
    phase_shifts_rad
        Stated phase shifts, rad, (N,); right to about 20 deg.
    mask
        True where the surface is smooth, (H, W), for example the bare plate; by default all that is valid.
        Blocks with an edge in them are left out in any case.
    white_level
        Saturation, grey levels, as for `demodulate`.

    Notes
    -----
    In each block of about three fringes the unwrapped phase is fitted by a quadratic `f`; then
    `I_n = a_n + c_n cos(f) - s_n sin(f) + two harmonics`, a_n, c_n and s_n with a slope over the block, by
    least squares, and `delta_n = atan2(s_n, c_n)` against the first frame's. The mean over the blocks,
    outliers left out, is the phase shift, its scatter the uncertainty, its slope over the field the gradient.
    Phase shifts of 120 deg, one of them wrong by d, make a ripple `-(d / sqrt 3) sin(2 phi)` if not corrected.

    Raises
    ------
    PhaseError
        No phase, or fewer than four usable blocks: too few fringes or a surface that is too rough.
    """
    return phase_shifts_and_blocks(frames, phase_shifts_rad, mask=mask, white_level=white_level)[0]


def phase_shifts_and_blocks(
    frames: ArrayLike, phase_shifts_rad: ArrayLike, *, mask: ArrayLike | None = None, white_level: float | None = None
) -> tuple[PhaseShiftEstimate, list[Block]]:
    """Return what `estimate_phase_shifts` does, and the blocks that it rests on."""
    grey = np.asarray(frames)
    stated = np.asarray(phase_shifts_rad, dtype=np.float64).ravel()
    found = stated.copy()
    for _ in range(_ROUNDS):
        map_ = demodulate(grey, found, white_level=white_level, noise=Noise(1.0), max_residual=np.inf)
        blocks = measure_blocks(grey, map_, mask)
        if len(blocks) < _LEAST_BLOCKS:
            raise PhaseError(
                f"found {len(blocks)} usable blocks of {BLOCK_FRINGES:g} fringes, {_LEAST_BLOCKS} are needed "
                "to measure the phase shifts: use a smooth surface with more fringes, such as the reference plate"
            )
        estimate = _combine(blocks, stated, grey.shape[1:])
        moved = np.abs(estimate.phase_shifts_rad - found).max()
        found = estimate.phase_shifts_rad
        if moved < _CONVERGED_RAD:
            break
    return estimate, blocks


def _combine(blocks: list[Block], stated: NDArray, shape: tuple[int, ...]) -> PhaseShiftEstimate:
    """Average the blocks' phase shifts, gains and backgrounds."""
    signal = np.array([block.signal for block in blocks])
    turned = signal * np.conj(signal[:, :1]) * np.exp(-1j * (stated - stated[0]))
    errors = np.angle(turned)
    errors[:, 0] = 0.0  # the first phase shift is the origin, not a result
    u = np.array([block.u_px for block in blocks]) - (shape[1] - 1) / 2
    v = np.array([block.v_px for block in blocks]) - (shape[0] - 1) / 2
    fits = [_robust_plane(u, v, error) for error in errors.T]
    mean, u_mean, gradient, u_gradient = (np.array(part) for part in zip(*fits, strict=True))
    # Blocks above one another share what bends the carrier there: one column of them counts as one.
    few = [_places(place, length) < _LEAST_PLACES for place, length in ((u, shape[1]), (v, shape[0]))]
    u_gradient[:, few] = np.inf
    background = np.array([block.background for block in blocks])
    gain, u_gain = share_of_mean(np.abs(signal))
    share, u_share = share_of_mean(background)
    offset = _offset(background, gain, share)
    return PhaseShiftEstimate(
        phase_shifts_rad=stated + mean,
        u_rad=u_mean,
        stated_rad=stated,
        gradient_rad_px=gradient,
        u_gradient_rad_px=u_gradient,
        gain_per_frame=gain,
        u_gain=u_gain,
        background_per_frame=gain if offset.any() else share,
        u_background=u_share,
        offset_per_frame=offset,
        background_level=float(np.median(background)),
        modulation_level=float(np.median(np.abs(signal))),
        rms_residual=float(np.sqrt(np.median([block.rms**2 for block in blocks]))),
        frame_noise=float(np.sqrt(np.median([block.noise**2 for block in blocks]))),
        quiet_noise=float(np.quantile([block.noise for block in blocks], _QUIET)),
        n_blocks=len(blocks),
    )


def _places(centre: NDArray, length: int) -> int:
    """Count the eighths of the picture's length in which blocks lie."""
    return np.unique(np.floor(_PLACES_ALONG * (centre / length + 0.5))).size


def share_of_mean(values: NDArray) -> tuple[NDArray, NDArray]:
    """Return each frame's share of the mean over the frames and its standard uncertainty, (N,), medians over blocks.

    Parameters
    ----------
    values
        Modulation or background of every frame in every block, grey levels, (blocks, N).
    """
    return median_and_u(values / values.mean(axis=1, keepdims=True))


def _offset(background: NDArray, gain: NDArray, share: NDArray) -> NDArray:
    """Return what is added to each frame everywhere alike, if that fits the blocks better than a factor."""
    level = background.mean(axis=1, keepdims=True)
    added = background - gain * level
    offset = np.median(added, axis=0)
    as_offset, as_factor = np.median(np.abs(added - offset)), np.median(np.abs(background - share * level))
    return offset if as_offset < _CLEARLY * as_factor else np.zeros_like(offset)


def _robust_plane(u: NDArray, v: NDArray, values: NDArray) -> tuple[float, float, NDArray, NDArray]:
    """Fit value = mean + slope over the field, outliers left out: mean, its u, slopes, their u."""
    deviation = np.abs(values - np.median(values))
    keep = deviation <= OUTLIER_SIGMAS * robust_sd(values) + NO_SCATTER
    basis = np.column_stack([np.ones(keep.sum()), u[keep], v[keep]])
    fit, *_ = np.linalg.lstsq(basis, values[keep])
    spare = max(int(keep.sum()) - basis.shape[1], 1)
    variance = np.sum((values[keep] - basis @ fit) ** 2) / spare
    deviations = np.sqrt(np.diag(np.linalg.pinv(basis.T @ basis)) * variance)
    return float(fit[0]), float(deviations[0]), fit[1:], deviations[1:]
