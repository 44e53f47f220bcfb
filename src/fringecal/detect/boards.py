"""Find calibration boards: chessboards, ChArUco and dots, through OpenCV; every point at its place on the board."""

import cv2
import numpy as np
import numpy.typing as npt

from fringecal.errors import DetectionError

FloatArray = npt.NDArray[np.float64]
Grey = npt.NDArray[np.uint8]

#: Shorter side of a picture in which a pattern is sought: four of the smallest cells that are distinguished.
MIN_SIDE_PX = 40
#: Percentiles that become black and white: no dead and no hot pixel.
DARKEST, BRIGHTEST = 0.1, 99.9
#: Range below which a picture has one single brightness, grey levels.
NO_RANGE = 1e-12
#: A ChArUco may be partly covered; fewer corners than these do not fix its pose and scale.
MIN_CHARUCO_CORNERS = 8
#: Smallest blob that is taken for a dot of a board, px^2; OpenCV's own limit is 25.
MIN_DOT_AREA_PX = 9.0
#: Tried in turn: neither search finds all boards that the other one does.
CHESSBOARD_SEARCHES = (
    cv2.CALIB_CB_ACCURACY,
    cv2.CALIB_CB_ACCURACY | cv2.CALIB_CB_EXHAUSTIVE | cv2.CALIB_CB_NORMALIZE_IMAGE,
)


def find_chessboard(image: npt.NDArray[np.generic], columns: int, rows: int) -> FloatArray:
    """Find the inner corners of a chessboard.

    Parameters
    ----------
    image
        Grey picture, (H, W).
    columns, rows
        Inner corners in a row, and rows of them.

    Returns
    -------
    FloatArray
        Corners (rows, columns, 2), px as (u, v).

    Raises
    ------
    DetectionError
        If not all corners are seen.

    Notes
    -----
    OpenCV's sector-based detector (Duda and Frese, BMVC 2018). A chessboard turned by half a turn is the
    same; only its handedness is fixed here, so that rows run downward where columns run to the right.
    """
    grey = _as_bytes(image)
    for flags in CHESSBOARD_SEARCHES:
        found, corners = cv2.findChessboardCornersSB(grey, (columns, rows), flags=flags)
        if found:
            break
    else:
        raise DetectionError(
            f"no chessboard of {columns} x {rows} inner corners is wholly in the picture; show all of it, in focus, "
            "and check the counts (inner corners, not squares)"
        )
    return _right_handed(np.asarray(corners, dtype=float).reshape(rows, columns, 2))


def find_charuco(
    image: npt.NDArray[np.generic], squares: tuple[int, int], *, marker_part: float, dictionary: str
) -> FloatArray:
    """Find the inner corners of a ChArUco board, part of which may be hidden.

    Parameters
    ----------
    image
        Grey picture, (H, W).
    squares
        Columns and rows of squares.
    marker_part
        Side of a marker over side of a square.
    dictionary
        Name of the ArUco dictionary, for example ``"DICT_4X4_50"``.

    Returns
    -------
    FloatArray
        Corners (rows - 1, columns - 1, 2), px as (u, v), NaN where hidden.

    Raises
    ------
    DetectionError
        If fewer than eight corners are seen.

    Notes
    -----
    OpenCV before 4.6 began boards with an even number of rows with a marker where later versions have a black
    square. Where the later pattern is not found, the earlier one is tried; corners and their places are the same.
    """
    grey = _as_bytes(image)
    board = cv2.aruco.CharucoBoard(
        squares, 1.0, marker_part, cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, dictionary))
    )
    corners, numbers = _charuco_corners(grey, board)
    if len(numbers) < MIN_CHARUCO_CORNERS and squares[1] % 2 == 0:
        board.setLegacyPattern(True)
        corners, numbers = _charuco_corners(grey, board)
    count = len(numbers)
    if count < MIN_CHARUCO_CORNERS:
        raise DetectionError(
            f"{count} corners of the ChArUco board ({squares[0]} x {squares[1]} squares, {dictionary}) are seen, "
            f"{MIN_CHARUCO_CORNERS} are needed; show more of it, larger, and check its dictionary"
        )
    points = np.full(((squares[0] - 1) * (squares[1] - 1), 2), np.nan)
    points[numbers] = corners
    return points.reshape(squares[1] - 1, squares[0] - 1, 2)


def _charuco_corners(grey: Grey, board: cv2.aruco.CharucoBoard) -> tuple[FloatArray, npt.NDArray[np.int64]]:
    """Find the corners (n, 2) of a ChArUco board, px, and their numbers."""
    corners, numbers, _, _ = cv2.aruco.CharucoDetector(board).detectBoard(grey)
    if numbers is None:
        return np.empty((0, 2)), np.empty(0, np.int64)
    return np.reshape(np.asarray(corners, dtype=float), (-1, 2)), np.ravel(numbers).astype(np.int64)


_REFINED_SHARE = 0.3  # of the distance of corners, that half a window reaches: its own squares and no others' edges
_BLUR_PX = 1.0  # by which half a window stays off the edges of markers
_LEAST_HALF_PX = 2  # of a window: fewer pixels tell less than the search did
_MOST_HALF_PX = 12  # of a window: a saddle's edges within it are straight, whatever the lens
# That a corner may go: more, and it was drawn to another edge. Beside the edge of a lamp's light the search by sectors
# is off by a tenth of a square.
_MOVES_PX, _MOVES_SHARE = 1.0, 0.12


def refined_corners(
    image: npt.NDArray[np.generic], corners: FloatArray, *, marker_part: float | None = None
) -> FloatArray:
    """Place found corners of squares by the gradients about them, which light that changes over the board moves less.

    Parameters
    ----------
    image
        Grey picture, (H, W).
    corners
        Corners (rows, columns, 2), px as (u, v), NaN where hidden.
    marker_part
        Side of a marker over side of a square, of boards that have markers: windows stay off these.

    Notes
    -----
    At the corner q the gradients g of all pixels p about it are perpendicular to p - q (Foerstner and Guelch 1987), as
    OpenCV's `cornerSubPix` solves it. The search by sectors is off by 0.1 px where light falls off over the board, this
    by 0.02 px. A corner that would go by more than a pixel, and an eighth of a square, stays.
    """
    flat = corners.reshape(-1, 2)
    seen = np.isfinite(flat).all(axis=1)
    gaps = [np.linalg.norm(np.diff(corners, axis=axis), axis=-1) for axis in (0, 1)]
    least = min((float(np.nanquantile(gap, 0.05)) for gap in gaps if np.isfinite(gap).any()), default=0.0)
    clear = np.inf if marker_part is None else (1 - marker_part) / 2 * least - _BLUR_PX
    half = int(min(_REFINED_SHARE * least, clear, _MOST_HALF_PX))
    if half < _LEAST_HALF_PX or not seen.any():
        return corners
    found = flat.copy()
    stop = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_COUNT, 100, 1e-4)
    start = np.ascontiguousarray(flat[seen, None].astype(np.float32))
    moved = cv2.cornerSubPix(np.asarray(image, np.float32), start, (half, half), (-1, -1), stop).reshape(-1, 2)
    near = np.linalg.norm(moved - flat[seen], axis=1) < max(_MOVES_PX, _MOVES_SHARE * least)
    found[np.flatnonzero(seen)[near]] = moved[near]
    return found.reshape(corners.shape)


def find_dots(image: npt.NDArray[np.generic], columns: int, rows: int, *, asymmetric: bool = False) -> FloatArray:
    """Find the dots of a board, all of which must be seen.

    Parameters
    ----------
    image
        Grey picture of dark or light dots, (H, W).
    columns, rows
        Dots in a row, and rows.
    asymmetric
        Whether every second row is moved by half the distance of its dots.

    Returns
    -------
    FloatArray
        Centres (rows, columns, 2), px as (u, v); of asymmetric dots (rows, 2 columns, 2), on the
        square grid of one pitch that they half fill, NaN at the free sites.

    Raises
    ------
    DetectionError
        If not all dots are seen.

    Notes
    -----
    The centre of a disc's image is not the image of its centre when the board is tilted; the difference
    grows with the square of the diameter. Chessboards do not have it.
    """
    kind = cv2.CALIB_CB_ASYMMETRIC_GRID if asymmetric else cv2.CALIB_CB_SYMMETRIC_GRID
    grey = _as_bytes(image)
    for blobs in (cv2.SimpleBlobDetector.create(), _wide_blobs(grey, columns * rows)):
        for picture in (grey, 255 - grey):
            found, centres = cv2.findCirclesGrid(
                picture, (columns, rows), flags=kind | cv2.CALIB_CB_CLUSTERING, blobDetector=blobs
            )
            if found:
                dots = np.asarray(centres, dtype=float).reshape(rows, columns, 2)
                return _half_filled(dots) if asymmetric else _right_handed(dots)
    raise DetectionError(
        f"no board of {columns} x {rows} {'asymmetric ' if asymmetric else ''}dots is wholly in the picture; show all "
        "of it and check the counts"
    )


def _wide_blobs(grey: Grey, count: int) -> cv2.SimpleBlobDetector:
    """Look for dots of any size that so many of them may have in the picture: OpenCV's own limit is 80 px across."""
    limits = cv2.SimpleBlobDetector.Params()
    limits.maxArea = float(grey.size / count)
    limits.minArea = MIN_DOT_AREA_PX
    return cv2.SimpleBlobDetector.create(limits)


def _half_filled(dots: FloatArray) -> FloatArray:
    """Asymmetric dots on the square grid of one pitch: dot k of row j stands at place 2 k + j mod 2."""
    rows, columns = dots.shape[:2]
    grid = np.full((rows, 2 * columns, 2), np.nan)
    grid[0::2, 0::2], grid[1::2, 1::2] = dots[0::2], dots[1::2]
    return grid


def _right_handed(points: FloatArray) -> FloatArray:
    """Reverse the rows where columns and rows turn the wrong way round."""
    along, down = points[:, -1] - points[:, 0], points[-1] - points[0]
    (a, b), (c, d) = along.mean(axis=0), down.mean(axis=0)
    return points if a * d - b * c > 0 else points[:, ::-1].copy()


def _as_bytes(image: npt.NDArray[np.generic]) -> Grey:
    """Check the picture and give it as the 8 bit that OpenCV's board detectors want, its range stretched."""
    image = np.asarray(image)
    if image.ndim != 2 or min(image.shape) < MIN_SIDE_PX:
        raise DetectionError(
            f"a board is sought in a grey picture (H, W) of at least {MIN_SIDE_PX} px, got shape {image.shape}"
        )
    if image.dtype == np.uint8:
        return np.ascontiguousarray(image)
    grey = image.astype(float)
    if not np.isfinite(grey).all() or np.ptp(grey) == 0:
        raise DetectionError("the picture holds NaN, infinite values or one single brightness")
    low, high = np.percentile(grey, (DARKEST, BRIGHTEST))
    return np.clip((grey - low) * 255 / max(high - low, NO_RANGE), 0, 255).astype(np.uint8)
