"""Whole sessions from a virtual rig: the document, its pictures, its targets, and the truth beside them."""

import io
import json
import zlib
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from datetime import UTC, datetime
from typing import Any

import numpy as np

from fringecal.errors import FringecalError
from fringecal.simulate.leaf import leaf_scene
from fringecal.simulate.objects import scene_of
from fringecal.simulate.render import Frames, plate_points, render, true_steps_rad
from fringecal.simulate.rig import CaptureSpec, RigSpec
from fringecal.simulate.scene import Scene, plate
from fringecal.simulate.sensor import stream
from fringecal.simulate.truth import lens_shift_at_point_px, projection_angle_deg, truth_of
from fringecal.targets import Target, load_target, parse_target

# Virtual sessions are taken at one moment, so that the same seed gives the same bytes.
CAPTURED = datetime(2008, 1, 1, 12, tzinfo=UTC)
STATED_STREAM = zlib.crc32(b"stated")
ANGLE_POINTS_MM = (-80, -40, 0, 40, 80)

type Progress = Callable[[str], None]


@dataclass(frozen=True)
class SimulatedSession:
    """A session ready to be written.

    Parameters
    ----------
    document
        What session.toml says.
    frames
        Pictures by file name.
    files
        Further files by relative name: targets that do not ship, and the truth. Code under test
        must not read ``truth/``.
    captures
        Frames with the truth at every pixel, by capture name.
    """

    document: dict[str, Any]
    frames: dict[str, np.ndarray]
    files: dict[str, bytes]
    captures: dict[str, Frames] = field(repr=False)


def simulate_session(
    rig: RigSpec,
    captures: Iterable[str] | None = None,
    *,
    seed: int = 0,
    targets: Mapping[str, Target] | None = None,
    progress: Progress = lambda _: None,
) -> SimulatedSession:
    """Take all, or some, of a rig's captures.

    Parameters
    ----------
    rig
        The rig; its captures say what lies where.
    captures
        Names of those to take; all of the rig's by default.
    seed
        Seeds noise, flicker and the errors of what was measured by hand. A capture's noise does not
        depend on which other captures are taken.
    targets
        True artefacts by capture name, where they differ from what the session states of them.
    progress
        Called with each capture's name before it is drawn.

    Raises
    ------
    FringecalError
        For a capture that the rig does not have, or an object that cannot be drawn.
    """
    chosen = [rig.capture_named(name) for name in captures] if captures is not None else list(rig.capture)
    if not chosen:
        raise FringecalError(f"rig {rig.name} has no captures; add [[capture]] tables to it")
    taken: dict[str, Frames] = {}
    for capture in chosen:
        progress(capture.name)
        target = (targets or {}).get(capture.name) or stated_target(capture)
        taken[capture.name] = take(rig, capture, target, seed=seed)
    frames = {
        name: frame
        for capture in chosen
        for name, frame in zip(_file_names(rig, capture), taken[capture.name].frames, strict=True)
    }
    files = {_target_file(c): _toml(c.target).encode() for c in chosen if isinstance(c.target, dict)}
    files |= truth_files(rig, taken, seed=seed)
    return SimulatedSession(session_document(rig, chosen, seed=seed), frames, files, taken)


def take(rig: RigSpec, capture: CaptureSpec, target: Target | None = None, *, seed: int = 0) -> Frames:
    """Take one capture: its scene is put in place, lit as its kind demands, and drawn."""
    by_room_light = capture.kind in ("grid", "board")
    scene = capture_scene(rig, capture, target or stated_target(capture))
    stream_seed = (seed, zlib.crc32(capture.name.encode()))
    return render(rig, scene, seed=stream_seed, light="room" if by_room_light else "fringes")


def capture_scene(rig: RigSpec, capture: CaptureSpec, target: Target | None) -> Scene:
    """Put what a capture shows in its place on the plate."""
    if target is not None:
        scene = scene_of(target, field_mm=field_mm(rig))
    else:
        scene = leaf_scene() if capture.kind == "object" else plate()
    angle_deg = capture.rotation_deg + (90.0 if capture.direction == "rows" else 0.0)
    return scene.placed(*capture.position_mm, angle_deg)


def stated_target(capture: CaptureSpec) -> Target | None:
    """Return the target that a capture states: shipped by name, or written into the rig."""
    if capture.target is None:
        return None
    if isinstance(capture.target, dict):
        return parse_target(capture.target)
    return load_target(capture.target)


def field_mm(rig: RigSpec) -> tuple[float, float]:
    """Size of the picture on the plate along x and y."""
    scale = rig.camera.scale_mm_per_px
    return scale * rig.camera.width_px, scale * rig.camera.height_px


def session_document(rig: RigSpec, captures: Iterable[CaptureSpec], *, seed: int = 0) -> dict[str, Any]:
    """Write session.toml's contents: what somebody at this rig could have stated."""
    camera: dict[str, Any] = {"bits": rig.camera.bits} if rig.camera.bits not in (8, 16) else {}
    rng, stated = stream(seed, STATED_STREAM), rig.stated
    height_error, *position_errors = rng.standard_normal(4)
    if rig.camera.kind == "telecentric":
        camera["telecentric"] = True
    else:
        height = rig.camera.height_mm + stated.camera_height_u_mm * height_error
        camera["height_mm"] = {"value": round(height, 2), "u": stated.camera_height_u_mm}
    position = np.array(rig.projector.position_mm) + stated.projector_position_u_mm * np.array(position_errors)
    u_position = [stated.projector_position_u_mm] * 3
    return {
        "format": 1,
        "rig": rig.name,
        "captured": CAPTURED,
        "camera": camera,
        "projector": {"position_mm": {"value": np.round(position, 2).tolist(), "u": u_position}},
        "phase": {"steps_deg": list(rig.steps.nominal_deg)},
        "capture": [_capture_table(rig, capture) for capture in captures],
    }


def _capture_table(rig: RigSpec, capture: CaptureSpec) -> dict[str, Any]:
    table: dict[str, Any] = {"name": capture.name, "kind": capture.kind}
    if capture.target is not None:
        table["target"] = _target_file(capture) if isinstance(capture.target, dict) else capture.target
    return table | {"images": _file_names(rig, capture)}


def _file_names(rig: RigSpec, capture: CaptureSpec) -> list[str]:
    if capture.kind in ("grid", "board"):
        return [f"{capture.name}.png"]
    return [f"{capture.name}-{n}.png" for n in range(len(rig.steps.nominal_deg))]


def _target_file(capture: CaptureSpec) -> str:
    return f"t-{capture.name}.toml"


def _toml(target: str | dict[str, Any] | None) -> str:
    """A target document as TOML: flat, but for quantities, which are inline tables."""
    if not isinstance(target, dict):
        return ""
    lines = []
    for key, value in target.items():
        if isinstance(value, dict):
            inner = ", ".join(f"{name} = {json.dumps(item)}" for name, item in value.items())
            lines.append(f"{key} = {{ {inner} }}\n")
        else:
            lines.append(f"{key} = {json.dumps(value)}\n")
    return "".join(lines)


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
    camera (mm); grid_pitch; zmax (mm, of each artefact); rig_parameters; steps_rad (true, with their
    slopes per px); rig (all of its numbers) and seed.
    """
    truth, size = truth_of(rig), np.array(field_mm(rig))
    grid = _grid_facts(rig)
    k1 = rig.camera.distortion[0]
    corner = grid["corner"] if grid else tuple(size / 2)
    steps = true_steps_rad(rig.steps, rig.camera.width_px, rig.camera.height_px)
    document: dict[str, Any] = {
        "name": rig.name,
        "scale_h": truth.scale_h,
        "scale_v": truth.scale_v,
        "k1": k1,
        "verdict": "barrel" if k1 < 0 else "pincushion" if k1 > 0 else "none",
        "distortion_at_corner_px": lens_shift_at_point_px(rig, (corner[0], corner[1])),
        "angle_origin_deg": truth.angle_origin_deg,
        "apparent_angle_origin_deg": truth.apparent_angle_origin_deg,
        "projector": list(truth.projector_mm),
        "camera": list(truth.camera_mm),
        "grid_pitch": grid["pitch"] if grid else None,
        "rig_parameters": list(truth.rig_parameters),
        "steps_rad": steps.tolist(),
        "seed": seed,
        "rig": rig.model_dump(mode="json"),
    }
    return document | _angles(rig) | _highest(taken)


def _angles(rig: RigSpec) -> dict[str, dict[str, float]]:
    from fringecal.simulate.truth import apparent_angle_deg

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
        target = stated_target(capture)
        if target is not None and target.kind == "line-grid":
            pattern = capture_scene(rig, capture, target).pattern
            reach = [(n - 1) / 2 * pattern.pitch_mm for n in pattern.counts]
            return {"pitch": pattern.pitch_mm, "corner": tuple(reach)}
    return None


def _highest(taken: Mapping[str, Frames]) -> dict[str, Any]:
    heights = {name: float(np.nanmax(frames.z)) for name, frames in taken.items() if np.nanmax(frames.z) > 0}
    return {"zmax": heights.get("bars"), "zmax_of": heights}


def truth_maps(rig: RigSpec, taken: Mapping[str, Frames]) -> dict[str, np.ndarray]:
    """Maps of a session's truth at pixel centres.

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
