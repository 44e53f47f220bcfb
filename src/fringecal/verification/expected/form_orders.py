"""Fringe orders from a form of known place: each pixel has the order nearest to the phase that it must show.

A rig that reads heights wrongly, or an artefact that is not what it should be, departs from the expected phase by
more than half a fringe in the end. So the departure itself is followed over each top: it is smooth there, whatever the
top's own slope, and only its mean over the top must lie within half a fringe.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from fringecal.errors import FitError
from fringecal.numerics import wrap
from fringecal.targets import BallTop, PlaneTop, Top
from fringecal.verification.expected.form_search import CAP_DEG
from fringecal.verification.expected.known_rig import Floats, KnownRig
from fringecal.verification.expected.level_tops import demand_level
from fringecal.verification.expected.placed_form import PLATE, FormPlace, met_by_sight
from fringecal.verification.forms.pieces import MIN_PIXELS, RIM_PX

Mask = NDArray[np.bool_]

NOTHING = -2
"""Number of what is neither a top nor the plate: walls, rims, and what else lies about."""

_BESIDE_SHADOW_PX = 5  # side of the square that must be lit: blur brings what lies in shadow next to it


@dataclass(frozen=True)
class OrderByForm:
    """When a form decides orders.

    Parameters
    ----------
    open_rad
        Mean departure of a top from its expected phase beyond which two orders are equally near.
    plate_rad
        Departure up to which a pixel beside the form is the bare plate; something else stands there otherwise.
    lag_px
        Over which the departure's slope is read first: no two neighbours of it differ by half a fringe then.
    outside_rad
        Departure from a top's smooth course beyond which a pixel takes no part in it.
    least_agreeing
        Share of a top's pixels that must follow its smooth course within that.
    """

    open_rad: float = 2.6
    plate_rad: float = 0.5
    lag_px: int = 4
    outside_rad: float = 1.2
    least_agreeing: float = 0.9


ORDER_BY_FORM = OrderByForm()


@dataclass(frozen=True)
class FormPhase:
    """Absolute phase of a form and the plate beside it.

    Parameters
    ----------
    step_rad
        Phase over the plate's at the same pixel, (H, W); NaN where no form decides it.
    top
        Number of the top that each pixel sees, -1 the plate, `NOTHING`; (H, W).
    core
        Where a top is seen clear of rims, (H, W).
    """

    step_rad: Floats
    top: NDArray[np.int16]
    core: Mask


def orders_by_form(
    tops: Sequence[Top],
    place: FormPlace,
    wrapped_rad: NDArray[np.floating],
    valid: Mask,
    rig: KnownRig,
    *,
    rules: OrderByForm = ORDER_BY_FORM,
) -> FormPhase:
    """Give every pixel of a placed form the fringe order that the form demands.

    Parameters
    ----------
    tops, place
        The form and where it lies.
    wrapped_rad, valid
        Phase up to whole fringes, and where there is one; (H, W).
    rig
        The calibrated rig.

    Raises
    ------
    FitError
        A top's phase lies half-way between two fringes, is that of no such top, or is level with another order only.
    """
    rays = rig.camera.pixel_rays()
    met = met_by_sight(tops, place, rays)
    plate = rig.model.phase(rays.ax, rays.ay, 0.0)
    x, y = rays.at(met.z_mm)
    expected = rig.model.phase(x, y, met.z_mm)
    departure = wrap(np.asarray(wrapped_rad, float) - expected)
    step = np.full(plate.shape, np.nan)
    core = _clear_of_rims(met.top, valid) & ~_steep(tops, place, x, y, met.z_mm)
    lit = ndimage.binary_erosion(valid, np.ones((_BESIDE_SHADOW_PX,) * 2, dtype=np.bool_), border_value=1)
    seen = 0
    for number, top in enumerate(tops):
        inside = core & (met.top == number)
        if np.count_nonzero(inside) < MIN_PIXELS:
            continue
        course = _course(departure, inside, 2 if isinstance(top, BallTop) else 1, rules)
        _demand_order(departure, inside, course, number, rules, has_height=top.heights_mm[1] > 0)
        seen += 1
        absolute = expected + course + wrap(departure - course)
        if isinstance(top, PlaneTop) and not top.slope and top.heights_mm[1] > 0:
            v, u = np.nonzero(inside)
            demand_level(absolute[inside], (u, v), rig)
        here = lit & (met.top == number)
        here &= ~_beside(here & (np.abs(wrap(departure - course)) > rules.outside_rad))
        step[here] = (absolute - plate)[here]
    if not seen:
        raise FitError("no top of the artefact has enough lit pixels clear of its rims; light more of it")
    bare = valid & _bare(met.top) & (np.abs(departure) < rules.plate_rad)
    step[bare] = departure[bare]
    shown = np.where(np.isfinite(step), met.top, NOTHING).astype(np.int16)
    return FormPhase(step, shown, core & np.isfinite(step) & (shown >= 0))


def _clear_of_rims(top: NDArray[np.int16], valid: Mask) -> Mask:
    """Keep pixels of a top whose neighbours all see the same top and are lit."""
    side = 2 * RIM_PX + 1
    same = ndimage.minimum_filter(top, side) == ndimage.maximum_filter(top, side)
    # The picture's border counts as a rim: what blurs or filters a picture lacks neighbours there.
    return (top >= 0) & same & ndimage.binary_erosion(valid, np.ones((side, side), dtype=np.bool_))


def _steep(tops: Sequence[Top], place: FormPlace, x: Floats, y: Floats, z: Floats) -> Mask:
    """Tell what of balls is steeper than the cap."""
    s, t = place.inside(x, y)
    steep = np.zeros(s.shape, dtype=np.bool_)
    lowest = np.cos(np.radians(CAP_DEG))
    for top in tops:
        if isinstance(top, BallTop):
            steep |= top.covers(s, t) & (z < top.radius_mm * (1 + lowest))
    return steep


def _beside(other: Mask) -> Mask:
    """Widen what shows something else than the top by a rim: blur mixes both there."""
    return ndimage.binary_dilation(other, np.ones((2 * RIM_PX + 1,) * 2, dtype=np.bool_))


def _bare(top: NDArray[np.int16]) -> Mask:
    """Tell what sees the plate, rims of the form left out."""
    return ndimage.minimum_filter((top == PLATE).astype(np.uint8), 2 * RIM_PX + 1).astype(np.bool_)


def _course(departure: Floats, inside: Mask, degree: int, rules: OrderByForm) -> Floats:
    """Return the smooth course of the departure over a top: a polynomial of the pixel's place, map (H, W)."""
    v, u = (np.asarray(c, float) for c in np.indices(departure.shape))
    v0, u0 = v[inside].mean(), u[inside].mean()
    size = max(float(np.ptp(u[inside])), float(np.ptp(v[inside])), 1.0)
    p, q = (u - u0) / size, (v - v0) / size
    slopes = [size * _slope(departure, inside, axis, rules.lag_px) for axis in (1, 0)]
    rough = slopes[0] * p + slopes[1] * q
    middle = float(np.angle(np.mean(np.exp(1j * (departure - rough)[inside]))))
    terms = np.stack([p**i * q**j for i in range(degree + 1) for j in range(degree + 1 - i)], axis=-1)
    course = rough + middle
    for _ in range(4):
        left = wrap(departure - course)
        used = inside & (np.abs(left) < rules.outside_rad)
        if np.count_nonzero(used) < MIN_PIXELS:
            break
        course = course + terms @ np.linalg.lstsq(terms[used], left[used], rcond=None)[0]
    return course - 2 * np.pi * round(float(np.median(course[inside])) / (2 * np.pi))


def _slope(departure: Floats, inside: Mask, axis: int, lag: int) -> float:
    """Median change of the departure per pixel along an axis, from pairs a few pixels apart; 0 where there are few."""
    ahead = [slice(None), slice(None)]
    behind = [slice(None), slice(None)]
    ahead[axis], behind[axis] = slice(lag, None), slice(None, -lag)
    both = inside[tuple(ahead)] & inside[tuple(behind)]
    if np.count_nonzero(both) < MIN_PIXELS:
        return 0.0
    change = wrap(departure[tuple(ahead)] - departure[tuple(behind)])[both]
    return float(np.angle(np.mean(np.exp(1j * change)))) / lag


def _demand_order(
    departure: Floats, inside: Mask, course: Floats, number: int, rules: OrderByForm, *, has_height: bool
) -> None:
    """Refuse a top whose order is open, or whose pixels show something else; a plate has no height."""
    middle = float(np.median(course[inside]))
    if has_height and abs(middle) > rules.open_rad:
        raise FitError(
            f"fringe order open: the phase of top {number + 1} deviates by {middle:+z.2f} rad from what the rig "
            "predicts for the certified height, nearly half a fringe, so that two orders fit equally well; check the "
            "target's sizes, then the calibration"
        )
    agreeing = float(np.mean(np.abs(wrap(departure - course)[inside]) < rules.outside_rad))
    if agreeing < rules.least_agreeing:
        raise FitError(
            f"{100 * (1 - agreeing):.0f} % of the pixels of top {number + 1} show another phase than a smooth surface "
            "there would; look for a frame that moved or was swapped, for something that lies on the artefact, and "
            "whether the target is the one in the picture"
        )
