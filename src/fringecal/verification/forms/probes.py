"""Which pixels of a surface belong to an artefact, and which numbers they are judged by.

A probe picks pixels once; its numbers are then evaluated on the measured points, and again on the points as every
cause of uncertainty would move them.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import singledispatch

import numpy as np
from numpy.typing import NDArray

from fringecal.errors import FitError
from fringecal.targets import Artefact, BallBar, Box, Flat, Sphere, Steps, Strips, Wedge
from fringecal.uncertainty import Estimate, Influence
from fringecal.verification.forms.fitted_forms import fit_plane, fit_sphere, flatness, sphere_form
from fringecal.verification.forms.pieces import MIN_PIXELS, one_piece, pieces_between, valid_points
from fringecal.verification.zigzag.zigzag_shape import Floats, Surface

Mask = NDArray[np.bool_]
Numbers = dict[str, float]

CAP_DEG = 50.0
"""Of a ball, points steeper than this against the plate are left out: blur and shadow reach them."""

_FAR_SHARE = 0.03  # of a ball's diameter: what departs more is no ball


@dataclass(frozen=True)
class _Windows:
    """Between which heights a surface of an artefact is looked for.

    Wider ones would take a rim or a neighbour in, narrower ones lose an artefact whose height a rig reads wrongly,
    which is what a verification is to find out.

    Parameters
    ----------
    flat, flat_deviations, flat_least_mm
        Around a flat's height, on either side: a share of it, so many flatness deviations with their uncertainty, and
        the least; the largest of them counts.
    box
        A box's top, of its height.
    slope
        A wedge's slope, of its tallest edge; its thin edge cannot be distinguished from the plate.
    step
        Around a step, of the distance to the nearest other level: half of it would touch.
    ball
        A ball's rough piece, of the smallest and the largest diameter; below, blur and shadow reach it.
    beside, above
        What is looked through for a ball's cap: so many diameters around its rough piece's middle, from so many
        diameters above the plate.
    cap_rounds
        Of cutting the cap about the fitted centre: the set settles after two or three.
    """

    flat: float = 0.2
    flat_deviations: float = 5.0
    flat_least_mm: float = 2.0
    box: tuple[float, float] = (0.8, 1.2)
    slope: tuple[float, float] = (0.1, 1.2)
    step: float = 0.4
    ball: tuple[float, float] = (0.6, 1.1)
    beside: float = 0.7
    above: float = 0.3
    cap_rounds: int = 4


_WINDOWS = _Windows()
_LINE = "linearity deviation"
_CLEARLY = 2.5  # times as far off: strips that differ lie one way round and not the other


@dataclass(frozen=True)
class Probe:
    """Pixels of an artefact, in groups, and what is computed from them.

    Parameters
    ----------
    groups
        Flat pixel indices of each surface of the artefact.
    numbers
        Values by name from one (n, 3) array of points per group; lengths in mm, angles in deg.
    references
        Certified values by name.
    residuals
        Distances of the points from what each group should be, mm, for the map.
    forms
        Names of form errors: their value contains the noise by definition.
    units
        Units that are not mm.
    notes
        What was left out or assumed.
    """

    groups: tuple[NDArray[np.intp], ...]
    numbers: Callable[[Sequence[Floats]], Numbers]
    references: Mapping[str, Estimate]
    residuals: Callable[[Sequence[Floats]], list[Floats]]
    forms: frozenset[str] = frozenset()
    units: Mapping[str, str] = field(default_factory=dict)
    notes: tuple[str, ...] = ()


Tops = NDArray[np.integer] | None
"""Number of the target's top that each pixel sees clear of rims, -1 where none; None where that is not known."""


@singledispatch
def probe(target: Artefact, surface: Surface, tops: Tops = None) -> Probe:  # noqa: ARG001
    """Find an artefact in a measured surface and say what is to be computed from it.

    Parameters
    ----------
    target
        `Flat`, `Strips`, `Steps`, `Wedge`, `Box`, `Sphere` or `BallBar`.
    surface
        Height map, mm, plate at z = 0.
    tops
        (H, W), which pixel sees which top, as the order of `fringecal.targets.tops_of`; without it the tops are looked
        for between the heights that they should have.

    Raises
    ------
    FitError
        The surface does not show the artefact.
    """
    raise FitError(
        f"a target of kind {getattr(target, 'kind', '?')!r} has no surface to be verified on; use zigzag, flat, "
        "strips, steps, wedge, box, sphere or ball-bar"
    )


@probe.register
def _(target: Flat, surface: Surface, tops: Tops = None) -> Probe:
    points, valid = valid_points(surface)
    height = 0.0 if target.height_mm is None else target.height_mm.value
    deviation = target.flatness_mm.value + target.flatness_mm.u
    tolerance = max(_WINDOWS.flat * height, _WINDOWS.flat_deviations * deviation, _WINDOWS.flat_least_mm)
    inside = (
        one_piece(points, valid, height - tolerance, height + tolerance, what="flat")
        if tops is None
        else _only_top(tops, valid)
    )
    references = {"flatness": target.flatness_mm.estimate("flatness", "mm")}
    if target.height_mm is not None:
        references["height"] = target.height_mm.estimate("height", "mm")

    def numbers(groups: Sequence[Floats]) -> Numbers:
        (flat,) = groups
        error, plane = flatness(flat)
        found = {
            "flatness": error.value_mm,
            "flatness, 95 % of the points": flatness(flat, definition="iso10360-13")[0].value_mm,
            "rms from the plane": float(np.std(plane.residual_mm)),
            "tilt against the plate": math.degrees(math.acos(min(1.0, float(plane.normal[2])))),
        }
        return found | ({"height": float(flat[:, 2].mean())} if target.height_mm is not None else {})

    forms = frozenset({"flatness", "flatness, 95 % of the points", "rms from the plane"})
    return Probe((_indices(inside),), numbers, references, _from_planes, forms, {"tilt against the plate": "deg"})


@probe.register
def _(target: Box, surface: Surface, tops: Tops = None) -> Probe:
    points, valid = valid_points(surface)
    height = target.height_mm.value
    top = (
        one_piece(points, valid, *(share * height for share in _WINDOWS.box), what="top of the box")
        if tops is None
        else _only_top(tops, valid)
    )
    references = {"height": target.height_mm.estimate("height", "mm")}
    return Probe((_indices(top),), lambda groups: {"height": float(groups[0][:, 2].mean())}, references, _from_planes)


@probe.register
def _(target: Wedge, surface: Surface, tops: Tops = None) -> Probe:
    points, valid = valid_points(surface)
    tallest = target.width_mm.value * math.tan(math.radians(target.angle_deg.value))
    slope = (
        one_piece(points, valid, *(share * tallest for share in _WINDOWS.slope), what="slope of the wedge")
        if tops is None
        else _only_top(tops, valid)
    )
    references = {"angle": target.angle_deg.estimate("angle", "deg")}

    def numbers(groups: Sequence[Floats]) -> Numbers:
        normal = fit_plane(groups[0]).normal
        return {"angle": math.degrees(math.acos(min(1.0, float(normal[2]))))}

    return Probe((_indices(slope),), numbers, references, _from_planes, units={"angle": "deg"})


@probe.register
def _(target: Strips, surface: Surface, tops: Tops = None) -> Probe:
    points, valid = valid_points(surface)
    if tops is None:
        raise FitError("strips are found by their phase, not in a surface; verify them from their frames")
    groups, names, references, notes = [], [], {}, []
    for index in range(target.count):
        found = _top(tops, valid, index)
        if not found:
            notes.append(f"strip {index + 1} has too few lit pixels and was left out")
            continue
        groups.append(_indices(found[0]))
        names.append(f"strip {index + 1}")
        stated = target.height_mm.estimate(Influence.STRIP_HEIGHT, "mm", item=index)
        references[names[-1]] = replace(
            stated, value=stated.value + target.added_mm, u=math.hypot(stated.u, target.added_u_mm)
        )
    if not groups:
        raise FitError("no strip has enough lit pixels clear of its rims; light more of them")
    measured = {name: float(points[..., 2].ravel()[g].mean()) for name, g in zip(names, groups, strict=True)}
    references, note = _as_they_lie(references, measured, target)
    notes += note

    def numbers(groups: Sequence[Floats]) -> Numbers:
        return {name: float(np.mean(group[:, 2])) for name, group in zip(names, groups, strict=True)}

    return Probe(tuple(groups), numbers, references, _from_planes, notes=tuple(notes))


def _as_they_lie(
    references: dict[str, Estimate], measured: Mapping[str, float], target: Strips
) -> tuple[dict[str, Estimate], list[str]]:
    """Say which certified height each strip seen has: they may lie turned round, and differ by micrometres only."""
    heights, us = target.height_mm.array(target.count), target.height_mm.u_array(target.count)
    if np.ptp(heights) == 0:
        return references, []
    places = {name: int(name.removeprefix("strip ")) - 1 for name in references}
    turned = {
        name: replace(one, value=float(heights[-1 - places[name]]), u=float(us[-1 - places[name]]))
        for name, one in references.items()
    }
    off, off_turned = (
        float(np.std([measured[name] - one[name].value for name in one])) if len(one) > 1 else 0.0
        for one in (references, turned)
    )
    if off_turned * _CLEARLY < off:
        return turned, ["the strips lie the other way round: strip 1 is the last of the certificate"]
    if off * _CLEARLY < off_turned:
        return references, []
    either = {name: _between(one, turned[name]) for name, one in references.items()}
    return either, ["it is open which way round the strips lie: half of what that changes counts as uncertainty"]


def _between(one: Estimate, other: Estimate) -> Estimate:
    """Return a height that is one of two: their mean, half of their difference in its uncertainty."""
    u = math.hypot(max(one.u, other.u), (one.value - other.value) / 2)
    return replace(one, value=(one.value + other.value) / 2, u=u)


@probe.register
def _(target: Steps, surface: Surface, tops: Tops = None) -> Probe:
    points, valid = valid_points(surface)
    nominal = target.heights_mm.array(len(target.heights_mm.values))
    levels = np.unique(np.concatenate([[0.0], nominal]))
    groups, references, notes = [], {}, []
    for index, height in enumerate(nominal):
        if tops is None:
            half = _WINDOWS.step * float(np.min(np.abs(levels[levels != height] - height)))
            found = pieces_between(points, valid, height - half, height + half)
        else:
            found = _top(tops, valid, index)
        if not found:
            notes.append(f"the height step of {height:g} mm was not found, or its phase is that of another level")
            continue
        groups.append(_indices(found[0]))
        u = target.heights_mm.u_array(nominal.size)[index]
        references[f"step of {height:g} mm"] = Estimate(float(height), float(u), "mm", influence=Influence.STEP_HEIGHT)
    if len(groups) < 2:
        raise FitError(
            f"only {len(groups)} of {nominal.size} height steps were found at their heights; check the target's "
            "heights_mm, and that the block is lit"
        )
    certified = np.array([e.value for e in references.values()])
    names = tuple(references)

    def numbers(groups: Sequence[Floats]) -> Numbers:
        heights = np.array([float(np.median(g[:, 2])) for g in groups])
        # The plate is the response's first point: heights are counted from it.
        x, y = np.append(0.0, certified), np.append(0.0, heights)
        slope, offset = np.polyfit(x, y, 1)
        found = dict(zip(names, map(float, heights), strict=True))
        return found | {
            "amplification coefficient": float(slope),
            _LINE: float(np.max(np.abs(y - slope * x - offset))),
        }

    references["amplification coefficient"] = Estimate(1.0, _slope_u(certified, references), "1", "step heights")
    units = {"amplification coefficient": "1"}
    return Probe(tuple(groups), numbers, references, _from_planes, frozenset({_LINE}), units, tuple(notes))


def _slope_u(certified: Floats, references: Mapping[str, Estimate]) -> float:
    """Uncertainty that the certified heights, independent of each other, give to the slope."""
    x = np.append(0.0, certified)
    weights = (x - x.mean()) / np.sum((x - x.mean()) ** 2)
    return float(np.sqrt(sum((w * e.u) ** 2 for w, e in zip(weights[1:], references.values(), strict=True))))


@probe.register
def _(target: Sphere, surface: Surface, tops: Tops = None) -> Probe:
    points, valid = valid_points(surface)
    diameter = target.diameter_mm.value
    (ball,) = _balls(points, valid, (diameter,), tops)
    references = {"size": target.diameter_mm.estimate("diameter", "mm")}
    residuals = _from_spheres((diameter,))
    return Probe(
        (ball,), lambda groups: _ball_numbers(groups[0]), references, residuals, _BALL_FORMS, notes=(_CAP_NOTE,)
    )


@probe.register
def _(target: BallBar, surface: Surface, tops: Tops = None) -> Probe:
    points, valid = valid_points(surface)
    diameters = tuple(map(float, target.diameters_mm.array(2)))
    groups = _balls(points, valid, diameters, tops)
    return ball_bar_probe(target, groups, (_CAP_NOTE,))


def ball_bar_probe(target: BallBar, groups: tuple[NDArray[np.intp], ...], notes: tuple[str, ...]) -> Probe:
    """Return what is judged of a ball bar whose balls' points were found.

    Parameters
    ----------
    target
        The bar.
    groups
        Places of each ball's points among those that were measured.
    notes
        What is to be said of them.
    """
    diameters = tuple(map(float, target.diameters_mm.array(2)))
    references = {"spacing": target.spacing_mm.estimate("spacing", "mm")}
    for k, u in enumerate(target.diameters_mm.u_array(2)):
        references[f"ball {k + 1}: size"] = Estimate(diameters[k], float(u), "mm", "diameter")

    def numbers(groups: Sequence[Floats]) -> Numbers:
        centres = [fit_sphere(g, radius_mm=d / 2).centre_mm for g, d in zip(groups, diameters, strict=True)]
        found = {"spacing": float(np.linalg.norm(centres[1] - centres[0]))}
        for k, group in enumerate(groups):
            found |= {f"ball {k + 1}: {name}": value for name, value in _ball_numbers(group).items()}
        return found

    forms = frozenset(f"ball {k}: {name}" for k in (1, 2) for name in _BALL_FORMS)
    return Probe(groups, numbers, references, _from_spheres(diameters), forms, notes=notes)


def _from_planes(groups: Sequence[Floats]) -> list[Floats]:
    return [fit_plane(points).residual_mm for points in groups]


def _from_spheres(diameters: Sequence[float]) -> Callable[[Sequence[Floats]], list[Floats]]:
    return lambda groups: [
        fit_sphere(points, radius_mm=d / 2).residual_mm for points, d in zip(groups, diameters, strict=True)
    ]


_BALL_FORMS = frozenset({"form", "form, 95 % of the points"})
_CAP_NOTE = f"of each ball the cap of {CAP_DEG:g} deg half-angle is judged; centres have the certified radius"


def _ball_numbers(points: Floats) -> Numbers:
    return {
        "size": fit_sphere(points).diameter_mm,
        "form": sphere_form(points)[0].value_mm,
        "form, 95 % of the points": sphere_form(points, definition="iso10360-13")[0].value_mm,
    }


def _only_top(tops: NDArray[np.integer], valid: Mask) -> Mask:
    """Return the pixels of the one top that a target has.

    Raises
    ------
    FitError
        Hardly any is lit.
    """
    found = _top(tops, valid, 0)
    if not found:
        raise FitError("the artefact's top has too few lit pixels clear of its rims; light it, and leave it in view")
    return found[0]


def _top(tops: NDArray[np.integer], valid: Mask, number: int) -> list[Mask]:
    """Return the pixels of one top, if there are enough."""
    inside = valid & (tops == number)
    return [inside] if np.count_nonzero(inside) >= MIN_PIXELS else []


def _balls(points: Floats, valid: Mask, diameters: tuple[float, ...], tops: Tops) -> tuple[NDArray[np.intp], ...]:
    """Return the pixels of each ball's cap, from low x to high x; where tops are known, in their order."""
    if tops is not None:
        pieces = [_top(tops, valid, number) for number in range(len(diameters))]
        if not all(pieces):
            raise FitError("a ball's cap has too few lit pixels; light every ball from its top down")
        rough = [piece[0] for piece in pieces]
        return tuple(_cap(points, piece, piece, d) for piece, d in zip(rough, diameters, strict=True))
    lowest, highest = _WINDOWS.ball[0] * min(diameters), _WINDOWS.ball[1] * max(diameters)
    found = pieces_between(points, valid, lowest, highest)[: len(diameters)]
    if len(found) < len(diameters):
        raise FitError(
            f"found {len(found)} of {len(diameters)} balls above {lowest:.3g} mm; check the target's diameter, "
            "and that each ball's top is lit and not saturated. A ball whose outline stands whole fringes above "
            "the plate cannot be distinguished from it by one fringe period: take a second period, or a ball of "
            "another size"
        )
    found.sort(key=lambda piece: float(points[piece, 0].mean()))
    return tuple(_cap(points, valid, piece, d) for piece, d in zip(found, diameters, strict=True))


def _cap(points: Floats, valid: Mask, piece: Mask, diameter: float) -> NDArray[np.intp]:
    """Return the pixels of one ball within the cap, from a rough piece of it."""
    top = points[piece]
    near = valid & (np.hypot(*(points[..., k] - top[:, k].mean() for k in (0, 1))) < _WINDOWS.beside * diameter)
    candidates = _indices(near & (points[..., 2] > _WINDOWS.above * diameter))
    cloud = points.reshape(-1, 3)[candidates]
    centre = fit_sphere(top, radius_mm=diameter / 2).centre_mm
    lowest = math.cos(math.radians(CAP_DEG))
    for _ in range(_WINDOWS.cap_rounds):
        away = cloud - centre
        distance = np.linalg.norm(away, axis=1)
        kept = (np.abs(distance - diameter / 2) < _FAR_SHARE * diameter) & (away[:, 2] > lowest * distance)
        if np.count_nonzero(kept) < MIN_PIXELS:
            raise FitError(
                f"no ball of {diameter:g} mm: only {np.count_nonzero(kept)} pixels lie on such a sphere; check the "
                "target's diameter, and that the ball is matt and lit"
            )
        centre = fit_sphere(cloud[kept], radius_mm=diameter / 2).centre_mm
    return candidates[kept]


def _indices(mask: Mask) -> NDArray[np.intp]:
    return np.flatnonzero(mask)
