"""Named checks of a rig calibrated by a board in poses: value, limit, rule and decision."""

import math

from fringecal.projector import RigFault
from fringecal.records import DEFAULT_LIMITS, Check, Decision, Limits
from fringecal.workflows.commission.by_board.board_numbers import (
    points_of_boards,
    span_of_tilts_deg,
    u_of_points_mm,
)
from fringecal.workflows.commission.by_board.board_run import BoardCommissioning
from fringecal.workflows.shared import judged_below, rms_estimate

# Normals of the boards that differ by less leave focal length and distance to distortion; advice is 20 to 40 deg to
# different sides, which makes 40 and more.
_TILTS_DEG, _LEAST_TILTS_DEG = 25.0, 10.0
_USED_SHARE = 0.7  # of the poses that must take part: fewer, and what was wrong with the others may be in these


def board_checks(found: BoardCommissioning, limits: Limits = DEFAULT_LIMITS) -> tuple[Check, ...]:
    """Return the checks of a calibration by a board in poses, with their decisions."""
    fit = found.fit
    n = sum(int(pose.used.sum()) for pose in fit.poses)
    limit = limits.commission.grid_residual_px
    u = u_of_points_mm(points_of_boards(fit.rig))
    checks = [
        judged_below("residual of the corners, both pictures", rms_estimate(fit.stereo_rms_px, n, "px"), limit,
                     limits.level),
        _poses(found),
        _tilts(span_of_tilts_deg(fit)),
        *_faults(found),
        Check(
            name="largest standard uncertainty of a point at the boards",
            value=float(u.max()),
            unit="mm",
            decision="info",
            rule="root of the sum of squares over x, y, z, by the calibration alone; points that are known half as "
            "well count as outside the volume",
        ),
    ]  # fmt: skip
    return tuple(checks)


def _poses(found: BoardCommissioning) -> Check:
    share = len(found.used) / len(found.posed)
    return Check(
        name="poses used",
        value=100 * share,
        limit=100 * _USED_SHARE,
        unit="%",
        decision="pass" if share >= _USED_SHARE else "conditionalPass",
        rule=f"{len(found.used)} of {len(found.posed)} poses of the board take part, at least the limit",
    )


def _tilts(span_deg: float) -> Check:
    decision: Decision = (
        "pass" if span_deg >= _TILTS_DEG else "conditionalPass" if span_deg >= _LEAST_TILTS_DEG else "fail"
    )
    advice = "" if decision == "pass" else "; the poses are too alike: tilt the board by 20 to 40 deg to all sides"
    return Check(
        name="largest angle between boards",
        value=span_deg,
        limit=_TILTS_DEG,
        unit="deg",
        decision=decision,
        rule=f"largest angle between two boards, at least the limit{advice}",
    )


def _faults(found: BoardCommissioning) -> tuple[Check, ...]:
    """Fail for each fault of the captures that was named; pass once where there is none."""
    if not found.faults:
        rule = "print, pixels, focus, numbering and poses explain nothing of the residuals more than chance does"
        return (Check(name="errors of the captures", value=0, limit=0, decision="pass", rule=rule),)
    return tuple(
        Check(name=fault.kind.value, decision="fail", rule=fault.message, value=_size(fault)) for fault in found.faults
    )


def _size(fault: RigFault) -> float | None:
    return None if math.isnan(fault.size) else fault.size
