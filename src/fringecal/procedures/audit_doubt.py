"""How well an audit knows each change: today's scatter, the calibration's own doubt, and what two sessions share."""

import numpy as np
from numpy.typing import NDArray

from fringecal.camera.plate import CAMERA_NAMES
from fringecal.procedures.audit_layout import PLATE_DEGREE, STRIPS_DEGREE, Blocks, Layout, camera_quantities
from fringecal.procedures.audit_observed import GridToday, PlateToday, StripsToday, base_state
from fringecal.projection.calibration import RigCalibration

Array = NDArray[np.float64]
type Observed = tuple[GridToday | None, PlateToday | None, StripsToday | None]

_FLOOR_RAD = 5e-4  # ripple and texture that no polynomial and no cause describes
_FLOOR_PX = 0.02  # of the corner, likewise
_U_BLUR_PX = 0.02  # how well one picture of a grid tells its blur: width and blur of a line are fitted together
_U_CONTRAST = 0.01  # relative: lamps and exposures repeat to a percent
_SCATTER = ("phase scatter", "grid crossings")  # causes of doubt that two sessions do not share


def covariance_of(layout: Layout, calibration: RigCalibration, observed: Observed) -> Array:
    """Covariance of the change: today's scatter, the calibration's own, and artefacts that are not the same ones."""
    grid, plate, strips = observed
    parts = layout.parts
    size = max(part.stop for part in parts.values())
    total = np.zeros((size, size))
    if grid is not None:
        total[parts["camera"], parts["camera"]] += _camera_scatter(grid)
    for name, today, degree in (("plate", plate, PLATE_DEGREE), ("strips", strips, STRIPS_DEGREE)):
        if today is not None:
            scatter = _scatter(today.blocks, degree)
            total[parts[name], parts[name]] += scatter[1:, 1:] if name == "plate" else scatter
    total += _calibration_doubt(layout, calibration, observed)
    floors = {"camera": 0.0, "plate": _FLOOR_RAD, "strips": _FLOOR_RAD, "blur": _U_BLUR_PX, "contrast": _U_CONTRAST}
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
    start = layout.predict(base_state(calibration))
    total = np.zeros((start.size, start.size))
    for mode in calibration.modes:
        other_sheet = mode.label == "grid pitch" and grid is not None and not grid.same_sheet
        other_strips = mode.label == "strip height" and strips is not None and not strips.same_strips
        if mode.label in _SCATTER or other_sheet or other_strips:
            effect = layout.predict(base_state(calibration.shifted(mode))) - start
            total += np.outer(effect, effect)
    return total
