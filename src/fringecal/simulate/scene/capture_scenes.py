"""From a rig's list of captures to the scene that each of them shows."""

from dataclasses import replace

import numpy as np

from fringecal.simulate.rig.rig_spec import CaptureSpec, RigSpec
from fringecal.simulate.scene.leaf import leaf_scene
from fringecal.simulate.scene.objects import scene_of
from fringecal.simulate.scene.scene import Form, Scene, plate
from fringecal.targets import Target, load_target, parse_target


def capture_scene(rig: RigSpec, capture: CaptureSpec, target: Target | None) -> Scene:
    """Put what a capture shows in its place on the plate."""
    if target is not None:
        scene = scene_of(target, field_mm=field_mm(rig))
    else:
        scene = leaf_scene() if capture.kind == "object" else plate()
    if capture.dirt:
        scene = replace(scene, pattern=replace(scene.pattern, specks=_specks(rig, capture.dirt)))
    angle_deg = capture.rotation_deg + (90.0 if capture.direction == "rows" else 0.0)
    placed = scene.placed(*capture.position_mm, angle_deg)
    return placed.on_form(Form(rig.plate.form, rig.plate.unit_mm)) if rig.plate.form else placed


def stated_target(capture: CaptureSpec) -> Target | None:
    """Return the target that a capture states: shipped by name, or written into the rig."""
    if capture.target is None:
        return None
    if isinstance(capture.target, dict):
        return parse_target(capture.target)
    return load_target(capture.target)


SPECK_MM = (0.2, 1.0)  # least and largest radius of dirt: less than a pixel of the thesis's rig, and three of them


def field_mm(rig: RigSpec) -> tuple[float, float]:
    """Size of the picture on the plate along x and y."""
    scale = rig.camera.scale_mm_per_px
    return scale * rig.camera.width_px, scale * rig.camera.height_px


def _specks(rig: RigSpec, n_specks: int) -> np.ndarray:
    """Strew dirt over the field: x, y and radius in mm; it lies where the surface's seed puts it."""
    half = np.array(field_mm(rig)) / 2
    low, high = [-half[0], -half[1], SPECK_MM[0]], [half[0], half[1], SPECK_MM[1]]
    return np.random.default_rng([rig.surface.seed, n_specks]).uniform(low, high, (n_specks, 3))
