"""The report of a commissioning: verdict and headline numbers, camera, angle, rig, budgets, artefacts, phase."""

import math
from datetime import datetime

from fringecal.calibration import Calibrated
from fringecal.projector import fringe_pitch_mm
from fringecal.records import DEFAULT_LIMITS, Check, Limits, software_versions
from fringecal.report import Fact, InputFile, Report, Section, Verdict
from fringecal.session import Session
from fringecal.uncertainty import Estimate
from fringecal.workflows.commission.advice_section import advice_section
from fringecal.workflows.commission.angle_tables import angle_section, budgets_section
from fringecal.workflows.commission.artefact_sections import repeats_section, verified_sections
from fringecal.workflows.commission.camera_section import camera_sections, largest_scale_error_percent
from fringecal.workflows.commission.checks import commissioning_checks
from fringecal.workflows.commission.residual_section import residual_maps
from fringecal.workflows.commission.rig_section import rig_section, strips_section
from fringecal.workflows.commission.run import Commissioning
from fringecal.workflows.commission.testability import unseen_sentence
from fringecal.workflows.commission.unseen_table import unseen_tables
from fringecal.workflows.grid import distortion_size
from fringecal.workflows.lens import lens_section
from fringecal.workflows.shared import (
    checks_table,
    concise,
    findings_section,
    inputs_of_capture,
    phase_section,
    severest,
)


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
    calibrated = found.calibrated
    session, result = calibrated.session, calibrated.result
    checks = commissioning_checks(found, limits)
    residuals = residual_maps(result)
    return Report(
        title=f"Commissioning of {session.rig}",
        subtitle=_subtitle(session),
        verdict=Verdict(severest(checks), _sentence(found, checks)),
        facts=_facts(result),
        sections=(
            Section("Checks", (), (checks_table(checks), *unseen_tables(found, limits))),
            *camera_sections(result.camera, session.one("grid")),
            *_lens(result),
            angle_section(found.angles),
            rig_section(calibrated, residuals),
            strips_section(calibrated, residuals),
            budgets_section(result),
            advice_section(found),
            *verified_sections(found.verified),
            phase_section((calibrated.reference, calibrated.strips)),
            *repeats_section(found.repeats),
            findings_section(found.diagnosed),
            *((history,) if history else ()),
        ),
        inputs=_inputs(found),
        versions=software_versions(),
        command=command,
        created=created,
    )


def _lens(result: Calibrated) -> tuple[Section, ...]:
    """Show the lens where the session states one or holds board pictures."""
    known = result.camera.lens
    return () if known is None else (lens_section(known, result.rig.camera["height_mm"]),)


def _subtitle(session: Session) -> str:
    parts = [f"Captured {session.captured:%Y-%m-%d %H:%M}"]
    if session.operator:
        parts.append(f"by {session.operator}")
    if session.temperature_degC is not None:
        parts.append(f"at {session.temperature_degC:g} °C")
    return " ".join(parts)


def _sentence(found: Commissioning, checks: tuple[Check, ...]) -> str:
    """Give the reason of the decision: the checks that failed by name, or the residual."""
    result = found.calibrated.result
    failed = [check.name for check in checks if check.decision in ("fail", "conditionalFail")]
    rms = f"{result.fit.rms_rad:.3f} rad"
    residual = f"One rig model fits plate and strips to {rms} rms; the strips' fringe order was decided."
    head = f"Not within its limit: {', '.join(failed)}." if failed else residual
    unseen = unseen_sentence(checks)
    return " ".join((*((unseen,) if unseen else ()), head, result.origin.sentence, *found.verified.sentences))


def _facts(found: Calibrated) -> tuple[Fact, ...]:
    camera, lens = found.rig.camera, found.camera.distortion
    pitch = found.rig.budget(lambda c: float(fringe_pitch_mm(c.model)), unit="mm", label="pitch").result
    facts = [
        Fact("Mean scale", concise(found.camera.scales["mean"]), "at the image centre"),
        Fact("Projection angle", concise(found.origin.angle), "from the plate's normal, across the local fringe"),
        Fact("Fringe pitch", concise(pitch), "on the plate, at the origin"),
    ]
    if found.origin.theory is not None:
        facts.insert(2, Fact("Angle in theory", concise(found.origin.theory), "from the stated positions"))
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
        Fact("Largest error of the mean scale", largest, "of a short distance, over the field"),
    )


def _inputs(found: Commissioning) -> tuple[InputFile, ...]:
    """List every file of the session that is not a picture, then the pictures that were used."""
    session = found.calibrated.session
    verified = (*(one.capture for one in found.verified.bars), *(one.capture for one in found.verified.artefacts))
    used = dict.fromkeys(
        capture.name
        for capture in (
            session.one("grid"),
            found.calibrated.reference.capture,
            found.calibrated.strips.capture,
            *verified,
        )
    )
    pictures = {path for capture in session.captures.values() for path in capture.paths}
    others = tuple(
        InputFile("session", name, digest)
        for name, digest in session.inputs.items()
        if session.folder / name not in pictures
    )
    return (*others, *(file for name in used for file in inputs_of_capture(session.captures[name])))
