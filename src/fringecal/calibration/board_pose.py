"""One pose of a board that carries fringes: its corners in the picture, and the projector's coordinates there."""

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from fringecal.camera import board_view
from fringecal.detect import refined_corners
from fringecal.errors import DetectionError
from fringecal.numerics import robust_sd
from fringecal.projector import BoardPose
from fringecal.targets import Charuco, Chessboard, Target

Array = NDArray[np.float64]

_QUADRATIC = 6  # numbers of a surface of second order
_CHI2_MEDIAN = 0.455  # median of chi squared with one degree of freedom
_ROUNDS = 6  # of reweighting: weights change by less than a thousandth after five
_MUCH_GLARE = 0.01  # share of a picture: a lamp's mirror image covers more, hot pixels far less
_TELLING = 0.4  # share of the pixels about a corner that tells why it is not read: half of them are dark squares
_TUKEY = 4.685  # of Tukey's biweight: 95 % efficient for normal errors


@dataclass(frozen=True)
class PoseRules:
    """When a corner has a projector coordinate, and when a pose takes part.

    Parameters
    ----------
    reach
        Half side of the square around a corner that its coordinate is fitted to, in distances of corners: the light
        squares that meet there, and little of the next.
    darker
        Times the u of the lightest pixels from which a pixel counts as dark: u goes with one over brightness, and
        print is seven times darker than paper and more. What lies within a pixel of dark is left out too, since it
        mixes both.
    least_pixels, least_quadrants
        From so many pixels, in so many of the four quadrants about it: else the coordinate would be continued to the
        corner, not read there.
    most_leverage
        Largest variance of the value at the corner over that of a mean of the same pixels: light squares on both sides
        make 3 to 6, one side alone 20 and more.
    most_u_px
        Largest u of a coordinate that takes part, px of the projector.
    least_corners
        Corners with a coordinate from which a pose takes part: twice the numbers of its place, and some to judge.
    """

    reach: float = 0.75
    darker: float = 3.0
    least_pixels: int = 24
    least_quadrants: int = 2
    most_leverage: float = 12.0
    most_u_px: float = 0.5
    least_corners: int = 12


POSE_RULES = PoseRules()


@dataclass(frozen=True)
class PosedBoard:
    """What a capture shows of the board in one pose.

    Parameters
    ----------
    name
        The capture's.
    pose
        Corners, their places in picture and projector; None where the pose is left aside.
    reason
        Why it is left aside; empty where it takes part.
    corners, lit
        Corners of the board that the picture shows, and of these those with a coordinate of the projector.
    unread
        Why corners that the picture shows have no coordinate, in words; empty where all have one.
    handed
        1 if the projector's coordinates turn as the camera's pixels do, -1 if they are mirrored, 0 if that is open.
    """

    name: str
    pose: BoardPose | None
    reason: str = ""
    corners: int = 0
    lit: int = 0
    handed: int = 0
    unread: str = ""

    def aside(self, reason: str) -> "PosedBoard":
        """Return the pose as one that is left aside."""
        return replace(self, pose=None, reason=reason)


@dataclass(frozen=True)
class RasterMap:
    """Projector coordinates (2, H, W), px, column and row, NaN where not known, with their u, px.

    `lit` and `saturated`, (H, W), say where the projector's light falls and where some frame is saturated; None: not
    known.
    """

    px: Array
    u_px: Array
    lit: NDArray[np.bool_] | None = None
    saturated: NDArray[np.bool_] | None = None


def _refined(image: NDArray[np.generic], corners: Array, target: Target) -> Array:
    """Place the corners of squares anew; dots and crossings of lines are no such corners, and stay."""
    if isinstance(target, Charuco):
        return refined_corners(image, corners, marker_part=target.marker_mm.value / target.square_mm.value)
    return refined_corners(image, corners) if isinstance(target, Chessboard) else corners


def posed_board(
    name: str, image: NDArray[np.generic], target: Target, raster: RasterMap, *, rules: PoseRules = POSE_RULES
) -> PosedBoard:
    """Find a board in its even picture, and read the projector's coordinates at its corners.

    Parameters
    ----------
    name
        What to call the pose.
    image
        Picture of the board without fringes, (H, W): lit evenly, or the mean of whole sets of phase shifts.
    target
        The board.
    raster
        The projector's coordinates of each pixel.
    rules
        When a corner counts, and when the pose.

    Notes
    -----
    Around a corner each coordinate is a smooth function of the pixel. A surface of second order is fitted to the light
    pixels about it, weighted by one over u squared, by Tukey's biweight; its value at the corner is what the projector
    would light there. Dark squares carry little phase, edges mix two: both are left out.
    """
    try:
        view = board_view(image, target)
    except DetectionError as error:
        return PosedBoard(name, None, f"no board: {error}{_glare(raster)}")
    corners = _refined(image, view.points_px, target)
    seen = np.isfinite(corners).all(axis=-1)
    place, u = _read_at(corners, raster, rules)
    columns, rows = np.meshgrid(np.arange(corners.shape[1]), np.arange(corners.shape[0]))
    board = np.stack([columns, rows, 0 * rows], axis=-1).reshape(-1, 3).astype(np.float64) * view.spacing_mm
    lit = np.isfinite(place).any(axis=-1)
    # Where the projector does not light all about a corner, the picture's own corner is drawn to the edge of its light.
    corners = np.where(lit[..., None], corners, np.nan)
    found = PosedBoard(
        name,
        BoardPose(board, corners.reshape(-1, 2), place.reshape(-1, 2), projector_u_px=u.reshape(-1, 2), name=name),
        corners=int(seen.sum()),
        lit=int(lit.sum()),
        handed=_handed(corners[lit], place[lit]),
        unread=_unread(view.points_px[seen & ~lit], float(np.nanmedian(_spacing(view.points_px))), raster),
    )
    return found if found.lit >= rules.least_corners else found.aside(_too_few(found, rules))


def _glare(raster: RasterMap) -> str:
    """Say how much of the picture is saturated, where that may be what hides the board."""
    share = 0.0 if raster.saturated is None else float(raster.saturated.mean())
    return f"; {share:.0%} of the picture is saturated: glare hides squares" if share > _MUCH_GLARE else ""


def _unread(corners: Array, spacing: float, raster: RasterMap) -> str:
    """Say why corners (n, 2) have no coordinate: by what most of the pixels about each show."""
    counts = dict.fromkeys(("saturated", "not lit by the projector", "too dark, or beside an edge of the light"), 0)
    saturated, unlit, dark = counts
    for corner in corners:
        low = np.maximum(np.rint(corner - spacing / 2).astype(int), 0)
        high = np.maximum(np.rint(corner + spacing / 2).astype(int) + 1, low + 1)
        part = np.s_[low[1] : high[1], low[0] : high[0]]
        if raster.saturated is not None and raster.saturated[part].mean() > _TELLING:
            counts[saturated] += 1
        elif raster.lit is not None and (~raster.lit[part]).mean() > _TELLING:
            counts[unlit] += 1
        else:
            counts[dark] += 1
    listed = ", ".join(f"{number} {why}" for why, number in counts.items() if number)
    return f"corners without a coordinate: {listed}" if listed else ""


def _too_few(found: PosedBoard, rules: PoseRules) -> str:
    return (
        f"the projector's coordinates are known at {found.lit} of {found.corners} corners, {rules.least_corners} are "
        "needed: it lights too little of the board, or its fringes are saturated or too weak there"
        + (f" ({found.unread})" if found.unread else "")
    )


def _read_at(corners: Array, raster: RasterMap, rules: PoseRules) -> tuple[Array, Array]:
    """Return the projector's coordinates at corners (R, C, 2) and their u, px; NaN where they cannot be read."""
    place, u = np.full(corners.shape, np.nan), np.full(corners.shape, np.nan)
    half = rules.reach * _spacing(corners)
    for index in zip(*np.nonzero(np.isfinite(corners).all(axis=-1)), strict=True):
        if np.isfinite(half[index]):
            for axis in (0, 1):
                place[(*index, axis)], u[(*index, axis)] = _at_corner(
                    raster.px[axis], raster.u_px[axis], corners[index], float(half[index]), rules
                )
    return place, u


def _spacing(corners: Array) -> Array:
    """Return the least distance of each corner from its neighbours, px, (R, C); NaN where it has none."""
    padded = np.pad(corners, ((1, 1), (1, 1), (0, 0)), constant_values=np.nan)
    inner = padded[1:-1, 1:-1]
    around = (padded[:-2, 1:-1], padded[2:, 1:-1], padded[1:-1, :-2], padded[1:-1, 2:])
    distances = np.stack([np.linalg.norm(other - inner, axis=-1) for other in around])
    return np.where(np.isfinite(distances).any(axis=0), np.fmin.reduce(distances), np.nan)


def _at_corner(px: Array, u_px: Array, corner: Array, half: float, rules: PoseRules) -> tuple[float, float]:
    """Fit a surface of second order to the light pixels about a corner; its value there and u, px."""
    low = np.maximum(np.ceil(corner - half).astype(int), 0)
    high = np.floor(corner + half).astype(int) + 1
    part = np.s_[low[1] : high[1], low[0] : high[0]]
    value, u = np.asarray(px[part], np.float64), np.asarray(u_px[part], np.float64)
    known = np.isfinite(value)
    if known.sum() < rules.least_pixels:
        return math.nan, math.nan
    bright = known & (u < rules.darker * np.quantile(u[known], 0.1))
    use = ndimage.binary_erosion(bright, np.ones((3, 3), bool), border_value=1)
    rows, columns = np.nonzero(use)
    x, y = (columns + low[0] - corner[0]) / half, (rows + low[1] - corner[1]) / half
    if x.size < rules.least_pixels or len(set(zip(x > 0, y > 0, strict=True))) < rules.least_quadrants:
        return math.nan, math.nan
    if _leverage(np.stack([x, y])) > rules.most_leverage:
        return math.nan, math.nan
    found, own = _robust_value(np.stack([x, y]), value[use], u[use])
    return (found, own) if own < rules.most_u_px else (math.nan, math.nan)


def _terms(at: Array) -> Array:
    """Terms of a surface of second order at places (2, n)."""
    x, y = at
    return np.stack([np.ones_like(x), x, y, x * x, x * y, y * y], axis=1)


def _leverage(at: Array) -> float:
    """Return the variance of a surface's value at 0 over that of the mean of its points."""
    terms = _terms(at)
    return float(len(terms) * np.linalg.pinv(terms.T @ terms)[0, 0])


def _robust_value(at: Array, value: Array, u: Array) -> tuple[float, float]:
    """Return the value at 0 of a surface of second order through values at places (2, n), and its u."""
    terms = _terms(at) / u[:, None]
    scaled = value / u
    weight, scale = np.ones(value.size), 1.0
    for _ in range(_ROUNDS):
        rows = terms * weight[:, None]
        solved = np.linalg.lstsq(rows, scaled * weight, rcond=None)[0]
        rest = scaled - terms @ solved
        scale = max(robust_sd(rest, about=0), 1e-9)
        weight = np.clip(1 - (rest / (_TUKEY * scale)) ** 2, 0, None)
    normal = (terms * weight[:, None]).T @ terms
    variance = np.linalg.pinv(normal)[0, 0] * max(scale, 1.0) ** 2
    return float(solved[0]), math.sqrt(max(variance, 0.0))


def _handed(corners: Array, place: Array) -> int:
    """Tell whether the projector's coordinates turn the same way as the picture's about the board."""
    known = np.isfinite(place).all(axis=-1)
    if known.sum() < _QUADRATIC:
        return 0
    seen = corners[known] - corners[known].mean(axis=0)
    change = np.linalg.lstsq(seen, place[known] - place[known].mean(axis=0), rcond=None)[0]
    return int(np.sign(np.linalg.det(change)))
