"""The truth about a session as files beside it, which code under test must never read."""

import io
import json
from collections.abc import Mapping
from typing import Any

import numpy as np

from fringecal.simulate.rig.rig_spec import RigSpec
from fringecal.simulate.rig.truth import apparent_angle_deg, lens_shift_at_point_px, projection_angle_deg, truth_of
from fringecal.simulate.scene.artefacts_as_made import true_target
from fringecal.simulate.scene.capture_scenes import capture_scene, field_mm
from fringecal.simulate.tracing.ray_tracer import Frames, plate_points, true_phase_shifts_rad

# Places along x and y at which the true projection angle is written, mm.
ANGLE_POINTS_MM = (-80, -40, 0, 40, 80)


def truth_files(rig: RigSpec, taken: Mapping[str, Frames], *, seed: int = 0) -> dict[str, bytes]:
    """Truth as files: ``truth/truth.json`` with numbers, ``truth/truth.npz`` with maps."""
    document = json.dumps(truth_document(rig, taken, seed=seed), indent=1)
    buffer = io.BytesIO()
    np.savez_compressed(buffer, **truth_maps(rig, taken))  # type: ignore[arg-type]
    return {"truth/truth.json": document.encode(), "truth/truth.npz": buffer.getvalue()}


def truth_document(rig: RigSpec, taken: Mapping[str, Frames], *, seed: int = 0) -> dict[str, Any]:
    """Numbers of a rig's truth.

    Keys: scale_h, scale_v (mm/px at the image centre); k1, verdict, distortion_at_corner_px (at the
    printed grid's corner, else at the picture's); angle_origin_deg, angle_x, angle_y (projection angle
    in deg at points of both axes, mm); apparent_x, apparent_y (what breaks show there); projector,
    camera (mm); grid_pitch; zmax (mm, of each artefact); rig_parameters; steps_rad (true phase shifts, with their
    slopes per px); rig (all of its numbers), artefacts (as they are, by capture) and seed.
    """
    truth, size = truth_of(rig), np.array(field_mm(rig))
    grid = _grid_facts(rig)
    k1 = rig.camera.distortion[0]
    corner = grid["corner"] if grid else (size[0] / 2, size[1] / 2)
    steps = true_phase_shifts_rad(rig.steps, rig.camera.width_px, rig.camera.height_px)
    document: dict[str, Any] = {
        "name": rig.name,
        "scale_h": truth.scale_h,
        "scale_v": truth.scale_v,
        "k1": k1,
        "verdict": "barrel" if k1 < 0 else "pincushion" if k1 > 0 else "none",
        "distortion_at_corner_px": lens_shift_at_point_px(rig, corner),
        "angle_origin_deg": truth.angle_origin_deg,
        "apparent_angle_origin_deg": truth.apparent_angle_origin_deg,
        "projector": list(truth.projector_mm),
        "camera": list(truth.camera_mm),
        "grid_pitch": grid["pitch"] if grid else None,
        "rig_parameters": list(truth.rig_parameters),
        "steps_rad": steps.tolist(),
        "seed": seed,
        "rig": rig.model_dump(mode="json"),
        "artefacts": _artefacts(rig, taken),
    }
    return document | _angles(rig) | _highest(taken)


def _artefacts(rig: RigSpec, taken: Mapping[str, Frames]) -> dict[str, Any]:
    """Return the artefacts as they are, by capture."""
    true = {capture.name: true_target(rig, capture) for capture in rig.capture if capture.name in taken}
    return {name: target.model_dump(mode="json") for name, target in true.items() if target is not None}


def _angles(rig: RigSpec) -> dict[str, dict[str, float]]:
    at = np.array(ANGLE_POINTS_MM, float)
    axes = {"x": np.column_stack([at, 0 * at]), "y": np.column_stack([0 * at, at])}
    kinds = {"angle": projection_angle_deg, "apparent": apparent_angle_deg}
    return {
        f"{kind}_{axis}": dict(zip(map(str, ANGLE_POINTS_MM), angle(rig, points).tolist(), strict=True))
        for kind, angle in kinds.items()
        for axis, points in axes.items()
    }


def _grid_facts(rig: RigSpec) -> dict[str, Any] | None:
    for capture in rig.capture:
        target = true_target(rig, capture)
        if target is not None and target.kind == "line-grid":
            pattern = capture_scene(rig, capture, target).pattern
            reach = [(n - 1) / 2 * pattern.pitch_mm for n in pattern.counts]
            return {"pitch": pattern.pitch_mm, "corner": tuple(reach)}
    return None


def _highest(taken: Mapping[str, Frames]) -> dict[str, Any]:
    heights = {name: float(np.nanmax(frames.z)) for name, frames in taken.items() if np.nanmax(frames.z) > 0}
    return {"zmax": heights.get("bars"), "zmax_of": heights}


def truth_maps(rig: RigSpec, taken: Mapping[str, Frames]) -> dict[str, np.ndarray]:
    """Collect maps of a session's truth at pixel centres.

    Per capture of something that is not flat its height in mm under the capture's own name, and
    ``lit_NAME``; per phase-shifted capture ``phase_NAME`` in rad; ``lit`` is that of the bars;
    ``x``, ``y`` are the plate's coordinates under each pixel in mm.
    """
    x, y = plate_points(rig)
    maps = {"x": x.astype(np.float32), "y": y.astype(np.float32)}
    for name, frames in taken.items():
        if len(frames.frames) > 1:
            maps[f"phase_{name}"] = frames.phase
        if np.nanmax(frames.z) > 0:
            maps[name] = frames.z.astype(np.float32)
            maps[f"lit_{name}"] = frames.lit
    if "lit_bars" in maps:
        maps["lit"] = maps["lit_bars"]
    return maps
