"""The report of the projection angle from fringe breaks at strips."""

from datetime import datetime

from fringecal.records import software_versions
from fringecal.report import Decision, Fact, FigureItem, Report, Section, Table, Verdict, angle_field
from fringecal.workflows.commission import (
    CONVENTION,
    AngleFindings,
    angle_map,
    angle_section,
    breaks_section,
    strips_captures,
)
from fringecal.workflows.shared import budget_table, concise, field_mm, inputs_of_capture, rig_figure


def angle_report(found: AngleFindings, *, command: str = "", created: datetime | None = None) -> Report:
    """Return the report of `fringecal angle`.

    Parameters
    ----------
    found
        The angle and all that it rests on.
    command, created
        As for `commission_report`.
    """
    moved = found.displacement
    decision: Decision = "info" if moved is None else "pass" if moved.agrees else "conditionalFail"
    facts = [
        Fact("Projection angle", concise(found.angle), "at the plate's origin, from the normal"),
        Fact(
            "Apparent angle",
            concise(found.apparent),
            "there, the camera's own ray included",
        ),
    ]
    if found.theory is not None:
        facts.append(Fact("Angle in theory", concise(found.theory), "from the stated positions"))
    captures = [found.session.one("grid"), strips_captures(found.session)[0]]
    return Report(
        title=f"Projection angle of {found.session.rig}",
        subtitle=f"Captured {found.session.captured:%Y-%m-%d %H:%M}; {found.estimator} estimator",
        verdict=Verdict(decision, found.sentences[-1]),
        facts=tuple(facts),
        sections=(angle_section(found), breaks_section(found), _rig_section(found)),
        inputs=tuple(file for capture in captures for file in inputs_of_capture(capture)),
        versions=software_versions(),
        command=command,
        created=created,
    )


def _rig_section(found: AngleFindings) -> Section:
    """Draw the rig to scale, stated and measured, and the angle over the field."""
    field = angle_map(found.calibration)
    formats = dict.fromkeys(("x_mm", "y_mm"), ".1f") | {"apparent_deg": ".3f"}
    table = Table("Projection angle over the field", field, CONVENTION, formats, {"angle_deg": "u_deg"})
    figure = angle_field(found.calibration, field_mm(found.calibration), found.breaks)
    low, high = field["angle_deg"].min(), field["angle_deg"].max()
    alt = f"Lines of equal projection angle over the plate, {low:.1f} to {high:.1f} deg, and the fringe breaks."
    item = FigureItem("Projection angle over the field", figure, alt)
    budget = budget_table("Budget of the projection angle", found.budget)
    return Section(
        "Rig", (found.sentences[-1],), (table, budget), (item, *rig_figure(found.session, found.calibration))
    )
