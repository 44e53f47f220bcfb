"""Whether a stated lens can be that of a camera or of a projector: what speaks against it, from its numbers alone."""

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from fringecal.camera.lens.brown_lens import Lens, project
from fringecal.camera.lens.lens_solve import MAX_FOCAL_REL_U
from fringecal.camera.lens.radial_lens import LEAST_SLOPE
from fringecal.uncertainty import value_text

Array = NDArray[np.float64]

Device = Literal["camera", "projector"]

PIXEL_SHAPES = {"camera": (1.0,), "projector": (1.0, 0.5, 2.0)}
"""Ratios fy / fx, a pixel's width over its height, of rasters that are built: square pixels, and of projectors also
diamond ones that are counted along one axis (DLP4500)."""
ASPECT_DOUBTED, ASPECT_REFUSED = 0.01, 0.05
"""Relative departure from such a shape. A raster is true to 1e-4, and calibrations whose poses are tilted find it to
some 1e-3; a per cent is ten times that, and by 5 % lengths are wrong by as much in one direction and not in another."""
TERM_DOUBTED = 0.1
"""Share of the radius at the picture's corner by which one term of a measuring lens or of a projector moves at most."""
ORDER_DOUBTED = 0.02  # of the radius at the corner: by so much a higher radial term may exceed the one before it
TANGENTIAL_DOUBTED, TANGENTIAL_REFUSED = 0.01, 0.05
"""Share of the radius at the corner by which a lens off its axis moves points: built ones stay below half of one %."""
BEND_REFUSED = 0.5  # of the radius at the corner: a field so bent is no straight one with distortion (a fisheye)
CAMERA_OFF_CENTRE = 0.25  # of a side of the picture: no camera's sensor stands further beside its lens
PROJECTOR_OFF_CENTRE = 1.0  # of a side: projectors throw upward by half to three quarters of their frame
PINNED_PX = 0.01  # a centre that is measured to a pixel falls this near to the middle once in ten thousand times
FIELDS_DOUBTED = (0.3, 30.0)  # focal lengths in longer sides of the picture: fields of 118 deg and of 2 deg
_DIRECTIONS = 72
_STEPS = 600  # along each direction, out to `_REACH` radii of the corner
_REACH = 4.0  # a lens that shrinks the corner to a quarter is refused as bent beyond any


@dataclass(frozen=True)
class Doubt:
    """What speaks against a stated calibration.

    Parameters
    ----------
    subject
        What it is about: "camera", "projector" or "pair".
    name
        A few words by which it is known.
    refused
        True where the calibration cannot be used because of it; False where it is open.
    sentence
        What was found, what was expected, and what to do.
    """

    subject: str
    name: str
    refused: bool
    sentence: str


@dataclass(frozen=True)
class Reach:
    """How far outward a lens shows rays.

    Parameters
    ----------
    corner
        Largest radius, in focal lengths, at which a ray is still seen in the picture.
    fold_px
        Distance from the centre at which the distortion folds inside the picture; None where it does not.
    least_slope
        Least stretch, seen over ideal, in any direction inside the picture.
    """

    corner: float
    fold_px: float | None
    least_slope: float


def lens_reach(lens: Lens) -> Reach:
    """Follow rays from the centre outward until they leave the picture, or the distortion folds.

    Notes
    -----
    Along each of many directions the determinant of the distortion's derivatives is positive where rays and pixels
    answer one another; from its first zero on, two rays share a pixel and pixels further out have none.
    """
    fx, fy, cx, cy = lens.values[:4]
    angle = np.linspace(0, 2 * np.pi, _DIRECTIONS, endpoint=False)
    unit = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    enters, leaves = _crossed(unit * [fx, fy], lens)
    radius = np.linspace(0, _REACH * leaves.max(initial=0.0), _STEPS)
    ideal = radius[None, :, None] * unit[:, None, :]
    with np.errstate(over="ignore", invalid="ignore"):
        rays = np.dstack([ideal, np.ones(ideal.shape[:2])]).reshape(-1, 3)
        seen = (project(lens.values, rays).reshape(ideal.shape) - [cx, cy]) / [fx, fy]
        determinant, least = _stretch(lens.values, ideal)
    corner, fold, slope = 0.0, math.inf, math.inf
    for k in np.flatnonzero(leaves > enters):
        away = np.hypot(*seen[k].T)
        last = _first_zero(radius, determinant[k])
        good = radius <= last
        if math.isfinite(last):
            reached = float(np.hypot(*(project(lens.values, np.array([[*(last * unit[k]), 1.0]]))[0] - [cx, cy])))
            stretch = float(np.hypot(*(unit[k] * [fx, fy])))
            fold = min(fold, reached) if reached < leaves[k] * stretch else fold
        corner = max(corner, float(np.interp(leaves[k], away[good], radius[good])))
        inside = good & (away >= enters[k]) & (away <= leaves[k])
        slope = min(slope, float(least[k][inside].min(initial=math.inf)))
    return Reach(corner, fold if math.isfinite(fold) else None, slope)


def _crossed(directions: Array, lens: Lens) -> tuple[Array, Array]:
    """Lengths along directions (n, 2), px, from the centre, between which each crosses the picture; 0, 0 where not."""
    centre = lens.values[2:4]
    low, high = np.full(2, -0.5) - centre, np.array([lens.width_px, lens.height_px]) - 0.5 - centre
    with np.errstate(divide="ignore"):
        first, second = low / directions, high / directions
    enters = np.maximum(np.minimum(first, second).max(axis=1), 0.0)
    leaves = np.maximum(first, second).min(axis=1)
    crosses = leaves > enters
    return np.where(crosses, enters, 0.0), np.where(crosses, leaves, 0.0)


def _first_zero(radius: Array, values: Array) -> float:
    """Radius at which values pass zero first, between its steps; infinite where they do not."""
    below = np.flatnonzero(~(values > 0))
    if not below.size:
        return math.inf
    k = int(below[0])
    if k == 0 or not math.isfinite(values[k]):
        return float(radius[k])
    share = values[k - 1] / (values[k - 1] - values[k])
    return float(radius[k - 1] + share * (radius[k] - radius[k - 1]))


def lens_doubts(lens: Lens, device: Device = "camera", *, pixel_aspect: float | None = None) -> tuple[Doubt, ...]:
    """What speaks against a lens.

    Parameters
    ----------
    lens
        As it is stated.
    device
        Of a projector the centre may lie beside the picture's middle, and pixels may be diamonds.
    pixel_aspect
        Distance of rows over that of columns (fx / fy), as sessions state it, where it is known; by default any that is
        built.

    Examples
    --------
    >>> plain = Lens(np.array([800.0, 800.0, 323.1, 236.4, 0, 0, 0, 0, 0]), np.zeros((9, 9)), 640, 480)
    >>> lens_doubts(plain)
    ()
    """
    reach = lens_reach(lens)
    centre = _centre(lens, device)
    found = [
        *_aspect(lens, device, pixel_aspect),
        *_field(lens, device),
        *_fold(lens, reach, device),
        *_radial(lens, reach, device, pinned=any(each.name == "centre pinned" for each in centre)),
        *_tangential(lens, reach, device),
        *centre,
        *_uncertainty(lens, device),
    ]
    return tuple(found)


def _stretch(values: Array, ideal: Array) -> tuple[Array, Array]:
    """Determinant of the distortion's derivatives, and its least stretch, at ideal places (..., 2)."""
    k1, k2, p1, p2, k3 = values[4:]
    x, y = ideal[..., 0], ideal[..., 1]
    r2 = x * x + y * y
    factor = 1 + r2 * (k1 + r2 * (k2 + r2 * k3))
    rise = 2 * (k1 + r2 * (2 * k2 + 3 * r2 * k3))
    xx = factor + x * x * rise + 2 * p1 * y + 6 * p2 * x
    yy = factor + y * y * rise + 6 * p1 * y + 2 * p2 * x
    xy = x * y * rise + 2 * p1 * x + 2 * p2 * y
    determinant = xx * yy - xy * xy
    # Of a symmetric matrix the least singular value is that of the smaller eigenvalue, by its size.
    half, apart = (xx + yy) / 2, np.hypot((xx - yy) / 2, xy)
    return determinant, np.minimum(np.abs(half - apart), np.abs(half + apart))


def _aspect(lens: Lens, device: Device, stated: float | None) -> list[Doubt]:
    found = lens["fy_px"] / lens["fx_px"]
    shapes = PIXEL_SHAPES[device] if stated is None else (1 / stated,)
    nearest = min(shapes, key=lambda shape: abs(math.log(found / shape)))
    off = abs(found / nearest - 1)
    if off <= ASPECT_DOUBTED:
        return []
    square = "1 (square pixels)" if device == "camera" else "1 (square pixels), 0.5 or 2 (diamonds)"
    expected = square if stated is None else f"{1 / stated:.4g}, as stated"
    sentence = (
        f"fy / fx, a pixel's width over its height, is {found:.3f} and should be {expected}: {off:.1%} off. The "
        "board's print was stretched, its squares counted wrongly, a scaler or keystone stood between frame and "
        "pixels, or the poses were too much alike"
    )
    return [Doubt(device, "pixel aspect", off > ASPECT_REFUSED, sentence)]


def _field(lens: Lens, device: Device) -> list[Doubt]:
    sides = max(lens["fx_px"] / lens.width_px, lens["fy_px"] / lens.height_px)
    low, high = FIELDS_DOUBTED
    if low <= sides <= high:
        return []
    degrees = 2 * math.degrees(math.atan(0.5 / sides))
    sentence = (
        f"the focal length is {sides:.3g} sides of the picture, a field of {degrees:.2g} deg: was it calibrated at "
        f"another resolution than {lens.width_px} x {lens.height_px} px?"
    )
    return [Doubt(device, "field of view", False, sentence)]


def _fold(lens: Lens, reach: Reach, device: Device) -> list[Doubt]:
    edge = math.hypot(lens.width_px, lens.height_px) / 2
    terms = ", ".join(f"{name} = {lens[name]:.4g}" for name in ("k1", "k2", "k3") if lens[name])
    if reach.fold_px is not None:
        sentence = (
            f"the distortion ({terms}) folds {reach.fold_px:.0f} px from its centre, inside the picture (half diagonal "
            f"{edge:.0f} px): pixels beyond are seen by no ray or by two. It follows noise where the board never was; "
            "calibrate with fewer terms and with the board out to the corners"
        )
        return [Doubt(device, "distortion folds", True, sentence)]
    if reach.least_slope < LEAST_SLOPE:
        sentence = (
            f"the distortion ({terms}) shrinks the picture to {reach.least_slope:.2f} of its size somewhere, "
            f"{LEAST_SLOPE} at least were expected; calibrate with fewer terms and with the board out to the corners"
        )
        return [Doubt(device, "distortion nearly folds", True, sentence)]
    return []


def _radial(lens: Lens, reach: Reach, device: Device, *, pinned: bool) -> list[Doubt]:
    """Judge the radial terms by what they do at the picture's corner; of a lens that folds nothing is left to say."""
    if reach.fold_px is not None:
        return []
    shares = np.array([lens[name] * reach.corner ** (2 * n) for n, name in enumerate(("k1", "k2", "k3"), 1)])
    found = []
    if abs(shares.sum()) > BEND_REFUSED:
        sentence = (
            f"the distortion moves the picture's corner by {abs(shares.sum()):.0%} of its radius: no straight field "
            "with distortion (a fisheye, or terms that follow noise)"
        )
        found.append(Doubt(device, "distortion's size", True, sentence))
    irregular = _irregular(shares)
    if irregular:
        sentence = (
            f"{irregular}; terms of an objective fall from one order to the next. The board did not reach the corners, "
            "or its poses were too few for so many terms"
        )
        if pinned:
            sentence += ", and the centre, which was pinned, left its error to the distortion"
        found.append(Doubt(device, "distortion's terms", pinned, sentence))
    return found


def _tangential(lens: Lens, reach: Reach, device: Device) -> list[Doubt]:
    """Judge the tangential terms likewise."""
    share = 3 * reach.corner * math.hypot(lens["p1"], lens["p2"])
    if share <= TANGENTIAL_DOUBTED:
        return []
    sentence = (
        f"p1 = {lens['p1']:.3g}, p2 = {lens['p2']:.3g} move points by {share:.1%} of their radius at the corner, where "
        f"a built lens moves them by less than {TANGENTIAL_DOUBTED:.0%}: they stand for a centre that is elsewhere, or "
        "for noise"
    )
    return [Doubt(device, "tangential terms", share > TANGENTIAL_REFUSED, sentence)]


def _irregular(shares: Array) -> str:
    """Say which radial term outgrows what a lens shows, if one does; shares of the radius at the corner."""
    names = ("k1", "k2", "k3")
    for n in (1, 2):
        if abs(shares[n]) > abs(shares[n - 1]) + ORDER_DOUBTED:
            return (
                f"at the picture's corner {names[n]} moves points by {shares[n]:+.1%} of their radius and "
                f"{names[n - 1]} by {shares[n - 1]:+.1%}"
            )
    both = np.abs(shares).sum() - abs(shares.sum())
    if both > 2 * TERM_DOUBTED:
        parts = ", ".join(f"{name} {share:+.1%}" for name, share in zip(names, shares, strict=True))
        return f"at the picture's corner terms of opposite sign all but cancel ({parts})"
    return ""


def _centre(lens: Lens, device: Device) -> list[Doubt]:
    off = np.array([lens["cx_px"] - (lens.width_px - 1) / 2, lens["cy_px"] - (lens.height_px - 1) / 2])
    sides = np.array([lens.width_px, lens.height_px])
    where = f"({lens['cx_px']:.2f}, {lens['cy_px']:.2f}) px"
    limit = CAMERA_OFF_CENTRE if device == "camera" else PROJECTOR_OFF_CENTRE
    if (np.abs(off) > limit * sides).any():
        outside = (np.abs(off) > 0.5 * sides).any()
        sentence = (
            f"the principal point {where} lies {np.abs(off / sides).max():.0%} of a side beside the middle of a "
            f"picture of {lens.width_px} x {lens.height_px} px; was it calibrated at another resolution, or on a part "
            "of the sensor?"
        )
        return [Doubt(device, "principal point", bool(outside), sentence)]
    if any((np.abs(off - shift) < PINNED_PX).all() for shift in (0.0, 0.5)):
        sentence = (
            f"the principal point {where} is exactly the picture's middle: it was pinned there, not measured, and what "
            "it is off by stands in the other parameters"
        )
        sentence += "; a projector's is usually far from the middle" if device == "projector" else ""
        return [Doubt(device, "centre pinned", False, sentence)]
    return []


def _uncertainty(lens: Lens, device: Device) -> list[Doubt]:
    if not lens.covariance_known:
        sentence = "the file states no uncertainty of this lens: no measurement with it has an uncertainty that holds"
        return [Doubt(device, "no uncertainty", False, sentence)]
    focal = lens.estimate("fx_px")
    if focal.u > MAX_FOCAL_REL_U * focal.value:
        sentence = (
            f"the focal length is {value_text(focal.value, focal.u)} px with u {focal.u:.2g} px, more than "
            f"{MAX_FOCAL_REL_U:.0%}: the poses of the board did not determine it; add poses tilted 20 to 40 degrees to "
            "different sides"
        )
        return [Doubt(device, "focal length undetermined", True, sentence)]
    return []
