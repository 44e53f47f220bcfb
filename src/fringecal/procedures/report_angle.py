"""The last part of a commissioning report: the projection angle over the field, and what is uncertain."""

import math

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from fringecal.procedures.commission import Commissioning
from fringecal.procedures.report_parts import budget_table
from fringecal.procedures.report_rig import field_mm
from fringecal.projection.calibration import RigCalibration
from fringecal.report.figures_angle import angle_plot
from fringecal.report.figures_tables import budget_bars
from fringecal.report.structure import FigureItem, Section, Table

Array = NDArray[np.float64]

_COLUMNS = {
    "u_px": ("u / px", ".0f"),
    "x_mm": ("x / mm", ".1f"),
    "breaks": ("breaks", "d"),
    "angle_deg": ("angle / deg", ".3f"),
    "u_deg": ("u / deg", ".3f"),
    "apparent_deg": ("apparent / deg", ".3f"),
    "theory_deg": ("theory / deg", ".3f"),
    "u_theory_deg": ("u(theory) / deg", ".3f"),
    "difference_deg": ("difference / deg", "+z.3f"),
    "en": ("En", "+z.2f"),
}


def angle_section(found: Commissioning) -> Section:
    """Give the projection angle over the field, from the strips' breaks, beside theory."""
    sentences = (
        "The projection angle is measured from the plate's normal, in the plane across the local fringe; the apparent "
        "angle is what a fringe's break shows to the camera, the camera's own angle included.",
        found.angle_sentence,
    )
    if not found.columns:
        return Section("Projection angle", (*sentences, "No column of the picture crosses enough of a strip."))
    frame = columns_frame(found)
    formats = dict(_COLUMNS.values())
    note = "on the line y = 0, from the plate's normal; theory from the stated positions of the projector"
    table = Table("Projection angle by column", frame, note, formats)
    figure = angle_plot(
        np.array([c.x_mm for c in found.columns]),
        np.array([c.angle.value for c in found.columns]),
        np.array([c.angle.u for c in found.columns]),
        theory_deg=_theory(found),
        apparent_deg=np.array([c.apparent_deg for c in found.columns]),
    )
    low, high = (f(c.angle.value for c in found.columns) for f in (min, max))
    alt = f"Projection angle against x: from {low:.2f} to {high:.2f} deg, with 95 % bars, apparent angle and theory."
    return Section(
        "Projection angle", sentences, (table,), (FigureItem("Projection angle over the field", figure, alt),)
    )


def columns_frame(found: Commissioning) -> pd.DataFrame:
    """Tabulate the columns (the thesis's tables 3.5 and 3.6 side by side)."""
    rows = [
        {
            "u_px": c.u_px,
            "x_mm": c.x_mm,
            "breaks": c.breaks,
            "angle_deg": c.angle.value,
            "u_deg": c.angle.u,
            "apparent_deg": c.apparent_deg,
            "theory_deg": c.theory.value if c.theory else None,
            "u_theory_deg": c.theory.u if c.theory else None,
            "difference_deg": c.difference_deg,
            "en": c.en,
        }
        for c in found.columns
    ]
    frame = pd.DataFrame(rows).dropna(axis="columns", how="all")
    return frame.set_axis([_COLUMNS[str(key)][0] for key in frame.columns], axis="columns")


def _theory(found: Commissioning) -> Array | None:
    theory = [c.theory.value for c in found.columns if c.theory is not None]
    return np.array(theory) if len(theory) == len(found.columns) else None


def budgets_section(found: Commissioning) -> Section:
    """Say what the uncertainties of angle, scale and heights are made of."""
    angle = budget_table("Budget of the projection angle", found.angle_budget, "deg")
    scale = budget_table("Budget of the mean scale", found.camera.scale_budget, "mm/px")
    first = angle.frame.iloc[0]
    figure = budget_bars(
        list(angle.frame["influence"]),
        list(angle.frame["share of the variance / %"]),
        title=f"projection angle at the origin, u = {found.angle.u:.3f} deg",
    )
    alt = f"Bars: the largest share of the variance, {first.iloc[2]:.0f} %, is that of {first.iloc[0]}."
    noise = float(np.nanmedian(found.reference.map.sigma[found.reference.map.valid]))
    heights = heights_table(found.calibration, noise)
    item = FigureItem("Budget of the projection angle", figure, alt)
    return Section("Budgets", (), (angle, scale, heights), (item,))


def heights_table(calibration: RigCalibration, noise_rad: float) -> Table:
    """Tabulate what a height will be known to: by cause, at centre and corner, for three heights.

    Parameters
    ----------
    calibration
        The rig.
    noise_rad
        Standard deviation of the phase of one pixel.
    """
    camera = calibration.camera
    places = {"centre": camera.centre_px, "corner": (0.05 * camera.width_px, 0.05 * camera.height_px)}
    rows = []
    for height in _heights(calibration):
        for place, (u, v) in places.items():
            rows.append(
                {"height / mm": height, "place": place} | _height_budget(calibration, (u, v), height, noise_rad)
            )
    frame = pd.DataFrame(rows)
    formats = dict.fromkeys(frame.columns[2:], ".2g")
    return Table("What a height will be known to", frame, "standard uncertainty of one pixel's height, mm", formats)


def _heights(calibration: RigCalibration) -> tuple[float, ...]:
    """Heights of 5, 20 and 50 mm, smaller by tens until they suit the field."""
    x_min, x_max, y_min, y_max = field_mm(calibration)
    decade = min(0, math.floor(math.log10(min(x_max - x_min, y_max - y_min) / 100)))
    return tuple(height * 10.0**decade for height in (5, 20, 50))


def _height_budget(
    calibration: RigCalibration, pixel: tuple[float, float], height_mm: float, noise_rad: float
) -> dict[str, float]:
    """Contributions to u of one pixel's height by cause, mm, and all of them together."""
    rays = calibration.camera.rays(*pixel)
    phase = calibration.model.phase(*rays.at(height_mm), height_mm)

    def height(rig: RigCalibration, more_rad: float = 0.0) -> float:
        return float(rig.model.height(phase + more_rad, rig.camera.rays(*pixel)))

    estimate, budget = calibration.estimate(height, unit="mm", label="height")
    single = math.hypot(noise_rad, calibration.excess_rad)
    scatter = abs(height(calibration, single) - estimate.value)
    return {"combined": math.hypot(estimate.u, scatter)} | budget | {"phase of one pixel": scatter}
