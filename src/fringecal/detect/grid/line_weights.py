"""Lines of two weights on one sheet, such as millimetre paper: a cross-section for each, and which line is which."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from fringecal.detect.grid.line_profile import (
    NO_LIGHT,
    LineProfile,
    aligned_sections,
    ends_of,
    fit_profile,
    mean_section,
)
from fringecal.detect.grid.nodes import Edges
from fringecal.numerics import robust_sd

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]

# Edges of every line whose width is measured: the median of eight is known to half of one's scatter.
EDGES_PER_LINE = 8
# Heavy lines are at least so much wider than the others; less is the printer's or the lens's unevenness.
MIN_RATIO = 1.25
# A cover or the edge of a shadow can leave a line a width of nothing.
MIN_RELATIVE_WIDTH = 0.3
# The logarithms of two weights' widths lie apart by this many of their robust standard deviations.
MIN_SEPARATION = 4.0
# Half-length of a cross-section: this part of the spacing, clear of the next line, within these limits, px.
HALF_PART, MIN_HALF_PX, MAX_HALF_PX = 0.45, 2.5, 40.0
# Quantile of a cross-section that is its peak: a hot pixel is brighter.
PEAK_QUANTILE = 0.98
# A cross-section is a line's if it has this part of the usual height, and its ends differ by less than this part.
MIN_HEIGHT, MAX_STEP = 0.3, 0.3


@dataclass(frozen=True)
class Weights:
    """Cross-sections of the lines, light ones first, and the equivalent width (area over peak, px) between them."""

    profiles: tuple[LineProfile, ...]
    split_px: float

    @property
    def reach_px(self) -> FloatArray:
        """Reach of each weight, px."""
        return np.array([profile.reach_px for profile in self.profiles])


def fit_weights(image: npt.NDArray[np.float32], sign: int, edges: tuple[Edges, Edges]) -> Weights:
    """Fit one cross-section to all lines, or two where their widths fall apart.

    Parameters
    ----------
    image
        Grey picture, float32, (H, W).
    sign
        -1 for dark lines, +1 for light ones.
    edges
        Edges of the horizontal and of the vertical lines.
    """
    distance, sections, line = _sampled_sections(image, sign, edges)
    width = _line_medians(_equivalent_widths(distance, sections), line)
    split = _split(width[np.isfinite(width)])
    heavy = width[line] > split
    groups = [sections[~heavy], sections[heavy]] if heavy.any() else [sections]
    return Weights(tuple(fit_profile(distance, mean_section(group)) for group in groups), split)


def line_kinds(
    image: npt.NDArray[np.float32], sign: int, edges: tuple[Edges, Edges], shape: tuple[int, int], weights: Weights
) -> tuple[IntArray, IntArray]:
    """Weight of every row and of every column of a grid of that shape: 0 light, 1 heavy."""
    kinds = np.zeros(sum(shape), dtype=np.int64)
    if len(weights.profiles) > 1:
        distance, sections, line = _sampled_sections(image, sign, edges)
        width = _line_medians(_equivalent_widths(distance, sections), line)
        offset = int(edges[0].line.max()) + 1
        horizontal, vertical = width[:offset] > weights.split_px, width[offset:] > weights.split_px
        kinds[: len(horizontal)] = horizontal
        kinds[shape[0] : shape[0] + len(vertical)] = vertical
    return kinds[: shape[0]], kinds[shape[0] :]


def _sampled_sections(
    image: npt.NDArray[np.float32], sign: int, edges: tuple[Edges, Edges]
) -> tuple[FloatArray, FloatArray, IntArray]:
    """Places across (m,), px, cross-sections (n, m) of a few edges of every line, and their lines (n,).

    The vertical lines count on from the horizontal ones.
    """
    pick = [_few_per_line(e.line) for e in edges]
    start, end, spacing = (
        np.concatenate([getattr(e, name)[p] for e, p in zip(edges, pick, strict=True)])
        for name in ("start", "end", "spacing")
    )
    half = min(max(MIN_HALF_PX, HALF_PART * float(np.median(spacing))), MAX_HALF_PX)
    line = np.concatenate([edges[0].line[pick[0]], edges[1].line[pick[1]] + edges[0].line.max() + 1])
    return *aligned_sections(image, sign, start, end, half), line


def _few_per_line(line: IntArray) -> IntArray:
    """Numbers of EDGES_PER_LINE edges, evenly spread, of every line."""
    order = np.argsort(line, kind="stable")
    count = np.bincount(line)
    first = np.cumsum(count) - count
    rank = np.arange(len(line)) - np.repeat(first, count)
    many = np.maximum(count[line[order]], 1)
    chosen = (rank * EDGES_PER_LINE) // many != ((rank - 1) * EDGES_PER_LINE) // many
    return order[chosen]


def _equivalent_widths(distance_px: FloatArray, sections: FloatArray) -> FloatArray:
    """Area over peak of every cross-section, px (n,); its ends are the base. NaN where it shows no line alone."""
    pitch = float(distance_px[1] - distance_px[0])
    peak = np.maximum(np.quantile(sections, PEAK_QUANTILE, axis=1), NO_LIGHT)
    step = np.maximum(*ends_of(sections))
    clear = (peak > MIN_HEIGHT * np.median(peak)) & (step < MAX_STEP * peak)
    return np.where(clear, sections.sum(axis=1) * pitch / peak, np.nan)


def _line_medians(values: FloatArray, line: IntArray) -> FloatArray:
    """Median of the finite values of every line, NaN where it has none."""
    finite = np.isfinite(values)
    order = np.lexsort((values, line))
    first = np.searchsorted(line[order], np.arange(line.max() + 1))
    count = np.bincount(line, finite, len(first)).astype(int)
    middle = np.minimum(first + count // 2, len(values) - 1)
    return np.where(count > 0, values[order][middle], np.nan)


def _split(width_px: FloatArray) -> float:
    """Width between light and heavy lines by two medians of the logarithm, infinite where they are one weight.

    Widths that only spread, as blur and lens make them, split into halves that are not much narrower than their
    distance.
    """
    width_px = width_px[width_px > 0]
    if width_px.size == 0:
        return np.inf
    log = np.sort(np.log(width_px[width_px > MIN_RELATIVE_WIDTH * np.median(width_px)]))
    ways = [(log[:k], log[k:]) for k in range(1, len(log))]
    if not ways:
        return np.inf
    light, heavy = min(ways, key=lambda way: sum(np.abs(part - np.median(part)).sum() for part in way))
    low, high = float(np.median(light)), float(np.median(heavy))
    spread = max(robust_sd(light), robust_sd(heavy))
    apart = high - low > max(np.log(MIN_RATIO), MIN_SEPARATION * spread)
    return float(np.exp(0.5 * (low + high))) if apart else np.inf
