"""The report of a commissioning: verdict and headline numbers, camera, angle, rig, budgets, artefacts, phase."""

import math
from datetime import datetime

from fringecal.projector import fringe_pitch_mm
from fringecal.records import DEFAULT_LIMITS, Check, Limits, software_versions
from fringecal.report import Fact, InputFile, Report, Section, Verdict
from fringecal.uncertainty import Estimate
from fringecal.workflows.commission.advice_section import advice_section
from fringecal.workflows.commission.angle_findings import angles_of
from fringecal.workflows.commission.angle_tables import angle_section, budgets_section
from fringecal.workflows.commission.artefact_sections import repeats_section, verified_sections
from fringecal.workflows.commission.camera_section import camera_sections, largest_scale_error_percent
from fringecal.workflows.commission.checks import commissioning_checks
from fringecal.workflows.commission.residual_section import residual_maps
from fringecal.workflows.commission.rig_section import rig_section, strips_section
from fringecal.workflows.commission.run import Commissioning
from fringecal.workflows.grid import distortion_size
from fringecal.workflows.lens import lens_section
from fringecal.workflows.shared import checks_table, concise, doctor_section, inputs_of_capture, phase_section, severest


def commission_report(
    found: Commissioning,
    *,
    command: str = "",
    created: datetime | None = None,
    limits: Limits = DEFAULT_LIMITS,
    history: Section | None = None,
) -> Report:
    """Return the report of a commissioning.

    Parameters
    ----------
    found
        What commissioning has found.
    command
        Command line that made it.
    created
        Time of writing, with its zone.
    limits
        The laboratory's limits.
    history
        What the rig's history says beside this calibration (`fringecal.workflows.history.report.history_section`).
    """
    checks = commissioning_checks(found, limits)
    residuals = residual_maps(found)
    return Report(
        title=f"Commissioning of {found.session.rig}",
        subtitle=_subtitle(found),
        verdict=Verdict(severest(checks), _sentence(found, checks)),
        facts=_facts(found),
        sections=(
            Section("Checks", (), (checks_table(checks),)),
            *camera_sections(found.camera),
            *_lens(found),
            angle_section(angles_of(found)),
            rig_section(found, residuals),
            strips_section(found, residuals),
            budgets_section(found),
            advice_section(found),
            *verified_sections(found.verified),
            phase_section((found.reference, found.strips_capture)),
            *repeats_section(found.repeats),
            doctor_section(found.examined),
            *((history,) if history else ()),
        ),
        inputs=_inputs(found),
        versions=software_versions(),
        command=command,
        created=created,
    )


def _lens(found: Commissioning) -> tuple[Section, ...]:
    """Show the lens where the session states one or holds board pictures."""
    known = found.camera.lens
    return () if known is None else (lens_section(known, found.calibration.camera["height_mm"]),)


def _subtitle(found: Commissioning) -> str:
    session = found.session
    parts = [f"Captured {session.captured:%Y-%m-%d %H:%M}"]
    if session.operator:
        parts.append(f"by {session.operator}")
    if session.temperature_degC is not None:
        parts.append(f"at {session.temperature_degC:g} °C")
    return " ".join(parts)


def _sentence(found: Commissioning, checks: tuple[Check, ...]) -> str:
    """Defend the decision: what failed by name, or what holds."""
    failed = [check.name for check in checks if check.decision in ("fail", "conditionalFail")]
    residual = (
        f"One rig model explains plate and strips to {found.fit.rms_rad:.3f} rad; the strips' fringe order was decided."
    )
    head = f"Not within its limit: {', '.join(failed)}." if failed else residual
    return " ".join((head, found.angle_sentence, *found.verified.sentences))


def _facts(found: Commissioning) -> tuple[Fact, ...]:
    camera, lens = found.calibration.camera, found.camera.distortion
    pitch, _ = found.calibration.estimate(lambda c: float(fringe_pitch_mm(c.model)), unit="mm", label="pitch")
    facts = [
        Fact("Mean scale", concise(found.camera.scales["mean"]), "at the image centre"),
        Fact("Projection angle", concise(found.angle), "from the plate's normal, across the local fringe"),
        Fact("Fringe pitch", concise(pitch), "on the plate, at the origin"),
    ]
    if found.theory is not None:
        facts.insert(2, Fact("Angle in theory", concise(found.theory), "from the stated positions"))
    if not camera.telecentric:
        height = Estimate(camera["height_mm"], math.sqrt(camera.covariance[-1, -1]), "mm")
        facts.append(
            Fact("Camera height", concise(height), f"entrance pupil above the plate, {found.camera.height_origin}")
        )
    largest = f"{largest_scale_error_percent(found.camera):.2g} %"
    return (
        *facts,
        Fact("Plate residual", f"{found.fit.plate_rms_rad:.4f} rad", "rms"),
        Fact("Lens distortion", lens.verdict, distortion_size(lens)),
        Fact("Mean scale alone errs by", largest, "at most, over the field"),
    )


def _inputs(found: Commissioning) -> tuple[InputFile, ...]:
    """List every file of the session that is not a picture, then the pictures that were used."""
    verified = (*(one.capture for one in found.verified.bars), *(one.capture for one in found.verified.artefacts))
    used = dict.fromkeys(
        capture.name
        for capture in (
            found.camera.capture,
            found.reference.capture,
            found.strips_capture.capture,
            *verified,
        )
    )
    pictures = {path for capture in found.session.captures.values() for path in capture.paths}
    others = tuple(
        InputFile("session", name, digest)
        for name, digest in found.session.inputs.items()
        if found.session.folder / name not in pictures
    )
    return (*others, *(file for name in used for file in inputs_of_capture(found.session.captures[name])))
