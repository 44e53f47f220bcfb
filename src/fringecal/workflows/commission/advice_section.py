"""The predicted uncertainty of heights in a report, and what to measure next."""

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from fringecal.calibration import Calibrated
from fringecal.projector import Advice
from fringecal.report import (
    AS_U,
    FigureItem,
    Layer,
    Live,
    ReadableMap,
    Section,
    Table,
    field_uncertainty,
    forecast_bars,
    gain_lines,
)
from fringecal.workflows.commission.run import Commissioning
from fringecal.workflows.shared import assumption_sentences

Array = NDArray[np.float64]


def advice_section(found: Commissioning) -> Section:
    """Say how uncertain heights will be over the field, from which sources, and the gain by one more artefact."""
    advice, result = found.advice, found.calibrated.result
    tables = (_forecast_table(advice), _gain_table(advice), *_further_tables(result))
    sentences = (*advice.sentences, *assumption_sentences(result.rig), *result.contradictions)
    return Section("What to measure next", sentences, tables, _figures(advice))


def _forecast_table(advice: Advice) -> Table:
    rows = [
        {
            "height / mm": f.z_mm,
            "u over the field / mm": f.rms_mm,
            "least / mm": float(f.u_mm.min()),
            "largest / mm": float(f.u_mm.max()),
            **{f"{source.text} / mm": value for source, value in f.contributions_mm().items()},
        }
        for f in advice.forecasts
    ]
    frame = pd.DataFrame(rows)
    note = "standard uncertainty, root mean square over the field, then by source; noise of single pixels left out"
    return Table("Predicted height uncertainty by source", frame, note, dict.fromkeys(frame.columns[1:], AS_U))


def _gain_table(advice: Advice) -> Table:
    rows = []
    for gain in advice.gains:
        row: dict[str, object] = {"one more artefact": gain.proposal.name, "its u / mm": gain.proposal.u_mm}
        for z, after in gain.after_mm.items():
            row |= {f"u({z:g} mm) / mm": after, f"times u now, {z:g} mm": gain.ratio(z)}
        rows.append(row)
    frame = pd.DataFrame(rows)
    note = "predicted by the joint fit with the artefact added; the best first"
    return Table("Gain by one more artefact", frame, note, dict.fromkeys(frame.columns[1:], AS_U))


def _further_tables(result: Calibrated) -> tuple[Table, ...]:
    """Tabulate the artefacts beside plate and strips that took part in the fit."""
    rows = []
    for artefact in result.standards:
        seen, place = artefact.seen.observations, artefact.seen.place
        for height, pixels in () if seen is None else zip(seen.height_mm, seen.u_px, strict=True):
            where = (place.x_mm, place.y_mm) if place is not None else (None, None)
            row = {"capture": artefact.name, "height / mm": height.value, "u / mm": height.u}
            rows.append(row | {"points": pixels.size, "x / mm": where[0], "y / mm": where[1]})
    if not rows:
        return ()
    frame = pd.DataFrame(rows).dropna(axis="columns", how="all")
    return (Table("Further artefacts in the fit", frame, "place of the artefact's centre", {"u / mm": AS_U}),)


def _figures(advice: Advice) -> tuple[FigureItem, ...]:
    causes = {f.z_mm: {s.text: u for s, u in f.contributions_mm().items()} for f in advice.forecasts}
    middle = advice.forecasts[len(advice.forecasts) // 2]
    field = field_uncertainty(middle.u_px, middle.v_px, middle.u_mm, title=f"height of {middle.z_mm:g} mm")
    live = Live(_readable(middle.u_px, middle.v_px, middle.u_mm))
    alt = f"Standard uncertainty, from {float(middle.u_mm.min()):.2g} to {float(middle.u_mm.max()):.2g} mm."
    items = (
        FigureItem("Sources of height uncertainty", forecast_bars(causes), advice.sentences[len(causes) // 2]),
        FigureItem("Height uncertainty over the field", field, alt, "png", live),
    )
    if not advice.gains:
        return items
    heights = list(advice.gains[0].before_mm)
    figure = gain_lines(
        [g.proposal.name for g in advice.gains],
        heights,
        list(advice.gains[0].before_mm.values()),
        [list(g.after_mm.values()) for g in advice.gains],
    )
    return (*items, FigureItem("Gain by one more artefact", figure, advice.sentences[-1]))


def _readable(u_px: Array, v_px: Array, u_mm: Array) -> ReadableMap:
    """Take the forecast's pixels as they are: on a regular grid, but for rounding to whole pixels."""
    start = (float(u_px[0, 0]), float(v_px[0, 0]))
    step = (float(np.ptp(u_px)) / (u_px.shape[1] - 1), float(np.ptp(v_px)) / (v_px.shape[0] - 1))
    return ReadableMap(("u", "v"), "px", start, step, (Layer("u(z)", "mm", u_mm, 4),))
