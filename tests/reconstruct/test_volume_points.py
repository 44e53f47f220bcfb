"""Points of whole pictures by a rig with an inverse camera: what single points say, and what is masked."""

import dataclasses

import cv2
import numpy as np
import pytest

from fringecal.camera import Lens
from fringecal.errors import FitError
from fringecal.projector import BoardRig, rig_points
from fringecal.reconstruct import Reason, volume_points

SIZE = (320, 256)  # of the camera
U_PX = (0.05, 0.08)


def rig_at(turn_rad: tuple[float, float, float], shift_mm: tuple[float, float, float]) -> BoardRig:
    """A camera, and a projector beside or above it, known to tenths of pixels and mm; boards were at 600 mm."""
    camera = Lens(np.array([550.0, 552, 161, 125, -0.1, 0.1, 4e-4, -3e-4, 0]), np.zeros((9, 9)), *SIZE)
    projector = Lens(np.array([1700.0, 1690, 460, 560, 0.06, -0.05, -4e-4, 2e-4, 0.01]), np.zeros((9, 9)), 912, 1140)
    sizes = np.array([0.3, 0.3, 0.5, 0.5, 1e-3, 5e-3, 1e-4, 1e-4, 0] * 2 + [2e-4] * 3 + [0.2] * 3)
    grid = np.stack(np.meshgrid([-60.0, 0, 60], [-45.0, 0, 45], [560.0, 600, 640]), axis=-1).reshape(-1, 3)
    rotation = cv2.Rodrigues(np.array(turn_rad))[0]
    return BoardRig(camera, projector, rotation, np.array(shift_mm), np.diag(sizes**2), volume_mm=grid)


def beside() -> BoardRig:
    return rig_at((0.05, 0.42, -0.02), (-250.0, 20.0, 60.0))


def seen_surface(rig: BoardRig) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A waved surface over the picture: pixels, points (n, 3), and the projector's coordinates (H, W, 2)."""
    v, u = np.mgrid[: SIZE[1], : SIZE[0]]
    pixels = np.column_stack([u.ravel(), v.ravel()]).astype(float)
    depth = 600 + 20 * np.sin(u / 50) + 10 * np.cos(v / 40)
    points = rig.camera.unproject(pixels) * depth.ravel()[:, None]
    return pixels, points, rig.project(points).reshape(SIZE[1], SIZE[0], 2)


@pytest.mark.parametrize(("columns", "rows"), [(True, False), (True, True)])
def test_every_pixel_has_the_point_and_u_that_single_points_have(columns, rows):
    rig = beside()
    pixels, points, places = seen_surface(rig)
    found = volume_points(
        rig, places[..., 0] if columns else None, places[..., 1] if rows else None, u_px=U_PX, dtype=float
    )
    here = found.mask.ravel()
    assert here.mean() > 0.5
    got = np.stack([found.x, found.y, found.z], axis=-1).reshape(-1, 3)
    assert np.abs(got - points)[here].max() < 1e-5
    some = np.flatnonzero(here)[::97]
    known = places.reshape(-1, 2)[some] * np.where([columns, rows], 1.0, np.nan)
    single = rig_points(rig, pixels[some], known, projector_u_px=np.array([U_PX]))
    u = np.stack([found.u_x, found.u_y, found.u_z], axis=-1).reshape(-1, 3)[some]
    assert u == pytest.approx(single.u_mm, rel=0.06)


def test_rows_alone_serve_a_projector_above_the_camera():
    rig = rig_at((-0.42, 0.03, 0.02), (20.0, -250.0, 60.0))
    _, points, places = seen_surface(rig)
    found = volume_points(rig, None, places[..., 1], u_px=0.05, dtype=float)
    got = np.stack([found.x, found.y, found.z], axis=-1).reshape(-1, 3)
    assert np.abs(got - points)[found.mask.ravel()].max() < 1e-5
    assert found.mask.mean() > 0.5


def test_pixels_without_a_point_say_why():
    rig = beside()
    _, points, places = seen_surface(rig)
    column, row = places[..., 0].copy(), places[..., 1].copy()
    column[100, 100], row[120, 120] = np.nan, row[120, 120] + 25.0
    far = rig.project(points * 3.0).reshape(*column.shape, 2)
    column[130, 130], row[130, 130] = far[130, 130]
    found = volume_points(rig, column, row, u_px=0.05)
    assert found.reasons[100, 100] == Reason.NO_PHASE
    assert found.reasons[120, 120] == Reason.ORDER_UNDECIDED
    assert found.reasons[130, 130] == Reason.OUT_OF_RANGE
    assert found.reasons[128, 160] == 0
    assert np.isnan(found.z[100, 100])
    assert np.isnan(found.u_z[130, 130])


def test_fringes_along_the_baseline_are_refused():
    rig = rig_at((0.0, 0.42, 0.0), (-250.0, 0.0, 60.0))
    _, _, places = seen_surface(rig)
    with pytest.raises(FitError, match="along the line from camera to projector"):
        volume_points(rig, None, places[..., 1])


def test_a_lens_that_folds_inside_the_picture_is_refused():
    rig = beside()
    folded = dataclasses.replace(rig.camera, values=rig.camera.values + np.array([0, 0, 0, 0, -4.0, 0, 0, 0, 0]))
    with pytest.raises(FitError, match="folds"):
        volume_points(dataclasses.replace(rig, camera=folded), np.zeros((SIZE[1], SIZE[0])))


def test_maps_of_another_size_are_refused():
    with pytest.raises(FitError, match="needed"):
        volume_points(beside(), np.zeros((10, 10)))
