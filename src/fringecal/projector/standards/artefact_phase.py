"""Further artefacts as observations of the joint fit: their place found, their fringe order decided, or left out."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from fringecal.errors import FitError
from fringecal.numerics import wrap
from fringecal.projector.rig_calibration import OF_SINGLE_STRIPS, Observations, RigCalibration
from fringecal.projector.sampling import pick_points
from fringecal.projector.standards.placing import NEAR_RAD, ArtefactPlace, place_artefact
from fringecal.projector.standards.strip_heights import height_parts, is_split, total_u
from fringecal.projector.standards.strip_phase import StripPhase, averaged_numberings, numberings
from fringecal.projector.standards.target_facets import Facet, facets_of
from fringecal.targets import Target
from fringecal.uncertainty import Estimate, Influence, Source, UncertaintyComponent

Array = NDArray[np.float64]

_POINTS = 4_000  # of a facet; the covariance comes from blocks of pixels, so that more only take longer
_LEAST_POINTS = 100  # pixels of a facet: fewer are a rim, or a facet that lies in shadow
_MARGIN_PX = 2.5  # left out along edges: pixels there see two surfaces
_COVERAGE = 3.0  # standard uncertainties within which a prediction must stay to decide an order
_CLOSE = 0.9 * math.pi  # rad; half way to the next order is pi, a tenth of it is left for what the prediction neglects
_FEW = 50  # points at which a prediction's uncertainty is taken: it is smooth over a facet
_MOST_ODD = 0.2  # share of a facet's pixels whose phase may be another's: shadow, dirt, the next facet's rim


@dataclass(frozen=True)
class ArtefactPhase:
    """An artefact registered on the plate.

    Parameters
    ----------
    place
        Where it lies; None for strips, which are found by the step that they make.
    observations
        Its facets with absolute phase; None where none could be used.
    left_out
        For every other facet, why.
    """

    place: ArtefactPlace | None
    observations: Observations | None
    left_out: tuple[str, ...]


def observe_artefact(
    target: Target, wrapped_rad: Array, valid: NDArray[np.bool_], calibration: RigCalibration
) -> ArtefactPhase:
    """Register an artefact on the plate and give its facets absolute phase.

    The order of a facet is the one nearest to what the calibrated rig predicts there, if three standard
    uncertainties of that prediction stay within half a fringe.

    Parameters
    ----------
    target
        A step block, box, wedge or raised flat.
    wrapped_rad, valid
        Phase of the capture and where it can be used, shape (H, W).
    calibration
        The rig as known without it.

    Raises
    ------
    FitError
        The target has no top of known height, or is not to be seen.
    """
    facets = facets_of(target)
    if not facets:
        raise FitError(
            f"A target of kind {target.kind!r} has no level or sloping top of stated height that a rig could be fitted "
            "to; use steps, box, wedge, or a flat with height_mm."
        )
    place = place_artefact(facets, wrapped_rad, valid, calibration)
    used: list[Observations] = []
    left_out: list[str] = []
    for facet in facets:
        try:
            z = _height_map(facet, place, calibration)
            seen = _observed(facet.height, z, wrapped_rad, valid, calibration)
            split = _with_common(seen, target)
            used.append(replace(split, components=(_of_slope(facet, place, seen),)))
        except FitError as error:
            left_out.append(f"{facet.height.label} {facet.height.value:g} mm left out: {error}")
    return ArtefactPhase(place, _joined(used), tuple(left_out))


def observe_strips(strips: StripPhase, plate_phase_rad: Array, calibration: RigCalibration) -> ArtefactPhase:
    """Give a further set of strips absolute phase, by what the rig as known without it predicts.

    Parameters
    ----------
    strips
        The strips' phase difference to the plate; of one nominal height, or to be distinguished by their order.
    plate_phase_rad
        Map of the plate's unwrapped phase.
    calibration
        The rig as known without them.

    Raises
    ------
    FitError
        It is open which strip is which.
    """
    items = numberings(strips)
    if len(items) != 1 and (averaged := averaged_numberings(strips)) is not None:
        strips, items = averaged, numberings(averaged)
    if len(items) != 1:
        raise FitError(
            "The strips differ in height and it is open which is which; use strips of one height as a second set."
        )
    wrapped = plate_phase_rad + strips.difference_rad
    used: list[Observations] = []
    left_out: list[str] = []
    for label in strips.regions.seen:
        item = items[0][label - 1]
        height = strips.heights_mm[item]
        z = np.where(strips.regions.labels == label, height.value, np.nan)
        try:
            seen = _observed(height, z, wrapped, np.isfinite(wrapped), calibration)
            used.append(_split(seen, strips, item, calibration))
        except FitError as error:
            left_out.append(f"strip {label} left out: {error}")
    own = _own_influences(strips)
    heights = dict.fromkeys(o.height_mm[0] for o in used)
    grouped = [_merged([o for o in used if o.height_mm[0] == h], own) for h in heights]
    return ArtefactPhase(None, _joined(grouped), tuple(left_out))


def _with_common(seen: Observations, target: Target) -> Observations:
    """Split the uncertainty of a facet's height into its own and what all lengths of the artefact have in common."""
    if not (target.instrument_u_mm or target.thermal_rel_u):
        return seen
    (height,), size = seen.height_mm, seen.u_px[0].size
    common = {
        Influence.INSTRUMENT: (target.instrument_u_mm, target.instrument or target.name),
        Influence.TEMPERATURE: (target.thermal_rel_u * height.value, ""),
    }
    own = replace(UncertaintyComponent.of(height), effect=np.full(size, height.u))
    parts = [UncertaintyComponent(i, np.full(size, u), detail=name) for i, (u, name) in common.items() if u > 0]
    total = math.hypot(height.u, *(u for u, _ in common.values()))
    return replace(seen, height_mm=(replace(height, u=total),), parts=((own, *parts),))


def _split(seen: Observations, strips: StripPhase, item: int, calibration: RigCalibration) -> Observations:
    """Split the uncertainty of one strip's height into what it is made of, where more than one u is stated."""
    if strips.target is None or not is_split(strips.target):
        return seen
    (u,), (v,), (height,) = seen.u_px, seen.v_px, seen.height_mm
    rays = calibration.camera.rays(u, v)
    own = height_parts(strips.target, strips.heights_mm, np.full(u.size, item, np.intp), rays.ax, rays.ay)
    return replace(seen, height_mm=(replace(height, u=total_u(strips.target, height)),), parts=(own,))


def _own_influences(strips: StripPhase) -> frozenset[Influence]:
    """Return what each strip of a set has for itself: its height only where the set's instrument is stated apart."""
    apart = strips.target is not None and strips.target.instrument_u_mm > 0
    return OF_SINGLE_STRIPS if apart else OF_SINGLE_STRIPS - {Influence.STRIP_HEIGHT}


def _merged(parts: Sequence[Observations], own: frozenset[Influence]) -> Observations:
    """Make one surface of several that share one height and its uncertainty."""
    columns = (np.concatenate([getattr(p, n)[0] for p in parts]) for n in ("u_px", "v_px", "phase_rad", "cluster"))
    u, v, phase, cluster = columns
    split = (
        ()
        if not parts[0].parts
        else (_spread([p.parts[0] or () for p in parts], [p.u_px[0].size for p in parts], own),)
    )
    return Observations((u,), (v,), (phase,), (cluster,), (parts[0].height_mm[0],), parts=split)


def _spread(
    rows: Sequence[Sequence[UncertaintyComponent]], sizes: Sequence[int], own: frozenset[Influence]
) -> tuple[UncertaintyComponent, ...]:
    """Put the components of single strips side by side: what a set has in common is one, a strip's own are its own."""
    starts, whole = np.cumsum([0, *sizes]), int(sum(sizes))
    common: dict[Source, Array] = {}
    kept: list[tuple[UncertaintyComponent, Array]] = []
    for row, start, size in zip(rows, starts[:-1], sizes, strict=True):
        for one in row:
            if one.influence not in own and one.source in common:
                effect = common[one.source]
            else:
                effect = np.zeros(whole)
                common.setdefault(one.source, effect)
                kept.append((one, effect))
            effect[start : start + size] = one.effect
    return tuple(replace(one, effect=effect) for one, effect in kept)


def _joined(parts: Sequence[Observations]) -> Observations | None:
    whole = parts[0] if parts else None
    for part in parts[1:]:
        whole = whole.joined(part) if whole is not None else part
    return whole


def _observed(
    height: Estimate, z: Array, wrapped: Array, valid: NDArray[np.bool_], calibration: RigCalibration
) -> Observations:
    """Take the pixels of one surface, decide its order, and give them absolute phase."""
    u, v, cluster = pick_points(np.isfinite(z) & valid, _POINTS)
    if u.size < _LEAST_POINTS:
        raise FitError(f"only {u.size} pixels of it are lit, {_LEAST_POINTS} are needed")
    index = v.astype(int), u.astype(int)
    predicted = calibration.model.phase(*calibration.camera.rays(u, v).at(z[index]), z[index])
    lack = wrap(wrapped[index] - predicted)
    middle = float(np.angle(np.mean(np.exp(1j * lack))))
    spread = wrap(lack - middle)
    _demand_order(_prediction_u(calibration, u, v, z[index]), middle, spread)
    relief = z[index] - height.value
    return Observations((u,), (v,), (predicted + middle + spread,), (cluster,), (height,), (relief,), ((),))


def _height_map(facet: Facet, place: ArtefactPlace, calibration: RigCalibration) -> Array:
    """Height at which each pixel's ray meets the facet, NaN where it misses it or comes near an edge."""
    rays = calibration.camera.pixel_rays()
    low, _ = place.inside(*rays.at(0.0))
    rise = place.inside(*rays.at(1.0))[0] - low
    # The ray crosses s = low + rise z, the facet stands at z = height + slope (s - middle).
    z = (facet.height.value + facet.slope * (low - facet.middle_mm)) / (1 - facet.slope * rise)
    s, t = place.inside(*rays.at(z))
    margin = _MARGIN_PX * calibration.camera.scale("mean").value + place.u_mm
    inside = (s > facet.low_mm + margin) & (s < facet.high_mm - margin) & (np.abs(t) < facet.half_length_mm - margin)
    return np.where(inside, z, np.nan)


def _demand_order(u_rad: float, middle: float, spread: Array) -> None:
    """Refuse a surface whose order the rig cannot predict, or whose phase is not that of one surface."""
    if _COVERAGE * u_rad + abs(middle) > _CLOSE:
        raise FitError(
            f"its fringe order is open: the phase deviates by {middle:+z.2f} rad from a prediction whose standard "
            f"uncertainty is {u_rad:.2f} rad; measure a lower surface too, or state its height "
            "better"
        )
    odd = float(np.mean(np.abs(spread) > NEAR_RAD))
    if odd > _MOST_ODD:
        raise FitError(f"{100 * odd:.0f} % of its pixels show the phase of something else")


def _prediction_u(calibration: RigCalibration, u_px: Array, v_px: Array, z_mm: Array) -> float:
    """Largest standard uncertainty of the phase that the rig predicts for a surface of known height."""
    few = slice(None, None, max(1, u_px.size // _FEW))
    u, v, z = u_px[few], v_px[few], z_mm[few]

    def predicted(c: RigCalibration) -> Array:
        return c.model.phase(*c.camera.rays(u, v).at(z), z)

    base = predicted(calibration)
    moved = (predicted(calibration.shifted(component)) for component in calibration.components)
    variance = sum(((phase - base) ** 2 for phase in moved), np.zeros(u.size))
    return float(np.sqrt(np.max(variance, initial=0.0)))


def _of_slope(facet: Facet, place: ArtefactPlace, seen: Observations) -> tuple[UncertaintyComponent, ...]:
    """Return what angle and place of a slope do to its height."""
    if not facet.slope:
        return ()
    across = seen.relief_mm[0] / facet.slope + facet.middle_mm
    tilt = UncertaintyComponent(Influence.WEDGE_ANGLE, facet.u_slope * (across - facet.low_mm))
    return (tilt, UncertaintyComponent(Influence.WEDGE_POSITION, abs(facet.slope) * place.u_mm))
