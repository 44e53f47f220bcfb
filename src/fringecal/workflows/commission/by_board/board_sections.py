"""The report of a rig calibrated by a board in poses: checks, rig, poses, residuals in both pictures, volume."""

from datetime import datetime

import numpy as np
import pandas as pd

from fringecal.camera import LENS_NAMES
from fringecal.projector import BoardRig
from fringecal.records import DEFAULT_LIMITS, Check, Limits, software_versions
from fringecal.report import (
    Fact,
    FigureItem,
    Report,
    Section,
    Table,
    Verdict,
    depth_drawing,
    residual_quiver,
    volume_drawing,
)
from fringecal.uncertainty import Estimate
from fringecal.workflows.commission.by_board.board_judged import board_checks
from fringecal.workflows.commission.by_board.board_numbers import (
    baseline,
    depth_section,
    points_of_boards,
    triangulation_angle,
    u_of_points_mm,
)
from fringecal.workflows.commission.by_board.board_run import BoardCommissioning
from fringecal.workflows.shared import checks_table, concise, estimates_table, inputs_of_capture, severest


def board_report(
    found: BoardCommissioning, *, command: str = "", created: datetime | None = None, limits: Limits = DEFAULT_LIMITS
) -> Report:
    """Return the report of a calibration by a board in poses."""
    checks, rig, fit = board_checks(found, limits), found.fit.rig, found.fit
    u = u_of_points_mm(points_of_boards(rig))
    return Report(
        title=f"Commissioning of {found.session.rig}",
        subtitle=f"by {found.target.name} in {len(found.used)} poses under fringes",
        verdict=Verdict(severest(checks), _sentence(checks, found)),
        facts=(
            Fact("Baseline", concise(baseline(rig)), "between camera and projector"),
            Fact("Angle", concise(triangulation_angle(rig)), "between their rays, amid the boards"),
            Fact("Residual", f"{fit.stereo_rms_px:.3f} px", "rms, both pictures"),
            Fact("u of a point", f"{u.min():.2g} to {u.max():.2g} mm", "where boards were, by the calibration"),
            Fact("Poses", f"{len(found.used)} of {len(found.posed)}", "take part"),
        ),
        sections=(
            Section("Checks", found.notes, (checks_table(checks),)),
            _rig_section(rig),
            _volume_section(rig, u),
            _residual_section(found),
            *_next_section(found),
        ),
        inputs=tuple(file for capture in found.captures for file in inputs_of_capture(capture)),
        versions=software_versions(),
        command=command,
        created=created,
    )


def _sentence(checks: tuple[Check, ...], found: BoardCommissioning) -> str:
    failed = [check.name for check in checks if check.decision in ("fail", "conditionalFail")]
    if failed:
        return f"Not within its limit: {', '.join(failed)}."
    rms = f"{found.fit.stereo_rms_px:.3f} px"
    return f"One camera and one projector explain all corners of {len(found.used)} poses to {rms} rms."


def _rig_section(rig: BoardRig) -> Section:
    lenses = {
        f"{device}: {name}": rig.estimate(f"{device}.{name}")
        for device in ("camera", "projector")
        for name in LENS_NAMES
    }
    place = {
        f"projector's centre, {axis}": Estimate(float(value), float(u), "mm")
        for axis, value, u in zip("xyz", rig.centre_mm, _u_of_centre(rig), strict=True)
    }
    note = "Brown's distortion, OpenCV's order; pixels count from the centre of the first"
    return Section(
        "Camera and projector",
        (),
        (
            estimates_table("Lenses", lenses, first="parameter", header_note=note),
            estimates_table("Place of the projector in the camera's frame", place, first="coordinate"),
        ),
    )


def _u_of_centre(rig: BoardRig) -> np.ndarray:
    """Standard uncertainty of the projector's centre: it moves by the shift and by the turn."""
    shift = rig.covariance[-3:, -3:]
    turn = rig.covariance[-6:-3, -6:-3]
    cross = np.cross(np.eye(3), rig.shift_mm)
    by_turn, by_shift = rig.rotation.T @ cross.T, -rig.rotation.T
    both = np.hstack([by_turn, by_shift])
    joint = np.block([[turn, rig.covariance[-6:-3, -3:]], [rig.covariance[-3:, -6:-3], shift]])
    return np.sqrt(np.maximum(np.diag(both @ joint @ both.T), 0.0))


def _volume_section(rig: BoardRig, u: np.ndarray) -> Section:
    low, high = rig.volume_mm.min(axis=0), rig.volume_mm.max(axis=0)
    ranges = ", ".join(f"{axis} {a:.0f} to {b:.0f}" for axis, a, b in zip("xyz", low, high, strict=True))
    drawn = FigureItem(
        "Volume of the calibration",
        volume_drawing(rig.volume_mm, u, rig.centre_mm),
        "Camera and projector to scale, with all corners of all boards, coloured by the standard uncertainty of a "
        "point there by the calibration. Where no board was, points are continued, and flagged once they are known "
        "half as well as the least known of these.",
        "png",
    )
    depth = FigureItem(
        "Uncertainty over depth, baseline and angle",
        depth_drawing(depth_section(rig)),
        "The rig to scale, seen along the picture's columns, y in the middle of the boards: edges of both pictures "
        "(full lines), rays to the middle of the boards (broken), the angle between them, and the baseline. Colour: "
        "u of a point by the calibration, wherever both devices reach. White: where boards were. Beyond the black line "
        "points count as outside the calibrated volume.",
        "png",
    )
    return Section("Volume", (f"Boards were at {ranges} mm of the camera's frame.",), figures=(drawn, depth))


def _next_section(found: BoardCommissioning) -> tuple[Section, ...]:
    return (Section("What to measure next", found.next_poses),) if found.next_poses else ()


def _residual_section(found: BoardCommissioning) -> Section:
    rig = found.fit.rig
    figures = []
    for device, lens, k, rms in (
        ("camera", rig.camera, 0, rig.camera_rms_px),
        ("projector", rig.projector, 2, rig.projector_rms_px),
    ):
        points, rest = _residuals(found, k)
        if len(points):
            figures.append(
                FigureItem(
                    f"Residuals in the {device}",
                    residual_quiver(points, rest, (lens.height_px, lens.width_px), title=f"{device}: seen - modelled"),
                    f"Arrows at the corners of all boards, {rms:.3f} px rms. Arrows that point alike in a region would "
                    "show what the model leaves out.",
                )
            )
    return Section("Poses and residuals", (), (_poses(found),), tuple(figures))


def _residuals(found: BoardCommissioning, k: int) -> tuple[np.ndarray, np.ndarray]:
    points, rest = [], []
    for one, pose in zip(found.used, found.fit.poses, strict=True):
        assert one.pose is not None
        seen = one.pose.camera_px if k == 0 else one.pose.projector_px
        left = pose.camera_residual_px if k == 0 else pose.projector_residual_px
        use = pose.used[:, k : k + 2].all(axis=1)
        points.append(seen[use])
        rest.append(left[use])
    return np.concatenate(points), np.concatenate(rest)


def _poses(found: BoardCommissioning) -> Table:
    fits = {pose.name: pose for pose in found.fit.poses}
    rows = []
    for one in found.posed:
        row: dict[str, object] = {
            "pose": one.name,
            "status": one.reason or "; ".join(["used", one.unread] if one.unread else ["used"]),
            "corners": one.corners,
            "with projector": one.lit,
        }
        if one.pose is not None:
            pose = fits[one.name]
            row |= {"camera rms / px": pose.camera_rms_px, "projector rms / px": pose.projector_rms_px}
            row |= {"tilt / deg": pose.tilt_deg, "distance / mm": pose.distance_mm}
        rows.append(row)
    formats = {"camera rms / px": ".3f", "projector rms / px": ".3f", "tilt / deg": ".1f", "distance / mm": ".0f"}
    return Table("Poses of the board", pd.DataFrame(rows), "tilt from the camera's axis", formats)
