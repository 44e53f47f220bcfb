"""The cross-section of a ruled line: a box blurred by a Gaussian and by the pixel's own width."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np
import numpy.typing as npt
from scipy import optimize, special

from fringecal.detect.picture_samples import brightness_at

FloatArray = npt.NDArray[np.float64]
Integral = Callable[[FloatArray], FloatArray]

# Steps of the table of a line's height and slope: interpolated, it errs by less than 1e-4 of the height.
TABLE_STEP_PX = 1 / 32
# Sine of a slant below which the pixel's second box is none: it widens a line's variance by 1e-7 px^2 at most.
LEAST_SLANT = 1e-3
# Samples across a line: four to a pixel, from pieces whose places among the pixels differ.
SAMPLE_STEP_PX = 0.25
# Cross-sections that are averaged along a piece: at its middle, and to either side.
SECTIONS = 3
# Where a Gaussian's integral is within 1 % of its end, standard deviations.
REACH_SDS = 2.3
# Rounds in which a cross-section is shifted to its own middle, and samples at either end that are its ground.
ALIGNMENTS, GROUND_SAMPLES = 3, 3
# First guess of the blur, px, and limits of what is fitted: width and blur, px, peak over the brightest sample, ground.
# Narrower lines and sharper edges than a pixel's own are not seen.
BLUR_PX, LEAST, MOST_PEAK = 0.6, (0.3, 0.05, 0.0, -1.0), 20.0
# Tolerances of the fit, relative: width and blur to 1e-4, far below what they are needed for.
FTOL, XTOL = 1e-6, 1e-4
# Brightness, instead of a division by 0.
NO_LIGHT, NO_WEIGHT = 1e-9, 1e-12
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
        return self.width_px / 2 + 0.5 + REACH_SDS * self.blur_px

    def height(self, distance_px: FloatArray, slant: float = 0.0) -> FloatArray:
        """Brightness across the line, 1 where a wide line is flat.

        Parameters
        ----------
        distance_px
            Distance from the line's middle, px, any shape.
        slant
            Sine of the angle between the line and the nearer direction of the pixels, 0 to 0.707.

        Notes
        -----
        box(w) * box(c) * box(s) * Gauss(b), c and s the cosine and sine of that angle: a square pixel seen along the
        line. By second differences of F(x) = x Phi(x/b) + b phi(x/b), by third ones of its integral where the pixel is
        slanted. Without the pixel a sharp line's position is off by up to 0.1 px, periodically with its place among
        the pixels.

        Examples
        --------
        >>> LineProfile(4.0, 0.5).height(np.array([0.0, 2.0, 9.0])).round(3).tolist()
        [1.0, 0.5, 0.0]
        """
        return self._boxes(distance_px, self._ramp, self._bowl, slant)

    def slope(self, distance_px: FloatArray, slant: float = 0.0) -> FloatArray:
        """Return the derivative of `height`, 1/px."""
        return self._boxes(distance_px, self._step, self._ramp, slant)

    def _boxes(self, x: FloatArray, twice: Integral, thrice: Integral, slant: float) -> FloatArray:
        """Differences of an integral over the line's width and over the pixel's two boxes, or over one alone."""
        if slant < LEAST_SLANT:
            return _difference(lambda y: _difference(twice, y, 1.0), x, self.width_px)
        wide = float(np.sqrt(1 - slant**2))
        pixel = partial(_difference, partial(_difference, thrice, width=slant), width=wide)
        return _difference(pixel, x, self.width_px) / (wide * slant)

    def _step(self, x: FloatArray) -> FloatArray:
        return np.asarray(special.ndtr(x / self.blur_px))

    def _ramp(self, x: FloatArray) -> FloatArray:
        scaled = x / self.blur_px
        return x * special.ndtr(scaled) + self.blur_px * _normal(scaled)

    def _bowl(self, x: FloatArray) -> FloatArray:
        scaled = x / self.blur_px
        return 0.5 * ((x**2 + self.blur_px**2) * special.ndtr(scaled) + x * self.blur_px * _normal(scaled))

    def table(self, reach_px: float, slant: float = 0.0) -> FloatArray:
        """Rows height and slope at distances 0, TABLE_STEP_PX, 2 TABLE_STEP_PX ... up to `reach_px`."""
        distance = np.arange(0, reach_px + 2 * TABLE_STEP_PX, TABLE_STEP_PX)
        return np.stack([self.height(distance, slant), self.slope(distance, slant)])


def _normal(x: FloatArray) -> FloatArray:
    """Density of the normal distribution."""
    return np.asarray(np.exp(-0.5 * x**2) / np.sqrt(2 * np.pi))


def _difference(function: Integral, x: FloatArray, width: float) -> FloatArray:
    """Difference of an integral over a box about every place."""
    return function(x + width / 2) - function(x - width / 2)


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
    for _ in range(ALIGNMENTS):
        sections = sign * _sections(image, start, end, distance, shift)
        sections -= np.minimum(*ends_of(sections))[:, None]
        weight = np.maximum(sections, 0) * np.cos(np.pi / 2 * distance / half_px) ** 2
        shift += (weight * distance).sum(axis=1) / np.maximum(weight.sum(axis=1), NO_WEIGHT)
    return distance, sections


def ends_of(sections: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Brightness (n,) of the ground at both ends of cross-sections (n, m)."""
    return sections[:, :GROUND_SAMPLES].mean(axis=1), sections[:, -GROUND_SAMPLES:].mean(axis=1)


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
    total = np.zeros((len(start), len(distance)))
    for t in np.linspace(*CLEAR_PART, SECTIONS):
        middle = start + t * along + shift[:, None] * normal
        at = middle[:, None, :] + distance[None, :, None] * normal[:, None, :]
        total += brightness_at(image, at[..., 0], at[..., 1], cubic=True)
    return total / SECTIONS


def fit_profile(distance_px: FloatArray, brightness: FloatArray) -> LineProfile:
    """Fit width and blur of a line to its mean cross-section by least squares.

    Examples
    --------
    >>> x = np.linspace(-8, 8, 65)
    >>> fit = fit_profile(x, 90 * LineProfile(3.0, 0.8).height(x) + 4)
    >>> round(fit.width_px, 3), round(fit.blur_px, 3)
    (3.0, 0.8)
    """
    peak = max(float(brightness.max()), NO_LIGHT)
    above = brightness > 0.5 * peak  # the width at half height is the first guess
    width = max(1.0, float(above.sum()) * float(distance_px[1] - distance_px[0]))

    def residual(p: FloatArray) -> FloatArray:
        return p[2] * LineProfile(p[0], p[1]).height(distance_px) + p[3] - brightness / peak

    half = float(distance_px[-1])
    fit = optimize.least_squares(
        residual,
        [min(width, 1.5 * half), BLUR_PX, 1.0, 0.0],
        bounds=(LEAST, [2 * half, half, MOST_PEAK, 1.0]),
        x_scale=[1.0, 0.3, 1.0, 0.3],  # about what each changes by
        ftol=FTOL,
        xtol=XTOL,
    )
    return LineProfile(float(fit.x[0]), float(fit.x[1]))
