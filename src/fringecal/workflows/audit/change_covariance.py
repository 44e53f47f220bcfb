"""Covariance of the changes in an audit: today's scatter, the calibration's uncertainty, less what both share."""

import math
from dataclasses import replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from fringecal.calibration import SURFACE_POINTS
from fringecal.camera import CAMERA_NAMES
from fringecal.projector import RigCalibration
from fringecal.records import AppearanceRecord
from fringecal.uncertainty import Influence
from fringecal.workflows.audit.layout import PLATE_DEGREE, STRIPS_DEGREE, Blocks, Layout, camera_quantities
from fringecal.workflows.audit.observed import GridFound, PlateFound, StripsFound, base_state

Array = NDArray[np.float64]
type Observed = tuple[GridFound | None, PlateFound | None, tuple[StripsFound, ...]]

#: Ripple of 0.01 rad over fifty fringes leaves so much of itself in a smooth term. Strips have fewer pixels and edges,
#: and lie elsewhere each time: on virtual rigs with gamma, texture and distortion the tilt of their step moves so much.
_FLOOR_RAD = {"plate": 1e-4, "strips": 4e-4}
_FLOOR_PX = 0.02  # of the corner, likewise
_U_BLUR_PX = 0.01  # of a change: width and blur of a line are fitted together; 0.0075 px over virtual rigs
_U_LIGHT = 0.007  # relative, of one session's modulation or contrast: lamps and exposures repeat to a percent
_U_LIGHT_LEAST = 0.002  # what no number of repeats within minutes says of the next month
_ENOUGH_REPEATS = 4  # from so many on, their scatter has a standard deviation at all (JCGM 101:2008, 6.4.9.4)
#: What else the heights of strips hang on.
_OF_STRIPS = frozenset(
    {
        Influence.STRIP_PAINT,
        Influence.STRIP_SEATING,
        Influence.STRIP_PARALLELISM,
        Influence.TRANSLUCENCY,
        Influence.INSTRUMENT,
        Influence.TEMPERATURE,
    }
)
#: What is the same in both sessions, and so falls out of their comparison.
_THE_SAME = frozenset(
    {
        Influence.GRID_PITCH,
        Influence.CAMERA_HEIGHT,
        Influence.PRINCIPAL_POINT_U,
        Influence.PRINCIPAL_POINT_V,
        Influence.CAMERA_TILT_X,
        Influence.CAMERA_TILT_Y,
        Influence.LENS,
        Influence.PLATE_FLATNESS,
    }
)


def covariance_of(layout: Layout, calibration: RigCalibration, observed: Observed, u_contrast: float) -> Array:
    """Covariance of the change: today's scatter, the calibration's own, and artefacts that are not the same ones.

    `u_contrast` is the relative standard uncertainty of the contrast's change.
    """
    grid, plate, strips = observed
    parts = layout.parts
    size = max(part.stop for part in parts.values())
    total = np.zeros((size, size))
    if grid is not None:
        total[parts["camera"], parts["camera"]] += _camera_scatter(grid)
    if plate is not None:
        total[parts["plate"], parts["plate"]] += _plate_scatter(plate, calibration)[1:, 1:]
    for today, part in zip(strips, layout.strip_parts, strict=True):
        total[part, part] += _scatter(today.tops.blocks, STRIPS_DEGREE)
    total += _calibration_part(layout, calibration, observed)
    floors = {"blur": _U_BLUR_PX, "contrast": u_contrast, **_FLOOR_RAD}
    for name, floor in floors.items():
        total[parts[name], parts[name]] += floor**2 * np.eye(parts[name].stop - parts[name].start)
    if grid is not None:
        corner = parts["camera"].stop - 1
        total[corner, corner] += _FLOOR_PX**2
    return total


def _scatter(blocks: Blocks, degree: int) -> Array:
    """Covariance of the terms from the scatter of the blocks."""
    design = blocks.design(degree)
    left = blocks.value - design @ np.linalg.lstsq(design, blocks.value, rcond=None)[0]
    variance = float(left @ left) / max(left.size - design.shape[1], 1)
    return variance * np.linalg.inv(design.T @ design)


def _plate_scatter(plate: PlateFound, calibration: RigCalibration) -> Array:
    """Covariance of the plate's terms: blocks scatter today as they did, and the calibration saw fewer pixels.

    It follows its plate by a smooth residual through some thousands of single pixels, whose own noise does not vanish
    as it does from all pixels today.
    """
    light, design = plate.phase.map, plate.blocks.design(PLATE_DEGREE)
    variance = float(np.nanmedian(light.sigma[light.valid])) ** 2 + calibration.excess_rad**2
    used = min(SURFACE_POINTS, int(plate.blocks.pixels.sum()))
    single = variance / used * np.linalg.inv(design.T @ design / len(design))
    return 2 * _scatter(plate.blocks, PLATE_DEGREE) + single


def _camera_scatter(grid: GridFound) -> Array:
    """Covariance of the camera's quantities: today's crossings, and the pitch where it is another sheet's."""
    camera = grid.fit.camera
    shared = [c.effect for c in grid.fit.components if c.influence is not Influence.GRID_PITCH or grid.same_sheet]
    covariance = camera.covariance - sum((np.outer(e, e) for e in shared), np.zeros_like(camera.covariance))
    base = camera_quantities(camera)
    sd = np.sqrt(np.clip(np.diag(covariance), 0.0, None))
    slopes = np.zeros((base.size, len(CAMERA_NAMES)))
    for i in np.flatnonzero(sd):
        step = sd[i] * np.eye(len(CAMERA_NAMES))[i]
        slopes[:, i] = (camera_quantities(camera.replaced(camera.parameters + step)) - base) / sd[i]
    return slopes @ covariance @ slopes.T


def _calibration_part(layout: Layout, calibration: RigCalibration, observed: Observed) -> Array:
    """Covariance of what the calibration predicts, from every source that does not cancel in the comparison.

    Its effect is what an unchanged rig would show today if its source were one standard uncertainty off: the rig as
    it then is, less the rig as it was calibrated.
    """
    grid, _, strips = observed
    base = base_state(calibration)
    start = layout.predict(base)
    scales = {number: 1 + one.u_height for number, one in enumerate(strips)}
    same = {number: scales[number] for number, one in enumerate(strips) if one.same_strips}
    others = {number: scales[number] for number in scales if number not in same}
    effects = [layout.predict(replace(base, set_scales=others)) - start]
    another_sheet = grid is not None and not grid.same_sheet
    alone = [component.influence for component in calibration.components].count(Influence.STRIP_HEIGHT) == 1
    for component in calibration.components:
        influence = component.influence
        if influence in _THE_SAME and not (influence is Influence.GRID_PITCH and another_sheet):
            continue
        state = base_state(calibration.shifted(component))
        if influence is Influence.STRIP_HEIGHT:  # the same strips lie there today, as far off what is stated as then
            state = replace(state, set_scales=same)
        effect = layout.predict(state) - start
        for part in _cancelled(influence, layout, strips, alone=alone):
            effect[part] = 0.0
        effects.append(effect)
    return sum((np.outer(effect, effect) for effect in effects), np.zeros((start.size, start.size)))


def _cancelled(
    influence: Influence, layout: Layout, strips: tuple[StripsFound, ...], *, alone: bool
) -> tuple[slice, ...]:
    """Return the parts of the vector in which a source cancels, where its effect does not show that by itself."""
    if influence in _OF_STRIPS or (
        influence is Influence.STRIP_HEIGHT and not alone
    ):  # of several heights: components do not say which is whose
        return tuple(part for part, one in zip(layout.strip_parts, strips, strict=True) if one.same_strips)
    # The plate's residual compensates the scatter of the seven numbers where both were measured: on the plate.
    return (layout.parts["plate"],) if influence is Influence.PHASE_SCATTER else ()


def light_uncertainty(name: Literal["modulation", "contrast"], *quality: AppearanceRecord) -> float:
    """Relative standard uncertainty of a difference of modulation or contrast between sessions.

    Without repeats the usual repeatability of a lamp brightness is taken for each session. Repeats that scatter more
    are used as they are; four or more that scatter less replace it, ``s sqrt((n - 1) / (n - 3) / n)``.

    Examples
    --------
    >>> round(light_uncertainty("contrast", AppearanceRecord(), AppearanceRecord()), 4)
    0.0099
    """
    return math.hypot(*(_light_uncertainty(getattr(one, f"scatter_{name}"), one.repeats) for one in quality))


def _light_uncertainty(scatter: float | None, repeats: int) -> float:
    if scatter is None:
        return _U_LIGHT
    if repeats < _ENOUGH_REPEATS:
        return max(_U_LIGHT, scatter)
    return max(_U_LIGHT_LEAST, scatter * math.sqrt((repeats - 1) / (repeats - 3) / repeats))
