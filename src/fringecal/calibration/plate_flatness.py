"""What a certificate says of the reference plate's form, over the part of it that the camera sees."""

import math

import numpy as np

from fringecal.camera import PlateCamera
from fringecal.projector import PlateForm, form_of_flatness, unknown_form
from fringecal.targets import Flat

type Box = tuple[float, float, float, float]


def plate_form(reference: Flat | PlateForm | None, camera: PlateCamera) -> PlateForm:
    """Return what is known of the plate's form.

    Parameters
    ----------
    reference
        The plate as its certificate states it, or None. Its size is that of the part that its flatness is stated for,
        with the middle of the picture as its middle; without one, and at least, that is what the camera sees. A form
        that was measured (`form_by_poses`) is taken as it is.
    camera
        The camera on the plate.
    """
    if isinstance(reference, PlateForm):
        return reference
    box = seen_box(camera)
    if reference is None:
        return unknown_form(box)
    flat = reference.flatness_mm
    half_x, half_y = (0.0 if side is None else side.value / 2 for side in (reference.width_mm, reference.length_mm))
    whole = (min(box[0], -half_x), max(box[1], half_x), min(box[2], -half_y), max(box[3], half_y))
    return form_of_flatness(math.hypot(flat.value, flat.us[0]), whole)


def seen_box(camera: PlateCamera) -> Box:
    """Return the part of the plate that the camera sees: (x_low, x_high, y_low, y_high), mm."""
    rays = camera.rays(*np.meshgrid([0.0, camera.width_px - 1.0], [0.0, camera.height_px - 1.0]))
    return float(rays.ax.min()), float(rays.ax.max()), float(rays.ay.min()), float(rays.ay.max())
