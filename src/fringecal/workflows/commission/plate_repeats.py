"""What repeats of the bare plate show: whether its noise is the one predicted, and what form no model explains."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fringecal.projector import RigCalibration
from fringecal.uncertainty import Estimate
from fringecal.workflows.shared import CapturePhase, height_per_rad_mm, shortest_period

Array = NDArray[np.float64]

BLOCK_PX = 16
_LEAST_SHARE = 0.5  # of a block's pixels that must have a phase in every repeat


@dataclass(frozen=True)
class PlateRepeats:
    """Repeats of the bare plate against the noise model and against the rig model.

    Parameters
    ----------
    sets
        Number of repeats.
    noise_rad, predicted_rad
        Rms over the picture of the phase's standard deviation from repeat to repeat, and of what the camera's noise
        predicts for one set.
    ratio
        The first over the second.
    form_mm
        Rms of what is the same in all repeats and in no model, as a height at the origin: the plate's form, finer
        than the smooth residual that the model takes up.
    shift_rad
        Mean phase of each repeat against the mean of all, (sets,).
    """

    sets: int
    noise_rad: float
    predicted_rad: float
    ratio: Estimate
    form_mm: Estimate
    shift_rad: Array


def plate_repeats(reference: CapturePhase, plate_phase_rad: Array, calibration: RigCalibration) -> PlateRepeats | None:
    """Compare the repeats of the bare plate; None where there are none, or too few pixels.

    Parameters
    ----------
    reference
        The bare plate's phase, mean of its repeats.
    plate_phase_rad
        The same, unwrapped, NaN where there is none, (H, W).
    calibration
        The rig as fitted.

    Notes
    -----
    Changes of the mean phase between repeats are subtracted and returned as `shift_rad`. A variance from R repeats is
    ``sum (x - mean)^2 / (R - 1)``; means over blocks, in the same way, say how much of the blocks' mean residual is
    noise, and the rest of its square is form (JCGM 100:2008, 4.2).
    """
    capture, middle = reference.capture, reference.map
    if capture.repeat < 2:
        return None
    valid = middle.valid & np.isfinite(plate_phase_rad)
    off, sigma, shift = [], [], []
    for number in range(capture.repeat):
        one = reference.again(capture.read_set(repeat=number, period=shortest_period(capture)))
        valid &= one.valid
        difference = np.angle(np.exp(1j * (one.phase - middle.phase).astype(np.float64)))
        shift.append(float(difference[valid].mean()) if valid.any() else 0.0)
        off.append(difference - shift[-1])
        sigma.append(one.sigma.astype(np.float64) ** 2)
    blocks = _Blocks(valid)
    if blocks.count < 2:
        return None
    variance = blocks.mean(np.var(off, axis=0, ddof=1))
    predicted = blocks.mean(np.mean(sigma, axis=0))
    per_block = np.sqrt(variance / predicted)
    noise, expected = math.sqrt(variance.mean()), math.sqrt(predicted.mean())
    ratio = Estimate(noise / expected, float(per_block.std(ddof=1)) / math.sqrt(blocks.count), "", "noise ratio")
    form = _form(blocks, plate_phase_rad, np.array([blocks.mean(one) for one in off]), calibration)
    return PlateRepeats(capture.repeat, noise, expected, ratio, form, np.array(shift) - np.mean(shift))


def _form(blocks: "_Blocks", plate_phase_rad: Array, means_of_repeats: Array, calibration: RigCalibration) -> Estimate:
    """Return the rms of the blocks' residuals that repeats have in common, as a height."""
    rays = calibration.camera.pixel_rays()
    model = calibration.model
    left = plate_phase_rad - model.ratio(rays.ax, rays.ay, 0.0) - model.residual(rays.ax, rays.ay)
    residual = blocks.mean(left)
    residual -= residual.mean()
    noise = means_of_repeats.var(axis=0, ddof=1).mean() / len(means_of_repeats)
    variance = float(np.mean(residual**2))
    form = math.sqrt(max(variance - float(noise), 0.0))
    # Of a variance with nu degrees of freedom, u is sqrt(2 / nu) of it; a root near nought has the root's own u.
    u_variance = variance * math.sqrt(2 / blocks.count)
    u = u_variance / (2 * form) if form**2 > u_variance else math.sqrt(u_variance)
    scale = height_per_rad_mm(calibration)
    return Estimate(form * scale, u * scale, "mm", "plate form")


class _Blocks:
    """Square blocks of a picture of which enough pixels are valid."""

    def __init__(self, valid: NDArray[np.bool_]) -> None:
        height, width = (side - side % BLOCK_PX for side in valid.shape)
        self._valid = valid[:height, :width]
        self._shape = (height // BLOCK_PX, BLOCK_PX, width // BLOCK_PX, BLOCK_PX)
        self._number = self._valid.reshape(self._shape).sum(axis=(1, 3))
        self._used = self._number >= _LEAST_SHARE * BLOCK_PX**2
        self.count = int(self._used.sum())

    def mean(self, values: Array) -> Array:
        """Average over the valid pixels of every block, (count,)."""
        cut = np.where(self._valid, values[: self._valid.shape[0], : self._valid.shape[1]], 0.0)
        total = cut.reshape(self._shape).sum(axis=(1, 3))
        return np.asarray(total[self._used] / self._number[self._used])
