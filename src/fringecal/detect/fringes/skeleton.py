"""The thesis's way to a fringe's centre: filter, threshold, thin to one pixel, read at chosen columns."""

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from fringecal.detect.fringes.ridge import Centres, grey_noise
from fringecal.errors import DetectionError

Array = NDArray[np.float32]

_LEAST_PERIOD_PX = 6.0  # three bright and three dark pixels, of which filtering leaves two each
_FINE_PX = 12.0  # period below which the median moves the edges: the picture is then doubled
_FILTERED = 1 / 3  # noise that a mean over nine pixels leaves; the median before it takes hardly any more


def thinned(image: ArrayLike, period_px: float, *, along: str = "rows") -> NDArray[np.bool_]:
    """Thin the bright fringes to lines of one pixel.

    Parameters
    ----------
    image
        Grey values, (H, W).
    period_px
        Usual period of the fringes.
    along
        What the fringes run along: "rows" or "columns" of the picture.

    Notes
    -----
    Median 3x3, mean 3x3, threshold at the mean over two periods across the fringes (the light of a diverging projector
    falls off: no one level suits the whole picture), thinning after Zhang and Suen, Commun. ACM 27 (1984) 236.

    Raises
    ------
    DetectionError
        Fringes finer than 6 px.
    """
    return _thin(_above_level(_checked(image, period_px), period_px, along))


def skeleton_centres(image: ArrayLike, period_px: float, *, along: str = "rows", whole_rows: bool = False) -> Centres:
    """Return the centres of the bright fringes along their thinned lines.

    Parameters
    ----------
    image, period_px, along
        As for `thinned`.
    whole_rows
        Read the thinned pixels themselves, as the thesis did.

    Notes
    -----
    Whole rows err alike on all fringes whose period is near a whole number of pixels, and on all strips that a fringe
    crosses: more of them do not help, and their scatter does not show it. So the thinned line tells only which bright
    band is read; the reading is the middle between the band's two edges, where the picture crosses the threshold,
    interpolated between pixels. A median over 3x3 pixels moves the edges of fringes finer than 12 px, by up to 0.07 px
    at 6 px, with their place between the rows: there the picture is doubled before it is filtered (Lanczos).

    Raises
    ------
    DetectionError
        Fringes finer than 6 px.

    Examples
    --------
    >>> v = np.arange(80)[:, None] * np.ones(40)
    >>> found = skeleton_centres(100 + 50 * np.cos(2 * np.pi * (v - 3.3) / 16), 16.0)
    >>> sorted({round(float(x), 1) for x in found.v_px})
    [19.3, 35.3, 51.3, 67.3]
    """
    grey = _checked(image, period_px)
    times = 2 if period_px < _FINE_PX and not whole_rows else 1
    if times > 1:
        grey = cv2.resize(grey, None, fx=times, fy=times, interpolation=cv2.INTER_LANCZOS4)
    above = _above_level(grey, times * period_px, along)
    lines = _thin(above)
    noise = grey_noise(np.asarray(image, float)) * _FILTERED
    straight = along == "rows"
    found = _read(above if straight else above.T, lines if straight else lines.T, noise, whole_rows=whole_rows)
    u, v = ((part + 0.5) / times - 0.5 for part in (found.u_px, found.v_px))
    found = Centres(u, v, found.sigma_px / times, found.bright)
    return found if straight else found.swapped()


def _thin(above: Array) -> NDArray[np.bool_]:
    return np.asarray(cv2.ximgproc.thinning((above > 0).astype(np.uint8) * 255) > 0)


def _checked(image: ArrayLike, period_px: float) -> Array:
    grey = np.ascontiguousarray(image, dtype=np.float32)
    if grey.ndim != 2 or not np.isfinite(grey).all():
        raise DetectionError(f"found a picture of shape {grey.shape}; needed: (height, width), finite")
    if not period_px >= _LEAST_PERIOD_PX:
        raise DetectionError(
            f"fringes of {period_px:.1f} px are too fine to be thresholded and thinned; at least "
            f"{_LEAST_PERIOD_PX:g} px are needed: use coarser fringes, or the ridge or phase estimator"
        )
    return grey


def _above_level(grey: Array, period_px: float, along: str) -> Array:
    """Filter the picture and take the local mean off: positive where it is bright."""
    smooth = cv2.blur(cv2.medianBlur(grey, 3), (3, 3))
    return (
        smooth - _level(smooth, round(period_px)) if along == "rows" else smooth - _level(smooth.T, round(period_px)).T
    )


def _level(smooth: Array, period: int) -> Array:
    """Mean over two periods across the fringes; at the picture's rim that of the outermost two."""
    mean = cv2.blur(np.ascontiguousarray(smooth), (3, 2 * period + 1))
    last = len(mean) - 1
    return np.asarray(mean[np.clip(np.arange(last + 1), min(period, last // 2), max(last - period, last // 2))])


def _read(above: Array, lines: NDArray[np.bool_], noise: float, *, whole_rows: bool) -> Centres:
    """Read thinned lines that run along rows."""
    columns, rows = np.nonzero(lines.T)
    rise, fall, found = _edges(above, columns, rows)
    columns, rise, fall = columns[found], rise[found], fall[found]
    middle = rows[found].astype(float) if whole_rows else (rise[:, 0] + fall[:, 0]) / 2
    sigma = noise * np.hypot(1 / rise[:, 1], 1 / fall[:, 1]) / 2
    return Centres(columns.astype(float), middle, np.asarray(sigma), np.ones(middle.size, bool))


def _edges(above: Array, columns: NDArray[np.intp], rows: NDArray[np.intp]) -> tuple[Array, Array, NDArray[np.bool_]]:
    """Return where (and how steeply) the bands about pixels begin and end in their columns, and which have both ends.

    Each edge is (place in px, slope in grey levels per px).
    """
    height = above.shape[0]
    across = above.T
    at, first = np.nonzero((across[:, :-1] > 0) != (across[:, 1:] > 0))
    before, after = across[at, first].astype(float), across[at, first + 1].astype(float)
    edges = np.column_stack([first + before / (before - after), np.abs(after - before)])
    after_pixel = np.searchsorted(at * height + first, columns * height + rows)
    start, end = after_pixel - 1, np.minimum(after_pixel, at.size - 1)
    found = (start >= 0) & (after_pixel < at.size) & (at[start] == columns) & (at[end] == columns)
    return edges[start], edges[end], found
