"""One line of light over a plate with something on it: its centre in every column, and the breaks it shows.

A laser line is a single fringe. Its centre is the mean of the light above the background in each column; columns
without enough light say nothing (holes, shadow). Runs of columns at one level are pieces; the level that most columns
share is the plate, and a piece off it is a break.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import ndimage

from fringecal.errors import DetectionError
from fringecal.numerics import robust_sd

Array = NDArray[np.float64]

_LEAST_SIDE_PX = 32  # of a picture: the window about a line, and some ground
# A column shows the line if its peak is above all of these: share of the line's usual peak (the 90th percentile: most
# columns are lit), standard deviations of the picture's noise, and grey levels: rounding leaves 0.06 after
# smoothing, a step of one level in the background 0.5 at its edge.
_LEAST_SHARE, _USUAL_PERCENTILE, _LEAST_SIGMAS, _LEAST_LEVELS = 0.15, 90, 6.0, 0.6
_SMOOTH_PX, _ALONG_PX = 2.0, 1.0  # smoothing of the light across and along the line, before its peak is sought
_WINDOW_PX = 12  # half width about the peak over which the centre is taken
_FOOT = 0.3  # of the peak, below which light does not count for the centre: it is the line's uneven foot
_CONCENTRATED = 0.35  # of a column's light that lies within the window: a lit scene spreads it
_LIGHT_SIGMAS = 2.0  # of the noise, from which light counts for that
_NO_LIGHT = 1e-12  # grey levels, instead of a division by 0
_LEAST_COLUMNS = 12  # of a piece: shorter ones are specks
_GAP_PX = 2  # columns from one to the next that a piece passes: one dark column between
_JUMP_PX = 3.0  # between neighbouring columns of one piece, at most
_CLEAR_SIGMAS = 5.0  # standard uncertainties of a break's shift from which it is one: relief is not normal noise
_PARTS = 8  # of a piece, whose levels tell how well its own is known
_LEAST_SCATTER_PX = 0.1  # of columns: no centre of a line is known better, whatever a short piece shows
_ENDS = 0.05  # of the columns with light, at either end of the line, that are taken for the plate
_ENDS_HELD, _LEAST_PLATE = 0.5, 0.2  # of the ends' columns, and of all, that lie on the line through both ends
_NEAR_SIGMAS = 2.5  # robust standard deviations about the base line within which columns count as on it
_PLATEAU_PX = 2.0  # from the level of what is off the base, within which columns are not its flanks
_CORRELATED = 4  # standard deviations of the smoothing over which columns is connected
_LEAST_BREAK = 0.02  # of the picture's width: a glint is shorter


@dataclass(frozen=True)
class LineBreak:
    """One piece of the line off the plate's level.

    `shift_px` is its median distance from the base line (down is positive), `sigma_px` the standard uncertainty,
    `from_px` and `to_px` its first and last column; `middle_px` is the shift about its middle third.
    """

    from_px: int
    to_px: int
    shift_px: float
    sigma_px: float
    middle_px: float


@dataclass(frozen=True)
class LineTrace:
    """Centre of a line in every column (NaN where dark), the straight base line `a + b u`, and the breaks."""

    centre_px: Array
    base: tuple[float, float]
    breaks: tuple[LineBreak, ...]


def line_breaks(image: ArrayLike) -> LineTrace:
    """Trace one bright line that runs along the rows, and find where it breaks.

    Parameters
    ----------
    image
        Grey values, (H, W), of one bright line on a dark ground; its own colour channel is best.

    Notes
    -----
    The base line is the straight line that most columns lie on, fitted to the pieces on it. A piece is a break when it
    lies further off than both 3 px and five of its standard uncertainties, which come from the scatter within pieces:
    along a coin in relief the level wanders by more than noise.

    Raises
    ------
    DetectionError
        No line, or one that is seen in too few columns.
    """
    grey = np.asarray(image, float)
    if grey.ndim != 2 or min(grey.shape) < _LEAST_SIDE_PX or not np.isfinite(grey).all():
        raise DetectionError(
            f"found a picture of shape {grey.shape}; needed: (height, width), finite, {_LEAST_SIDE_PX} px or more"
        )
    centre = _centres(grey - np.median(grey, axis=0))
    pieces = _pieces(centre)
    if not pieces:
        raise DetectionError("no bright line runs along the picture's rows: check exposure, and the colour channel")
    base = _base(centre, pieces)
    off = centre - (base[0] + base[1] * np.arange(centre.size))
    return LineTrace(centre, base, tuple(_breaks(off, pieces)))


def _centres(light: Array) -> Array:
    """Mean place of the light about its peak, column by column."""
    smooth = ndimage.gaussian_filter(light, (_SMOOTH_PX, _ALONG_PX))
    peak = smooth.argmax(axis=0)
    height = smooth.max(axis=0)
    noise = robust_sd(smooth)
    usual = float(np.percentile(height, _USUAL_PERCENTILE))
    bright = height > max(_LEAST_SHARE * usual, _LEAST_SIGMAS * noise, _LEAST_LEVELS)
    rows = np.arange(light.shape[0])[:, None]
    near = np.abs(rows - peak) <= _WINDOW_PX
    weight = np.where(near, np.clip(smooth - _FOOT * height, 0, None), 0.0)
    total = weight.sum(axis=0)
    lit = np.clip(smooth - _LIGHT_SIGMAS * noise, 0, None)
    alone = (lit * near).sum(axis=0) > _CONCENTRATED * lit.sum(axis=0)
    return np.where(bright & alone & (total > 0), (weight * rows).sum(axis=0) / np.maximum(total, _NO_LIGHT), np.nan)


def _pieces(centre: Array) -> list[NDArray[np.intp]]:
    """Return runs of columns in which the line goes on without a jump."""
    seen = np.flatnonzero(np.isfinite(centre))
    if seen.size == 0:
        return []
    cut = (np.diff(seen) > _GAP_PX) | (np.abs(np.diff(centre[seen])) > _JUMP_PX)
    return [run for run in np.split(seen, np.flatnonzero(cut) + 1) if run.size >= _LEAST_COLUMNS]


def _base(centre: Array, pieces: list[NDArray[np.intp]]) -> tuple[float, float]:
    """Fit the straight line that most columns lie on: levels first, then a slope."""
    columns = np.concatenate(pieces)
    places = centre[columns]
    ends = max(_LEAST_COLUMNS, int(_ENDS * columns.size))
    (first, last), outer = (
        [float(np.median(part)) for part in (values[:ends], values[-ends:])] for values in (columns, places)
    )
    # The plate runs on beyond what stands on it: the line through the two ends, if enough lies on it.
    slope = (outer[1] - outer[0]) / max(last - first, 1.0)
    through = _refined_line(columns, places, (outer[0] - slope * first, slope), slopes=False)
    near = np.abs(places - through[0] - through[1] * columns) < _JUMP_PX
    if near[:ends].mean() > _ENDS_HELD and near[-ends:].mean() > _ENDS_HELD and near.mean() > _LEAST_PLATE:
        return through
    guesses = [(float(np.median(centre[piece])), 0.0) for piece in pieces]
    counts = [np.count_nonzero(np.abs(places - a) < _JUMP_PX) for a, _ in guesses]
    return _refined_line(columns, places, guesses[int(np.argmax(counts))], slopes=True)


def _refined_line(
    columns: NDArray[np.intp], places: Array, guess: tuple[float, float], *, slopes: bool
) -> tuple[float, float]:
    """Fit a straight line to what lies about a guess, closer round by round; wider at first if it may slope more.

    A break that is within the wider limit would tilt the line, and stay within the closer one then.
    """
    a, b = guess
    for limit in (3 * _JUMP_PX if slopes else _JUMP_PX, _JUMP_PX, _JUMP_PX):
        near = np.abs(places - a - b * columns) < limit
        if np.count_nonzero(near) < _LEAST_COLUMNS:
            break
        b, a = np.polyfit(columns[near], places[near], 1)
    # Flanks that are within these limits lie to one side.
    off = places - a - b * columns
    near = np.abs(off) < max(_NEAR_SIGMAS * robust_sd(off[np.abs(off) < _JUMP_PX], about=0), _LEAST_SCATTER_PX)
    if np.count_nonzero(near) >= _LEAST_COLUMNS:
        b, a = np.polyfit(columns[near], places[near], 1)
    return float(a), float(b)


def _breaks(off: Array, pieces: list[NDArray[np.intp]]) -> list[LineBreak]:
    """Join neighbouring pieces at one level off the base, and keep those that are clearly off."""
    found: list[list[NDArray[np.intp]]] = []
    for piece in (part for p in pieces for part in _off_base(off, p)):
        level = float(np.median(off[piece]))
        if found and abs(level - float(np.median(off[found[-1][-1]]))) < _JUMP_PX:
            found[-1].append(piece)
        else:
            found.append([piece])
    breaks = []
    for group in found:
        columns = np.concatenate(group)
        shift, sigma = float(np.median(off[columns])), _sigma(off[columns])
        third = columns[columns.size // 3 : columns.size - columns.size // 3]
        if columns.size >= _LEAST_BREAK * off.size and abs(shift) > _CLEAR_SIGMAS * sigma:
            middle = float(np.mean(off[third]))
            breaks.append(LineBreak(int(columns[0]), int(columns[-1]), shift, sigma, middle))
    return breaks


def _off_base(off: Array, piece: NDArray[np.intp]) -> list[NDArray[np.intp]]:
    """Return the parts of a piece that lie off the base, to one side each, without their flanks.

    Where the line is blurred along its run it passes from one level to the other without a jump.
    """
    side = np.where(np.abs(off[piece]) > _JUMP_PX, np.sign(off[piece]), 0.0)
    smooth = ndimage.median_filter(side, 2 * _GAP_PX + 1, mode="nearest")  # single columns of noise do not part it
    parts = []
    for run in np.split(piece, np.flatnonzero(np.diff(smooth)) + 1):
        if abs(float(np.median(off[run]))) <= _JUMP_PX:
            continue
        # Flanks lie to both sides of a plateau, so that its middle third is clear of them.
        level = float(np.median(off[run[run.size // 3 : run.size - run.size // 3]]))
        part = run[np.abs(off[run] - level) < max(_PLATEAU_PX, 3 * robust_sd(off[run]))]
        parts += [part] * (part.size >= _LEAST_COLUMNS)
    return parts


def _sigma(off: Array) -> float:
    """Standard uncertainty of a piece's level: from the scatter of its parts, for relief is correlated over columns.

    No less than the scatter of columns gives, which is correlated over the smoothing's length.
    """
    columns = max(float(np.std(off)), _LEAST_SCATTER_PX) / np.sqrt(max(off.size / (_CORRELATED * _SMOOTH_PX), 1.0))
    parts = [float(np.median(part)) for part in np.array_split(off, min(_PARTS, off.size))]
    return float(max(columns, np.std(parts, ddof=1) / np.sqrt(len(parts))))
