"""Find parallel strips in a picture from the phase they add: which pixels are strip top, which are plate.

The strips' count, width and spacing in pixels are known from the target and the scale; their direction and
place are found. Everything here is in pixels.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage, signal

from fringecal.errors import DetectionError

Array = NDArray[np.float64]

PLATE, EDGE = 0, -1
_FINE_STEP_DEG = 0.1
_MIN_CONTRAST = 0.12  # mean difference of cos(step) between gaps and strips below which nothing is there


@dataclass(frozen=True)
class StripRegions:
    """Where the strips lie.

    Parameters
    ----------
    labels
        Map: 0 plate, 1..count the strip tops, -1 edge zones and pixels without phase.
    direction_deg
        Angle of the strips' length from +u toward +v, in [0, 180).
    across_px
        Map of the coordinate across the strips, in px.
    edges_px
        Lower and upper edge of each strip in that coordinate, shape (count, 2).
    """

    labels: NDArray[np.int16]
    direction_deg: float
    across_px: Array
    edges_px: Array

    @property
    def seen(self) -> tuple[int, ...]:
        """Labels of the strips of which something is in the picture."""
        return tuple(int(k) for k in np.unique(self.labels) if k > 0)


def find_strips(
    step_rad: Array,
    valid: NDArray[np.bool_],
    *,
    count: int,
    width_px: float,
    gap_px: float,
    margin_px: float = 2.0,
) -> StripRegions:
    """Find `count` strips from the wrapped phase difference strips minus plate.

    Parameters
    ----------
    step_rad
        Phase of the strips' picture minus phase of the bare plate, any multiple of 2 pi, shape (H, W).
    valid
        Pixels where both phases are trustworthy.
    count, width_px, gap_px
        The strips' number, width and gap.
    margin_px
        Half-width of the zone at each edge that is given to neither side, besides a tenth of the width.

    Raises
    ------
    DetectionError
        No pattern of strips: nothing on the plate, other strips, or a phase step of a whole fringe.
    """
    field = np.where(valid, np.exp(1j * np.where(valid, step_rad, 0.0)), 0)
    edges = _edge_strength(field, valid)
    direction = _direction_across(edges)
    direction, profile, start = _refine_direction(edges, direction)
    place, pitch = _place_comb(profile, count, width_px, gap_px, start, field, valid, direction)
    across = _across(field.shape, direction)
    bounds = place + np.arange(count)[:, None] * pitch + np.array([0.0, width_px * pitch / (width_px + gap_px)])
    bounds = _refine_edges(profile, start, bounds, reach=0.25 * min(width_px, gap_px))
    labels = _label(across, bounds, valid, margin_px, width_px)
    return StripRegions(labels, (math.degrees(direction) + 90.0) % 180.0, across, bounds)


def _edge_strength(field: NDArray[np.complex128], valid: NDArray[np.bool_]) -> tuple[Array, Array]:
    """Change of the complex phase step along u and v, each limited so that no stripe of noise rules."""
    smooth = ndimage.uniform_filter(field.real, 3) + 1j * ndimage.uniform_filter(field.imag, 3)
    inside = ndimage.binary_erosion(valid, iterations=1) | ~valid
    du = np.zeros(field.shape)
    dv = np.zeros(field.shape)
    du[:, 1:-1] = np.abs(smooth[:, 2:] - smooth[:, :-2])
    dv[1:-1, :] = np.abs(smooth[2:, :] - smooth[:-2, :])
    return np.minimum(du, 1.0) * inside, np.minimum(dv, 1.0) * inside


def _direction_across(edges: tuple[Array, Array]) -> float:
    """Angle from +u of the direction across the strips, from the structure tensor of the strong edges."""
    du, dv = edges
    magnitude = np.hypot(du, dv)
    strong = magnitude > max(0.3, float(np.quantile(magnitude, 0.9)))
    if np.count_nonzero(strong) < 50:
        raise DetectionError(
            "No strips were found: the phase over the strips does not differ from that of the bare plate. Check "
            "that the strips' picture and the reference are not the same, and that fringes cross the strips."
        )
    # |change| along u and v has lost the sign: the larger one names rows or columns, the fine search the rest.
    along_u, along_v = float(np.sum(du[strong] ** 2)), float(np.sum(dv[strong] ** 2))
    return 0.0 if along_u >= along_v else math.pi / 2


def _across(shape: tuple[int, ...], direction: float) -> Array:
    v, u = np.mgrid[: shape[0], : shape[1]]
    return u * math.cos(direction) + v * math.sin(direction)


def _profile(edges: tuple[Array, Array], direction: float) -> tuple[Array, float]:
    """Mean edge strength over lines along the strips, at every half pixel across them."""
    strength = edges[0] if abs(math.cos(direction)) > abs(math.sin(direction)) else edges[1]
    across = _across(strength.shape, direction)
    start = float(across.min())
    index = np.round((across - start) * 2).astype(np.intp).ravel()
    total = np.bincount(index, weights=strength.ravel())
    number = np.bincount(index)
    profile = np.where(number > 20, total / np.maximum(number, 1), 0.0)
    return ndimage.gaussian_filter1d(profile, 1.5), start


def _refine_direction(edges: tuple[Array, Array], coarse: float) -> tuple[float, Array, float]:
    """Turn until the profile of edge strength is sharpest; any angle within 45 deg of rows or columns."""

    def sharpness(angle: float) -> float:
        return float(np.var(_profile(edges, angle)[0]))

    best = coarse
    for half_range, step in ((44.0, 2.0), (2.0, 0.5), (0.5, _FINE_STEP_DEG)):
        angles = best + np.radians(np.arange(-half_range, half_range + step / 2, step))
        best = float(max(angles, key=sharpness))
    profile, start = _profile(edges, best)
    return best, profile, start


def _place_comb(  # noqa: PLR0913, PLR0917 -- private: one search over what was measured above
    profile: Array,
    count: int,
    width_px: float,
    gap_px: float,
    start: float,
    field: NDArray[np.complex128],
    valid: NDArray[np.bool_],
    direction: float,
) -> tuple[float, float]:
    """Slide a comb of strips over the picture until gaps look like plate and strips do not."""
    across = _across(field.shape, direction)
    index = np.round((across - start) * 2).astype(np.intp)[valid]
    size = profile.size
    number = np.maximum(np.bincount(index, minlength=size), 1)
    # The step drifts along a strip, so cos(step) alone may average out: its mean magnitude is what differs.
    likeness = np.bincount(index, weights=field.real[valid], minlength=size) / number
    best = (-np.inf, 0.0, 0.0)
    period = width_px + gap_px
    for pitch in np.linspace(0.97, 1.03, 25) * period:
        score, place = _best_place(profile, likeness, count, pitch, width_px / period)
        if score > best[0]:
            best = (score, place, pitch)
    contrast = _contrast(likeness, count, best[2] * 2, width_px / period, best[1])
    if contrast < _MIN_CONTRAST:
        raise DetectionError(
            f"{count} strips of {width_px:.1f} px width and {gap_px:.1f} px gaps do not show in the phase "
            f"(contrast {contrast:.2f}, at least {_MIN_CONTRAST} needed): wrong target, other strips, fringes that "
            "do not cross the strips, or a phase step of just a whole fringe."
        )
    return best[1] / 2 + start, best[2]


def _best_place(profile: Array, likeness: Array, count: int, pitch: float, share: float) -> tuple[float, float]:
    """Best score of comb places for one pitch (in px), in half-pixel bins."""
    starts = (np.arange(count)[:, None] * pitch + np.array([0.0, share * pitch])).ravel() * 2
    length = int(starts[-1]) + 1
    comb = np.zeros(length + 1)
    comb[np.round(starts).astype(int)] = 1.0
    inside = np.zeros(length + 1)
    for low, high in starts.reshape(-1, 2):
        inside[int(low) : int(high)] = 1.0
    pad = length // 2
    edge_score = signal.correlate(np.pad(profile, pad), comb, mode="valid") / starts.size
    sum_in = signal.correlate(np.pad(likeness, pad), inside, mode="valid")
    known = np.pad((likeness != 0).astype(float), pad)
    number_in = np.maximum(signal.correlate(known, inside, mode="valid"), 1)
    number_out = np.maximum(known.sum() - number_in, 1)
    contrast = (likeness.sum() - sum_in) / number_out - sum_in / number_in
    score = edge_score / max(float(profile.max()), 1e-9) + contrast
    place = int(np.argmax(score))
    return float(score[place]), float(place - pad)


def _contrast(likeness: Array, count: int, pitch_bins: float, share: float, place: float) -> float:
    position = (np.arange(likeness.size) - place) / pitch_bins
    inside = (position >= 0) & (position < count) & (position % 1 < share) & (likeness != 0)
    outside = ~((position >= 0) & (position < count) & (position % 1 < share)) & (likeness != 0)
    if not inside.any() or not outside.any():
        return 0.0
    return float(likeness[outside].mean() - likeness[inside].mean())


def _refine_edges(profile: Array, start: float, bounds: Array, *, reach: float) -> Array:
    """Move each edge to the centroid of its peak; edges without a peak stay where the comb puts them."""
    refined = bounds.copy()
    floor = float(np.median(profile))
    for index, edge in np.ndenumerate(bounds):
        centre = (edge - start) * 2
        low, high = int(max(0, centre - 2 * reach)), int(min(profile.size, centre + 2 * reach + 1))
        weights = np.clip(profile[low:high] - floor, 0, None)
        if weights.size and weights.max() > 0.1 * max(float(profile.max()) - floor, 1e-9):
            weights = np.where(weights > 0.3 * weights.max(), weights, 0)
            refined[index] = start + float(np.sum(np.arange(low, high) * weights) / weights.sum()) / 2
    return refined


def _label(
    across: Array, bounds: Array, valid: NDArray[np.bool_], margin_px: float, width_px: float
) -> NDArray[np.int16]:
    margin = margin_px + 0.1 * width_px
    labels = np.zeros(across.shape, dtype=np.int16)
    for number, (low, high) in enumerate(bounds, start=1):
        labels[(across > low - margin) & (across < high + margin)] = EDGE
        labels[(across > low + margin) & (across < high - margin)] = number
    labels[~valid] = EDGE
    return labels
