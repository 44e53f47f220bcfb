"""Named checks of a verification: every profile and every certified number against its certificate."""

from typing import TYPE_CHECKING

from fringecal.phase import FindingKind
from fringecal.records import DEFAULT_LIMITS, Check, Limits
from fringecal.uncertainty import Estimate
from fringecal.verification import Departures
from fringecal.workflows.shared import judged, judged_en

if TYPE_CHECKING:
    from fringecal.workflows.verify.artefacts import ArtefactVerification
    from fringecal.workflows.verify.run import Verification
    from fringecal.workflows.verify.session_artefacts import Verified
    from fringecal.workflows.verify.volume_artefacts import VolumeVerification


def verified_checks(found: "Verified", limits: Limits = DEFAULT_LIMITS) -> tuple[Check, ...]:
    """Return the checks of all artefacts of a session, named by their captures.

    An artefact that was laid there to verify the rig and could not be measured is a check that failed.
    """
    bars = ((one.capture.name, verification_checks(one, limits)) for one in found.bars)
    others = ((one.capture.name, artefact_checks(one, limits)) for one in found.artefacts)
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


def verification_checks(found: "Verification", limits: Limits = DEFAULT_LIMITS) -> tuple[Check, ...]:
    """Return the checks of a verification: every profile, and all together, against the certificate."""
    checks = []
    for profile in (*found.errors.profiles, found.errors.pooled):
        if profile.en is not None:
            name = f"mean error, {profile.name if profile is found.errors.pooled else 'profile ' + profile.name}"
            checks.append(judged_en(name, profile.en, limits.verify.en, of="mean error / U, certificate included"))
    if limits.verify.mean_error_percent is not None:
        checks.append(_tolerated_mean(found, limits))
    checks += _compressed(found)
    return (*checks, *departure_checks(found.errors.departures, limits))


def _compressed(found: "Verification") -> tuple[Check, ...]:
    """Say that frames were compressed; such a verification proves nothing of the uncertainty of heights."""
    left = [one for one in found.diagnosed.findings if one.kind is FindingKind.COMPRESSED]
    if not left:
        return ()
    rule = f"{left[0].what}: {left[0].how_large}; {left[0].remedy}"
    return (Check(name=FindingKind.COMPRESSED.text, decision="conditionalFail", rule=rule),)


def departure_checks(found: Departures | None, limits: Limits = DEFAULT_LIMITS) -> tuple[Check, ...]:
    """Judge scatter and maximum of an artefact's pixels against what noise and uncertainty allow.

    A mean hides what cancels in it; the ripples of a frame that moved, or of a lamp that flickered, do not.
    """
    if found is None:
        return ()
    scatter = Check(
        name="scatter of pixels",
        value=found.ratio,
        limit=limits.verify.scatter_ratio,
        decision="pass" if found.ratio <= limits.verify.scatter_ratio else "fail",
        rule="root mean square of each pixel's departure from the form over its standard uncertainty",
    )
    share = found.largest_ratio / found.allowed_ratio
    largest = Check(
        name="largest error of a pixel",
        value=share,
        limit=limits.verify.largest_ratio,
        decision="pass" if share <= limits.verify.largest_ratio else "fail",
        rule=f"departure over standard uncertainty, over {found.allowed_ratio:.1f}: what the largest of {found.points} "
        "stays below in 99 of 100 cases",
    )
    return scatter, largest


def _tolerated_mean(found: "Verification", limits: Limits) -> Check:
    """Compare the mean error of all profiles with the laboratory's own tolerance."""
    pooled, full = found.errors.pooled, found.errors.full_height_mm
    return judged(
        "mean error against the tolerance",
        Estimate(pooled.mean_percent, 100 * pooled.u_mm / full, "%", dof=pooled.dof),
        limits.verify.mean_error_percent or 0.0,
        level=limits.level,
    )


def artefact_checks(
    found: "ArtefactVerification | VolumeVerification", limits: Limits = DEFAULT_LIMITS
) -> tuple[Check, ...]:
    """Return the checks of an artefact: every certified number, and its pixels against its form."""
    quotient = "error / root sum of squares of U of rig and certificate"
    numbers = tuple(
        judged_en(reading.name, reading.en, limits.verify.en, of=quotient)
        for reading in found.readings
        if reading.en is not None
    )
    return (*numbers, *departure_checks(found.departures, limits))
