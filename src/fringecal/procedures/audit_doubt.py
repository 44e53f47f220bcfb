"""How well an audit knows each change: today's scatter, the calibration's own doubt, and what two sessions share."""

import math
from dataclasses import replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from fringecal.camera.plate import CAMERA_NAMES
from fringecal.procedures.audit_layout import PLATE_DEGREE, STRIPS_DEGREE, Blocks, Layout, camera_quantities
from fringecal.procedures.audit_observed import GridToday, PlateToday, StripsToday, base_state
from fringecal.projection.calibration import RigCalibration
from fringecal.records.calibration import AppearanceRecord

Array = NDArray[np.float64]
type Observed = tuple[GridToday | None, PlateToday | None, tuple[StripsToday, ...]]

_FLOOR_RAD = 5e-4  # ripple and texture that no polynomial and no cause describes
_FLOOR_PX = 0.02  # of the corner, likewise
_U_BLUR_PX = 0.02  # how well one picture of a grid tells its blur: width and blur of a line are fitted together
_U_LIGHT = 0.007  # relative, of one session's modulation or contrast: lamps and exposures repeat to a percent
_U_LIGHT_LEAST = 0.002  # what no number of repeats within minutes says of the next month
_ENOUGH_REPEATS = 4  # from so many on, their scatter has a standard deviation at all (JCGM 101:2008, 6.4.9.4)
_SCATTER = ("phase scatter", "grid crossings")  # causes of doubt that two sessions do not share


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
        total[parts["plate"], parts["plate"]] += _scatter(plate.blocks, PLATE_DEGREE)[1:, 1:]
    for today, part in zip(strips, layout.strip_parts, strict=True):
        total[part, part] += _scatter(today.tops.blocks, STRIPS_DEGREE)
    total += _calibration_doubt(layout, calibration, observed)
    floors = {"camera": 0.0, "plate": _FLOOR_RAD, "strips": _FLOOR_RAD, "blur": _U_BLUR_PX, "contrast": u_contrast}
    for name, part in parts.items():
        total[part, part] += floors[name] ** 2 * np.eye(part.stop - part.start)
    if grid is not None:
        corner = parts["camera"].stop - 1
        total[corner, corner] += _FLOOR_PX**2
    return total


def _scatter(blocks: Blocks, degree: int) -> Array:
    """Covariance of the terms from the scatter of the blocks, twice: the calibration's plate is as noisy."""
    design = blocks.design(degree)
    left = blocks.value - design @ np.linalg.lstsq(design, blocks.value, rcond=None)[0]
    variance = float(left @ left) / max(left.size - design.shape[1], 1)
    return 2 * variance * np.linalg.inv(design.T @ design)


def _camera_scatter(grid: GridToday) -> Array:
    """Covariance of the camera's quantities: today's crossings, and the pitch where it is another sheet's."""
    camera = grid.fit.camera
    shared = [e for label, e in grid.fit.causes.items() if not (label == "grid pitch" and not grid.same_sheet)]
    covariance = camera.covariance - sum((np.outer(e, e) for e in shared), np.zeros_like(camera.covariance))
    base = camera_quantities(camera)
    spread = np.sqrt(np.clip(np.diag(covariance), 0.0, None))
    slopes = np.zeros((base.size, len(CAMERA_NAMES)))
    for i in np.flatnonzero(spread):
        step = spread[i] * np.eye(len(CAMERA_NAMES))[i]
        slopes[:, i] = (camera_quantities(camera.replaced(camera.parameters + step)) - base) / spread[i]
    return slopes @ covariance @ slopes.T


def _calibration_doubt(layout: Layout, calibration: RigCalibration, observed: Observed) -> Array:
    """Covariance of what the calibration predicts: causes that today's session does not share."""
    grid, _, strips = observed
    base = base_state(calibration)
    start = layout.predict(base)
    others = {number: 1 + one.u_height for number, one in enumerate(strips) if not one.same_strips}
    effects = [layout.predict(replace(base, set_scales=others)) - start] if others else []
    for mode in calibration.modes:
        other_sheet = mode.label == "grid pitch" and grid is not None and not grid.same_sheet
        if mode.label in _SCATTER or other_sheet or (mode.label == "strip height" and others):
            effect = layout.predict(base_state(calibration.shifted(mode))) - start
            if mode.label == "strip height":
                for number in set(range(len(strips))) - set(others):
                    effect[layout.strip_parts[number]] = 0.0  # the same strips are as wrong today as they were
            effects.append(effect)
    return sum((np.outer(effect, effect) for effect in effects), np.zeros((start.size, start.size)))


def light_doubt(name: Literal["modulation", "contrast"], *looks: AppearanceRecord) -> float:
    """Relative standard uncertainty of a difference of modulation or contrast between sessions.

    Without repeats a lamp's usual repeatability stands for each session. Repeats that scatter more count as they are;
    four or more that scatter less stand in its place, ``s sqrt((n - 1) / (n - 3) / n)``.

    Examples
    --------
    >>> round(light_doubt("contrast", AppearanceRecord(), AppearanceRecord()), 4)
    0.0099
    """
    return math.hypot(*(_light_doubt(getattr(one, f"scatter_{name}"), one.repeats) for one in looks))


def _light_doubt(scatter: float | None, repeats: int) -> float:
    if scatter is None:
        return _U_LIGHT
    if repeats < _ENOUGH_REPEATS:
        return max(_U_LIGHT, scatter)
    return max(_U_LIGHT_LEAST, scatter * math.sqrt((repeats - 1) / (repeats - 3) / repeats))
