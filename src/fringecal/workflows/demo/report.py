"""The report of the demonstration: measured against true against thesis first, then the pictures."""

from collections.abc import Sequence
from datetime import datetime

import numpy as np
import pandas as pd

from fringecal.records import software_versions
from fringecal.report import (
    Fact,
    FigureItem,
    Report,
    Section,
    Table,
    Verdict,
    comparison_bars,
    phase_overview,
    profile_plot,
)
from fringecal.thesis import AnalyticCase
from fringecal.workflows.demo.analytic_section import analytic_section
from fringecal.workflows.demo.run import THESIS, Demonstration, RealCapture
from fringecal.workflows.shared import height_item, readable_surface, surface_item

_REPORTS = "The full reports lie beside this one: calibration/report.html, verification/report.html, leaf/report.html."


def demonstration_report(
    found: Demonstration,
    table: pd.DataFrame,
    real: Sequence[RealCapture] = (),
    analytic: Sequence[AnalyticCase] = (),
    *,
    command: str = "",
    created: datetime | None = None,
) -> Report:
    """Return the demonstration as a report.

    Parameters
    ----------
    found
        What was measured on the virtual rig.
    table
        The result table.
    real
        Phase maps of real captures.
    analytic
        Objects drawn by formula and read back.
    """
    angle = found.commissioning.calibrated.result.origin.angle
    return Report(
        title="The thesis's rig, measured",
        subtitle="A virtual rig with the thesis's scale, angle and camera: commissioned, verified on angle bars, used.",
        verdict=_verdict(found),
        facts=(
            Fact("Mean scale", f"{found.commissioning.calibrated.result.camera.scales['mean'].value:.5f} mm/px"),
            Fact("Projection angle", f"{angle.value:.3f} deg", "from the plate's normal, at the origin"),
            Fact("Thesis's height error", f"{THESIS['height_error']} %", "mean of the maximum errors"),
        ),
        sections=(_result(table), _bars(found), _leaf(found), *_real(real), *_analytic(analytic)),
        versions=software_versions(),
        command=command,
        created=created,
    )


def _verdict(found: Demonstration) -> Verdict:
    errors = found.verification.errors
    mean_of_max = np.mean([p.max_percent for p in errors.profiles])
    sentence = (
        f"Largest height errors on the zig-zag average {mean_of_max:.2f} % of its full height where the thesis had "
        f"{THESIS['height_error']} %: its one angle for diverging light explains the difference."
    )
    return Verdict("info", sentence)


def _result(table: pd.DataFrame) -> Section:
    note = "u is a standard uncertainty; angles are measured from the plate's normal; percent of the full height."
    formats = dict.fromkeys(("measured", "true"), ".4f") | {"thesis 2008": ".3g"}
    shown = Table("Measured against true against thesis", table, note, formats, {"measured": "u", "true": "u"})
    return Section("Measured, true, thesis", (_REPORTS,), (shown,))


def _bars(found: Demonstration) -> Section:
    errors = found.verification.errors
    curve = errors.curves[len(errors.curves) // 2]
    models = found.verification.models
    pooled = [models[name].pooled for name in models]
    profile = profile_plot(
        curve.across_mm,
        curve.measured_mm,
        curve.reference_mm,
        curve.u_mm,
        left_out=curve.edge,
        position_label="across the ridges / mm",
        title=f"Angle bars, profile {curve.name}",
    )
    bars = comparison_bars(
        list(models),
        [p.mean_percent for p in pooled],
        [100 * p.sd_mm / errors.full_height_mm for p in pooled],
        [p.max_percent for p in pooled],
        title="Height models on the same pictures",
    )
    return Section(
        "Angle bars",
        (errors.sentence,),
        figures=(
            FigureItem("Measured and reference height", profile, "profile across the bars with its error below"),
            FigureItem("One constant angle against the rig model", bars, "errors of three height models as bars"),
        ),
    )


def _leaf(found: Demonstration) -> Section:
    surface = found.leaf.surface
    values = readable_surface(surface)
    return Section(
        "Leaf",
        figures=(
            height_item("Height of the leaf", surface, values, "map of heights of a pleated leaf"),
            surface_item("The leaf as a surface", surface, values, "surface of a pleated leaf seen from the side"),
        ),
    )


def _real(real: Sequence[RealCapture]) -> tuple[Section, ...]:
    if not real:
        return ()
    sentences = tuple(
        f"{c.name}: {c.where} period {c.period.period_px:.1f} px, phase rises toward {c.period.direction_deg:z.0f} deg "
        f"(from +u toward +v). {c.phase.sentence()}"
        for c in real
    )
    figures = tuple(
        FigureItem(
            f"Phase of {c.name}",
            phase_overview(c.phase.map, title=c.name),
            f"wrapped phase, modulation, uncertainty and mask of {c.name}",
            "png",
        )
        for c in real
    )
    return (Section("Real captures", sentences, figures=figures),)


def _analytic(cases: Sequence[AnalyticCase]) -> tuple[Section, ...]:
    return (analytic_section(cases),) if cases else ()
