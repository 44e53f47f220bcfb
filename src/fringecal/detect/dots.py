"""Find a board of dots of unknown size in a picture: sub-pixel centroids, indexed from neighbour to neighbour."""

from collections import deque
from dataclasses import dataclass
from typing import Literal

import cv2
import numpy as np
import numpy.typing as npt
from scipy.spatial import KDTree

from fringecal.detect.boards import BRIGHTEST, DARKEST, MIN_SIDE_PX, NO_RANGE
from fringecal.detect.dot_outlines import RAYS, outlined
from fringecal.detect.grid.grid_search import FAMILIES, GridDetection, GridLine, Polarity
from fringecal.detect.grid.line_points import LineStatus
from fringecal.detect.grid.line_profile import LineProfile
from fringecal.errors import DetectionError
from fringecal.numerics import robust_sd

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]

#: In place of an index where a blob has none.
NO_SITE = int(np.iinfo(np.int64).min)
#: Dots of five rows and columns: fewer show no lens.
MIN_DOTS = 25
#: Pixels of a blob: of smaller ones a centroid is no better than the raster.
MIN_AREA_PX = 9
#: Blobs whose area differs from the median by more than these factors are dirt, or dots that touch.
AREA_FACTORS = (0.3, 3.0)
#: The same against the blobs around, as a share: a cover, or the end of the light, cuts more off.
LOCAL_AREA = 0.25
#: Blobs that are looked at for that, itself among them: those of a 3 x 3 square.
NEIGHBOURS = 9
#: A blob that is longer than this many times its width is no dot, even if the board is seen obliquely (66 deg).
MAX_ELONGATION = 2.5
#: Pixels from the picture's border within which a blob is cut.
RIM_PX = 2
#: A dot farther from midway between its neighbours than this many times the usual distance carries dirt.
OFF_SCATTERS = 15.0
#: What the raster does to the places of dots that stand on it alike, and so does not show in their scatter, px.
RASTER_PX = 0.006
#: A centroid is taken over all pixels darker than this part of the dot's contrast.
EDGE_PART = 0.15
#: A neighbour is accepted within this part of the step from where it is expected.
NEAR = 0.25
#: Share of the blobs that must be found in one pattern: else they are something else than dots.
MIN_INDEXED = 0.6
#: The ground is the median over 5 x 5 pixels of the picture reduced by 8, 16 or 32: 40, 80 or 160 px, over which light
#: is even. Dots must be narrower than that, and the shorter the better the ground follows the light.
GROUND_REDUCED, GROUND_MEDIAN_PX = (8, 16, 32), 5
#: A ground over a wider square, or light dots, must show so many times the dots in one pattern to be preferred.
CLEARLY_MORE = 1.05
#: Dots at which growth of the pattern is begun, spread over the picture: one of them may be dirt, or stand alone.
SEEDS = 9
#: Every so many pixels are looked at for the picture's range.
RANGE_STRIDE = 4
#: Standard deviation of a centroid that is never undercut, and that of a board whose rows are too short to tell it, px.
MIN_SIGMA_PX, UNKNOWN_SIGMA_PX = 1e-3, 0.05


@dataclass(frozen=True)
class _Pattern:
    """Blobs of one polarity and size; the place of each in a square pattern, the least integer where it has none."""

    sign: int
    stats: npt.NDArray[np.int32]
    diameter_px: float
    site: IntArray

    @property
    def inside(self) -> npt.NDArray[np.bool_]:
        """Blobs that have a place."""
        return self.site[:, 0] > NO_SITE

    @property
    def score(self) -> float:
        """Blobs in the pattern times their share of all: many dots, and little that is none."""
        return float(self.inside.sum()) ** 2 / max(len(self.site), 1)


def find_dot_grid(image: npt.NDArray[np.generic], *, polarity: Polarity = "auto") -> GridDetection:
    """Find a square board of dots, as many as are seen, without being told their number.

    Parameters
    ----------
    image
        Grey picture of dark dots on a light ground or the other way round, (H, W).
    polarity
        ``"dark"`` or ``"light"`` dots; ``"auto"`` takes those of which more form one square pattern.

    Returns
    -------
    GridDetection
        Dots as crossings; each row and column of dots is a line whose points are the dots.

    Raises
    ------
    DetectionError
        Fewer than 25 dots, or dots that form no square pattern.

    Notes
    -----
    The centre of the dot's outline without what specks hide of it, or the centroid of the brightness above the ground
    over the dot and its blurred edge: whichever scatters less about its neighbours. Under perspective the
    image of a disc's centre is not the centroid of its image; for a dot of diameter d at distance z from a
    camera tilted by t the difference is about d^2 sin(t) / (4 z) on the plate, far below 0.01 px where dots
    are small.

    Examples
    --------
    >>> v, u = np.mgrid[0:200, 0:240]
    >>> picture = 200.0 - 150 * (np.hypot((u - 10) % 24 - 12, (v - 10) % 24 - 12) < 5)
    >>> grid = find_dot_grid(picture)
    >>> len(grid.family("vertical")), len(grid.family("horizontal"))
    (9, 8)
    """
    grey = np.asarray(image, dtype=np.float32)
    if grey.ndim != 2 or min(grey.shape) < MIN_SIDE_PX or not np.isfinite(grey).all() or np.ptp(grey) == 0:
        raise DetectionError(
            f"dots are sought in a finite grey picture (H, W) of {MIN_SIDE_PX} px or more, got {grey.shape}"
        )
    pattern = _best_pattern(grey, {"dark": (-1,), "light": (1,)}.get(polarity, (-1, 1)))
    if len(pattern.site) < MIN_DOTS:
        raise DetectionError(
            f"{len(pattern.site)} dots are seen, {MIN_DOTS} are needed; show more of the board, in focus"
        )
    site, inside = pattern.site, pattern.inside
    if inside.sum() < max(MIN_DOTS, MIN_INDEXED * len(site)):
        raise DetectionError(
            f"{len(site)} blobs are seen, but only {int(inside.sum())} of them form one square pattern of dots"
        )
    bright = pattern.sign * grey
    points, further, known = _steady_centres(bright, pattern)
    site = site[inside]
    clean = known & _between_neighbours(site - site.min(axis=0), points)
    site, points, further = site[clean] - site[clean].min(axis=0), points[clean], further[clean]
    profile = LineProfile(pattern.diameter_px, 0.0)
    return _detection(site, points, further, grey.shape, profile, "dark" if pattern.sign < 0 else "light")


def _best_pattern(grey: npt.NDArray[np.float32], signs: tuple[int, ...]) -> _Pattern:
    """Return the blobs of which most form one pattern: dark before light, small before large."""
    best: _Pattern | None = None
    for reduced in GROUND_REDUCED:
        for sign in signs:
            for stats, usual in _blobs(sign * grey, reduced):
                found = _Pattern(sign, stats, 2 * float(np.sqrt(usual / np.pi)), _sites(stats))
                if best is None or found.score > CLEARLY_MORE * best.score:
                    best = found
    return best if best is not None else _Pattern(-1, np.empty((0, 5), np.int32), 0.0, np.empty((0, 2), np.int64))


def _sites(stats: npt.NDArray[np.int32]) -> IntArray:
    """Index the blobs by the middles of their boxes, from the seed that most of them hang on."""
    best = np.full((len(stats), 2), NO_SITE)
    if len(stats) < MIN_DOTS:
        return best
    middles = stats[:, :2] + 0.5 * (stats[:, 2:4] - 1)
    for seed in _seeds(middles):
        site = _indexed(middles, seed)
        best = max(best, site, key=lambda one: np.count_nonzero(one[:, 0] > NO_SITE))
        if np.count_nonzero(best[:, 0] > NO_SITE) >= MIN_INDEXED * len(stats):
            break
    return best


def _seeds(points: FloatArray) -> list[int]:
    """Return the middle point first, then the points nearest to places spread over the middle of the picture."""
    low, middle, high = np.percentile(points, (25, 50, 75), axis=0)
    places = [middle, *np.stack(np.meshgrid(*np.stack([low, middle, high], axis=1)), axis=2).reshape(-1, 2)]
    _, near = KDTree(points).query(np.array(places))
    return list(dict.fromkeys(near.tolist()))[:SEEDS]


def _blobs(bright: npt.NDArray[np.float32], reduced: int) -> list[tuple[npt.NDArray[np.int32], float]]:
    """Bright blobs of one size each as OpenCV's statistics (n, 5), with that area, px^2: by number and by area.

    Where specks outnumber the dots, the blob in the middle by number is a speck; by area it is a dot.
    """
    level = _ground(bright, reduced)
    flat = _bytes(bright).astype(np.int16) - level
    core, _ = cv2.threshold(np.clip(flat, 0, 255).astype(np.uint8), 0, 255, cv2.THRESH_OTSU)
    _, _, stats, _ = cv2.connectedComponentsWithStats((flat > core).astype(np.uint8))
    sized = stats[1:][stats[1:, cv2.CC_STAT_AREA] >= MIN_AREA_PX]
    if not len(sized):
        return []
    areas = np.sort(sized[:, cv2.CC_STAT_AREA])
    by_number = float(np.median(areas))
    by_area = float(areas[np.searchsorted(np.cumsum(areas), areas.sum() / 2)])
    alike = [by_number] if by_area < by_number / AREA_FACTORS[0] else [by_number, by_area]
    return [(_of_one_size(sized, usual, bright.shape), usual) for usual in alike]


def _ground(bright: npt.NDArray[np.float32], reduced: int) -> npt.NDArray[np.uint8]:
    """Median brightness around every pixel, of the picture as bytes."""
    part = 1 / reduced
    small = cv2.resize(_bytes(bright), None, fx=part, fy=part, interpolation=cv2.INTER_AREA)
    ground = cv2.medianBlur(small, GROUND_MEDIAN_PX)
    return np.asarray(cv2.resize(ground, bright.shape[::-1], interpolation=cv2.INTER_LINEAR), np.uint8)


def _of_one_size(stats: npt.NDArray[np.int32], usual: float, shape: tuple[int, ...]) -> npt.NDArray[np.int32]:
    """Leave blobs of about the usual area that are wholly in the picture, round, and as large as those around."""
    areas = stats[:, cv2.CC_STAT_AREA]
    good = stats[(areas > AREA_FACTORS[0] * usual) & (areas < AREA_FACTORS[1] * usual)]
    good = good[_inside(good, shape)]
    return good[_like_neighbours(good)]


def _like_neighbours(stats: npt.NDArray[np.int32]) -> npt.NDArray[np.bool_]:
    """Blobs about as large as those around them: others are cut by a cover or by the end of the light."""
    if len(stats) <= NEIGHBOURS:
        return np.ones(len(stats), dtype=bool)
    middle = stats[:, :2] + 0.5 * stats[:, 2:4]
    _, near = KDTree(middle).query(middle, k=NEIGHBOURS)
    area = stats[:, cv2.CC_STAT_AREA]
    around = np.median(area[near], axis=1)
    return np.abs(area - around) < np.maximum(LOCAL_AREA * around, MIN_AREA_PX)


def _bytes(bright: npt.NDArray[np.float32]) -> npt.NDArray[np.uint8]:
    low, high = np.percentile(bright[::RANGE_STRIDE, ::RANGE_STRIDE], (DARKEST, BRIGHTEST))
    return np.clip((bright - low) * (255 / max(high - low, NO_RANGE)), 0, 255).astype(np.uint8)


def _inside(stats: npt.NDArray[np.int32], shape: tuple[int, ...]) -> npt.NDArray[np.bool_]:
    """Blobs that do not touch the picture's border and are about as wide as high."""
    left, top, width, height = stats[:, :4].T
    begins = (left > RIM_PX) & (top > RIM_PX)
    ends = (left + width < shape[1] - RIM_PX) & (top + height < shape[0] - RIM_PX)
    return begins & ends & (np.maximum(width, height) < MAX_ELONGATION * np.minimum(width, height))


def _weighted_centres(bright: npt.NDArray[np.float32], stats: npt.NDArray[np.int32]) -> FloatArray:
    """Centroids of the brightness above the ground around each blob."""
    centres = np.empty((len(stats), 2))
    for n, (left, top, width, height, _) in enumerate(stats):
        margin = 2 + max(width, height) // 4  # for the blurred edge, and some ground
        rows = slice(max(top - margin, 0), top + height + margin)
        columns = slice(max(left - margin, 0), left + width + margin)
        window = bright[rows, columns].astype(float)
        ground = np.median(np.concatenate([window[0], window[-1], window[:, 0], window[:, -1]]))
        weight = np.maximum(window - ground, 0.0)
        weight[weight < EDGE_PART * weight.max()] = 0.0
        total = max(weight.sum(), NO_RANGE)
        centres[n] = (
            columns.start + (weight.sum(axis=0) @ np.arange(weight.shape[1])) / total,
            rows.start + (weight.sum(axis=1) @ np.arange(weight.shape[0])) / total,
        )
    return centres


def _steady_centres(
    bright: npt.NDArray[np.float32], pattern: _Pattern
) -> tuple[FloatArray, FloatArray, npt.NDArray[np.bool_]]:
    """Centres (n, 2) of the dots in the pattern, what to add to the u of each, px, and which are known at all.

    By outlines where these scatter no more about their neighbours than centroids, else where a speck touches the dot.
    """
    site = pattern.site[pattern.inside] - pattern.site[pattern.inside].min(axis=0)
    centroids = _weighted_centres(bright, pattern.stats[pattern.inside])
    found = outlined(bright, centroids, pattern.diameter_px / 2)
    scatter = _scatter_px(site, found.points)
    by_outline = found.touched | (scatter <= _scatter_px(site, centroids))
    further = scatter * np.sqrt(1 / np.maximum(found.kept, 1 / RAYS) - 1)
    return (
        np.where(by_outline[:, None], found.points, centroids),
        np.where(by_outline, further, 0.0),
        ~by_outline | found.known,
    )


def _indexed(points: FloatArray, seed: int) -> IntArray:
    """Index (column, row) of every dot, grown from one of them; the least integer where none was given."""
    tree = KDTree(points)
    site = np.full((len(points), 2), NO_SITE)
    taken = {(0, 0): seed}
    site[seed] = 0
    queue = deque([(seed, _first_steps(points, tree, seed))])
    while queue:
        here, steps = queue.popleft()
        for axis, way in ((0, 1), (0, -1), (1, 1), (1, -1)):
            offset = np.array([way if axis == 0 else 0, way if axis == 1 else 0])
            key = (int(site[here, 0] + offset[0]), int(site[here, 1] + offset[1]))
            distance, there = tree.query(points[here] + way * steps[axis])
            if key in taken or site[there, 0] != NO_SITE:
                continue
            if distance < NEAR * float(np.hypot(*steps[axis])):
                taken[key], site[there] = int(there), key
                moved = steps.copy()
                moved[axis] = way * (points[there] - points[here])
                queue.append((int(there), moved))
    return site


def _first_steps(points: FloatArray, tree: KDTree, middle: int) -> FloatArray:
    """Steps (2, 2) from the middle dot to its neighbours along columns and rows."""
    _, near = tree.query(points[middle], k=5)  # itself and four
    arms = points[near[1:]] - points[middle]
    along = arms[np.argmax(arms[:, 0])]
    down = arms[np.argmax(arms[:, 1])]
    return np.stack([along, down])


def _detection(
    site: IntArray,
    points: FloatArray,
    further_u_px: FloatArray,
    shape: tuple[int, ...],
    profile: LineProfile,
    polarity: Literal["dark", "light"],
) -> GridDetection:
    order = np.lexsort((site[:, 0], site[:, 1]))
    site, points = site[order], points[order]
    sigma = np.hypot(max(_scatter_px(site, points), RASTER_PX), further_u_px[order])
    lines = [
        GridLine(family, k, points[pick, 0], points[pick, 1], sigma[pick], np.full(pick.sum(), int(LineStatus.OK)))
        for axis, family in ((1, FAMILIES[0]), (0, FAMILIES[1]))
        for k in range(int(site[:, axis].max()) + 1)
        for pick in [site[:, axis] == k]
        if pick.any()
    ]
    size = (int(shape[0]), int(shape[1]))
    column, row = site.T
    u, v = points.T
    return GridDetection(row, column, u, v, sigma, tuple(lines), size, polarity, profile)


def _between_neighbours(site: IntArray, points: FloatArray) -> npt.NDArray[np.bool_]:
    """Dots that lie midway between their neighbours along rows or along columns: dirt moves the others off both.

    Midway but for the bend that the dots around show too: perspective and lens, most at the board's rim.
    """
    nodes = np.full((site[:, 1].max() + 3, site[:, 0].max() + 3, 2), np.nan)
    nodes[site[:, 1] + 1, site[:, 0] + 1] = points
    bends = (
        nodes[1:-1, 1:-1] - 0.5 * (first + last)
        for first, last in ((nodes[:-2, 1:-1], nodes[2:, 1:-1]), (nodes[1:-1, :-2], nodes[1:-1, 2:]))
    )
    off = np.fmin(*(np.hypot(*np.moveaxis(bend - _usual_around(bend), 2, 0)) for bend in bends))[site[:, 1], site[:, 0]]
    return ~(off > OFF_SCATTERS * np.nanmedian(off))


def _usual_around(nodes: FloatArray) -> FloatArray:
    """Median of a lattice's vectors (rows, columns, 2) over 3 x 3 of them, or as many as there are."""
    rows, columns = nodes.shape[:2]
    wide = np.pad(nodes, ((1, 1), (1, 1), (0, 0)), constant_values=np.nan)
    around = np.stack([wide[k : k + rows, j : j + columns] for k in range(3) for j in range(3)])
    ordered = np.sort(around, axis=0)  # what is missing comes last
    count = np.isfinite(around).sum(axis=0)
    middle = [np.maximum(count - 1 + k, 0) // 2 for k in (0, 1)]
    low, high = (np.take_along_axis(ordered, place[None], axis=0)[0] for place in middle)
    return np.asarray(0.5 * (low + high))


def _scatter_px(site: IntArray, points: FloatArray) -> float:
    """Standard deviation of a dot about the middle of its neighbours, px: what a smooth lens leaves."""
    nodes = np.full((site[:, 1].max() + 1, site[:, 0].max() + 1, 2), np.nan)
    nodes[site[:, 1], site[:, 0]] = points
    bend = nodes[:, 3:] - 3 * nodes[:, 2:-1] + 3 * nodes[:, 1:-2] - nodes[:, :-3]
    seen = bend[np.isfinite(bend)]
    # The third difference of independent errors has 1 + 9 + 9 + 1 = 20 times their variance.
    return max(MIN_SIGMA_PX, robust_sd(seen, about=0) / np.sqrt(20)) if seen.size else UNKNOWN_SIGMA_PX
