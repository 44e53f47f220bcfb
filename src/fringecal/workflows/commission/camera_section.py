"""The camera's part of a commissioning report: scale, lens, crossings."""

import math

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy import special

from fringecal.calibration import CameraFindings
from fringecal.camera import CAMERA_NAMES, SIGNIFICANCE, CameraFit, PlateCamera
from fringecal.report import FigureItem, Section, Table, residual_quiver
from fringecal.session import Capture
from fringecal.workflows.grid import GridPicture, distortion_section, lines_section, scale_section
from fringecal.workflows.shared import RIM, estimates_table

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


def camera_sections(found: CameraFindings, capture: Capture) -> tuple[Section, ...]:
    """Say what the grid picture tells of lines, scale, lens, and the camera on the plate."""
    grid = GridPicture(
        capture.name,
        capture.read()[0],
        found.detection,
        found.distortion,
        found.tables,
        found.pitch,
        np.isfinite(found.fit.residual_u_px),
    )
    camera = Section(
        "Camera",
        _sentences(found, capture),
        (
            estimates_table("Scale on the plate at the image centre", found.scales, first="scale"),
            local_scale_table(found.fit.camera, found.scales["mean"].value),
            shape_table(found.fit),
            _parameters_table(found),
        ),
        (_residuals(found),),
    )
    return lines_section(grid), camera, scale_section(grid), distortion_section(grid)


def shape_table(fit: CameraFit) -> Table:
    """Test pixel aspect and tilt, apart from the scale, against square pixels and a square-on camera."""
    rows = []
    for name, label, null in (
        ("aspect", "pixel aspect, v over u", 1.0),
        ("tilt_x_rad", "tilt toward +x / rad", 0.0),
        ("tilt_y_rad", "tilt toward +y / rad", 0.0),
    ):
        place = CAMERA_NAMES.index(name)
        value, u = float(fit.camera.parameters[place]), math.sqrt(fit.camera.covariance[place, place])
        if u > 0:
            p = float(2 * special.ndtr(-abs(value - null) / u))
            found = "significant" if p < SIGNIFICANCE else "not significant"
            rows.append({"quantity": label, "value": value, "u": u, "without it": null, "p": p, "at 5 %": found})
    names = ["quantity", "value", "u", "without it", "p", "at 5 %"]
    formats = {"value": ".6g", "without it": ".0f", "p": ".2g"}
    note = "two-sided test of each; a telecentric camera's tilt cannot be told from its aspect"
    return Table(
        "Aspect and tilt, apart from the scale", pd.DataFrame(rows, columns=names), note, formats, {"value": "u"}
    )


def local_scale_table(camera: PlateCamera, mean_mm_per_px: float) -> Table:
    """Tabulate the scale at nine places of the picture and the error of the mean scale there."""
    rows = []
    for v_name, v_share in (("top", RIM), ("middle", 0.5), ("bottom", 1 - RIM)):
        for u_name, u_share in (("left", RIM), ("centre", 0.5), ("right", 1 - RIM)):
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
    note = "error of a short distance on the plate computed with the mean scale"
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
    """Return the largest error over the field of distances computed with the mean scale, percent."""
    frame = local_scale_table(found.fit.camera, found.scales["mean"].value).frame
    return float(frame[["error along u / %", "error along v / %"]].abs().to_numpy().max())


def _sentences(found: CameraFindings, capture: Capture) -> tuple[str, ...]:
    fit, grid = found.fit, found.detection
    name = capture.name if capture.target is None else capture.target.name
    used = int(np.isfinite(fit.residual_u_px).sum())
    return (
        f"{used} of {grid.u_px.size} crossings of {name} fit one flat sheet seen by one camera; "
        f"residual {fit.rms_px:.3f} px rms per coordinate, sheet turned by {fit.turn_deg:+z.2f} deg.",
        f"With the mean scale alone, distances have errors of up to {largest_scale_error_percent(found):.2g} %.",
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
    return Table(
        "Camera parameters", pd.DataFrame(rows), f"{kind} camera on the plate", {"value": ".6g"}, {"value": "u"}
    )


def _residuals(found: CameraFindings) -> FigureItem:
    grid, fit = found.detection, found.fit
    residuals = np.column_stack([fit.residual_u_px, fit.residual_v_px])
    figure = residual_quiver(
        np.column_stack([grid.u_px, grid.v_px]), residuals, grid.shape, title="observed - modelled"
    )
    alt = (
        f"Arrows at the crossings, observed minus modelled, {fit.rms_px:.3f} px rms per coordinate. Arrows that "
        "point alike in a region would show what the camera model leaves out."
    )
    return FigureItem("Residuals of the grid", figure, alt)
