"""Find a form of known size in a phase map: the place at which the phase is that of the form, and not the plate's.

Coarsely by correlation: at each of the form's heights every point of a lattice votes, by how much better the phase
there fits that height than the plate. Then the best places are refined against the pixels themselves.
"""

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy import fft, ndimage, optimize

from fringecal.errors import FitError
from fringecal.numerics import wrap
from fringecal.targets import BallTop, PlaneTop, Top
from fringecal.verification.expected.known_rig import Floats, KnownRig
from fringecal.verification.expected.placed_form import PLATE, FormPlace, met_by_sight

Mask = NDArray[np.bool_]
Spectrum = NDArray[np.complex128]

CAP_DEG = 50.0
"""Of a ball, points steeper than this against the plate are left out: blur and shadow reach them."""

_CAP_SLOPE = 0.7  # of a ball's cap, on the mean over its area
_SAME = 1e-4  # of a form's height: what differs by less is the same turned round
_ROOM = 0.15  # of the form's reach, beside the picture on every side: a form that sticks out further is not looked for


@dataclass(frozen=True)
class SearchRules:
    """How a form is looked for, and when it counts as found.

    Parameters
    ----------
    nodes, most_nodes, step_rad
        Of the lattice along the picture's longer side; more where slopes would rise further over a step, in phase.
    turns_deg
        Steps of the directions that are tried: all round, then about the best.
    slice_rad
        Rise that one level of a slope or ball stands for, in phase.
    coarse_rad, fine_rad
        Beyond which a misfit counts no more: coarsely, since place and rig are not known yet, then in two rounds.
    unlit
        Vote of a point without phase: shadow is expected, absence is not.
    kept
        Places that are refined.
    pixels
        That a place is refined with.
    agrees_rad
        Misfit of a pixel that agrees with the form: an eighth of a fringe, one in four by chance.
    least_agreeing
        Share of lit pixels that must agree: of a rig that reads heights wrongly the tallest do not.
    least_lit
        Share of the tops that must have a phase.
    least_lead
        Of `FoundForm.lead`: an rms difference of 0.09 rad between form and plate, about what a rig errs by.
    """

    nodes: int = 128
    most_nodes: int = 320
    step_rad: float = 1.6
    turns_deg: tuple[float, ...] = (6.0, 2.0, 0.7)
    slice_rad: float = 1.5
    coarse_rad: float = 1.2
    fine_rad: tuple[float, ...] = (1.0, 0.5)
    unlit: float = -0.1
    kept: int = 4
    pixels: int = 5000
    agrees_rad: float = 0.8
    least_agreeing: float = 0.5
    least_lit: float = 0.25
    least_lead: float = 0.03


SEARCH = SearchRules()


@dataclass(frozen=True)
class FoundForm:
    """A form in the picture.

    Parameters
    ----------
    place
        Where it lies.
    agreeing
        Share of the lit pixels of its tops that have its phase.
    lit
        Share of the tops' pixels that have a phase.
    lead
        By how much the form fits its pixels better than the bare plate does: mean of the capped, squared misfit,
        1 where plate is out of the question and 0 where form and plate cannot be distinguished.
    """

    place: FormPlace
    agreeing: float
    lit: float
    lead: float


def find_form(
    tops: Sequence[Top], wrapped_rad: NDArray[np.floating], valid: Mask, rig: KnownRig, *, rules: SearchRules = SEARCH
) -> FoundForm:
    """Find a form in a phase map.

    Parameters
    ----------
    tops
        The form.
    wrapped_rad, valid
        Phase up to whole fringes, and where there is one; (H, W).
    rig
        The calibrated rig.

    Raises
    ------
    FitError
        Nothing in the picture could be the form.
    """
    pixels = _Pixels.of(wrapped_rad, valid, rig)
    if not _has_edges(tops):
        return _described(tops, FormPlace(0.0, 0.0, 0.0), pixels, rules)
    candidates = _candidates(tops, wrapped_rad, valid, rig, rules)
    refined = [_refined(tops, place, pixels, rules) for place in candidates]
    best, misfit = min(refined, key=lambda pair: pair[1])
    if _turns(tops, rules).size > 1 and not _same_turned_round(tops, _SAME):
        # Balls of nearly one size, low wedges: turned round they fit nearly as well, and the lattice takes either.
        round_ = _refined(tops, replace(best, turn_rad=best.turn_rad + math.pi), pixels, rules)
        best = round_[0] if round_[1] < misfit else best
    return _described(tops, best, pixels, rules)


def demand_form(found: FoundForm, tops: Sequence[Top], what: str, *, rules: SearchRules = SEARCH) -> None:
    """Refuse a form that is not where it was found.

    Parameters
    ----------
    found
        What `find_form` returned.
    tops, what
        The form, and its name in messages.

    Raises
    ------
    FitError
        The best place shows something else, is hardly lit, or shows what bare plate would show as well.
    """
    if not _has_edges(tops):
        return
    where = f"at ({found.place.x_mm:.0f}, {found.place.y_mm:.0f}) mm, where it would fit best"
    if found.lit < rules.least_lit:
        raise FitError(
            f"no {what} in the picture: {where}, only {100 * found.lit:.0f} % of its top has fringes. Light it, and "
            "leave all of it in view"
        )
    if found.agreeing < rules.least_agreeing:
        raise FitError(
            f"no {what} in the picture: {where}, {100 * found.agreeing:.0f} % of its top has the phase that it "
            "must show. Check that the target states what lies there, and its sizes; then the calibration"
        )
    if found.lead < rules.least_lead:
        raise FitError(
            f"the {what} cannot be distinguished from the plate: {where}, its top stands whole fringes above the "
            "plate. Take a second period, turn it, or use one of another height"
        )


def _has_edges(tops: Sequence[Top]) -> bool:
    if not tops:
        raise FitError("the target has no top that could be looked for")
    return all(isinstance(top, BallTop) or math.isfinite(top.low_mm) for top in tops)


# ------------------------------------------------------------------ coarse


@dataclass(frozen=True)
class _Lattice:
    """Points of the plate at which votes are taken: x grows along columns, y along rows."""

    x: Floats
    y: Floats
    step_mm: float

    @classmethod
    def over(cls, rig: KnownRig, room_mm: float, step_mm: float, rules: SearchRules) -> "_Lattice":
        camera = rig.camera
        corners = camera.rays(
            np.array([0.0, camera.width_px, 0.0, camera.width_px]),
            np.array([0.0, 0.0, camera.height_px, camera.height_px]),
        )
        sides = [(float(c.min()), float(c.max())) for c in (corners.ax, corners.ay)]
        side = max(high - low for low, high in sides)
        step = float(np.clip(step_mm, side / rules.most_nodes, side / rules.nodes))
        # Room for the form beside the picture: the correlation is circular.
        x, y = (np.arange(low - room_mm, high + room_mm, step) for low, high in sides)
        xx, yy = np.meshgrid(x, y)
        return cls(xx, yy, step)


def _candidates(
    tops: Sequence[Top], wrapped: NDArray[np.floating], valid: Mask, rig: KnownRig, rules: SearchRules
) -> list[FormPlace]:
    """Return the best places of the correlation, no two of them alike."""
    rad_per_mm = max(abs(float(rig.model.phase(0.0, 0.0, 0.5) - rig.model.phase(0.0, 0.0, -0.5))), 1e-9)
    steepest = max((abs(top.slope) if isinstance(top, PlaneTop) else _CAP_SLOPE for top in tops), default=0.0)
    step_mm = rules.step_rad / rad_per_mm / max(steepest, 1e-9)
    lattice = _Lattice.over(rig, _ROOM * _reach_mm(tops), step_mm, rules)
    levels = _levels(tops, rules.slice_rad / rad_per_mm)
    spectra = [fft.rfft2(_votes(z, wrapped, valid, rig, lattice, rules).astype(np.float32)) for z in levels]

    def best_at(turns: Iterable[float]) -> list[tuple[float, FormPlace]]:
        found = (pair for turn in turns for pair in _best_at(turn, tops, levels, spectra, lattice))
        return sorted(found, key=lambda pair: -pair[0])

    kept: list[FormPlace] = []
    for _, place in best_at(np.radians(_turns(tops, rules)).tolist()):
        if not any(_alike(place, other, lattice.step_mm, rules) for other in kept):
            kept.append(place)
        if len(kept) == rules.kept:
            break
    if steepest == 0 or _turns(tops, rules).size == 1:
        return kept
    return [_finer(place, best_at, rules) for place in kept]


def _finer(
    place: FormPlace, best_at: Callable[[Iterable[float]], list[tuple[float, FormPlace]]], rules: SearchRules
) -> FormPlace:
    """Try directions about a place in finer steps: the ends of long slopes move by fringes over a coarse one."""
    for before, step in zip(rules.turns_deg, rules.turns_deg[1:], strict=False):
        place = best_at((place.turn_rad + np.radians(np.arange(-before + step, before, step))).tolist())[0][1]
    return place


def _alike(one: FormPlace, other: FormPlace, step_mm: float, rules: SearchRules) -> bool:
    turn = abs(math.remainder(one.turn_rad - other.turn_rad, 2 * math.pi))
    near = math.hypot(one.x_mm - other.x_mm, one.y_mm - other.y_mm) < 3 * step_mm
    return near and turn < math.radians(1.5 * rules.turns_deg[0])


def _reach_mm(tops: Sequence[Top]) -> float:
    return 2 * max(_radius_mm(top) for top in tops)


def _radius_mm(top: Top) -> float:
    if isinstance(top, BallTop):
        return abs(top.x_mm) + top.radius_mm
    return math.hypot(max(abs(top.low_mm), abs(top.high_mm)), top.half_length_mm)


def _turns(tops: Sequence[Top], rules: SearchRules) -> Floats:
    """Directions to be tried, deg: one for a ball, half a circle for what looks the same when turned round."""
    if len(tops) == 1 and isinstance(tops[0], BallTop):
        return np.zeros(1)
    step = rules.turns_deg[1 if isinstance(tops[0], BallTop) else 0]  # both balls of a bar, or one alone fits best
    return np.arange(0.0, 180.0 if _same_turned_round(tops) else 360.0, step)


def _same_turned_round(tops: Sequence[Top], share: float = 0.01) -> bool:
    """Whether half a turn leaves the form as it is, to a share of its height."""
    tolerance = share * max(top.heights_mm[1] for top in tops)
    pairs = zip(tops, reversed(tops), strict=True)
    return all(_mirrored(one, other, tolerance) for one, other in pairs)


def _mirrored(one: Top, other: Top, tolerance: float) -> bool:
    if isinstance(one, PlaneTop) and isinstance(other, PlaneTop):
        numbers = (one.low_mm + other.high_mm, one.height_mm - other.height_mm)
        return max(map(abs, numbers)) < tolerance and abs(one.slope + other.slope) < 1e-6
    if isinstance(one, BallTop) and isinstance(other, BallTop):
        return max(abs(one.x_mm + other.x_mm), abs(one.radius_mm - other.radius_mm)) < tolerance
    return False


def _levels(tops: Sequence[Top], step_mm: float) -> Floats:
    """Heights at which votes are taken: those of level tops, and steps over slopes and caps."""
    level = {top.height_mm for top in tops if isinstance(top, PlaneTop) and not top.slope}
    runs = [_run(top) for top in tops if isinstance(top, BallTop) or top.slope]
    sloping = set()
    for low, high in runs:
        number = max(1, math.ceil((high - low) / step_mm))
        sloping |= {round(low + (k + 0.5) * (high - low) / number, 3) for k in range(number)}
    return np.array(sorted(level | sloping))


def _run(top: Top) -> tuple[float, float]:
    """Heights over which a sloping top is looked for: of a ball, those of its cap."""
    low, high = top.heights_mm
    return (low + top.radius_mm * math.cos(math.radians(CAP_DEG)), high) if isinstance(top, BallTop) else (low, high)


def _votes(
    z: float, wrapped: NDArray[np.floating], valid: Mask, rig: KnownRig, lattice: _Lattice, rules: SearchRules
) -> Floats:
    """From 1, where the phase is that of the height and not the plate's, to -1 where it is the other way round."""
    u, v = rig.camera.project(lattice.x, lattice.y, z)
    column, row = (np.rint(np.nan_to_num(c, nan=-1.0)).astype(int) for c in (u, v))
    seen = (column >= 0) & (column < wrapped.shape[1]) & (row >= 0) & (row < wrapped.shape[0])
    column, row = np.where(seen, column, 0), np.where(seen, row, 0)
    phase = wrapped[row, column]
    foot = rig.camera.rays(column.astype(float), row.astype(float))
    here = _capped(phase - rig.model.phase(lattice.x, lattice.y, z), rules.coarse_rad)
    plate = _capped(phase - rig.model.phase(foot.ax, foot.ay, 0.0), rules.coarse_rad)
    return np.where(seen & valid[row, column], plate - here, rules.unlit)


def _capped(misfit: Floats, cap: float) -> Floats:
    """Squared misfit over its cap, from 0 to 1."""
    return np.minimum((wrap(np.nan_to_num(misfit)) / cap) ** 2, 1.0)


def _best_at(
    turn: float, tops: Sequence[Top], levels: Floats, spectra: Sequence[Spectrum], lattice: _Lattice
) -> Iterator[tuple[float, FormPlace]]:
    """Correlate the votes with the form turned so; yield the two best places."""
    shape = lattice.x.shape
    stencils, area = _stencils(turn, tops, levels, lattice)
    total = np.zeros(spectra[0].shape, spectra[0].dtype)
    for vote, stencil in zip(spectra, stencils, strict=True):
        total += vote * np.conj(fft.rfft2(stencil))
    score: Floats = np.asarray(fft.irfft2(total, shape)) / max(area, 1)
    peaks = np.argwhere(score == ndimage.maximum_filter(score, 9, mode="wrap"))
    order = np.argsort(-score[peaks[:, 0], peaks[:, 1]])[:2]
    for row, column in peaks[order]:
        x = lattice.x[0].mean() + lattice.step_mm * _signed(int(column), shape[1])
        y = lattice.y[:, 0].mean() + lattice.step_mm * _signed(int(row), shape[0])
        yield float(score[row, column]), FormPlace(float(x), float(y), turn)


def _stencils(
    turn: float, tops: Sequence[Top], levels: Floats, lattice: _Lattice
) -> tuple[list[NDArray[np.float32]], int]:
    """Which points of the lattice lie under the form at which level, the form in the lattice's middle."""
    dx, dy = lattice.x - lattice.x[0].mean(), lattice.y - lattice.y[:, 0].mean()
    s, t = FormPlace(0.0, 0.0, turn).turned(dx, dy)
    nearest = np.full(s.shape, -1)
    for top in tops:
        low, high = _run(top)
        with np.errstate(invalid="ignore"):
            z = top.height(s, t)
            inside = top.covers(s, t) & (z >= low - 1e-9) & (z <= high + 1e-9)
        nearest[inside] = np.argmin(np.abs(z[inside][:, None] - levels), axis=1)
    return [(nearest == k).astype(np.float32) for k in range(len(levels))], int(np.sum(nearest >= 0))


def _signed(index: int, size: int) -> int:
    """Shift that an index of a circular correlation stands for."""
    return index - size if index > size // 2 else index


# ------------------------------------------------------------------ fine


@dataclass(frozen=True)
class _Pixels:
    """Pixels of the picture as lists: phase, whether there is one, line of sight, and the plate's phase."""

    phase: Floats
    valid: Mask
    ax: Floats
    ay: Floats
    bx: Floats
    by: Floats
    plate: Floats
    rig: KnownRig

    @classmethod
    def of(cls, wrapped: NDArray[np.floating], valid: Mask, rig: KnownRig) -> "_Pixels":
        rays = rig.camera.pixel_rays()
        plate = rig.model.phase(rays.ax, rays.ay, 0.0)
        phase, ax, ay, bx, by, foot = (
            np.asarray(m, float).ravel() for m in (wrapped, rays.ax, rays.ay, rays.bx, rays.by, plate)
        )
        return cls(phase, valid.ravel(), ax, ay, bx, by, foot, rig)

    def where(self, chosen: NDArray[np.intp]) -> "_Pixels":
        """Take some of them."""
        names = ("phase", "valid", "ax", "ay", "bx", "by", "plate")
        return replace(self, **{name: getattr(self, name)[chosen] for name in names})

    def near(self, place: FormPlace, radius_mm: float, most: int) -> tuple["_Pixels", int]:
        """Take about so many around a place, evenly, and say how many each stands for."""
        inside = np.flatnonzero(np.hypot(self.ax - place.x_mm, self.ay - place.y_mm) < radius_mm)
        step = max(1, inside.size // most) | 1
        return self.where(inside[::step]), step


def _refined(tops: Sequence[Top], place: FormPlace, pixels: _Pixels, rules: SearchRules) -> tuple[FormPlace, float]:
    """Move and turn a form until its pixels fit best; also return their misfit less that of the bare plate."""
    radius = _reach_mm(tops) / 2
    tallest = max(top.heights_mm[1] for top in tops)
    near, each = pixels.near(place, 1.1 * radius + 0.5 * tallest + 5, rules.pixels)
    lever = 1.0 / max(radius, 1.0)
    for cap, size in zip(rules.fine_rad, (3.0, 0.7), strict=True):

        def misfit(step: Floats, cap: float = cap, start: FormPlace = place) -> float:
            return _misfit(tops, _moved(start, step, lever), near, cap)

        simplex = size * np.vstack([np.zeros(3), np.eye(3)]) - size / 4
        found = optimize.minimize(
            misfit, np.zeros(3), method="Nelder-Mead",
            options={"initial_simplex": simplex, "maxfev": 120, "xatol": 0.02, "fatol": 0.01},
        )  # fmt: skip
        place = _moved(place, found.x, lever)
    return place, _misfit(tops, place, near, rules.fine_rad[0]) * each


def _moved(place: FormPlace, step: Floats, lever: float) -> FormPlace:
    """Move a place by mm; the third step turns it, in mm at the form's end."""
    return FormPlace(place.x_mm + float(step[0]), place.y_mm + float(step[1]), place.turn_rad + lever * float(step[2]))


def _misfit(tops: Sequence[Top], place: FormPlace, pixels: _Pixels, cap: float) -> float:
    """Sum of the capped misfit of the pixels that see the form, less what the bare plate would leave there."""
    met = met_by_sight(tops, place, pixels)
    form = met.top >= 0
    x, y = pixels.ax[form] + pixels.bx[form] * met.z_mm[form], pixels.ay[form] + pixels.by[form] * met.z_mm[form]
    here = _capped(pixels.phase[form] - pixels.rig.model.phase(x, y, met.z_mm[form]), cap)
    plate = _capped(pixels.phase[form] - pixels.plate[form], cap)
    return float(np.sum((here - plate)[pixels.valid[form]]))


def _described(tops: Sequence[Top], place: FormPlace, pixels: _Pixels, rules: SearchRules) -> FoundForm:
    """Say how well the form's pixels agree with it."""
    met = met_by_sight(tops, place, pixels)
    under = np.flatnonzero((met.top >= 0) & _judged(tops, place, pixels, met.z_mm))
    lit = under[pixels.valid[under]]
    if lit.size == 0:
        return FoundForm(place, 0.0, 0.0, 0.0)
    z = met.z_mm[lit]
    x, y = pixels.ax[lit] + pixels.bx[lit] * z, pixels.ay[lit] + pixels.by[lit] * z
    off = wrap(pixels.phase[lit] - pixels.rig.model.phase(x, y, z))
    plate = _capped(pixels.phase[lit] - pixels.plate[lit], rules.fine_rad[-1])
    lead = float(np.mean(plate - _capped(off, rules.fine_rad[-1])))
    return FoundForm(place, float(np.mean(np.abs(off) < rules.agrees_rad)), lit.size / under.size, lead)


def _judged(tops: Sequence[Top], place: FormPlace, pixels: _Pixels, z: Floats) -> Mask:
    """Leave out what of balls is steeper than the cap."""
    s, t = place.inside(pixels.ax + pixels.bx * z, pixels.ay + pixels.by * z)
    steep = np.zeros(s.shape, dtype=np.bool_)
    for top in tops:
        if isinstance(top, BallTop):
            low = _run(top)[0]
            steep |= top.covers(s, t) & (z < low)
    return ~steep


__all__ = ["CAP_DEG", "PLATE", "FoundForm", "SearchRules", "demand_form", "find_form"]
