"""The phase steps that the frames really have, found from the frames themselves.

Three frames determine three unknowns per pixel, so a wrong step cannot be seen in any one pixel. It is
seen over a few fringes: there the phase is smooth, while a wrong step makes it ripple. In each block of
the picture the smooth phase is taken as the carrier, and every frame's own phase against it is measured;
what is wrong with the carrier is the same for all frames and drops out of their differences.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fringecal.errors import PhaseError
from fringecal.phase.demodulate import PhaseMap, demodulate
from fringecal.phase.noise import Noise
from fringecal.phase.period import fringe_period
from fringecal.phase.unwrap import unwrap

BLOCK_FRINGES = 3.0
"""Side of a block in fringe periods: enough to part carrier, harmonics and shading."""

_BLOCK_LIMITS_PX = (24, 400)
_LEAST_BLOCKS = 4
_LEAST_VALID_SHARE = 0.9
_LEAST_CYCLES_IN_BLOCK = 1.8
_MAX_ROUGHNESS_RAD = 0.35
_OUTLIER_MADS = 4.0
_MAD_TO_SIGMA = 1.482602218505602
_SIGNIFICANT = 3.0
_ROUNDS = 3
_CONVERGED_RAD = 1e-5


@dataclass(frozen=True)
class StepEstimate:
    """Phase steps found from the frames, with what else differs between the frames.

    Parameters
    ----------
    steps_rad
        Steps, rad, (N,); the first is as stated, for only differences can be seen.
    u_rad
        Standard uncertainties, rad, (N,), from the scatter over the blocks; the first is 0.
    stated_rad
        Steps as stated, rad, (N,).
    gradient_rad_px
        Change of each step over the field, rad/px along u and v, (N, 2), zero for the first.
    u_gradient_rad_px
        Standard uncertainties of the same, (N, 2).
    gain_per_frame
        Modulation of each frame against the mean over the frames, (N,).
    offset_per_frame
        Background of each frame, gain removed, against the mean over the frames, grey levels, (N,).
    rms_residual
        Residual of the frames against carrier, two harmonics and shading, rms, grey levels.
    n_blocks
        Blocks of the picture that were smooth enough to be used.
    """

    steps_rad: NDArray[np.float64]
    u_rad: NDArray[np.float64]
    stated_rad: NDArray[np.float64]
    gradient_rad_px: NDArray[np.float64]
    u_gradient_rad_px: NDArray[np.float64]
    gain_per_frame: NDArray[np.float64]
    offset_per_frame: NDArray[np.float64]
    rms_residual: float
    n_blocks: int

    @property
    def errors_rad(self) -> NDArray[np.float64]:
        """Return found minus stated steps, rad, (N,)."""
        return self.steps_rad - self.stated_rad

    @property
    def significant(self) -> bool:
        """Tell whether any step differs from the stated one by more than three standard uncertainties."""
        return bool((np.abs(self.errors_rad[1:]) > _SIGNIFICANT * self.u_rad[1:]).any())


def estimate_steps(
    frames: ArrayLike,
    steps_rad: ArrayLike,
    *,
    mask: ArrayLike | None = None,
    white_level: float | None = None,
) -> StepEstimate:
    """Estimate the actual phase steps of N frames of a surface that is smooth over a few fringes.

    Parameters
    ----------
    frames
        Grey values, (N, H, W), N >= 3.
    steps_rad
        Stated steps, rad, (N,); right to about 20 deg.
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
    outliers left out, is the step, its scatter the uncertainty, its slope over the field the gradient.
    Steps of 120 deg, one of them wrong by d, make a ripple `-(d / sqrt 3) sin(2 phi)` if not corrected.

    Raises
    ------
    PhaseError
        No phase, or fewer than four usable blocks: too few fringes or a surface that is too rough.
    """
    grey = np.asarray(frames)
    stated = np.asarray(steps_rad, dtype=np.float64).ravel()
    found = stated.copy()
    for _ in range(_ROUNDS):
        map_ = demodulate(grey, found, white_level=white_level, noise=Noise(1.0))
        blocks = _measure_blocks(grey, map_, mask)
        if len(blocks) < _LEAST_BLOCKS:
            raise PhaseError(
                f"found {len(blocks)} usable blocks of {BLOCK_FRINGES:g} fringes, {_LEAST_BLOCKS} are needed "
                "to measure the steps: use a smooth surface with more fringes, such as the reference plate"
            )
        estimate = _combine(blocks, stated, grey.shape[1:])
        moved = np.abs(estimate.steps_rad - found).max()
        found = estimate.steps_rad
        if moved < _CONVERGED_RAD:
            break
    return estimate


@dataclass(frozen=True)
class _Block:
    """One block: its centre, its frames' complex modulations and backgrounds, and the residual."""

    u_px: float
    v_px: float
    signal: NDArray[np.complex128]
    background: NDArray[np.float64]
    rms: float


def _measure_blocks(grey: NDArray, map_: PhaseMap, mask: ArrayLike | None) -> list[_Block]:
    """Cut the picture into blocks and measure the smooth ones."""
    valid = map_.valid if mask is None else map_.valid & np.asarray(mask, bool)
    if not valid.any():
        raise PhaseError("no pixel carries a phase, so no step can be measured: check exposure and stated steps")
    unwrapped = unwrap(map_.phase, valid)
    period = fringe_period(map_.phase, valid).period_px
    side = int(np.clip(round(BLOCK_FRINGES * period), *_BLOCK_LIMITS_PX))
    height, width = valid.shape
    blocks = []
    for top in range(0, max(height - side, 0) + 1, side):
        for left in range(0, max(width - side, 0) + 1, side):
            window = np.s_[top : top + side, left : left + side]
            block = _measure_block(grey[:, *window], unwrapped.phase[window], unwrapped.pieces[window])
            if block is not None:
                blocks.append(_moved(block, left, top))
    return blocks


def _moved(block: _Block, left: int, top: int) -> _Block:
    """Return a block with its centre in the whole picture."""
    return _Block(block.u_px + left, block.v_px + top, block.signal, block.background, block.rms)


def _measure_block(grey: NDArray, phase: NDArray, pieces: NDArray) -> _Block | None:
    """Measure all frames of one block against its smooth phase; None where the block is not smooth."""
    largest = np.bincount(pieces[pieces > 0]).argmax() if (pieces > 0).any() else 0
    use = pieces == largest
    if largest == 0 or use.mean() < _LEAST_VALID_SHARE:
        return None
    rows, columns = np.nonzero(use)
    x = (columns - columns.mean()) / phase.shape[1]
    y = (rows - rows.mean()) / phase.shape[0]
    quadratic = np.column_stack([np.ones_like(x), x, y, x * x, x * y, y * y])
    carrier, roughness = _smooth(quadratic, phase[use])
    if roughness > _MAX_ROUGHNESS_RAD or np.ptp(carrier) < 2 * np.pi * _LEAST_CYCLES_IN_BLOCK:
        return None
    return _fit_frames(grey[:, use].astype(np.float64), carrier, quadratic, (float(columns.mean()), float(rows.mean())))


def _smooth(basis: NDArray, values: NDArray) -> tuple[NDArray, float]:
    """Return the least-squares fit of a basis to values, and the rms residual."""
    # Normal equations: few well-scaled columns, thousands of rows.
    fit = basis @ np.linalg.solve(basis.T @ basis, basis.T @ values)
    return fit, float(np.sqrt(np.mean((values - fit) ** 2)))


def _fit_frames(grey: NDArray, carrier: NDArray, quadratic: NDArray, centre: tuple[float, float]) -> _Block:
    """Fit every frame of a block by shading, carrier with a slope, and two harmonics."""
    slopes = quadratic[:, :3]
    basis = np.concatenate(
        [
            quadratic,
            slopes * np.cos(carrier)[:, None],
            slopes * -np.sin(carrier)[:, None],
            np.column_stack([f(k * carrier) for k in (2, 3) for f in (np.cos, np.sin)]),
        ],
        axis=1,
    )
    coefficients = np.linalg.solve(basis.T @ basis, basis.T @ grey.T)
    residual = grey.T - basis @ coefficients
    signal = coefficients[6] + 1j * coefficients[9]
    return _Block(*centre, signal, coefficients[0], float(np.sqrt(np.mean(residual**2))))


def _combine(blocks: list[_Block], stated: NDArray, shape: tuple[int, ...]) -> StepEstimate:
    """Average the blocks' steps, gains and backgrounds."""
    signal = np.array([block.signal for block in blocks])
    turned = signal * np.conj(signal[:, :1]) * np.exp(-1j * (stated - stated[0]))
    errors = np.angle(turned)
    errors[:, 0] = 0.0  # the first step is the origin, not a result
    u = np.array([block.u_px for block in blocks]) - (shape[1] - 1) / 2
    v = np.array([block.v_px for block in blocks]) - (shape[0] - 1) / 2
    fits = [_robust_plane(u, v, error) for error in errors.T]
    mean, u_mean, gradient, u_gradient = (np.array(part) for part in zip(*fits, strict=True))
    background = np.array([block.background for block in blocks])
    gain = np.median(np.abs(signal) / np.abs(signal).mean(axis=1, keepdims=True), axis=0)
    offset = np.median(background - gain * background.mean(axis=1, keepdims=True), axis=0)
    rms = float(np.sqrt(np.median([block.rms**2 for block in blocks])))
    return StepEstimate(stated + mean, u_mean, stated, gradient, u_gradient, gain, offset, rms, len(blocks))


def _robust_plane(u: NDArray, v: NDArray, values: NDArray) -> tuple[float, float, NDArray, NDArray]:
    """Fit value = mean + slope over the field, outliers left out: mean, its u, slopes, their u."""
    deviation = np.abs(values - np.median(values))
    keep = deviation <= _OUTLIER_MADS * _MAD_TO_SIGMA * np.median(deviation) + 1e-12
    basis = np.column_stack([np.ones(keep.sum()), u[keep], v[keep]])
    fit, *_ = np.linalg.lstsq(basis, values[keep])
    spare = max(int(keep.sum()) - basis.shape[1], 1)
    variance = np.sum((values[keep] - basis @ fit) ** 2) / spare
    deviations = np.sqrt(np.diag(np.linalg.pinv(basis.T @ basis)) * variance)
    return float(fit[0]), float(deviations[0]), fit[1:], deviations[1:]
