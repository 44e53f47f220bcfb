"""Named checks of a commissioning: value, limit, rule and one of four outcomes."""

import math
from typing import TYPE_CHECKING

import numpy as np
from scipy import ndimage

from fringecal.calibration import CONTRADICTS, Calibrated
from fringecal.camera import ThesisScale
from fringecal.numerics import robust_sd
from fringecal.phase import FindingKind
from fringecal.projector import DISPLACEMENT_PROBABILITY
from fringecal.records import DEFAULT_LIMITS, Check, Limits
from fringecal.uncertainty import Estimate, Influence, en_score
from fringecal.workflows.commission.spacing import spacing_of
from fringecal.workflows.commission.testability import statement_checks
from fringecal.workflows.shared import judged_below, judged_en, rms_estimate
from fringecal.workflows.verify import verified_checks

if TYPE_CHECKING:
    from fringecal.workflows.commission.run import Commissioning
    from fringecal.workflows.shared import CaptureDiagnosis


def commissioning_checks(found: "Commissioning", limits: Limits = DEFAULT_LIMITS) -> tuple[Check, ...]:
    """Return the checks of a commissioning, with their decisions."""
    own, result = limits.commission, found.calibrated.result
    camera, apparent = result.camera, result.origin.apparent
    plate = rms_estimate(result.fit.plate_rms_rad, result.observations.phase_rad[0].size, "rad")
    grid = rms_estimate(camera.fit.rms_px, camera.fit.dof, "px")
    checks = [
        judged_below("plate phase residual", plate, own.plate_residual_rad, limits.level),
        judged_below("grid residual", grid, own.grid_residual_px, limits.level),
        # Heights hang on the angle that the camera sees; where a tilted camera stands changes only the other.
        judged_below(
            "standard uncertainty of the apparent projection angle",
            Estimate(apparent.u, apparent.u / math.sqrt(2 * apparent.dof), "deg"),
            own.angle_u_deg,
            limits.level,
        ),
        Check(
            name="largest lens displacement",
            value=camera.distortion.max_px.value,
            u=camera.distortion.max_px.u,
            expanded=camera.distortion.max_px.expanded().U,
            unit="px",
            decision="info",
            rule=f"verdict {camera.distortion.verdict}; corrected by the camera model",
        ),
    ]
    if camera.height_seen is not None and found.height_stated is not None:
        checks.append(pitch_check(camera.height_seen, found.height_stated, most=own.height_en))
    if camera.assumed_height is not None:
        assumed = camera.assumed_height
        rule = "not stated: a usual lens is assumed, within 60 %; state camera.height_mm"
        checks.append(
            Check(
                name=Influence.CAMERA_HEIGHT.value,
                value=assumed.value,
                u=assumed.u,
                expanded=assumed.expanded().U,
                unit="mm",
                decision="conditionalPass",
                rule=rule,
            )
        )
    checks += [*spacing_check(result, most=own.height_en), evenness_check(camera.tables)]
    if result.origin.en is not None:
        checks.append(
            judged_en(
                "angle against theory",
                result.origin.en,
                own.angle_en,
                of="difference / root sum of squares of U of measured and theoretical angle",
            )
        )
    several = (*_repeats_checks(found, limits), *(_frames_check(one, limits) for one in found.diagnosed))
    return (
        *statement_checks(found, limits),
        *checks,
        *_lamp_check(found),
        *_heights_check(result),
        *several,
        *verified_checks(found.verified, limits),
    )


def _repeats_checks(found: "Commissioning", limits: Limits) -> tuple[Check, ...]:
    """Judge noise and form of the plate where it was taken several times."""
    repeats = found.repeats
    if repeats is None:
        return ()
    return (
        judged_below(
            "noise of repeats over its prediction", repeats.ratio, limits.commission.noise_ratio, limits.level
        ),
        judged_below(
            "plate form beyond the model, rms", repeats.form_mm, limits.commission.plate_form_mm, limits.level
        ),
    )


def _frames_check(diagnosed: "CaptureDiagnosis", limits: Limits) -> Check:
    """Judge the findings of the diagnostics for which the phase used is not corrected."""
    left = [finding for finding in diagnosed.findings if finding.kind not in diagnosed.corrected]
    cost = math.sqrt(sum((finding.cost_rad or 0.0) ** 2 for finding in left))
    limit = limits.commission.frames_rad
    compressed = any(finding.kind is FindingKind.COMPRESSED for finding in left)
    named = ", ".join(dict.fromkeys(finding.kind.text for finding in left)) or "nothing"
    return Check(
        name=f"frames of {diagnosed.phase.capture.name}",
        value=cost,
        limit=limit,
        unit="rad",
        # A diagnosis from the frames alone proves no error of heights: at worst it is a condition.
        decision="pass" if cost <= limit and not compressed else "conditionalFail",
        rule=f"rms phase error by findings of the diagnostics that are not corrected ({named}), at most the limit; "
        "frames were not compressed, for u(phase) would be too small by more than is known",
    )


def _lamp_check(found: "Commissioning") -> tuple[Check, ...]:
    """Compare the projector position found with the stated one, where there is one."""
    moved = found.angles.displacement
    if moved is None:
        return ()
    return (
        Check(
            name="projector against its stated position",
            value=moved.probability,
            limit=DISPLACEMENT_PROBABILITY,
            decision="pass" if moved.agrees else "conditionalFail",
            rule="chance of a displacement as large as found if the position is as stated, at least the limit",
        ),
    )


def _heights_check(result: Calibrated) -> tuple[Check, ...]:
    """Compare the stated heights with each other, where there are artefacts beside plate and strips."""
    if not result.standards:
        return ()
    name = "stated heights against one another"
    largest = max((abs(float(v)) for changes in result.fit.height_changes_u for v in changes), default=0.0)
    return (
        Check(
            name=name,
            value=largest,
            limit=CONTRADICTS,
            decision="fail" if largest > CONTRADICTS else "pass",
            rule="largest change of a stated height, in its standard uncertainties, that makes all heights agree",
        ),
    )


def spacing_check(result: Calibrated, *, most: float = DEFAULT_LIMITS.commission.height_en) -> tuple[Check, ...]:
    """Compare the distance of the strips by the grid's scale with the stated one; none where too few are seen whole."""
    spacing = spacing_of(result)
    if spacing is None:
        return ()
    en = en_score(spacing.by_grid, spacing.stated)
    note = ""
    if abs(en) > most:
        note = (
            f"; by the grid the strips are {spacing.by_grid.value:.3f} mm apart, stated {spacing.stated.value:.3f} mm: "
            f"if not the strips' widths and gaps, the grid's scale is wrong by a factor of {spacing.ratio:.4f}: a "
            "sheet printed at another size, on something that raised it, or rows or columns missing in its picture"
        )
    of = "difference / root sum of squares of U of both distances"
    return (judged_en("distance of strips by the grid", en, most, of=of, note=note),)


_MISSING_PX = 0.75  # a distance of lines that is so much shorter than its neighbours': of one row, with noise
_MISSING_SIGMAS = 6.0  # robust standard deviations of the distances that it must be besides
_AROUND = 5  # distances whose median says what one is to be: perspective and lens change it slowly


def evenness_check(scale: ThesisScale) -> Check:
    """Look for one distance of the grid's lines that is unlike those around it: rows or columns missing or doubled."""
    worst, where, sigma = 0.0, "", 0.0
    for name, table in (("horizontal", scale.horizontal_lines), ("vertical", scale.vertical_lines)):
        distances = table[table["span"] == 1].sort_values("first_line")
        found = distances["distance_px"].to_numpy()
        if found.size < _AROUND:
            continue
        off = found - ndimage.median_filter(found, _AROUND, mode="nearest")
        k = int(np.abs(off).argmax())
        if abs(off[k]) > abs(worst):
            worst, sigma = float(off[k]), robust_sd(off, about=0)
            where = f"{name} lines {int(distances['first_line'].iloc[k])} and {int(distances['last_line'].iloc[k])}"
    wrong = abs(worst) > max(_MISSING_PX, _MISSING_SIGMAS * sigma)
    note = (
        f"; between {where}: {'rows' if 'horiz' in where else 'columns'} of the grid's picture are missing or doubled"
    )
    return Check(
        name="distances of the grid's lines",
        value=abs(worst),
        limit=_MISSING_PX,
        unit="px",
        decision="fail" if wrong else "pass",
        rule="largest departure of a distance of neighbouring lines from the median of five around it, at most the "
        "limit or six robust standard deviations" + (note if wrong else ""),
    )


def pitch_check(seen: Estimate, stated: Estimate, *, most: float = DEFAULT_LIMITS.commission.height_en) -> Check:
    """Compare the camera's height by lens and grid with the stated one: a wrong pitch moves the first in proportion.

    Examples
    --------
    >>> check = pitch_check(Estimate(1200.0, 3.0, "mm"), Estimate(1000.0, 5.0, "mm"))
    >>> check.decision, round(check.value, 1)
    ('fail', 17.5)
    """
    return judged_en(
        "grid pitch against camera height",
        en_score(seen, stated),
        most,
        of="difference / root sum of squares of U of both heights",
        note=f"; lens and grid put the camera at {seen.value:.1f} mm, stated {stated.value:.1f} mm: if not the height, "
        f"the pitch is wrong by a factor of {stated.value / seen.value:.4f}",
    )
