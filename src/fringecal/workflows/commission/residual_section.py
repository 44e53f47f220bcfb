"""Residuals of the joint fit in a commissioning report: on the plate, on the strips, and what the model took up."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fringecal.calibration import Calibrated
from fringecal.report import FigureItem, Layer, Live, ReadableMap, readable_picture, residual_map, symmetric_limit
from fringecal.uncertainty import Estimate
from fringecal.workflows.shared import BORDER_PX, within_border

Array = NDArray[np.float64]

_CELLS = 240  # of a residual map along its longer side: as many as a page shows apart


@dataclass(frozen=True)
class StripResiduals:
    """Residuals at the points of strips of one height: label of the strip, place, phase, and the same as height."""

    height: Estimate
    label: NDArray[np.int16]
    u_px: Array
    v_px: Array
    residual_rad: Array
    as_height_mm: Array


@dataclass(frozen=True)
class ResidualMaps:
    """Measured minus modelled phase: maps of means over cells, NaN where there is none, and the strips' points.

    `smooth_rad` is what the fit took up as plate residual; `cell_px` the side of a cell: single pixels show noise,
    their means show what the model leaves out.
    """

    cell_px: int
    plate_rad: Array
    smooth_rad: Array
    strips: tuple[StripResiduals, ...]


def residual_maps(found: Calibrated) -> ResidualMaps:
    """Compute the residuals of plate and strips, of what the fit rejected too, but not at the picture's border."""
    camera, model = found.rig.camera, found.rig.model
    cell = max(1, -(-max(found.plate.unwrapped_rad.shape) // _CELLS))
    rays = camera.pixel_rays()
    smooth = np.where(np.isfinite(found.plate.unwrapped_rad), model.residual(rays.ax, rays.ay), np.nan)
    plate = found.plate.unwrapped_rad - model.ratio(rays.ax, rays.ay, 0.0) - smooth
    plate[~within_border(plate.shape)] = np.nan
    strips = tuple(_strip_residuals(found, i) for i in range(1, len(found.observations.height_mm)))
    return ResidualMaps(cell, cell_means(plate, cell), cell_means(smooth, cell), strips)


def cell_means(values: Array, cell_px: int) -> Array:
    """Average a map over cells of `cell_px` pixels a side, NaN left out; the last ones may be cut short.

    Examples
    --------
    >>> cell_means(np.array([[1.0, 3.0, 7.0], [np.nan, 2.0, np.nan]]), 2).tolist()
    [[2.0, 7.0]]
    """
    known = np.isfinite(values)
    rows, columns = (np.arange(0, side, cell_px) for side in values.shape)

    def total(part: Array) -> Array:
        return np.add.reduceat(np.add.reduceat(part, rows, axis=0), columns, axis=1)

    number = total(known.astype(float))
    return np.where(number > 0, total(np.where(known, values, 0.0)) / np.maximum(number, 1), np.nan)


def _strip_residuals(found: Calibrated, number: int) -> StripResiduals:
    """Take the residuals of one surface of the fit."""
    observed, model = found.observations, found.rig.model
    u, v = observed.u_px[number], observed.v_px[number]
    surface = observed.surfaces(found.rig.camera)[number]
    x, y = surface.rays.at(surface.z_mm)
    residual = surface.phase_rad - model.phase(x, y, surface.z_mm)
    gx, gy, gz = model.gradient(x, y, surface.z_mm)
    slope = gz + gx * surface.rays.bx + gy * surface.rays.by
    label = found.strips.found.regions.labels[v.astype(int), u.astype(int)]
    return StripResiduals(observed.height_mm[number], label, u, v, residual, residual / slope)


def scattered(points: tuple[StripResiduals, ...], shape: tuple[int, ...], cell_px: int) -> Array:
    """Average the residuals at points over cells of `cell_px` pixels a side; NaN at the border and where is none."""
    rows, columns = (-(-side // cell_px) for side in shape)
    v = np.concatenate([p.v_px for p in points]).astype(int)
    u = np.concatenate([p.u_px for p in points]).astype(int)
    values = np.concatenate([p.residual_rad for p in points])
    inside = within_border(shape)[v, u]
    v, u, values = (part[inside] for part in (v // cell_px, u // cell_px, values))
    index = v * columns + u
    number = np.bincount(index, minlength=rows * columns)
    total = np.bincount(index, weights=values, minlength=rows * columns)
    return np.where(number > 0, total / np.maximum(number, 1), np.nan).reshape(rows, columns)


def residual_figures(found: Calibrated, maps: ResidualMaps) -> tuple[FigureItem, ...]:
    """Draw each residual on the scale of the points which the fit kept: what it rejected stands out."""
    strips = scattered(maps.strips, found.plate.unwrapped_rad.shape, maps.cell_px)
    shown = (
        ("Phase residual on the plate", maps.plate_rad, symmetric_limit(maps.plate_rad)),
        ("Phase residual on the strips", strips, symmetric_limit(np.concatenate(found.fit.residuals[1:]))),
    )
    items = [
        FigureItem(
            caption,
            residual_map(
                values,
                limit_rad=limit,
                step_px=maps.cell_px,
                title=f"means over {maps.cell_px} px, without {BORDER_PX} px at the picture's border",
            ),
            f"Map in the camera's picture, whose border of {BORDER_PX} px is left out since blur pulls the phase aside "
            f"there, on a scale of plus and minus {limit:.3f} rad, which "
            f"{100 * float(np.mean(np.abs(values[np.isfinite(values)]) > limit)):.1f} % of its values exceed.",
            "png",
            Live(_readable(values, maps.cell_px)),
        )
        for caption, values, limit in shown
    ]
    smooth = residual_map(maps.smooth_rad, label="plate residual / rad", step_px=maps.cell_px)
    alt = f"Smooth map in the camera's picture, at most {float(np.nanmax(np.abs(maps.smooth_rad))):.3f} rad."
    live = Live(_readable(maps.smooth_rad, maps.cell_px))
    return (*items, FigureItem("Smooth plate residual taken up by the model", smooth, alt, "png", live))


def _readable(residual_rad: Array, cell_px: int) -> ReadableMap:
    return readable_picture(Layer("residual", "rad", residual_rad, 4), step_px=cell_px)
