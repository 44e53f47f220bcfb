"""The report of a verification on an artefact: its numbers beside the certificate, and distances from its form."""

from datetime import datetime

import numpy as np
import pandas as pd

from fringecal.records import DEFAULT_LIMITS, Limits, software_versions
from fringecal.report import DOF, Fact, FigureItem, Layer, Live, Report, Section, Table, Verdict, budget_bars, error_map
from fringecal.uncertainty import EXPANDED_BY
from fringecal.verification import Reading, readings_table
from fringecal.workflows.shared import (
    budget_table,
    height_item,
    inputs_of_capture,
    phase_section,
    readable_surface,
    severest,
    surface_item,
)
from fringecal.workflows.verify.artefacts import ArtefactVerification
from fringecal.workflows.verify.checks import artefact_checks
from fringecal.workflows.verify.volume_artefacts import VolumeVerification

_NOTE = (
    "error = measured - certified; u: standard uncertainty of rig and certificate, dof that of the rig's; "
    f"En = error / root sum of squares of both U; {EXPANDED_BY}. Form errors follow "
    "VDI/VDE 2634-2 (range, 3 per mille of the points left out) and ISO 10360-13 (width holding 95 %), without a claim "
    "of conformity; they contain the noise and grow with the number of points"
)


def artefact_report(
    found: ArtefactVerification,
    *,
    command: str = "",
    created: datetime | None = None,
    limits: Limits = DEFAULT_LIMITS,
) -> Report:
    """Return the report of a verification on an artefact.

    Parameters
    ----------
    found
        What the verification has found.
    command, created, limits
        As for `commission_report`.
    """
    return Report(
        title=f"Verification on {found.target.name}",
        subtitle=f"Capture {found.capture.name}; certificate: {found.target.certificate}",
        verdict=Verdict(severest(artefact_checks(found, limits)), found.sentence),
        facts=tuple(reading_fact(reading) for reading in found.readings),
        sections=(
            numbers_section(found),
            *budget_sections(found),
            artefact_surface_section(found),
            phase_section((found.phase,)),
        ),
        inputs=inputs_of_capture(found.capture),
        versions=software_versions(),
        command=command,
        created=created,
    )


def reading_fact(reading: Reading) -> Fact:
    """Return a number for the report's head."""
    unit = "" if reading.unit == "1" else f" {reading.unit}"
    note = "not certified" if reading.error is None else f"error {reading.error:+.4f}{unit}"
    return Fact(reading.name[0].upper() + reading.name[1:], f"{reading.measured:.4f}{unit}", note)


def numbers_section(found: ArtefactVerification | VolumeVerification) -> Section:
    """Tabulate every number of the artefact beside its certificate."""
    formats = {
        "measured": ".4f",
        "reference": ".4f",
        "error": "+z.4f",
        "en": "+z.2f",
        "dof": DOF,
    }
    names = {"u_measured": "u(measured)", "u_reference": "u(certificate)", "reference": "certified", "en": "En"}
    frame = readings_table(found.readings)
    frame.columns = pd.Index([names.get(name, name) for name in frame.columns])
    uncertainties = {"measured": "u(measured)", "certified": "u(certificate)", "error": "u(measured)"}
    table = Table(
        "Numbers", frame, _NOTE, {names.get(name, name): form for name, form in formats.items()}, uncertainties
    )
    return Section(
        "Errors", (found.sentence, *(f"{note[0].upper()}{note[1:]}." for note in found.probe.notes)), (table,)
    )


def budget_sections(found: ArtefactVerification | VolumeVerification) -> tuple[Section, ...]:
    """Show the uncertainty budget of the largest certified number."""
    judged = [r for r in found.readings if r.u_measured and r.reference is not None]
    if not judged:
        return ()
    reading = max(judged, key=lambda r: abs(r.reference or 0.0))
    assert reading.budget is not None
    percents = {source.text: percent for source, percent in reading.budget.percents().items()}
    figure = budget_bars(list(percents), list(percents.values()), title=reading.name)
    alt = f"Bars of the shares of the variance of {reading.name}; the largest is {next(iter(percents))}."
    table = budget_table(f"Budget of {reading.name}", reading.budget)
    return (Section("Uncertainty", (), (table,), (FigureItem(f"Budget of {reading.name}", figure, alt),)),)


def artefact_surface_section(found: ArtefactVerification) -> Section:
    """Show the distances from the fitted form, the heights, and the surface as a view that can be turned."""
    surface, probe = found.surface, found.probe
    cloud = np.stack([surface.x, surface.y, surface.z], axis=-1).reshape(-1, 3)
    residual = np.full(surface.z.size, np.nan)
    for group, off in zip(probe.groups, probe.residuals([cloud[g] for g in probe.groups]), strict=True):
        residual[group] = off
    rms = float(np.sqrt(np.nanmean(residual**2)))
    seen = f"{100 * float(np.mean(surface.mask)):.1f} % of the picture has a height"
    distance = residual.reshape(surface.z.shape)
    values = readable_surface(surface, Layer("distance from the form", "mm", distance, 4))
    figures = (
        FigureItem(
            "Distance from the fitted form",
            error_map(surface.x, surface.y, distance),
            f"Map of the distances of {int(np.isfinite(residual).sum())} points from the form: {rms:.4f} mm rms.",
            "png",
            Live(values),
        ),
        height_item("Height", surface, values, f"Height map, y up; {seen}."),
        surface_item("In three dimensions", surface, values, f"Oblique view of {found.target.name} on the plate."),
    )
    return Section("Surface", (f"{seen}.",), (), figures)
