"""The cross-section of a ruled line: a box blurred by a Gaussian and by the pixel's own width."""

from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt
from scipy import optimize, special

FloatArray = npt.NDArray[np.float64]

TABLE_STEP_PX = 1 / 32
SAMPLE_STEP_PX = 0.25
MAX_STEPS = 3
# Part of an edge between crossings that is averaged for the mean profile: clear of the crossing lines.
CLEAR_PART = (0.3, 0.7)


@dataclass(frozen=True)
class LineProfile:
    """Width of the ruled line and standard deviation of the blur, both in px."""

    width_px: float
    blur_px: float

    @property
    def reach_px(self) -> float:
        """Distance from the middle beyond which the line contributes less than 1 % of its height."""
        return self.width_px / 2 + 0.5 + 2.3 * self.blur_px

    def height(self, distance_px: FloatArray) -> FloatArray:
        """Brightness across the line, 1 where a wide line is flat.

        Notes
        -----
        box(w) * box(1 px) * Gauss(s), by second differences of F(x) = x Phi(x/s) + s phi(x/s).
        The box of 1 px is the pixel: without it a sharp line's position is off by up to 0.1 px,
        periodically with its place among the pixels.

        Examples
        --------
        >>> LineProfile(4.0, 0.5).height(np.array([0.0, 2.0, 9.0])).round(3).tolist()
        [1.0, 0.5, 0.0]
        """
        half, step = self.width_px / 2, 0.5
        return (
            self._ramp(distance_px + half + step)
            - self._ramp(distance_px + half - step)
            - self._ramp(distance_px - half + step)
            + self._ramp(distance_px - half - step)
        )

    def slope(self, distance_px: FloatArray) -> FloatArray:
        """Return the derivative of `height`, 1/px."""
        half, step = self.width_px / 2, 0.5
        return (
            special.ndtr((distance_px + half + step) / self.blur_px)
            - special.ndtr((distance_px + half - step) / self.blur_px)
            - special.ndtr((distance_px - half + step) / self.blur_px)
            + special.ndtr((distance_px - half - step) / self.blur_px)
        )

    def _ramp(self, x: FloatArray) -> FloatArray:
        scaled = x / self.blur_px
        return x * special.ndtr(scaled) + self.blur_px * np.exp(-0.5 * scaled**2) / np.sqrt(2 * np.pi)

    def table(self, reach_px: float) -> FloatArray:
        """Rows height and slope at distances 0, TABLE_STEP_PX, 2 TABLE_STEP_PX ... up to `reach_px`."""
        distance = np.arange(0, reach_px + 2 * TABLE_STEP_PX, TABLE_STEP_PX)
        return np.stack([self.height(distance), self.slope(distance)])


def aligned_sections(
    image: npt.NDArray[np.float32], sign: int, start: FloatArray, end: FloatArray, half_px: float
) -> tuple[FloatArray, FloatArray]:
    """Cross-sections of many short line pieces, each shifted to its own middle.

    Parameters
    ----------
    image
        Grey picture, float32, (H, W).
    sign
        -1 for dark lines, +1 for light ones.
    start, end
        Ends of the pieces, px, (n, 2) as (u, v).
    half_px
        Half-length of the cross-section, px.

    Returns
    -------
    distance_px, brightness
        Places (m,) across, and signed brightness (n, m) above the level of the cross-section's darker end.
    """
    distance = np.arange(-half_px, half_px + SAMPLE_STEP_PX / 2, SAMPLE_STEP_PX)
    shift = np.zeros(len(start))
    for _ in range(3):
        sections = sign * _sections(image, start, end, distance, shift)
        sections -= np.minimum(sections[:, :3].mean(axis=1), sections[:, -3:].mean(axis=1))[:, None]
        weight = np.maximum(sections, 0) * np.cos(np.pi / 2 * distance / half_px) ** 2
        shift += (weight * distance).sum(axis=1) / np.maximum(weight.sum(axis=1), 1e-12)
    return distance, sections


def mean_section(sections: FloatArray) -> FloatArray:
    """Median (m,) of cross-sections (n, m), made symmetric."""
    brightness = np.median(sections, axis=0)
    symmetric: FloatArray = 0.5 * (brightness + brightness[::-1])
    return symmetric


def _sections(
    image: npt.NDArray[np.float32],
    start: FloatArray,
    end: FloatArray,
    distance: FloatArray,
    shift: FloatArray,
) -> FloatArray:
    """Cross-sections (n, m), each averaged along the clear part of its piece."""
    along = end - start
    length = np.hypot(along[:, 0], along[:, 1])
    normal = np.stack([-along[:, 1], along[:, 0]], axis=1) / length[:, None]
    steps = int(np.clip(np.median(length) * (CLEAR_PART[1] - CLEAR_PART[0]), 3, MAX_STEPS))
    total = np.zeros((len(start), len(distance)))
    for t in np.linspace(*CLEAR_PART, steps):
        middle = start + t * along + shift[:, None] * normal
        at = middle[:, None, :] + distance[None, :, None] * normal[:, None, :]
        total += cv2.remap(
            image,
            at[..., 0].astype(np.float32),
            at[..., 1].astype(np.float32),
            cv2.INTER_CUBIC,
            borderMode=cv2.BORDER_REPLICATE,
        )
    return total / steps


def fit_profile(distance_px: FloatArray, brightness: FloatArray) -> LineProfile:
    """Fit width and blur of a line to its mean cross-section by least squares.

    Examples
    --------
    >>> x = np.linspace(-8, 8, 65)
    >>> fit = fit_profile(x, 90 * LineProfile(3.0, 0.8).height(x) + 4)
    >>> round(fit.width_px, 3), round(fit.blur_px, 3)
    (3.0, 0.8)
    """
    peak = max(float(brightness.max()), 1e-9)
    above = brightness > 0.5 * peak
    width = max(1.0, float(above.sum()) * float(distance_px[1] - distance_px[0]))

    def misfit(p: FloatArray) -> FloatArray:
        return p[2] * LineProfile(p[0], p[1]).height(distance_px) + p[3] - brightness / peak

    half = float(distance_px[-1])
    fit = optimize.least_squares(
        misfit,
        [min(width, 1.5 * half), 0.6, 1.0, 0.0],
        bounds=([0.3, 0.05, 0.0, -1.0], [2 * half, half, 20.0, 1.0]),
        x_scale=[1.0, 0.3, 1.0, 0.3],
        ftol=1e-6,
        xtol=1e-4,
    )
    return LineProfile(float(fit.x[0]), float(fit.x[1]))
