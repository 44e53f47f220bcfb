"""Whole sessions from a virtual rig: the document, its pictures, its targets, and the truth beside them."""

import json
import zlib
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from fringecal.errors import FringecalError
from fringecal.simulate.rig.rig_spec import CaptureSpec, RigSpec, StepsSpec
from fringecal.simulate.scene.artefacts_as_made import true_target
from fringecal.simulate.scene.capture_scenes import capture_scene
from fringecal.simulate.tracing.ray_tracer import Frames, render
from fringecal.simulate.tracing.sensor import stream
from fringecal.simulate.truth_files import truth_files
from fringecal.targets import Target

REPEAT_SEED = 1_000_003  # between repeats: far from the seeds that people give
STATED_STREAM = zlib.crc32(b"stated")

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
    steps: Mapping[str, StepsSpec] | None = None,
    with_truth: bool = True,
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
        True artefacts by capture name, in place of those that the rig states or draws.
    steps
        What the mirror did, by capture name, where captures differ.
    with_truth
        Whether the truth goes among the files.
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
        target = (targets or {}).get(capture.name) or true_target(rig, capture)
        taken[capture.name] = _repeated(_stepped(rig, (steps or {}).get(capture.name)), capture, target, seed=seed)
    frames = {
        name: frame
        for capture in chosen
        for name, frame in zip(_file_names(rig, capture), taken[capture.name].frames, strict=True)
    }
    files = {_target_file(c): target_text(c.target).encode() for c in chosen if isinstance(c.target, dict)}
    if with_truth:
        files |= truth_files(rig, taken, seed=seed)
    return SimulatedSession(session_document(rig, chosen, seed=seed), frames, files, taken)


def _stepped(rig: RigSpec, steps: StepsSpec | None) -> RigSpec:
    return rig if steps is None else rig.model_copy(update={"steps": steps})


def take(rig: RigSpec, capture: CaptureSpec, target: Target | None = None, *, seed: int = 0) -> Frames:
    """Take one capture: its scene is put in place, lit as its kind demands, and drawn."""
    by_room_light = capture.kind in ("grid", "board")
    scene = capture_scene(rig, capture, target or true_target(rig, capture))
    stream_seed = (seed, zlib.crc32(capture.name.encode()))
    return render(rig, scene, seed=stream_seed, light="room" if by_room_light else "fringes")


def _repeated(rig: RigSpec, capture: CaptureSpec, target: Target | None, *, seed: int) -> Frames:
    """Take a capture as often as it asks for; the first set is the one that it would be alone, and so is its truth."""
    first = take(rig, capture, target, seed=seed)
    sets = [take(rig, capture, target, seed=seed + REPEAT_SEED * k).frames for k in range(1, capture.repeat)]
    return replace(first, frames=np.concatenate([first.frames, *sets])) if sets else first


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
        "captured": rig.captured,
        "camera": camera,
        "projector": {"position_mm": {"value": np.round(position, 2).tolist(), "u": u_position}},
        "phase": {"steps_deg": list(rig.steps.nominal_deg)},
        "capture": [_capture_table(rig, capture) for capture in captures],
    }


def _capture_table(rig: RigSpec, capture: CaptureSpec) -> dict[str, Any]:
    table: dict[str, Any] = {"name": capture.name, "kind": capture.kind}
    if capture.target is not None:
        table["target"] = _target_file(capture) if isinstance(capture.target, dict) else capture.target
    if capture.use is not None:
        table["use"] = capture.use
    if capture.repeat > 1:
        table["repeat"] = capture.repeat
    return table | {"images": _file_names(rig, capture)}


def _file_names(rig: RigSpec, capture: CaptureSpec) -> list[str]:
    if capture.kind in ("grid", "board"):
        return [f"{capture.name}.png"]
    steps = range(len(rig.steps.nominal_deg))
    if capture.repeat < 2:
        return [f"{capture.name}-{n}.png" for n in steps]
    return [f"{capture.name}-r{number}-{n}.png" for number in range(capture.repeat) for n in steps]


def _target_file(capture: CaptureSpec) -> str:
    return f"t-{capture.name}.toml"


def target_text(target: str | dict[str, Any] | None) -> str:
    """Write a target document as TOML: flat, but for quantities, which are inline tables."""
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
