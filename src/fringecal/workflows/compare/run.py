"""Two calibrations of one rig beside each other: whether they agree, in what was measured and in heights."""

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fringecal.camera import local_scale
from fringecal.errors import RecordError
from fringecal.projector import RigCalibration, apparent_angle, fringe_pitch_mm, projection_angle, seen_axes
from fringecal.records import CalibrationRecord
from fringecal.uncertainty import Estimate, Influence, effective_dof, en_score
from fringecal.workflows.shared import calibration_of

Array = NDArray[np.float64]
Quantity = Callable[[RigCalibration], float]

# Kinds of artefact whose error is the same in both calibrations where both used one and the same.
_SHARED = {
    Influence.GRID_PITCH: ("line-grid",),
    Influence.STRIP_HEIGHT: ("strips",),
    Influence.PLATE_FLATNESS: ("flat",),
}
_WIDTH_OVER_HEIGHT = 10  # of the field and of an object that fits any rig, yet is higher than strips
# Fractions of the picture's width and height at which heights are compared.
_PLACES = {
    "centre": (0.5, 0.5),
    "top left": (0.1, 0.1),
    "top right": (0.9, 0.1),
    "bottom left": (0.1, 0.9),
    "bottom right": (0.9, 0.9),
}


@dataclass(frozen=True)
class Compared:
    """One quantity in two calibrations; u of `difference` (second minus first) holds only what they do not share."""

    name: str
    first: Estimate
    second: Estimate
    difference: Estimate

    @property
    def en(self) -> float:
        """`en_score` of the difference; 0 where neither is uncertain nor different."""
        if self.difference.u > 0:
            return en_score(self.difference)
        return math.copysign(math.inf, self.difference.value) if self.difference.value else 0.0

    @property
    def agrees(self) -> bool:
        """Whether the difference lies within its expanded uncertainty."""
        return abs(self.en) <= 1


def compare_calibrations(first: CalibrationRecord, second: CalibrationRecord) -> tuple[Compared, ...]:
    """Compare two calibrations of one rig.

    Every source of uncertainty k changes a quantity q by c_k per standard uncertainty. Sources that both share (grid
    pitch, strip height, where both used the same artefact) change both together; the others do not:
    ``u(d)^2 = sum_shared (c2_k - c1_k)^2 + sum_others (c1_k^2 + c2_k^2)`` (JCGM 100:2008, 5.2.2, correlation 1 or 0).

    Parameters
    ----------
    first, second
        Records of the same rig.

    Raises
    ------
    RecordError
        The records are of different rigs or pictures, or hold what this version does not know.
    """
    _demand_one_rig(first, second)
    shared = shared_influences(first, second)
    before, after = calibration_of(first), calibration_of(second)
    return tuple(
        _compared(name, unit, quantity, (before, after), shared) for name, unit, quantity in _quantities(before, after)
    )


def shared_influences(first: CalibrationRecord, second: CalibrationRecord) -> tuple[Influence, ...]:
    """Name the sources of uncertainty that are the same in both: of artefacts whose files say the same."""
    kept = [target for target in first.targets.values() if target in second.targets.values()]
    kinds = {str(target.get("kind")) for target in kept}
    return tuple(influence for influence, of in _SHARED.items() if kinds.intersection(of))


def _demand_one_rig(*records: CalibrationRecord) -> None:
    rigs = dict.fromkeys(record.session.rig for record in records)
    if len(rigs) > 1:
        raise RecordError(f"two calibrations of one rig were needed, found those of {' and '.join(rigs)}")
    sizes = dict.fromkeys(f"{record.camera.width} x {record.camera.height} px" for record in records)
    if len(sizes) > 1:
        raise RecordError(f"pictures of one size were needed, found {' and '.join(sizes)}; the camera is another one")


def _quantities(before: RigCalibration, after: RigCalibration) -> Iterator[tuple[str, str, Quantity]]:
    for direction in ("mean", "horizontal", "vertical"):
        yield f"scale, {direction}", "mm/px", lambda c, d=direction: local_scale(c.camera, d)  # type: ignore[misc]
    yield "projection angle", "deg", lambda c: math.degrees(float(projection_angle(c.model, 0.0, 0.0)))
    yield "apparent angle", "deg", lambda c: math.degrees(float(apparent_angle(c.model, c.camera, 0.0, 0.0)))
    yield "fringe pitch on the plate", "mm", lambda c: float(fringe_pitch_mm(c.model))
    yield from _projector(before, after)
    height_mm = _round_height(before)
    for place, (across, down) in _PLACES.items():
        pixel = (across * (before.camera.width_px - 1), down * (before.camera.height_px - 1))
        yield f"height of {height_mm:g} mm, {place}", "mm", _height_there(before, pixel, height_mm)


def _projector(before: RigCalibration, after: RigCalibration) -> Iterator[tuple[str, str, Quantity]]:
    """Give the coordinates of the projector that the fringes of both show."""
    if not all(np.isfinite(c.model.projector_mm).all() for c in (before, after)):
        return
    seen = zip("xyz", *(seen_axes(c.model) for c in (before, after)), strict=True)
    for place, (axis, *both) in enumerate(seen):
        if all(both):
            yield f"projector, {axis}", "mm", lambda c, i=place: float(c.model.projector_mm[i])  # type: ignore[misc]


def _round_height(calibration: RigCalibration) -> float:
    """Give the power of ten that is at most a tenth of the field's width, mm."""
    width = calibration.camera.width_px * local_scale(calibration.camera, "mean")
    return 10.0 ** math.floor(math.log10(width / _WIDTH_OVER_HEIGHT))


def _height_there(before: RigCalibration, pixel: tuple[float, float], height_mm: float) -> Quantity:
    """Take the phase difference of an object of this height, as the first calibration has it, with any calibration."""
    rays = before.camera.rays(*map(np.array, pixel))
    step = before.model.phase(*rays.at(height_mm), height_mm) - before.model.phase(*rays.at(0.0), 0.0)

    def height(calibration: RigCalibration) -> float:
        ours = calibration.camera.rays(*map(np.array, pixel))
        return float(calibration.model.height(calibration.model.phase(*ours.at(0.0), 0.0) + step, ours))

    return height


def _compared(
    name: str, unit: str, quantity: Quantity, both: tuple[RigCalibration, RigCalibration], shared: tuple[Influence, ...]
) -> Compared:
    moved = [_changes(c, quantity) for c in both]
    first, second = (
        _estimate(quantity(c), tuple(changes.values()), unit, name) for c, changes in zip(both, moved, strict=True)
    )
    together = [_shared_change(moved[0].get(one, _NOTHING), moved[1].get(one, _NOTHING)) for one in shared]
    apart = [change for one in moved for influence, change in one.items() if influence not in shared]
    difference = _estimate(second.value - first.value, (*together, *apart), unit, f"change of {name}")
    return Compared(name, first, second, difference)


_NOTHING = np.array([[0.0], [math.inf]])  # of an influence that one calibration does not have


def _estimate(value: float, changes: Sequence[Array], unit: str, label: str) -> Estimate:
    """Combine independent changes, each an array (2, n) of contributions and their degrees of freedom."""
    contributions, dof = np.concatenate([np.empty((2, 0)), *changes], axis=1)
    return Estimate(value, float(np.linalg.norm(contributions)), unit, label, effective_dof(contributions, dof))


def _shared_change(before: Array, after: Array) -> Array:
    """Return what a source that changes both alike contributes to their difference, and its degrees of freedom."""
    return np.stack([after[0] - before[0], np.minimum(before[1], after[1])])


def _changes(calibration: RigCalibration, quantity: Quantity) -> dict[Influence, Array]:
    """Return signed changes and degrees of freedom, (2, n), of the components of each influence.

    A shared influence has one component, or the same ones in the same order.
    """
    changes = np.stack([calibration.changes(quantity), [component.dof for component in calibration.components]])
    influences = [component.influence for component in calibration.components]
    return {
        influence: changes[:, [n for n, one in enumerate(influences) if one is influence]]
        for influence in dict.fromkeys(influences)
    }
