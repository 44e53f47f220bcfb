"""Whole sessions from a virtual rig with a raster projector: document, pictures, targets, and the truth beside them."""

import io
import json
import zlib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from fringecal.errors import FringecalError
from fringecal.simulate.rig.raster_device import centre_px, flat_pose, focal_lengths_px, projector_pose
from fringecal.simulate.rig.raster_spec import RasterCaptureSpec, RasterRigSpec
from fringecal.simulate.scene.objects import scene_of
from fringecal.simulate.scene.scene import Form, Scene, plate
from fringecal.simulate.sessions import Progress, target_text
from fringecal.simulate.tracing.raster_render import RasterFrames, render_raster
from fringecal.targets import Target, load_target, parse_target


@dataclass(frozen=True)
class SimulatedRasterSession:
    """A session ready to be written; fields as those of `SimulatedSession`."""

    document: dict[str, Any]
    frames: dict[str, np.ndarray]
    files: dict[str, bytes]
    captures: dict[str, RasterFrames] = field(repr=False)


def simulate_raster_session(
    rig: RasterRigSpec,
    captures: Iterable[str] | None = None,
    *,
    seed: int = 0,
    targets: Mapping[str, Target] | None = None,
    with_truth: bool = True,
    progress: Progress = lambda _: None,
) -> SimulatedRasterSession:
    """Take all, or some, of a rig's captures.

    Parameters
    ----------
    rig
        The rig; its captures say where each flat is and what stands on it.
    captures
        Names of those to take; all of the rig's by default.
    seed
        Seeds noise. A capture's noise does not depend on which other captures are taken.
    targets
        True artefacts by capture name, where they differ from what the session states of them.
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
    taken: dict[str, RasterFrames] = {}
    for capture in chosen:
        progress(capture.name)
        target = (targets or {}).get(capture.name) or _stated(capture)
        taken[capture.name] = take_raster(rig, capture, target, seed=seed)
    frames = {
        name: frame
        for capture in chosen
        for name, frame in zip(_every_name(rig, capture), taken[capture.name].frames, strict=True)
    }
    files = {_target_file(c): target_text(c.target).encode() for c in chosen if isinstance(c.target, dict)}
    if with_truth:
        files |= _truth_files(rig, chosen, taken, seed)
    return SimulatedRasterSession(_document(rig, chosen), frames, files, taken)


def take_raster(
    rig: RasterRigSpec, capture: RasterCaptureSpec, target: Target | None = None, *, seed: int = 0
) -> RasterFrames:
    """Take one capture: what it shows is put on its flat, and drawn."""
    scene = _scene(rig, target)
    if capture.stretch:
        scene = replace(scene, pattern=replace(scene.pattern, stretch=capture.stretch))
    return render_raster(rig, capture, scene, seed=(seed, zlib.crc32(capture.name.encode())))


def _scene(rig: RasterRigSpec, target: Target | None) -> Scene:
    scene = plate() if target is None else scene_of(target)
    return scene.on_form(Form(rig.plate.form, rig.plate.unit_mm)) if rig.plate.form else scene


def _stated(capture: RasterCaptureSpec) -> Target | None:
    if capture.target is None:
        return None
    return parse_target(capture.target) if isinstance(capture.target, dict) else load_target(capture.target)


def _document(rig: RasterRigSpec, captures: Iterable[RasterCaptureSpec]) -> dict[str, Any]:
    """Write session.toml's contents: what somebody at this rig would state."""
    camera = {"bits": rig.camera.bits} if rig.camera.bits not in (8, 16) else {}
    return {
        "format": 1,
        "rig": rig.name,
        "captured": rig.captured,
        "camera": camera,
        "projector": {"resolution_px": [rig.projector.columns, rig.projector.rows]},
        "phase": {"steps_deg": list(rig.fringes.steps_deg)},
        "capture": [_table(rig, capture) for capture in captures],
    }


def _table(rig: RasterRigSpec, capture: RasterCaptureSpec) -> dict[str, Any]:
    *fringes, white, black = _every_name(rig, capture)
    table: dict[str, Any] = {"name": capture.name, "kind": capture.kind}
    if capture.target is not None:
        table["target"] = _target_file(capture) if isinstance(capture.target, dict) else capture.target
    if capture.use is not None:
        table["use"] = capture.use
    stated = {"axes": list(rig.fringes.axes), "fringes": list(rig.fringes.fringes)}
    return table | stated | {"images": fringes, "white": [white], "black": [black]}


def _every_name(rig: RasterRigSpec, capture: RasterCaptureSpec) -> list[str]:
    fringes = rig.fringes
    return [
        *(
            f"{capture.name}-{axis}{k + 1}-{n}.png"
            for axis in fringes.axes
            for k in range(len(fringes.fringes))
            for n in range(len(fringes.steps_deg))
        ),
        f"{capture.name}-white.png",
        f"{capture.name}-black.png",
    ]


def _target_file(capture: RasterCaptureSpec) -> str:
    return f"t-{capture.name}.toml"


def _truth_files(
    rig: RasterRigSpec, captures: Iterable[RasterCaptureSpec], taken: Mapping[str, RasterFrames], seed: int
) -> dict[str, bytes]:
    """Truth as files: ``truth/truth.json`` with numbers, ``truth/truth.npz`` with maps."""
    document = raster_truth(rig) | {"poses": _poses(captures), "seed": seed, "rig": rig.model_dump(mode="json")}
    maps = {}
    for name, frames in taken.items():
        maps[f"points_{name}"] = frames.points_mm.astype(np.float32)
        maps[f"projector_{name}"] = frames.projector_px.astype(np.float32)
        maps[f"lit_{name}"] = frames.lit
    buffer = io.BytesIO()
    np.savez_compressed(buffer, **maps)  # type: ignore[arg-type]
    return {"truth/truth.json": json.dumps(document, indent=1).encode(), "truth/truth.npz": buffer.getvalue()}


def raster_truth(rig: RasterRigSpec) -> dict[str, Any]:
    """Return the numbers of a rig's truth: both lenses as fx, fy, cx, cy and Brown's five, and where the projector is.

    `rotation` and `shift_mm` lead from the camera's frame to the projector's.
    """
    rotation, shift = projector_pose(rig)
    camera = rig.camera
    middle = (camera.width_px - 1) / 2, (camera.height_px - 1) / 2
    du, dv = camera.principal_offset_px
    return {
        "name": rig.name,
        "camera": [camera.focal_px, camera.focal_px, middle[0] + du, middle[1] + dv, *camera.distortion],
        "projector": [*focal_lengths_px(rig), *centre_px(rig), *rig.projector.distortion],
        "rotation": rotation.tolist(),
        "shift_mm": shift.tolist(),
        "projector_position_mm": list(rig.projector.position_mm),
    }


def _poses(captures: Iterable[RasterCaptureSpec]) -> dict[str, Any]:
    poses = {capture.name: flat_pose(capture) for capture in captures}
    return {
        name: {"rotation": rotation.tolist(), "shift_mm": shift.tolist()} for name, (rotation, shift) in poses.items()
    }
