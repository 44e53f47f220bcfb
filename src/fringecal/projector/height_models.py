"""Height models side by side, from the thesis's one constant angle to the projective rig."""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fringecal.camera import Rays
from fringecal.projector.angle.projection_angle import fringe_pitch_mm
from fringecal.projector.pixelwise import fit_pixelwise
from fringecal.projector.rig_calibration import RigCalibration
from fringecal.projector.rig_model import RigModel

Array = NDArray[np.float64]

#: Names of the height models, from worst to best known.
HEIGHT_MODELS = ("constant-angle", "column-angle", "cubic", "pixelwise", "pixelwise-three-term", "projective")
_PIXELWISE = {"cubic": "cubic", "pixelwise": "inverse-linear", "pixelwise-three-term": "three-term"}
_FLATS = 5  # virtual flats: two more than the laws have coefficients
_HIGHEST = 0.12  # of the field's shorter side: height of the highest virtual flat, 40 mm on the thesis rig


@dataclass(frozen=True)
class HeightModel:
    """A named way from phase (rad) and rays to height (mm): `height(phase_rad, rays)`."""

    name: str
    height: Callable[[Array, Rays], Array]


def fitted_to(name: str) -> str:
    """Say what a height model's numbers were fitted to.

    Examples
    --------
    >>> fitted_to("projective"), fitted_to("cubic")
    ('the session', 'virtual flats of the rig model')
    """
    return "virtual flats of the rig model" if name in _PIXELWISE else "the session"


def height_model(calibration: RigCalibration, name: str = "projective") -> HeightModel:
    """Return a height model of a calibrated rig by name.

    ``constant-angle``: `z = p0 dphi / (2 pi tan(theta0))`, one apparent angle and one pitch, taken at the plate's
    origin: the thesis. ``column-angle``: the same with pitch and apparent angle of each pixel's own plate point,
    first order in z. ``projective``: the rig model, exact. ``pixelwise``, ``pixelwise-three-term`` and ``cubic``: a
    law of its own at every pixel (`projection.pixelwise`), fitted to five virtual flats seen by the rig model; they
    show what these laws can hold, not what flats on a bench would give.

    Raises
    ------
    KeyError
        An unknown name.

    Examples
    --------
    >>> from fringecal.camera import PlateCamera
    >>> camera = PlateCamera.from_values({"scale_mm_per_px": 0.8, "height_mm": 1100.0}, (480, 640))
    >>> model = RigModel(np.array([0.5, 0.0, 0.5, 0.0, 0.0, 0.0, 0.0]), np.full(3, np.inf))  # light from 45 deg
    >>> rig = RigCalibration(camera, model, ())
    >>> rays = camera.rays(*camera.centre_px)
    >>> float(height_model(rig).height(np.array(1.0), rays).round(6))
    2.0
    """
    rig = calibration.model
    makers: dict[str, Callable[[], HeightModel]] = {
        "constant-angle": lambda: _constant_angle(calibration),
        "column-angle": lambda: HeightModel(name, lambda phase, rays: _first_order(rig, phase, rays)),
        "projective": lambda: HeightModel(name, rig.height),
    }
    if name in _PIXELWISE:
        return _pixelwise(calibration, name, _PIXELWISE[name])
    if name not in makers:
        raise KeyError(f"no height model is called {name!r}; known: {', '.join(HEIGHT_MODELS)}")
    return makers[name]()


def _constant_angle(calibration: RigCalibration) -> HeightModel:
    rig = calibration.model
    pitch = float(fringe_pitch_mm(rig))
    gx, gy, gz = (float(g) for g in rig.gradient(0.0, 0.0, 0.0))
    # The camera looks straight down at the origin, up to its tilt: the angle the strips show there.
    centre = calibration.camera.rays(*calibration.camera.centre_px)
    tangent = -(gz + gx * float(centre.bx) + gy * float(centre.by)) / math.hypot(gx, gy)

    def height(phase: Array, rays: Rays) -> Array:
        step = phase - rig.phase(rays.ax, rays.ay, 0.0)
        return -step * pitch / (2 * math.pi * tangent)

    return HeightModel("constant-angle", height)


def _pixelwise(calibration: RigCalibration, name: str, law: str) -> HeightModel:
    rig, camera = calibration.model, calibration.camera
    shorter = camera.scale("mean").value * min(camera.width_px, camera.height_px)
    heights = _HIGHEST * shorter * np.arange(1, _FLATS + 1) / _FLATS

    def height(phase: Array, rays: Rays) -> Array:
        plate = rig.phase(rays.ax, rays.ay, 0.0)
        flats = np.stack([rig.phase(*rays.at(z), z) - plate for z in heights])
        return fit_pixelwise(flats, heights, law=law).height(phase - plate)

    return HeightModel(name, height)


def _first_order(rig: RigModel, phase: Array, rays: Rays) -> Array:
    gx, gy, gz = rig.gradient(rays.ax, rays.ay, 0.0)
    return (phase - rig.phase(rays.ax, rays.ay, 0.0)) / (gz + gx * rays.bx + gy * rays.by)


def height_changes(
    calibration: RigCalibration, z_mm: Array | float, u_px: Array, v_px: Array, *, model: str = "projective"
) -> Array:
    """Return the change of a measured height in mm under one standard uncertainty of every influence.

    The phase that a surface at `z_mm` sends to a pixel stays; what is made of it moves with the calibration.

    Parameters
    ----------
    calibration
        The rig with its uncertainty components.
    z_mm
        Heights, in a shape that broadcasts with the pixels'.
    u_px, v_px
        Pixels, of one shape.
    model
        Name of a height model.

    Returns
    -------
    changes
        Shape (components, ...), 0 where a moved rig sees no height.

    Examples
    --------
    >>> from fringecal.camera import PlateCamera
    >>> camera = PlateCamera.from_values({"scale_mm_per_px": 0.8, "height_mm": 1100.0}, (480, 640))
    >>> model = RigModel(np.array([0.5, 0.0, 0.5, 0.0, 0.0, 0.0, 0.0]), np.full(3, np.inf))
    >>> height_changes(RigCalibration(camera, model, ()), 5.0, np.zeros(3), np.zeros(3)).shape  # no component, 3 pixels
    (0, 3)
    """
    z, _ = np.broadcast_arrays(np.asarray(z_mm, float), u_px)
    rays = calibration.camera.rays(u_px, v_px)
    phase = calibration.model.phase(*rays.at(z), z)
    base = height_model(calibration, model).height(phase, rays)
    rows = []
    for component in calibration.components:
        moved = calibration.shifted(component)
        change = height_model(moved, model).height(phase, moved.camera.rays(u_px, v_px)) - base
        rows.append(np.where(np.isfinite(change), change, 0.0))
    return np.stack(rows) if rows else np.zeros((0, *z.shape))
