"""Named checks of a commissioning: value, limit, rule and one of four outcomes."""

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

from fringecal.procedures.further import CONTRADICTS
from fringecal.records.parts import Check
from fringecal.uncertainty.conformity import decide
from fringecal.uncertainty.estimates import Estimate
from fringecal.verify.readings import Reading

if TYPE_CHECKING:
    from fringecal.procedures.commission import Commissioning
    from fringecal.procedures.verification import Verification

# Defaults that a sound rig keeps; a lab's own limits will take their place.
PLATE_RESIDUAL_LIMIT_RAD = (
    0.10  # 1.6 % of a fringe: beyond it the plate is no plane or the frames do not belong together
)
GRID_RESIDUAL_LIMIT_PX = 0.30
EN_LIMIT = 1.0
ANGLE_U_LIMIT_DEG = 0.5  # 1.8 % of a height at 50 deg


def commissioning_checks(found: "Commissioning") -> tuple[Check, ...]:
    """Return the checks of a commissioning, with their decisions."""
    checks = [
        _below("plate phase residual", found.fit.plate_rms_rad, PLATE_RESIDUAL_LIMIT_RAD, "rad"),
        _below("grid residual", found.camera.fit.rms_px, GRID_RESIDUAL_LIMIT_PX, "px"),
        _below("standard uncertainty of the projection angle", found.angle.u, ANGLE_U_LIMIT_DEG, "deg"),
        Check(
            name="largest lens displacement",
            value=found.camera.distortion.max_px.value,
            u=found.camera.distortion.max_px.u,
            unit="px",
            decision="info",
            rule=f"verdict {found.camera.distortion.verdict}; corrected by the camera model",
        ),
    ]
    stated = found.session.camera.height_mm
    if found.camera.height_seen is not None and stated is not None:
        checks.append(pitch_check(found.camera.height_seen, stated.estimate("camera height", "mm")))
    if found.angle_en is not None:
        checks.append(
            Check(
                name="angle against theory",
                value=found.angle_en,
                limit=EN_LIMIT,
                decision="pass" if abs(found.angle_en) <= EN_LIMIT else "fail",
                rule="|En| <= 1, En = difference over the root sum of squares of both expanded uncertainties (k = 2)",
            )
        )
    return (*checks, _heights_check(found))


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


def pitch_check(seen: Estimate, stated: Estimate) -> Check:
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
        limit=EN_LIMIT,
        decision="pass" if abs(en) <= EN_LIMIT else "fail",
        rule=f"|En| <= 1; lens and grid put the camera at {seen.value:.1f} mm, stated are {stated.value:.1f} mm: if "
        f"not the height, the pitch is wrong by a factor of {stated.value / seen.value:.4f}",
    )


def verification_checks(found: "Verification") -> tuple[Check, ...]:
    """Return the checks of a verification: every profile, and all together, against the certificate."""
    rule = "|En| <= 1, En = mean error over its expanded uncertainty (k = 2), certificate included"
    checks = []
    for profile in (*found.errors.profiles, found.errors.pooled):
        if profile.en is not None:
            decision = "pass" if abs(profile.en) <= EN_LIMIT else "fail"
            name = f"mean error, {profile.name if profile is found.errors.pooled else 'profile ' + profile.name}"
            checks.append(Check(name=name, value=profile.en, limit=EN_LIMIT, decision=decision, rule=rule))
    return tuple(checks)


def artefact_checks(readings: Sequence[Reading]) -> tuple[Check, ...]:
    """Return the checks of an artefact: every certified number, against its certificate."""
    rule = "|En| <= 1, En = error over the expanded uncertainties (k = 2) of rig and certificate"
    return tuple(
        Check(
            name=reading.name,
            value=reading.en,
            limit=EN_LIMIT,
            decision="pass" if abs(reading.en) <= EN_LIMIT else "fail",
            rule=rule,
        )
        for reading in readings
        if reading.en is not None
    )


def _below(name: str, value: float, limit: float, unit: str, *, u: float = 0.0) -> Check:
    outcome = decide(value, u, upper=limit).outcome
    return Check(
        name=name, value=value, limit=limit, u=u, unit=unit, decision=outcome, rule="value + guard band <= limit"
    )
