"""Breaks from phase-shifted pictures: every pixel of a strip's top shows one; those of one fringe go together."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from fringecal.camera import PlateCamera
from fringecal.projector.angle.breaks import OK, Breaks
from fringecal.projector.angle.projection_angle import (
    NEWTON_ROUNDS,
    across_fringe,
    angles_from_breaks,
    projection_tangent,
)
from fringecal.projector.joint_fit import PhasePoints
from fringecal.projector.rig_calibration import Observations, RigCalibration
from fringecal.projector.rig_model import RigModel

Array = NDArray[np.float64]

_LEAST_PIXELS = 5  # of one fringe on one strip: fewer say little of their own scatter, which becomes the break's sigma


def phase_breaks(
    calibration: RigCalibration, observations: Observations, labels: NDArray[np.int16], *, surfaces: int
) -> Breaks:
    """Return the breaks that the phase on strip tops shows against the plate's.

    Parameters
    ----------
    calibration
        The rig fitted to the observations; its plate phase is what the breaks are measured against.
    observations
        Plate first, then the strips' tops, then whatever else the rig was fitted to.
    labels
        Map of the strips' numbers.
    surfaces
        How many surfaces, after the plate, are tops of these strips.
    """
    tops = observations.surfaces(calibration.camera)[1 : surfaces + 1]
    parts = [
        _of_surface(calibration, surface, observations.u_px[i], observations.v_px[i], labels)
        for i, surface in enumerate(tops, start=1)
    ]
    breaks = _joined(parts)
    return breaks.without_outliers(projection_tangent(calibration.model, breaks.x_mm, breaks.y_mm))


def _of_surface(
    calibration: RigCalibration, surface: PhasePoints, u: Array, v: Array, labels: NDArray[np.int16]
) -> dict[str, Array]:
    model, camera = calibration.model, calibration.camera
    tangent, x, y = angles_from_breaks(model, surface)
    shift = _shift_px(model, camera, surface, u, v)
    mx, my = across_fringe(model, x, y)
    seen = tangent * surface.z_mm - surface.z_mm * (mx * surface.rays.bx + my * surface.rays.by)
    strip = labels[np.rint(v).astype(np.intp), np.rint(u).astype(np.intp)]
    fringe = np.rint(surface.phase_rad / (2 * np.pi)).astype(np.intp)
    good = np.isfinite(tangent) & np.isfinite(shift) & (strip > 0)
    keys, index, number = np.unique(
        np.column_stack([strip, fringe])[good], axis=0, return_inverse=True, return_counts=True
    )
    index = index.ravel()

    def mean(values: Array) -> Array:
        return np.bincount(index, weights=values[good]) / number

    scatter = np.sqrt(np.maximum(mean(shift**2) - mean(shift) ** 2, 0.0))
    table = {
        "strip": keys[:, 0], "fringe": keys[:, 1].astype(float), "u_px": mean(u), "v_px": mean(v),
        "shift_px": mean(shift), "sigma_px": scatter / np.sqrt(number), "shift_mm": mean(seen),
        "tangent": mean(tangent), "apparent": mean(seen / surface.z_mm), "x_mm": mean(x), "y_mm": mean(y),
    }  # fmt: skip
    return {name: column[number >= _LEAST_PIXELS] for name, column in table.items()}


def _shift_px(model: RigModel, camera: PlateCamera, surface: PhasePoints, u: Array, v: Array) -> Array:
    """How far along the column (or row) the plate shows the same phase: the place on the strip minus that."""
    du, dv = (0.0, 1.0) if runs_along_rows(model, camera) else (1.0, 0.0)

    def plate(off: Array) -> Array:
        rays = camera.rays(u - off * du, v - off * dv)
        return model.phase(rays.ax, rays.ay, 0.0)

    shift = np.zeros_like(u)
    for _ in range(NEWTON_ROUNDS):
        slope = plate(shift + 0.5) - plate(shift - 0.5)
        shift = shift + (surface.phase_rad - plate(shift)) / slope
    return shift


def runs_along_rows(model: RigModel, camera: PlateCamera) -> bool:
    """Return whether the fringes run along the picture's rows rather than its columns.

    Examples
    --------
    >>> camera = PlateCamera.from_values({"scale_mm_per_px": 0.8, "height_mm": 1100.0}, (480, 640))
    >>> across_x, across_y = np.array([0.5, 0, 0.5, 0, 0, 0, 0]), np.array([0, 0.5, 0.5, 0, 0, 0, 0])
    >>> [runs_along_rows(RigModel(one, np.full(3, np.inf)), camera) for one in (across_x, across_y)]
    [False, True]
    """
    u, v = camera.centre_px
    rays = camera.rays(np.array([u, u + 1, u]), np.array([v, v, v + 1]))
    phase = model.phase(rays.ax, rays.ay, 0.0)
    return bool(abs(phase[2] - phase[0]) >= abs(phase[1] - phase[0]))


def _joined(parts: Sequence[dict[str, Array]]) -> Breaks:
    columns = {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}
    columns["strip"] = columns["strip"].astype(np.intp)
    return Breaks(**columns, status=np.full(columns["fringe"].size, OK, dtype="<U8"))
