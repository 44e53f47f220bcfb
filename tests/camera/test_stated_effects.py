"""What follows from another pitch, height or lens to first order, against the whole fit made again."""

import numpy as np
import pytest

from fringecal.camera.lens.brown_lens import Lens
from fringecal.camera.plate.plate_camera import CAMERA_NAMES, PlateCamera
from fringecal.camera.plate.plate_fit import fit_plate_camera
from fringecal.camera.plate.stated_effects import effects_of_statements
from fringecal.uncertainty.estimates import Estimate
from fringecal.uncertainty.influences import Influence

SHAPE = (480, 640)
TRUTH = {"scale_mm_per_px": 0.5, "height_mm": 900.0, "tilt_x_rad": 0.02, "tilt_y_rad": -0.015, "k1": -0.1}
HEIGHT = Estimate(900.0, 4.0, "mm")
OFF = 0.01
NAMES = ("scale_mm_per_px", "height_mm", "tilt_x_rad", "tilt_y_rad")
PLACES = [CAMERA_NAMES.index(name) for name in NAMES]


@pytest.fixture(scope="module")
def sheet():
    x, y = (c.ravel() for c in np.meshgrid(np.arange(-140, 141, 40.0), np.arange(-100, 101, 40.0)))
    camera = PlateCamera.from_values(TRUTH, SHAPE)
    return np.column_stack(camera.project(x, y)), np.column_stack([x, y])


def lens(factor=1.0):
    """The true lens, its focal length known to 0.2 %, the rest better."""
    focal = factor * 900.0 / 0.5
    values = np.array([focal, focal, 319.5, 239.5, -0.1, 0.0, 0.0, 0.0, 0.0])
    u = np.array([0.002 * focal, 0.002 * focal, 0.5, 0.5, 1e-3, 1e-6, 1e-6, 1e-6, 1e-6])
    return Lens(values, np.diag(u**2), SHAPE[1], SHAPE[0])


def fitted(sheet, *, pitch=1.0, height=1.0, with_height=True, focal=None):
    pixels, points = sheet
    stated = Estimate(height * HEIGHT.value, HEIGHT.u, "mm") if with_height else None
    own = None if focal is None else lens(focal)
    return fit_plate_camera(pixels, pitch * points, SHAPE, pitch_rel_u=1e-4, height_mm=stated, lens=own)


CASES = (
    (Influence.GRID_PITCH, {}, {"pitch": 1 + OFF}),
    (Influence.CAMERA_HEIGHT, {}, {"height": 1 + OFF}),
    (Influence.GRID_PITCH, {"focal": 1.0, "with_height": False}, {"pitch": 1 + OFF}),
    (Influence.LENS, {"focal": 1.0}, {"focal": 1 + OFF}),
)


@pytest.mark.parametrize(("influence", "known", "changed"), CASES)
def test_first_order_is_what_the_fit_made_again_gives(sheet, influence, known, changed):
    base, other = fitted(sheet, **known), fitted(sheet, **(known | changed))
    stated = HEIGHT if known.get("with_height", True) else None
    effect = effects_of_statements(base, stated, lens="focal" in known)[influence]
    found = OFF * effect[PLACES] / np.abs(base.camera.parameters[PLACES])
    again = (other.camera.parameters - base.camera.parameters)[PLACES] / np.abs(base.camera.parameters[PLACES])
    # Relative changes of up to 1 %, of which the second order is a hundredth; tilt and height share their doubt.
    assert found == pytest.approx(again, abs=0.12 * OFF)


def test_a_telecentric_camera_has_no_height_that_could_be_wrong(sheet):
    pixels, points = sheet
    fit = fit_plate_camera(pixels, points, SHAPE, pitch_rel_u=1e-4, telecentric=True)
    (effect,) = effects_of_statements(fit, None, lens=False).values()
    assert effect[CAMERA_NAMES.index("scale_mm_per_px")] == fit.camera["scale_mm_per_px"]
    assert np.count_nonzero(effect) == 1
