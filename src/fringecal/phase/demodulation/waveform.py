"""The waveform of the fringes, which should be a cosine: gamma and clipping, measured and corrected.

A projector or camera that does not answer in proportion adds harmonics to the fringes. Three phase shifts turn the
second one into a ripple at three times the fringe frequency, the wavy surface. The harmonics' shares of the
first are the same on bright and on dark parts, so that one short table corrects every pixel.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fringecal.errors import PhaseError
from fringecal.numerics import robust_sd, wrap
from fringecal.phase.demodulation.blocks import HARMONICS, Block
from fringecal.phase.demodulation.demodulate import PhaseMap, single_precision
from fringecal.phase.demodulation.phase_shifts import NO_SCATTER, OUTLIER_SIGMAS, SIGNIFICANT, phase_shifts_and_blocks
from fringecal.phase.demodulation.schemes import Scheme, least_squares

SMALL_RIPPLE_RAD = 0.005
"""Ripple, rms, below which the fringes' shape is left alone, rad: half the noise of one good pixel."""

_TABLE = 2048  # phases of a fringe: linear interpolation between them costs less than 1e-5 rad
_LEAST_SLOPE = 0.05  # of found against true phase: where it is flatter, noise is magnified twentyfold


@dataclass(frozen=True)
class Waveform:
    """Harmonics of the fringes as shares of the first.

    Parameters
    ----------
    ratios
        a_k / a_1 for k = 2, 3, 4; complex, real for a wave that is symmetric about its crest, (3,).
    u
        Standard uncertainties of each part, from the scatter over blocks and frames, (3,).
    n_blocks
        Blocks of the picture that were measured.
    """

    ratios: NDArray[np.complex128]
    u: NDArray[np.float64]
    n_blocks: int

    @property
    def gamma(self) -> float:
        """Return the exponent g for which `(1/2 + cos/2)^g` has this second harmonic: (1 + 2 r) / (1 - r)."""
        second = float(self.ratios[0].real)
        return (1 + 2 * second) / (1 - second)

    @property
    def u_gamma(self) -> float:
        """Return the standard uncertainty of `gamma`: 3 u(r) / (1 - r)^2."""
        return float(3 * self.u[0] / (1 - self.ratios[0].real) ** 2)

    @property
    def significant(self) -> NDArray[np.complex128]:
        """Return the ratios, 0 where they are not above noise."""
        return np.where(np.abs(self.ratios) > SIGNIFICANT * self.u, self.ratios, 0)

    def matters(self, phase_shifts_rad: ArrayLike | Scheme) -> bool:
        """Return whether the waveform makes a ripple that is both above noise and large enough to be corrected."""
        return ripple_rms(phase_error(phase_shifts_rad, ratios=self.significant)) > SMALL_RIPPLE_RAD


def third_stands_alone(wave: Waveform, phase_shifts_rad: ArrayLike | Scheme) -> bool:
    """Tell whether the third harmonic costs more than the second, and no gamma that makes the second explains it.

    Parameters
    ----------
    wave
        The fringes' harmonics.
    phase_shifts_rad
        As `phase_error`: they decide what each harmonic costs.
    """
    second, third = (float(ratio.real) for ratio in wave.ratios[:2])
    of_gamma = second * (wave.gamma - 2) / (wave.gamma + 3)
    costs = [cost_of_harmonic(phase_shifts_rad, wave.significant, order) for order in HARMONICS[:2]]
    return costs[1] > costs[0] and abs(third - of_gamma) > abs(of_gamma)


def cost_of_harmonic(phase_shifts_rad: ArrayLike | Scheme, ratios: NDArray, order: int) -> float:
    """Return the ripple that one harmonic alone makes with these phase shifts, rms, rad."""
    alone = np.where(np.array(HARMONICS) == order, ratios, 0)
    return ripple_rms(phase_error(phase_shifts_rad, ratios=alone))


def estimate_waveform(
    frames: ArrayLike, phase_shifts_rad: ArrayLike, *, mask: ArrayLike | None = None, white_level: float | None = None
) -> Waveform:
    """Measure the waveform of the fringes on a surface that is smooth over a few of them, such as the plate.

    Parameters
    ----------
    frames
        Grey values, (N, H, W), N >= 3; three are enough, more know it better.
    phase_shifts_rad
        Stated phase shifts, rad, (N,).
    mask
        True where the surface is to be used, (H, W).
    white_level
        Saturation, grey levels.

    Notes
    -----
    In each block of about three fringes the true phase f is a quadratic, and every frame is
    `sum_k Re(z_k exp(i k f))`; `a_k / a_1 = z_k |z_1|^(k-1) / z_1^k`. For `(1/2 + cos/2)^g` it is
    `a_2/a_1 = (g - 1)/(g + 2)`, `a_3/a_2 = (g - 2)/(g + 3)`.

    Raises
    ------
    PhaseError
        As `estimate_phase_shifts`: no phase, or too few smooth blocks.
    """
    return waveform_of_blocks(phase_shifts_and_blocks(frames, phase_shifts_rad, mask=mask, white_level=white_level)[1])


def waveform_of_blocks(blocks: list[Block]) -> Waveform:
    """Average the harmonics over blocks and frames, outliers left out."""
    first = np.array([block.signal for block in blocks])[:, None]
    first = np.where(first == 0, NO_SCATTER, first)  # of a black frame
    order = np.array(HARMONICS)[:, None]
    ratio = np.array([block.harmonics for block in blocks]) * np.abs(first) ** (order - 1) / first**order
    # Frames of one block share its carrier and are not independent: the blocks are.
    means = [_robust_mean(column) for column in ratio.mean(axis=2).T]
    return Waveform(np.array([mean for mean, _ in means]), np.array([u for _, u in means]), len(blocks))


def _robust_mean(values: NDArray[np.complex128]) -> tuple[complex, float]:
    """Return the mean without outliers and its standard uncertainty in each part."""
    distance = np.abs(values - (np.median(values.real) + 1j * np.median(values.imag)))
    keep = distance <= OUTLIER_SIGMAS * robust_sd(distance, about=0) + NO_SCATTER
    kept = values[keep]
    return complex(kept.mean()), float(kept.std() / np.sqrt(2 * kept.size))


def phase_error(
    phase_shifts_rad: ArrayLike | Scheme,
    *,
    true_phase_shifts_rad: ArrayLike | None = None,
    ratios: ArrayLike = (),
    gains: ArrayLike | None = None,
    offsets: ArrayLike | float = 0.0,
) -> NDArray[np.float64]:
    """Predict the error of the phase over one fringe from what is wrong with the frames.

    Parameters
    ----------
    phase_shifts_rad
        Phase shifts that the frames are demodulated with, rad, (N,), or a `Scheme`.
    true_phase_shifts_rad
        Phase shifts that they have, rad, (N,).
    ratios
        Harmonics 2, 3, ... as shares of the first.
    gains, offsets
        Modulation of each frame against the mean (by default what the scheme knows), and what is added to it
        beyond that, in units of the modulation, (N,).

    Returns
    -------
    numpy.ndarray
        Found minus true phase, rad, at 2048 equally spaced true phases from 0.

    Examples
    --------
    >>> error = phase_error(np.deg2rad([0, 120, 240]), ratios=[(2.2 - 1) / (2.2 + 2)])
    >>> f"{np.rad2deg(error.max()):.1f} deg"
    '16.6 deg'
    """
    scheme = _as_scheme(phase_shifts_rad)
    true = np.asarray(scheme.phase_shifts_rad if true_phase_shifts_rad is None else true_phase_shifts_rad, np.float64)
    phi = 2 * np.pi * np.arange(_TABLE) / _TABLE
    angle = phi + true[:, None]
    wave = np.cos(angle)
    for order, share in enumerate(np.asarray(ratios, np.complex128), start=2):
        wave = wave + (share * np.exp(1j * order * angle)).real
    frames = np.reshape(scheme.gains or 1.0 if gains is None else gains, (-1, 1)) * wave + np.reshape(offsets, (-1, 1))
    _, cosine, sine = scheme.weights @ np.broadcast_to(frames, wave.shape)
    return np.angle((cosine + 1j * sine) * np.exp(-1j * phi))


def ripple_rms(error: NDArray) -> float:
    """Return the rms of an error over the fringe; its mean only shifts the fringes and is left out."""
    return float(np.std(error))


def correct_gamma(map_: PhaseMap, phase_shifts_rad: ArrayLike | Scheme, wave: Waveform) -> PhaseMap:
    """Correct what the waveform of the fringes does to the phase.

    Parameters
    ----------
    map_
        A demodulated set.
    phase_shifts_rad
        The phase shifts, rad, (N,), or the `Scheme`, that it was demodulated with.
    wave
        The fringes' shape, from `estimate_waveform`, best of the plate.

    Returns
    -------
    PhaseMap
        The same with phase and u(phi) corrected; u(phi) is the noise's part alone, as before.

    Notes
    -----
    Found phase against true phase is computed over one fringe from the harmonics and inverted as a table.

    Raises
    ------
    PhaseError
        Harmonics so strong that two phases look alike (three phase shifts: gamma above about 2.5).
    """
    true = 2 * np.pi * np.arange(_TABLE + 1) / _TABLE
    error = phase_error(phase_shifts_rad, ratios=wave.ratios)
    found = true + np.append(error, error[0])
    slope = np.diff(found) / np.diff(true)
    if slope.min() < _LEAST_SLOPE:
        raise PhaseError(
            f"the fringes' second harmonic is {abs(wave.ratios[0]):.2f} of the first: phases can no longer be "
            "distinguished with these phase shifts; take more frames, or correct the projector's gamma"
        )
    phase = map_.phase.astype(np.float64)
    place = np.mod(phase - found[0], 2 * np.pi) + found[0]
    corrected = phase + np.interp(place, found, true - found)
    centres = (found[1:] + found[:-1]) / 2
    factor = np.interp(place, centres, 1 / slope, period=2 * np.pi)
    return replace(map_, phase=single_precision(wrap(corrected)), sigma=(map_.sigma * factor).astype(np.float32))


def _as_scheme(phase_shifts_rad: ArrayLike | Scheme) -> Scheme:
    """Return a scheme for phase shifts, or the scheme given."""
    return phase_shifts_rad if isinstance(phase_shifts_rad, Scheme) else least_squares(phase_shifts_rad)
