"""The report of an artefact that was measured in the volume of a rig with a board's calibration."""

from datetime import datetime

import numpy as np

from fringecal.records import DEFAULT_LIMITS, Limits, software_versions
from fringecal.report import FigureItem, Report, Section, Verdict, picture_map
from fringecal.workflows.shared import inputs_of_capture, severest
from fringecal.workflows.verify.checks import artefact_checks
from fringecal.workflows.verify.report_artefact import budget_sections, numbers_section, reading_fact
from fringecal.workflows.verify.volume_artefacts import VolumeVerification


def volume_verification_report(
    found: VolumeVerification, *, command: str = "", created: datetime | None = None, limits: Limits = DEFAULT_LIMITS
) -> Report:
    """Return the report of an artefact measured in the volume.

    Parameters
    ----------
    found
        What the verification has found.
    command, created, limits
        As for `artefact_report`.
    """
    return Report(
        title=f"Verification on {found.target.name}",
        subtitle=f"Capture {found.capture.name}; certificate: {found.target.certificate}",
        verdict=Verdict(severest(artefact_checks(found, limits)), found.sentence),
        facts=tuple(reading_fact(reading) for reading in found.readings),
        sections=(numbers_section(found), *budget_sections(found), _points_section(found)),
        inputs=inputs_of_capture(found.capture),
        versions=software_versions(),
        command=command,
        created=created,
    )


def _points_section(found: VolumeVerification) -> Section:
    """Show the distances from the fitted form, and how far each point of the picture is from the camera."""
    off, name = found.residual_mm, found.capture.name
    rms = float(np.sqrt(np.nanmean(off**2)))
    depth = np.where(found.seen.volume.mask, found.seen.volume.z, np.nan)
    figures = (
        FigureItem(
            "Distance from the fitted form",
            picture_map(off, "distance / mm", title=name),
            f"Map of the distances of {int(np.isfinite(off).sum())} points from the form: {rms:.4f} mm rms.",
            "png",
        ),
        FigureItem(
            "Depth", picture_map(depth, "z / mm", title=name), f"Distance of {name} along the camera's axis.", "png"
        ),
    )
    return Section("Points", (found.how,), (), figures)
