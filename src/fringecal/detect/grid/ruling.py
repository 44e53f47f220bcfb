"""What a ruled sheet shows beside the lines that were indexed: finer lines in between, and heavier ones among them.

Millimetre paper has lines of two or three weights. Whichever of them a detector indexes, the distance of its lines in
mm follows only with what lies between them and which of them are heavy, and with what is stated of the paper.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from fringecal.detect.grid.grid_search import GridDetection
from fringecal.detect.picture_samples import brightness_at
from fringecal.numerics import robust_sd

FloatArray = npt.NDArray[np.float64]

_NO_SCATTER = 1e-12  # instead of a division by 0


@dataclass(frozen=True)
class RulingRules:
    """When lines in between and heavy lines are believed.

    Parameters
    ----------
    most_between
        Parts of a distance that are looked for: ten, of millimetre paper.
    least_parts_px
        Distance of lines in between, px, below which a camera hardly resolves them.
    contrast
        Least contrast of the lines in between against that of the indexed ones.
    sure
        Standard uncertainties that the contrast must be above: chance then makes none in a million.
    weakest
        Share of the median contrast that each of the lines in between must have: one that is missing has none.
    members
        Heavy lines, of both families, that show a rhythm; two may be chance.
    heavier
        Robust standard deviations of the other lines' logarithms of area by which heavy ones lie above them.
    held
        Share of the lines of a rhythm that must lie above nine tenths of the others.
    """

    most_between: int = 10
    least_parts_px: float = 2.5
    contrast: float = 0.04
    sure: float = 5.0
    weakest: float = 0.4
    members: int = 3
    heavier: float = 4.0
    held: float = 0.8


RULING_RULES = RulingRules()


@dataclass(frozen=True)
class Ruling:
    """What lies between and among the indexed lines.

    Parameters
    ----------
    parts
        Parts into which finer lines cut the distance of neighbouring indexed lines; 1 where none are seen.
    rhythms
        Every how many of the indexed lines heavier ones stand, as far as it is seen: 5 and 10, say.
    spacing_px
        Distance of the indexed lines, px.
    """

    parts: int
    rhythms: tuple[int, ...]
    spacing_px: float

    def sentence(self) -> str:
        """Say what was seen."""
        between = f"{self.parts - 1} finer lines" if self.parts > 2 else "one finer line"  # noqa: PLR2004
        first = f"{between} between neighbouring indexed lines" if self.parts > 1 else "no line in between"
        among = " and every ".join(str(rhythm) for rhythm in self.rhythms)
        second = f"every {among} of the indexed lines heavier" if among else "all indexed lines of one weight"
        return f"indexed lines {self.spacing_px:.1f} px apart, {first}, {second}"


def ruling_of(image: npt.NDArray[np.generic], detection: GridDetection, *, rules: RulingRules = RULING_RULES) -> Ruling:
    """Look for lines between the indexed ones, and for heavier ones among them.

    Parameters
    ----------
    image
        The picture of the grid, grey, (H, W).
    detection
        The grid found in it.
    rules
        When lines are believed.

    Notes
    -----
    Brightness is averaged along each line over the middle of the cells, so that a profile across all lines of a family
    is left. Lines in between stand at equal parts of every distance; of several numbers of parts the largest is taken,
    since of ten parts every fifth is seen too.
    """
    grey, sign = np.asarray(image, np.float32), 1 if detection.polarity == "light" else -1
    nodes = np.full((detection.row.max() + 1, detection.column.max() + 1, 2), np.nan)
    nodes[detection.row, detection.column] = np.stack([detection.u_px, detection.v_px], axis=1)
    profiles = [sign * _profiles(grey, each) for each in (nodes, nodes.transpose(1, 0, 2))]
    spacings = [_spacing(each) for each in (nodes, nodes.transpose(1, 0, 2))]
    found = [_parts(each, px, rules) for each, px in zip(profiles, spacings, strict=True)]
    rhythms = tuple(_rhythms([_areas(each) for each in profiles], rules))
    return Ruling(max(found) if min(found) > 1 else 1, rhythms, float(np.mean(spacings)))


_ACROSS = 120  # samples of a distance: twelve of a tenth
_ALONG = np.linspace(0.12, 0.88, 20)  # of a cell along the line, clear of the lines that cross
_LINE_PART = 0.4  # of a distance to either side of a line that holds it: heavy ones are wide
_WITH_INNER = 3  # parts, of more than which some lines in between are not beside an indexed one
_GROUND = 0.15  # quantile of a profile that is the paper's


def _spacing(nodes: FloatArray) -> float:
    """Return the median distance of neighbouring nodes along the first axis but one, px."""
    return float(np.nanmedian(np.hypot(*np.moveaxis(np.diff(nodes, axis=1), -1, 0))))


def _profiles(grey: npt.NDArray[np.float32], nodes: FloatArray) -> FloatArray:
    """Return the mean brightness across each distance of neighbouring columns, (distances, samples); NaN if unseen."""
    across = (np.arange(_ACROSS) + 0.5) / _ACROSS
    a, b, c, d = nodes[:-1, :-1], nodes[:-1, 1:], nodes[1:, :-1], nodes[1:, 1:]
    rows = []
    for k in range(nodes.shape[1] - 1):
        whole = np.isfinite([x[:, k] for x in (a, b, c, d)]).all(axis=(0, 2))
        if not whole.any():
            rows.append(np.full(_ACROSS, np.nan))
            continue
        corner = [x[whole, k][:, None, None] for x in (a, b, c, d)]
        s, t = _ALONG[None, :, None, None], across[None, None, :, None]
        at = (1 - s) * ((1 - t) * corner[0] + t * corner[1]) + s * ((1 - t) * corner[2] + t * corner[3])
        rows.append(brightness_at(grey, at[..., 0], at[..., 1]).mean(axis=(0, 1)))
    return np.array(rows)


def _parts(profiles: FloatArray, spacing_px: float, rules: RulingRules) -> int:
    """Return into how many parts finer lines cut the distances, 1 where none are seen."""
    known = profiles[np.isfinite(profiles[:, 0])]
    if len(known) == 0:
        return 1
    own = np.median(known[:, [0, -1]].mean(axis=1) - np.median(known, axis=1))
    for parts in range(rules.most_between, 1, -1):
        if spacing_px / parts >= rules.least_parts_px and _cut(known, parts, float(own), rules):
            return parts
    return 1


def _cut(profiles: FloatArray, parts: int, own: float, rules: RulingRules) -> bool:
    """Tell whether a line stands at each of these parts of the distances, and none half way between them."""
    lines = np.arange(1, parts) * _ACROSS // parts
    halves = ((np.arange(parts) + 0.5) * _ACROSS / parts).astype(int)
    width = max(1, _ACROSS // (6 * parts))
    smooth = np.cumsum(np.pad(profiles, ((0, 0), (width, width)), mode="edge"), axis=1)
    smooth = (smooth[:, 2 * width - 1 :] - np.pad(smooth, ((0, 0), (1, 0)))[:, : -2 * width]) / (2 * width)
    ground = (smooth[:, halves[:-1]] + smooth[:, halves[1:]]) / 2
    if parts > _WITH_INNER:  # beside wide lines the paper is seen to one side only; lines further in tell
        ground[:, [0, -1]] = smooth[:, halves[[1, -2]]]
    contrast = smooth[:, lines] - ground
    each = np.median(contrast, axis=0)
    u = max(robust_sd(contrast.mean(axis=1)) / np.sqrt(len(profiles)), _NO_SCATTER)
    typical = float(np.median(each))  # one in the middle may be heavier than the others
    return typical > max(rules.contrast * own, rules.sure * u) and float(each.min()) > rules.weakest * typical


def _areas(profiles: FloatArray) -> FloatArray:
    """Return the logarithm of what each line holds against the ground beside it, NaN where it is not seen."""
    reach = int(_LINE_PART * _ACROSS)
    ground = np.quantile(profiles, _GROUND, axis=1, keepdims=True)
    before = (profiles - ground)[:, :reach].sum(axis=1)
    after = (profiles - ground)[:, -reach:].sum(axis=1)
    area = before[1:] + after[:-1]
    return np.log(np.where(area > 0, area, np.nan))


def _rhythms(areas: list[FloatArray], rules: RulingRules) -> Iterator[int]:
    """Give every how many lines heavier ones stand, as both families together show it."""
    for rhythm in range(2, rules.most_between + 1):
        seen = [_in_rhythm(each, rhythm, rules) for each in areas]
        if sum(count for count, _ in seen) >= rules.members and all(good for _, good in seen):
            yield rhythm


def _in_rhythm(areas: FloatArray, rhythm: int, rules: RulingRules) -> tuple[int, bool]:
    """Return the heavy lines of a rhythm, and whether the lines do not contradict it."""
    best, number = -np.inf, np.arange(len(areas))
    count, held = 0, 0.0
    known = np.isfinite(areas)
    for phase in range(rhythm):
        heavy, others = areas[known & (number % rhythm == phase)], areas[known & (number % rhythm != phase)]
        if heavy.size == 0 or others.size < 2:  # noqa: PLR2004 -- a scatter needs two
            continue
        above = (np.median(heavy) - np.median(others)) / max(robust_sd(others), _LEAST_SCATTER)
        if above > best:
            best, count, held = above, heavy.size, float(np.mean(heavy > np.quantile(others, 0.9)))
    return count, best > rules.heavier and held >= rules.held


_LEAST_SCATTER = 0.01  # of the logarithm of an area: printing is no more even
