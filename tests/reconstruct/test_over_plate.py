"""Heights over a plate from points of the camera's frame: against planes, and their u against draws of the rig."""

import numpy as np
import pytest

from fringecal.camera import Lens
from fringecal.errors import FitError
from fringecal.projector import BOARD_RIG_NAMES, BoardRig, rig_points
from fringecal.reconstruct import heights_over, plate_frame, volume_points

SHAPE = (30, 40)


def turn(axis, degrees):
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    i, j = [k for k in range(3) if k != axis]
    found = np.eye(3)
    found[i, i], found[i, j], found[j, i], found[j, j] = c, -s, s, c
    return found


@pytest.fixture(scope="module")
def rig():
    camera = Lens(np.array([70.0, 70.0, 19.0, 15.0, -0.05, 0, 0, 0, 0]), np.zeros((9, 9)), SHAPE[1], SHAPE[0])
    projector = Lens(np.array([600.0, 600.0, 320.0, 180.0, 0.02, 0, 0, 0, 0]), np.zeros((9, 9)), 640, 360)
    rotation = turn(1, -24)
    shift = -rotation @ np.array([-250.0, 0.0, 40.0])
    u = np.zeros(len(BOARD_RIG_NAMES))
    for name, own in (
        ("camera.fx_px", 0.05),
        ("camera.cx_px", 0.1),
        ("projector.cx_px", 0.2),
        ("projector.fx_px", 0.3),
    ):
        u[BOARD_RIG_NAMES.index(name)] = own
    u[-6:] = 1e-4, 1e-4, 1e-4, 0.05, 0.05, 0.1
    board = np.stack(np.meshgrid(*[np.linspace(-150, 150, 4)] * 2, [500.0, 700.0]), axis=-1).reshape(-1, 3)
    return BoardRig(camera, projector, rotation, shift, np.diag(u**2), volume_mm=board)


def on_plane(rig, normal, offset):
    """Points of a plane n X = d that the pixels see, (H, W, 3), and their true coordinates of the projector."""
    rows, columns = np.indices(SHAPE)
    rays = rig.camera.unproject(np.stack([columns.ravel(), rows.ravel()], axis=1).astype(float))
    points = rays * (offset / (rays @ normal))[:, None]
    return points.reshape(*SHAPE, 3), rig.project(points).T.reshape(2, *SHAPE)


PLATE = turn(0, 6) @ turn(1, 5) @ np.array([0.0, 0.0, -1.0])


def measured(rig, place, u_px=(0.02, 0.02)):
    return volume_points(rig, place[0], place[1], u_px=u_px, dtype=np.float64)


def test_a_plane_over_the_plate_has_its_height_and_the_frame_of_the_conventions(rig) -> None:
    _, plate = on_plane(rig, PLATE, -620.0)
    frame = plate_frame(rig, measured(rig, plate), plate)
    surface, place = on_plane(rig, PLATE, -600.0)  # 20 mm nearer: the normal points to the camera
    over = heights_over(rig, frame, measured(rig, place), place, (0.02, 0.02))
    assert np.abs(over.z[over.mask] - 20.0).max() < 1e-6
    # x runs along the columns and y up in the picture; the origin is under the image centre.
    assert (np.diff(over.x, axis=1) > 0).all()
    assert (np.diff(over.y, axis=0) < 0).all()
    centre = rig.camera.project(frame.origin_mm[None])
    assert centre[0] == pytest.approx([(SHAPE[1] - 1) / 2, (SHAPE[0] - 1) / 2], abs=1e-6)
    assert np.abs(frame.points(surface)[..., 2] - 20.0).max() < 1e-6


def test_u_of_heights_holds_what_draws_of_the_rig_show(rig) -> None:
    _, plate = on_plane(rig, PLATE, -620.0)
    _, place = on_plane(rig, PLATE, -590.0)
    frame = plate_frame(rig, measured(rig, plate), plate)
    over = heights_over(rig, frame, measured(rig, place), place, (0.0, 0.0))
    rng, drawn = np.random.default_rng(9), []
    for _ in range(40):
        other = rig.moved(rng.standard_normal(24) * np.sqrt(np.diag(rig.covariance)))
        own = plate_frame(other, measured(other, plate), plate)
        drawn.append(heights_over(other, own, measured(other, place), place, (0.0, 0.0)).z)
    sd = np.std(drawn, axis=0)
    ratio = (over.u_z / sd)[over.mask]
    # The sd of 40 draws is known to 11 %, alike for all pixels. Plate and surface share most of the rig's error, which
    # alone would be far more.
    assert np.median(ratio) == pytest.approx(1, abs=0.35)
    alone = volume_points(rig, place[0], place[1], dtype=np.float64).u_z
    assert np.nanmedian(over.u_z) < 0.5 * np.nanmedian(alone)


def test_a_coordinate_that_depth_does_not_move_does_not_start_the_depth(rig) -> None:
    points, place = on_plane(rig, PLATE, -600.0)
    pixels = np.stack(np.indices(SHAPE)[::-1], axis=-1).reshape(-1, 2).astype(float)
    # Rows of the projector lie along the baseline, and are the better known: the columns still tell the depth.
    found = rig_points(rig, pixels, place.reshape(2, -1).T, projector_u_px=np.array([[0.03, 0.01]]))
    assert np.abs(found.points_mm - points.reshape(-1, 3)).max() < 1e-6


def test_a_plate_that_hardly_shows_is_refused(rig) -> None:
    _, plate = on_plane(rig, PLATE, -620.0)
    plate = np.where(np.arange(SHAPE[1]) < 3, plate, np.nan)
    with pytest.raises(FitError, match=r"points of the bare plate are measured, 200 are needed"):
        plate_frame(rig, measured(rig, plate), plate)
