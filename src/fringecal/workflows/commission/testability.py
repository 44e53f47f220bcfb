"""How large an error of each statement this session would have shown, as an error of heights."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from fringecal.calibration import CONTRADICTS, STATED_OFF, WrongStatement
from fringecal.projector import (
    DISPLACEMENT_PROBABILITY,
    HEIGHTS_MM,
    ProjectorPosition,
    RigCalibration,
    displaced_by,
    height_changes,
    projection_angle,
    theoretical_angle,
)
from fringecal.reconstruct import points_by_component
from fringecal.records import DEFAULT_LIMITS, Check, Limits
from fringecal.uncertainty import Estimate, Influence, UncertaintyComponent, least_seen, shift_seen
from fringecal.workflows.commission.spacing import spacing_of
from fringecal.workflows.shared import RIM

if TYPE_CHECKING:
    from fringecal.workflows.commission.run import Commissioning
    from fringecal.workflows.verify import ArtefactVerification, Verification

Array = NDArray[np.float64]

MOST_OFF = 0.5
"""Share of a statement beyond which nobody errs without seeing it on the bench: a length for half of it or twice it."""
_UNSEEN = "largest unseen height error by the "
_NODES = 9  # along each side of the picture: the change of heights is as smooth over it as the rig's few parameters
_POINTS = 2_000  # of an artefact's pixels: a mean of so many of them is that of all


@dataclass(frozen=True)
class Testability:
    """What this session says of one statement.

    Parameters
    ----------
    name, stated
        What is stated, and as what.
    heights_rel
        Largest relative change of heights over the field, over the relative change of the statement.
    error_rel
        Smallest relative error of the statement that a check shows with 95 %; infinite where none shows it.
    shown_by
        The check that shows the smallest; empty where none does.
    carries
        Whether heights rest on the statement; False for the certificate of what was only verified on.
    """

    name: str
    stated: Estimate
    heights_rel: float
    error_rel: float
    shown_by: str
    carries: bool = True

    @property
    def height_percent(self) -> float:
        """Height error in percent by the smallest error shown, or by `MOST_OFF` of the statement if that is less."""
        return 100 * self.heights_rel * min(self.error_rel, MOST_OFF)


def statements_tested(found: "Commissioning", limits: Limits = DEFAULT_LIMITS) -> tuple[Testability, ...]:
    """Return how large an error of each statement would have shown in which check.

    Each check is looked at by itself: all of them together show more.

    Parameters
    ----------
    found
        What commissioning has found.
    limits
        The laboratory's limits, which the checks keep.
    """
    rig, statements = found.calibrated.result.rig, found.wrong
    if not statements:
        return ()
    seen: list[dict[str, float]] = [{} for _ in statements]
    for check, ratios in _all_ratios(found, limits):
        for one, ratio in zip(seen, ratios, strict=True):
            one[check] = max(one.get(check, 0.0), float(ratio))
    heights = _heights_rel(rig, statements)
    rows = [_testability(s, h, ratios) for s, h, ratios in zip(statements, heights, seen, strict=True)]
    return (*rows, *_certificates(found, limits))


def unseen_sentence(checks: Sequence[Check]) -> str:
    """Say first what keeps a commissioning from passing: the statement that could hide the largest height error.

    Parameters
    ----------
    checks
        All checks; an empty text where no statement stands in the way.
    """
    left = [c for c in checks if c.name.startswith(_UNSEEN) and c.decision == "conditionalPass"]
    worst = max(left, key=lambda c: c.value or 0.0, default=None)
    if worst is None:
        return ""
    others = f", and {len(left) - 1} more statement(s) likewise" if len(left) > 1 else ""
    return (
        f"Heights could be wrong by {worst.value:.2g} % without a sign of it (limit {worst.limit:g} %): nothing in "
        f"this session tells well enough whether the {worst.name.removeprefix(_UNSEEN)} is as stated{others}."
    )


def statement_checks(found: "Commissioning", limits: Limits = DEFAULT_LIMITS) -> tuple[Check, ...]:
    """Judge for each statement whether an error of it that matters would have shown."""
    limit = limits.commission.height_percent
    return tuple(_check(one, limit) for one in statements_tested(found, limits))


def _check(one: Testability, limit: float) -> Check:
    within = one.height_percent <= limit
    decision = "pass" if within else "conditionalPass" if one.carries else "info"
    return Check(
        name=f"{_UNSEEN}{one.name}",
        value=one.height_percent,
        limit=limit,
        unit="%",
        decision=decision,  # type: ignore[arg-type]
        rule=_rule(one, within=within),
    )


def _rule(one: Testability, *, within: bool) -> str:
    size = f"{100 * min(one.error_rel, MOST_OFF):.2g} % of the {one.stated.value:.6g} {one.stated.unit} stated"
    if one.error_rel <= MOST_OFF:
        told = f"an error of {size} shows with a probability of 95 % in '{one.shown_by}', a smaller one may not"
    elif within:
        return f"even an error of {size} changes heights by no more than this"
    else:
        told = f"no check of this session shows an error of up to {size}"
    if not one.carries:
        return f"{told}; heights do not rest on it"
    return told if within else f"{told}. {_ADVICE}"


_ADVICE = (
    'Verify on an artefact of known height in the same session, add one with use = "calibration", or state '
    "projector.position_mm (and camera.model) as well as they can be measured"
)


# ---- what a statement that is off by STATED_OFF does to each check, over what the check shows with 95 % ------------
type Ratios = tuple[str, Array]


def _all_ratios(found: "Commissioning", limits: Limits) -> Iterator[Ratios]:
    """Yield every check that weighs statements against one another, and its change by each wrong statement."""
    result, own = found.calibrated.result, limits.commission
    statements, stated = found.wrong, result.stated_projector
    if stated is not None and result.origin.theory is not None:
        changes = np.abs([_angle_change(result.rig, s.effect, stated) for s in statements])
        yield "angle against theory", changes / _en_shift(result.origin.angle, result.origin.theory, own.angle_en)
    moved = found.angles.displacement
    if moved is not None and stated is not None:
        sizes = [moved.significance(displaced_by(result.rig, s.effect, stated)) for s in statements]
        yield (
            "projector against its stated position",
            np.sqrt(np.array(sizes) / least_seen(2, DISPLACEMENT_PROBABILITY)),
        )
    spacing = spacing_of(result)
    if spacing is not None:
        changes = spacing.by_grid.value * np.abs([s.scale_rel for s in statements])
        yield "distance of strips by the grid", changes / _en_shift(spacing.by_grid, spacing.stated, own.height_en)
    if found.height_stated is not None and result.camera.height_seen is not None:
        changes = found.height_stated.value * np.abs([_height_seen_rel(s) for s in statements])
        shift = _en_shift(result.camera.height_seen, found.height_stated, own.height_en)
        yield "grid pitch against camera height", changes / shift
    if result.standards:
        changes = np.array([np.abs(s.pulls).max(initial=0.0) for s in statements])
        yield "stated heights against one another", changes / shift_seen(CONTRADICTS, 1.0)
    yield from _verified_ratios(found, limits)


def _en_shift(one: Estimate, other: Estimate | None, limit: float) -> float:
    """Difference of two estimates that fails their En with 95 %."""
    both = (one,) if other is None else (one, other)
    expanded = math.hypot(*(e.expanded().U for e in both))
    return shift_seen(limit * expanded, math.hypot(*(e.u for e in both)))


def _angle_change(rig: RigCalibration, effect: Array, stated: ProjectorPosition) -> float:
    """Change of measured minus theoretical angle at the origin, deg."""
    before, after = (
        math.degrees(float(projection_angle(model, 0.0, 0.0))) - theoretical_angle(model, stated, 0.0, 0.0).value
        for model in (rig.model, rig.replaced(rig.vector + effect).model)
    )
    return after - before


def _height_seen_rel(statement: WrongStatement) -> float:
    """Relative change of the camera's height by lens and grid (as pitch and focal length change) less the stated."""
    changes = {Influence.GRID_PITCH: 1.0, Influence.LENS: 1.0, Influence.CAMERA_HEIGHT: -1.0}
    return STATED_OFF * changes.get(statement.influence, 0.0)


def _wrong_rig(rig: RigCalibration, statements: tuple[WrongStatement, ...]) -> RigCalibration:
    """Return the rig with one component for each wrong statement in place of its own."""
    return replace(rig, components=tuple(UncertaintyComponent(s.influence, s.effect) for s in statements))


def _heights_rel(rig: RigCalibration, statements: tuple[WrongStatement, ...]) -> Array:
    """Largest relative change of heights over field and heights, over the relative change of each statement."""
    camera = rig.camera
    v, u = (np.linspace(RIM, 1 - RIM, _NODES) * (n - 1) for n in (camera.height_px, camera.width_px))
    places = np.meshgrid(u, v)
    wrong = _wrong_rig(rig, statements)
    changes = [np.abs(height_changes(wrong, z, *places)).max(axis=(1, 2)) / z for z in HEIGHTS_MM]
    return np.asarray(np.max(changes, axis=0) / STATED_OFF)


def _testability(statement: WrongStatement, heights_rel: float, ratios: dict[str, float]) -> Testability:
    best = max(ratios, key=ratios.__getitem__, default="")
    shown = ratios.get(best, 0.0)
    error = STATED_OFF / shown if shown > 0 else math.inf
    by = best if error <= MOST_OFF else ""
    return Testability(statement.name, statement.stated, float(heights_rel), error, by)


# ---- artefacts that took no part in the fit ------------------------------------------------------------------------
def _verified_ratios(found: "Commissioning", limits: Limits) -> Iterator[Ratios]:
    rig = _wrong_rig(found.calibrated.result.rig, found.wrong)
    for bars in found.verified.bars:
        yield f"{bars.capture.name}: mean error", np.abs(_mean_changes(bars, rig)) / _bars_shift(bars, limits)
    for one in found.verified.artefacts:
        for name, shift, changes in _number_changes(one, rig, limits):
            yield f"{one.capture.name}: {name}", np.abs(changes) / shift


def _bars_shift(bars: "Verification", limits: Limits) -> float:
    pooled = bars.errors.pooled
    return _en_shift(Estimate(0.0, pooled.u_mm, "mm", dof=pooled.dof), None, limits.verify.en)


def _pixels(error_mm: Array) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Rows and columns of pixels that have an error, at most so many."""
    v, u = np.nonzero(np.isfinite(error_mm))
    step = max(1, v.size // _POINTS)
    return v[::step], u[::step]


def _mean_changes(bars: "Verification", rig: RigCalibration) -> Array:
    """Change of the mean error by each wrong statement, mm; sideways shifts cancel over the two kinds of flanks."""
    v, u = _pixels(bars.errors.error_mm)
    z = bars.surface.z[v, u].astype(float)
    return np.asarray(height_changes(rig, z, u.astype(float), v.astype(float)).mean(axis=1))


def _number_changes(
    one: "ArtefactVerification", rig: RigCalibration, limits: Limits
) -> Iterator[tuple[str, float, Array]]:
    """Yield each certified number: its name, the shift that shows, and its change by each wrong statement."""
    readings = [r for r in one.readings if r.en is not None and r.u_measured is not None]
    if not readings:
        return
    width = one.surface.z.shape[1]
    groups = [g[:: max(1, g.size // _POINTS)] for g in one.probe.groups]
    every, cuts = np.concatenate(groups), np.cumsum([g.size for g in groups])[:-1]
    u, v = (every % width).astype(float), (every // width).astype(float)
    z = one.surface.z.ravel()[every].astype(float)
    x, y = rig.camera.rays(u, v).at(z)
    base = one.probe.numbers(np.split(np.stack([x, y, z], axis=1), cuts))
    moved = [one.probe.numbers(np.split(points, cuts)) for _, points in points_by_component(rig, u, v, z)]
    for r in readings:
        measured = Estimate(r.measured, r.u_measured or 0.0, r.unit, dof=r.dof)
        shift = _en_shift(measured, Estimate(r.measured, r.u_reference, r.unit), limits.verify.en)
        yield r.name, shift, np.array([numbers[r.name] - base[r.name] for numbers in moved])


def _certificates(found: "Commissioning", limits: Limits) -> Iterator[Testability]:
    """Yield the certificates of what was verified on: an error of them is one of the verification, not of heights."""
    for bars in found.verified.bars:
        v, u = _pixels(bars.errors.error_mm)
        mean = float(np.mean(bars.surface.z[v, u]))
        full = Estimate(bars.errors.full_height_mm, 0.0, "mm")
        error = _bars_shift(bars, limits) / mean if mean > 0 else math.inf
        name = f"certificate of {bars.capture.name}"
        shown_by = f"{bars.capture.name}: mean error" if error <= MOST_OFF else ""
        yield Testability(name, full, 1.0, error, shown_by, carries=False)
    for one in found.verified.artefacts:
        best = min(_certified(one, limits), default=None)
        if best is not None:
            error, name, value = best
            stated = Estimate(value, 0.0, "mm")
            yield Testability(
                f"certificate of {one.capture.name}", stated, 1.0, error, f"{one.capture.name}: {name}", carries=False
            )


def _certified(one: "ArtefactVerification", limits: Limits) -> Iterator[tuple[float, str, float]]:
    for r in one.readings:
        if r.en is not None and r.u_measured is not None and r.unit == "mm" and r.reference:
            measured = Estimate(r.measured, r.u_measured, r.unit, dof=r.dof)
            shift = _en_shift(measured, Estimate(r.reference, r.u_reference, r.unit), limits.verify.en)
            yield shift / abs(r.reference), r.name, r.reference
