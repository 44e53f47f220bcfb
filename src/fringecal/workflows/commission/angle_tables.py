"""The projection angle in reports: tables 3.5 and 3.6, fringe breaks over the picture; and the budgets of a rig."""

import math

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from fringecal.calibration import Calibrated
from fringecal.projector import HEIGHTS_MM, OFF, AxisAngle, RigCalibration
from fringecal.report import AS_U, DOF, FigureItem, Section, Table, angle_plot, breaks_overlay, budget_bars
from fringecal.uncertainty import EXPANDED_BY, Influence
from fringecal.workflows.commission.angle_findings import AngleFindings
from fringecal.workflows.shared import RIM, budget_table, field_mm

Array = NDArray[np.float64]

_FIELD_MM = 100.0  # of a field's shorter side, from which on the heights that advice is given for suit it
CONVENTION = "angles from the plate's normal, in the plane across the local fringe"
_FORMATS = {
    "u / px": ".0f",
    "v / px": ".0f",
    "x / mm": ".1f",
    "y / mm": ".1f",
    "fringe breaks": "d",
    "fringe shift / px": "+z.3f",
    "fringe shift / mm": "+z.3f",
    "angle / deg": ".3f",
    "dof": DOF,
    "U / deg": AS_U,
    "apparent / deg": ".3f",
    "theory / deg": ".3f",
    "apparent in theory / deg": ".3f",
    "difference / deg": "+z.3f",
    "En": "+z.2f",
}
_UNCERTAINTIES = {"angle / deg": "u / deg", "theory / deg": "u(theory) / deg"}


def angle_section(found: AngleFindings) -> Section:
    """Give the projection angle over the field, from the fringe breaks at the strips, beside theory."""
    sentences = (
        "The projection angle is measured from the plate's normal, in the plane across the local fringe; the apparent "
        "angle is what a fringe break shows to the camera, the angle of the camera's own ray included.",
        *found.sentences,
    )
    tables, figures = [], []
    for rows, name, place in ((found.columns, "column", "x"), (found.rows, "row", "y")):
        if rows:
            line = f"on the line {'y' if place == 'x' else 'x'} = 0"
            compared = (
                "theory from the stated positions, En = difference / root sum of squares of both U"
                if found.theory
                else "no theory: no projector position is stated"
            )
            note = f"{line}; {CONVENTION}; {compared}; {EXPANDED_BY}"
            tables.append(Table(f"Projection angle by {name}", columns_frame(rows), note, _FORMATS, _UNCERTAINTIES))
            figures.append(_angle_figure(rows, f"Projection angle by {name}", f"{place} / mm"))
    if not tables:
        return Section("Projection angle", (*sentences, "No column of the picture crosses enough of a strip."))
    return Section("Projection angle", sentences, tuple(tables), tuple(figures))


def columns_frame(rows: tuple[AxisAngle, ...]) -> pd.DataFrame:
    """Tabulate columns or rows (the thesis's tables 3.5 and 3.6 side by side)."""
    place = ("u / px", "x / mm") if rows[0].axis == "u" else ("v / px", "y / mm")
    table = [
        {
            place[0]: c.place_px,
            place[1]: c.place_mm,
            "fringe breaks": c.breaks,
            "fringe shift / px": c.shift_px,
            "fringe shift / mm": c.shift_mm,
            "angle / deg": c.angle.value,
            "u / deg": c.angle.u,
            "dof": c.angle.dof,
            "U / deg": c.angle.expanded().U,
            "apparent / deg": c.apparent_deg,
            "theory / deg": c.theory.value if c.theory else None,
            "u(theory) / deg": c.theory.u if c.theory else None,
            "apparent in theory / deg": c.theory_apparent.value if c.theory_apparent else None,
            "difference / deg": c.difference_deg,
            "En": c.en,
        }
        for c in rows
    ]
    return pd.DataFrame(table).dropna(axis="columns", how="all")


def _angle_figure(rows: tuple[AxisAngle, ...], caption: str, label: str) -> FigureItem:
    theory = [(c.theory.value, c.theory.expanded().U) for c in rows if c.theory is not None]
    figure = angle_plot(
        np.array([c.place_mm for c in rows]),
        np.array([c.angle.value for c in rows]),
        np.array([c.angle.expanded().U for c in rows]),
        theory_deg=np.array(theory) if theory else None,
        apparent_deg=np.array([c.apparent_deg for c in rows]),
        position_label=label,
    )
    low, high = (f(c.angle.value for c in rows) for f in (min, max))
    also = "apparent and theory" if theory else "and apparent"
    alt = f"Projection angle against {label[0]}: from {low:.2f} to {high:.2f} deg, with 95 % bars, {also}."
    return FigureItem(caption, figure, alt)


def breaks_section(found: AngleFindings) -> Section:
    """Show every fringe break in the picture, and tabulate them by strip."""
    figure = breaks_overlay(found.picture, found.breaks, rows=found.along == "rows")
    used = int(np.count_nonzero(found.breaks.used))
    alt = f"The strips' picture with {used} fringe breaks: where each fringe is on the plate, and where on the strip."
    item = FigureItem("Fringe breaks in the picture", figure, alt, "png")
    return Section("Fringe breaks", (), (_by_strip(found),), (item,))


def _by_strip(found: AngleFindings) -> Table:
    """Tabulate the fringe breaks by strip: number, mean fringe shift, scatter of the angles."""
    frame = found.breaks_frame()
    good = frame[frame["status"] != OFF].groupby("strip")
    table = pd.DataFrame(
        {
            "fringe breaks": good.size(),
            "left out": frame["status"].eq(OFF).groupby(frame["strip"]).sum(),
            "mean fringe shift / px": good["shift_px"].mean(),
            "mean fringe shift / mm": good["shift_mm"].mean(),
            "u of one / px": good["sigma_px"].median(),
            "mean angle / deg": good["angle_deg"].mean(),
            "standard deviation / deg": good["angle_deg"].std(),
        }
    ).reset_index()
    formats = dict.fromkeys(table.columns[3:], ".3f")
    return Table("Fringe breaks by strip", table, f"all fringe breaks are in breaks.csv; {CONVENTION}", formats)


def budgets_section(result: Calibrated) -> Section:
    """Give the uncertainty budgets of angle, scale and heights."""
    angle = budget_table("Budget of the projection angle", result.origin.budget)
    scale = budget_table("Budget of the mean scale", result.camera.scale_budget)
    first = angle.frame.iloc[0]
    figure = budget_bars(
        list(angle.frame["source of uncertainty"]),
        list(angle.frame["share of the variance / %"]),
        title=f"projection angle at the origin, u = {result.origin.angle.u:.3f} deg",
    )
    alt = f"Bars: the largest share of the variance, {first.iloc[2]:.0f} %, is that of {first.iloc[0]}."
    heights = heights_table(result.rig, result.plate.noise_rad)
    item = FigureItem("Budget of the projection angle", figure, alt)
    return Section("Uncertainty budgets", (), (angle, scale, heights), (item,))


def heights_table(calibration: RigCalibration, noise_rad: float) -> Table:
    """Tabulate the predicted uncertainty of a height: by source, at centre and corner, for three heights.

    Parameters
    ----------
    calibration
        The rig.
    noise_rad
        Standard deviation of the phase of one pixel.
    """
    camera = calibration.camera
    places = {"centre": camera.centre_px, "corner": (RIM * camera.width_px, RIM * camera.height_px)}
    rows = []
    for height in _heights(calibration):
        for place, (u, v) in places.items():
            rows.append(
                {"height / mm": height, "place": place} | _height_budget(calibration, (u, v), height, noise_rad)
            )
    frame = pd.DataFrame(rows)
    formats = dict.fromkeys(frame.columns[2:], AS_U)
    return Table(
        "Predicted uncertainty of a height",
        frame,
        "standard uncertainty of one pixel's height in mm, by source",
        formats,
    )


def _heights(calibration: RigCalibration) -> tuple[float, ...]:
    """Heights that advice is given for, divided by ten until they suit the field."""
    x_min, x_max, y_min, y_max = field_mm(calibration)
    decade = min(0, math.floor(math.log10(min(x_max - x_min, y_max - y_min) / _FIELD_MM)))
    return tuple(height * 10.0**decade for height in HEIGHTS_MM)


def _height_budget(
    calibration: RigCalibration, pixel: tuple[float, float], height_mm: float, noise_rad: float
) -> dict[str, float]:
    """Contributions to u of one pixel's height by source, mm, and all of them together."""
    rays = calibration.camera.rays(*pixel)
    phase = calibration.model.phase(*rays.at(height_mm), height_mm)

    def height(rig: RigCalibration, more_rad: float = 0.0) -> float:
        return float(rig.model.height(phase + more_rad, rig.camera.rays(*pixel)))

    found = calibration.budget(height, unit="mm", label="height")
    single = math.hypot(noise_rad, calibration.excess_rad)
    scatter = abs(height(calibration, single) - found.result.value)
    sources = dict.fromkeys(component.source for component in calibration.components)
    parts = {source.text: found.contributions()[source] for source in sources}
    return {"combined": math.hypot(found.result.u, scatter)} | parts | {Influence.PIXEL_PHASE.text: scatter}
