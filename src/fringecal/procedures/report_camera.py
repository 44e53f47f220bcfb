"""The camera's part of a commissioning report: scale, lens, crossings."""

import math

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from fringecal.camera.plate import CAMERA_NAMES, PlateCamera
from fringecal.procedures.camera import CameraFindings
from fringecal.procedures.report_parts import concise, estimates_table
from fringecal.report.figures_camera import crossings_overlay, residual_arrows
from fringecal.report.structure import FigureItem, Section, Table

Array = NDArray[np.float64]

_LABELS = {
    "scale_mm_per_px": ("scale on the optical axis", "mm/px"),
    "aspect": ("scale along v over scale along u", "1"),
    "tilt_x_rad": ("tilt toward +x", "rad"),
    "tilt_y_rad": ("tilt toward +y", "rad"),
    "k1": ("k1, radial distortion", "1"),
    "k2": ("k2, radial distortion", "1"),
    "p1": ("p1, tangential distortion", "1"),
    "p2": ("p2, tangential distortion", "1"),
    "k3": ("k3, radial distortion", "1"),
    "cu_px": ("principal point along u, from the centre", "px"),
    "cv_px": ("principal point along v, from the centre", "px"),
    "height_mm": ("entrance pupil above the plate", "mm"),
}


def camera_section(found: CameraFindings) -> Section:
    """Say what the grid picture tells of the camera."""
    return Section(
        "Camera",
        _sentences(found),
        (
            estimates_table("Scale on the plate at the image centre", found.scales, first="scale"),
            *thesis_tables(found),
            local_scale_table(found.fit.camera, found.scales["mean"].value),
            _parameters_table(found),
        ),
        (_overlay(found), _residuals(found)),
    )


def thesis_tables(found: CameraFindings) -> tuple[Table, ...]:
    """Tabulate line distances and the errors of the mean factor, the thesis's way (its tables 3.1 to 3.4)."""
    tables = found.tables
    factors = f"mean factor {concise(tables.mean)}; distances in the middle third of the picture"
    errors = f"distances at other places by the mean factor; largest error {tables.largest_error_percent:+.3f} %"
    parts = (
        ("Distances between vertical lines", tables.vertical_lines, factors),
        ("Distances between horizontal lines", tables.horizontal_lines, factors),
        ("Errors of distances between vertical lines", tables.horizontal_errors, errors),
        ("Errors of distances between horizontal lines", tables.vertical_errors, errors),
    )
    return tuple(Table(caption, _by_span(frame), note) for caption, frame, note in parts)


_SHOWN = {
    "distance_px": ("mean distance / px", "sd distance / px"),
    "factor_mm_per_px": ("mean factor / (mm/px)", "sd factor / (mm/px)"),
    "error_mm": ("mean error / mm", "sd error / mm"),
    "error_percent": ("mean error / %", "sd error / %"),
}


def _by_span(frame: pd.DataFrame) -> pd.DataFrame:
    """Gather one row for each span between lines: the single distances would fill pages."""
    groups = frame.groupby(["part", "span"], sort=False)
    columns = {"distances": groups.size(), "nominal / mm": groups["distance_mm"].mean()}
    for name, (mean, spread) in _SHOWN.items():
        if name in frame:
            columns |= {mean: groups[name].mean(), spread: groups[name].std()}
    return pd.DataFrame(columns).fillna(0.0).reset_index()


def local_scale_table(camera: PlateCamera, mean_mm_per_px: float) -> Table:
    """Tabulate the scale at nine places of the picture and what the mean factor errs by there."""
    rows = []
    for v_name, v_share in (("top", 0.05), ("middle", 0.5), ("bottom", 0.95)):
        for u_name, u_share in (("left", 0.05), ("centre", 0.5), ("right", 0.95)):
            u, v = u_share * (camera.width_px - 1), v_share * (camera.height_px - 1)
            along_u, along_v = local_scale(camera, u, v)
            rows.append(
                {
                    "place": f"{v_name} {u_name}",
                    "u / px": u,
                    "v / px": v,
                    "along u / (mm/px)": along_u,
                    "along v / (mm/px)": along_v,
                    "error along u / %": 100 * (mean_mm_per_px / along_u - 1),
                    "error along v / %": 100 * (mean_mm_per_px / along_v - 1),
                }
            )
    formats = dict.fromkeys(("u / px", "v / px"), ".0f")
    formats |= dict.fromkeys(("along u / (mm/px)", "along v / (mm/px)"), ".5f")
    formats |= dict.fromkeys(("error along u / %", "error along v / %"), "+z.2f")
    note = "error of a short distance on the plate computed with the mean factor"
    return Table("Scale over the field", pd.DataFrame(rows), note, formats)


def local_scale(camera: PlateCamera, u_px: float, v_px: float) -> tuple[float, float]:
    """Return the scale on the plate along u and along v at a pixel, mm/px.

    Examples
    --------
    >>> camera = PlateCamera.from_values({"scale_mm_per_px": 0.5, "height_mm": 900.0}, (480, 640))
    >>> [round(scale, 6) for scale in local_scale(camera, 10.0, 400.0)]
    [0.5, 0.5]
    """
    rays = camera.rays(np.array([u_px + 0.5, u_px - 0.5, u_px, u_px]), np.array([v_px, v_px, v_px + 0.5, v_px - 0.5]))
    return (
        math.hypot(rays.ax[0] - rays.ax[1], rays.ay[0] - rays.ay[1]),
        math.hypot(rays.ax[2] - rays.ax[3], rays.ay[2] - rays.ay[3]),
    )


def largest_scale_error_percent(found: CameraFindings) -> float:
    """Return the largest error over the field of distances computed with the mean factor, percent."""
    frame = local_scale_table(found.fit.camera, found.scales["mean"].value).frame
    return float(frame[["error along u / %", "error along v / %"]].abs().to_numpy().max())


def _sentences(found: CameraFindings) -> tuple[str, ...]:
    fit, lens, grid = found.fit, found.distortion, found.detection
    used = int(np.isfinite(fit.residual_u_px).sum())
    shift = f"{concise(lens.max_px)} at {lens.radius_px:.0f} px from the centre"
    bent = (
        f"No lens distortion was found: {shift}; {lens.detection_limit_px:.2g} px would have shown in 95 % of cases."
        if lens.verdict == "none"
        else f"The lens shows {lens.verdict} distortion: {shift}, p = {lens.p_value:.2g}. The camera model corrects it."
    )
    return (
        f"{used} of {grid.u_px.size} crossings of {found.target.name} agree with one flat sheet seen by one camera; "
        f"residual {fit.rms_px:.3f} px rms per coordinate, sheet turned by {fit.turn_deg:+.2f} deg.",
        bent,
        f"With the mean scale alone, distances are wrong by up to {largest_scale_error_percent(found):.2g} %.",
    )


def _parameters_table(found: CameraFindings) -> Table:
    """Tabulate the parameters of the camera model and where each comes from."""
    camera = found.fit.camera
    u = np.sqrt(np.diag(camera.covariance))
    rows = []
    for name, value, u_value in zip(CAMERA_NAMES, camera.parameters, u, strict=True):
        if camera.telecentric and name == "height_mm":
            continue
        label, unit = _LABELS[name]
        origin = "fitted" if name in found.fit.free else "fixed"
        rows.append({"parameter": label, "value": float(value), "u": float(u_value), "unit": unit, "origin": origin})
    kind = "telecentric" if camera.telecentric else "pinhole"
    return Table("Camera parameters", pd.DataFrame(rows), f"{kind} camera on the plate", {"value": ".6g", "u": ".2g"})


def _overlay(found: CameraFindings) -> FigureItem:
    grid = found.detection
    used = np.isfinite(found.fit.residual_u_px)
    figure = crossings_overlay(found.capture.read()[0], grid.u_px, grid.v_px, used=used, title=found.capture.name)
    alt = (
        f"The picture of the grid with {grid.u_px.size} crossings marked over {grid.row.max() + 1} rows and "
        f"{grid.column.max() + 1} columns; {int((~used).sum())} of them were rejected by the fit."
    )
    return FigureItem("Grid crossings found", figure, alt, "png")


def _residuals(found: CameraFindings) -> FigureItem:
    grid, fit = found.detection, found.fit
    residuals = np.column_stack([fit.residual_u_px, fit.residual_v_px])
    figure = residual_arrows(
        np.column_stack([grid.u_px, grid.v_px]), residuals, grid.shape, title="observed - modelled, enlarged"
    )
    alt = (
        f"Arrows at the crossings, observed minus modelled, {fit.rms_px:.3f} px rms per coordinate. Arrows that "
        "point alike in a region would show what the camera model leaves out."
    )
    return FigureItem("Residuals of the grid", figure, alt)
