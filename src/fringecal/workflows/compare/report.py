"""The report of two calibrations beside each other: quantities that agree or differ, and both rigs drawn to scale."""

import math
from collections.abc import Sequence
from datetime import datetime

import numpy as np
import pandas as pd

from fringecal.projector import ProjectorPosition, projector_estimates
from fringecal.records import CalibrationRecord, software_versions
from fringecal.report import (
    Decision,
    Fact,
    FigureItem,
    Pupil,
    Report,
    Section,
    Table,
    Verdict,
    change_bars,
    rig_drawing,
)
from fringecal.uncertainty import EXPANDED_BY, Influence, uncertainty_text, value_text
from fringecal.workflows.compare.run import Compared, compare_calibrations, shared_influences
from fringecal.workflows.shared import calibration_of, field_mm

_NOTE = f"{EXPANDED_BY}; U(difference) leaves out the sources that both share; En = difference / U(difference)"
_HEIGHTS = "Heights are what the second calibration reads where the first one reads the round value."


def comparison_report(
    first: CalibrationRecord, second: CalibrationRecord, *, created: datetime | None = None
) -> Report:
    """Return the report of two calibrations of one rig.

    Parameters
    ----------
    first, second
        Their records; differences are second minus first.
    created
        Time of writing, with its zone.

    Raises
    ------
    RecordError
        The records are not of one rig and one size of picture.
    """
    compared = compare_calibrations(first, second)
    return Report(
        title=f"Two calibrations of {first.session.rig}",
        subtitle=f"First: {_named(first)}; second: {_named(second)}",
        verdict=_verdict(compared),
        facts=_facts(compared),
        sections=(_differences(compared, shared_influences(first, second)), _rigs(first, second)),
        versions=software_versions(),
        created=created,
    )


def _named(record: CalibrationRecord) -> str:
    when = record.session.captured or record.created
    by = f", {record.session.operator}" if record.session.operator else ""
    return f"{when:%Y-%m-%d %H:%M}{by}"


def _verdict(compared: Sequence[Compared]) -> Verdict:
    apart = sorted((c for c in compared if not c.agrees), key=lambda c: -abs(c.en))
    if not apart:
        return Verdict("pass", f"The two calibrations agree in all {len(compared)} quantities, |En| <= 1.")
    named = ", ".join(f"{c.name} (En {c.en:+.2g})" for c in apart)
    return Verdict("fail", f"The two calibrations differ in {len(apart)} of {len(compared)} quantities: {named}.")


def _facts(compared: Sequence[Compared]) -> tuple[Fact, ...]:
    """Lead with the quantity that differs most, and the height that does."""
    heights = [c for c in compared if c.name.startswith("height")]
    chosen = dict.fromkeys(max(group, key=lambda c: abs(c.en)) for group in (compared, heights) if group)
    return tuple(
        Fact(
            f"Change of {c.name}",
            f"{value_text(c.difference.value, c.difference.expanded().U, sign=True)} {c.difference.unit}",
            f"U {uncertainty_text(c.difference.expanded().U)}, En {c.en:+.2f}",
        )
        for c in chosen
    )


def _differences(compared: Sequence[Compared], shared: Sequence[Influence]) -> Section:
    frame = pd.DataFrame(
        {
            "quantity": [c.name for c in compared],
            "first": [c.first.value for c in compared],
            "U(first)": [c.first.expanded().U for c in compared],
            "second": [c.second.value for c in compared],
            "U(second)": [c.second.expanded().U for c in compared],
            "difference": [c.difference.value for c in compared],
            "U(difference)": [c.difference.expanded().U for c in compared],
            "En": [c.en for c in compared],
            "unit": [c.difference.unit for c in compared],
            "verdict": [_decision(c) for c in compared],
        }
    )
    formats = dict.fromkeys(("first", "second"), "#.6g") | {"difference": "+.2g", "En": "+z.2f"}
    uncertainties = {name: f"U({name})" for name in ("first", "second", "difference")}
    chart = change_bars(
        [c.name for c in compared],
        [c.en for c in compared],
        np.zeros(len(compared)).tolist(),
        label="En = difference / U(difference); shaded: the calibrations agree",
    )
    alt = f"Bars of En by quantity; {sum(c.agrees for c in compared)} of {len(compared)} lie between -1 and 1."
    return Section(
        "Differences",
        (
            _shared_sentence(shared),
            _HEIGHTS,
            "Of quantities that have not changed, one in twenty lies beyond |En| = 1 by chance.",
        ),
        (Table("Two calibrations compared", frame, _NOTE, formats, uncertainties),),
        (FigureItem("En by quantity", chart, alt),),
    )


def _decision(compared: Compared) -> Decision:
    return "pass" if compared.agrees else "fail"


def _shared_sentence(shared: Sequence[Influence]) -> str:
    if not shared:
        return "No artefact is the same in both: all uncertainties count as independent."
    named = " and ".join(influence.text for influence in shared)
    return (
        f"Both were made with the same artefacts, so that {named} cannot explain a difference; all "
        "other sources count as independent."
    )


def _rigs(*records: CalibrationRecord) -> Section:
    drawn = [_drawing(record, which) for which, record in zip(("first", "second"), records, strict=True)]
    lost = ("A projector with parallel light has no position that could be drawn.",) if None in drawn else ()
    return Section("The rig", lost, (), tuple(item for item in drawn if item is not None), side_by_side=True)


def _drawing(record: CalibrationRecord, which: str) -> FigureItem | None:
    """Draw the rig of a record to scale, with the projector where its session stated it."""
    calibration, stated = calibration_of(record), _stated(record)
    place = projector_estimates(calibration, stated)
    if not place:
        return None
    camera, eye = calibration.camera, None
    if not camera.telecentric:
        eye = Pupil("camera", camera.position_mm, np.array([0.0, 0.0, math.sqrt(camera.covariance[-1, -1])]))
    position = np.array([e.value for e in place])
    figure = rig_drawing(
        field_mm(calibration),
        Pupil("projector, fitted", position, np.array([e.u for e in place])),
        eye,
        stated_projector=None if stated is None else Pupil("projector, stated", stated.value_mm, stated.u_mm),
        title=_named(record),
    )
    where = ", ".join(f"{value:.0f}" for value in position)
    return FigureItem(f"The rig, {which} calibration", figure, f"Side view and plan: projector at ({where}) mm.")


def _stated(record: CalibrationRecord) -> ProjectorPosition | None:
    theory = record.projection.theory
    if theory is None:
        return None
    return ProjectorPosition(np.array(theory.projector_position_mm.value), np.array(theory.projector_position_mm.u))
