"""Named checks of a commissioning: value, limit, rule and one of four outcomes."""

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

from fringecal.procedures.further import CONTRADICTS
from fringecal.projection.theory import LAMP_CHANCE
from fringecal.records.limits import DEFAULT_LIMITS, Limits
from fringecal.records.parts import Check
from fringecal.uncertainty.conformity import decide
from fringecal.uncertainty.estimates import Estimate
from fringecal.verify.readings import Reading

if TYPE_CHECKING:
    from fringecal.procedures.commission import Commissioning
    from fringecal.procedures.examination import Examination
    from fringecal.procedures.verification import Verification
    from fringecal.procedures.verified import Verified


def commissioning_checks(found: "Commissioning", limits: Limits = DEFAULT_LIMITS) -> tuple[Check, ...]:
    """Return the checks of a commissioning, with their decisions."""
    own = limits.commission
    plate = rms_estimate(found.fit.plate_rms_rad, found.observations.phase_rad[0].size, "rad")
    grid = rms_estimate(found.camera.fit.rms_px, found.camera.fit.dof, "px")
    checks = [
        _below("plate phase residual", plate, own.plate_residual_rad, limits.level),
        _below("grid residual", grid, own.grid_residual_px, limits.level),
        # Heights hang on the angle that the camera sees; where a tilted camera stands changes only the other.
        _below(
            "standard uncertainty of the apparent projection angle",
            Estimate(found.apparent.u, found.apparent.u / math.sqrt(2 * found.apparent.dof), "deg"),
            own.angle_u_deg,
            limits.level,
        ),
        Check(
            name="largest lens displacement",
            value=found.camera.distortion.max_px.value,
            u=found.camera.distortion.max_px.u,
            expanded=found.camera.distortion.max_px.expanded().U,
            unit="px",
            decision="info",
            rule=f"verdict {found.camera.distortion.verdict}; corrected by the camera model",
        ),
    ]
    stated = found.session.camera.height_mm
    if found.camera.height_seen is not None and stated is not None:
        checks.append(pitch_check(found.camera.height_seen, stated.estimate("camera height", "mm"), most=own.height_en))
    if found.camera.assumed_height is not None:
        assumed = found.camera.assumed_height
        rule = "not stated: a usual lens is assumed, within 60 %; state camera.height_mm"
        checks.append(
            Check(
                name="camera height",
                value=assumed.value,
                u=assumed.u,
                expanded=assumed.expanded().U,
                unit="mm",
                decision="conditionalPass",
                rule=rule,
            )
        )
    if found.angle_en is not None:
        checks.append(
            Check(
                name="angle against theory",
                value=found.angle_en,
                limit=own.angle_en,
                decision="pass" if abs(found.angle_en) <= own.angle_en else "fail",
                rule=f"|En| <= {own.angle_en:g}, En = difference over the root sum of squares of both expanded "
                "uncertainties (k = 2)",
            )
        )
    several = (*_repeats_checks(found, limits), *(_frames_check(one, limits) for one in found.examined))
    return (*checks, *_lamp_check(found), _heights_check(found), *several, *verified_checks(found.verified, limits))


def _repeats_checks(found: "Commissioning", limits: Limits) -> tuple[Check, ...]:
    """Judge noise and form of the plate where it was taken several times."""
    repeats = found.repeats
    if repeats is None:
        return ()
    return (
        _below("noise of repeats over its prediction", repeats.ratio, limits.commission.noise_ratio, limits.level),
        _below("plate form beyond the model, rms", repeats.form_mm, limits.commission.plate_form_mm, limits.level),
    )


def _frames_check(examined: "Examination", limits: Limits) -> Check:
    """Judge what the doctor found wrong with frames and the phase used is not corrected for."""
    left = [finding for finding in examined.findings if finding.name not in examined.undone]
    cost = math.sqrt(sum((finding.cost_rad or 0.0) ** 2 for finding in left))
    limit = limits.commission.frames_rad
    named = ", ".join(dict.fromkeys(finding.name for finding in left)) or "nothing"
    return Check(
        name=f"frames of {examined.phase.capture.name}",
        value=cost,
        limit=limit,
        unit="rad",
        # A diagnosis from the frames alone proves no error of heights: at worst it is a condition.
        decision="pass" if cost <= limit else "conditionalFail",
        rule=f"rms error of the phase by what the doctor found and was not undone ({named}), at most the limit",
    )


def verified_checks(found: "Verified", limits: Limits = DEFAULT_LIMITS) -> tuple[Check, ...]:
    """Return the checks of all artefacts of a session, named by their captures.

    An artefact that was laid there to verify the rig and could not be measured is a check that failed.
    """
    bars = ((one.capture.name, verification_checks(one, limits)) for one in found.bars)
    others = ((one.capture.name, artefact_checks(one.readings, limits)) for one in found.artefacts)
    measured = tuple(
        check.model_copy(update={"name": f"{name}: {check.name}"})
        for name, checks in (*bars, *others)
        for check in checks
    )
    failed = (
        Check(name=f"{name}: measured", decision="fail", rule="the artefact can be measured; the notes say why not")
        for name, _ in found.failures
    )
    return (*measured, *failed)


def rms_estimate(rms: float, number: int, unit: str) -> Estimate:
    """Return an rms of independent residuals with its uncertainty, ``rms / sqrt(2 n)`` (JCGM 100:2008, E.4.3).

    Examples
    --------
    >>> rms_estimate(0.1, 50, "px").u
    0.01
    """
    return Estimate(rms, rms / math.sqrt(2 * max(number, 1)), unit)


def _lamp_check(found: "Commissioning") -> tuple[Check, ...]:
    """Hold the projector found against its stated position, where there is one."""
    moved = found.displacement
    if moved is None:
        return ()
    return (
        Check(
            name="projector against its stated position",
            value=moved.probability,
            limit=LAMP_CHANCE,
            decision="pass" if moved.agrees else "conditionalFail",
            rule="chance of a displacement as large as found if the position is as stated, at least the limit",
        ),
    )


def _heights_check(found: "Commissioning") -> Check:
    """Hold the stated heights against each other, or say that nothing in the session can."""
    name = "stated heights against one another"
    if not found.further:
        # Plate and strips alone fit any height of the strips equally well: a wrong one scales all heights.
        known = found.theory is not None
        rule = (
            "only the stated projector position bears the strips' height out; see the angle against theory"
            if known
            else "nothing in this session would show a wrong strip height; state projector.position_mm, or add an "
            'artefact of known height with use = "calibration"'
        )
        return Check(name=name, value=0.0, decision="info" if known else "conditionalPass", rule=rule)
    largest = max((abs(float(v)) for moved in found.fit.doubts for v in moved), default=0.0)
    return Check(
        name=name,
        value=largest,
        limit=CONTRADICTS,
        decision="fail" if largest > CONTRADICTS else "pass",
        rule="no stated height is moved by more standard uncertainties than this so that all agree",
    )


def pitch_check(seen: Estimate, stated: Estimate, *, most: float = DEFAULT_LIMITS.commission.height_en) -> Check:
    """Compare the camera's height by lens and grid with the stated one: a wrong pitch moves the first in proportion.

    Examples
    --------
    >>> check = pitch_check(Estimate(1200.0, 3.0, "mm"), Estimate(1000.0, 5.0, "mm"))
    >>> check.decision, round(check.value, 1)
    ('fail', 17.1)
    """
    en = (seen.value - stated.value) / (2 * math.hypot(seen.u, stated.u))
    return Check(
        name="grid pitch against camera height",
        value=en,
        limit=most,
        decision="pass" if abs(en) <= most else "fail",
        rule=f"|En| <= {most:g}; lens and grid put the camera at {seen.value:.1f} mm, stated {stated.value:.1f} mm: "
        f"if not the height, the pitch is wrong by a factor of {stated.value / seen.value:.4f}",
    )


def verification_checks(found: "Verification", limits: Limits = DEFAULT_LIMITS) -> tuple[Check, ...]:
    """Return the checks of a verification: every profile, and all together, against the certificate."""
    most = limits.verify.en
    rule = f"|En| <= {most:g}, En = mean error over its expanded uncertainty (k = 2), certificate included"
    checks = []
    for profile in (*found.errors.profiles, found.errors.pooled):
        if profile.en is not None:
            decision = "pass" if abs(profile.en) <= most else "fail"
            name = f"mean error, {profile.name if profile is found.errors.pooled else 'profile ' + profile.name}"
            checks.append(Check(name=name, value=profile.en, limit=most, decision=decision, rule=rule))
    if limits.verify.mean_error_percent is not None:
        checks.append(_tolerated_mean(found, limits))
    return tuple(checks)


def _tolerated_mean(found: "Verification", limits: Limits) -> Check:
    """Hold the mean error of all profiles against the laboratory's own tolerance."""
    pooled, full = found.errors.pooled, found.errors.full_height_mm
    return judged(
        "mean error against the tolerance",
        Estimate(pooled.mean_percent, 100 * pooled.u_mm / full, "%"),
        limits.verify.mean_error_percent or 0.0,
        level=limits.level,
    )


def judged(name: str, found: Estimate, limit: float, *, level: float = DEFAULT_LIMITS.level) -> Check:
    """Judge the size of a signed quantity against a limit, by probability of conformity (JCGM 106:2012, 8.2).

    Parameters
    ----------
    name
        What is judged.
    found
        Its value and standard uncertainty.
    limit
        Largest size allowed, in the unit of the value.
    level
        Probability at which conformity counts as proved.

    Examples
    --------
    >>> judged("drift", Estimate(-0.3, 0.01, "mm"), 0.2).decision
    'fail'
    """
    return Check(
        name=name,
        value=found.value,
        limit=limit,
        u=found.u,
        expanded=found.expanded().U,
        unit=found.unit,
        decision=decide(found.value, found.u, lower=-limit, upper=limit, level=level).outcome,
        rule=f"within the limit with a probability of {level:.0%} at least (guard band)",
    )


def artefact_checks(readings: Sequence[Reading], limits: Limits = DEFAULT_LIMITS) -> tuple[Check, ...]:
    """Return the checks of an artefact: every certified number, against its certificate."""
    most = limits.verify.en
    rule = f"|En| <= {most:g}, En = error over the expanded uncertainties (k = 2) of rig and certificate"
    return tuple(
        Check(
            name=reading.name,
            value=reading.en,
            limit=most,
            decision="pass" if abs(reading.en) <= most else "fail",
            rule=rule,
        )
        for reading in readings
        if reading.en is not None
    )


def _below(name: str, found: Estimate, limit: float, level: float) -> Check:
    """Judge a quantity that cannot be negative, such as an rms, against its upper limit."""
    return Check(
        name=name,
        value=found.value,
        limit=limit,
        u=found.u,
        expanded=found.expanded().U if found.u > 0 else None,
        unit=found.unit,
        decision=decide(found.value, found.u, upper=limit, level=level).outcome,
        rule=f"below the limit with a probability of {level:.0%} at least (guard band)",
    )
