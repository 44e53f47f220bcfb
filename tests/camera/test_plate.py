"""The camera on the plate against OpenCV's projection, round trips and the frame's definition."""

import cv2
import numpy as np
import pytest

from fringecal.camera.plate.plate_camera import PlateCamera

SHAPE = (480, 640)
PINHOLE = {"scale_mm_per_px": 0.5, "height_mm": 900.0, "tilt_x_rad": 0.02, "tilt_y_rad": -0.015}
LENS = {"k1": -0.12, "k2": 0.05, "k3": -0.01}
EVERYTHING = {**PINHOLE, **LENS, "aspect": 1.01, "p1": 1e-3, "p2": -5e-4, "cu_px": 6.0, "cv_px": -4.0}
PIXELS = np.meshgrid(np.linspace(0, 639, 9), np.linspace(0, 479, 7))


def opencv_pixels(camera, points_mm):
    """Project with OpenCV: the optical axis meets the plate at the origin, the picture's right leans to +x."""
    toward = np.array([np.tan(camera["tilt_x_rad"]), np.tan(camera["tilt_y_rad"]), 1.0])
    position = toward * camera["height_mm"]
    forward = -toward / np.linalg.norm(toward)
    right = np.array([1.0, 0, 0]) - forward[0] * forward
    right /= np.linalg.norm(right)
    rotation = np.stack([right, np.cross(forward, right), forward])
    focal = np.linalg.norm(position) / camera["scale_mm_per_px"]
    matrix = np.array([[focal, 0, 319.5], [0, focal / camera["aspect"], 239.5], [0, 0, 1]])
    lens = np.array([camera["k1"], camera["k2"], 0, 0, camera["k3"]])
    found, _ = cv2.projectPoints(points_mm, cv2.Rodrigues(rotation)[0], -rotation @ position, matrix, lens)
    return found.reshape(-1, 2)


def test_projection_is_opencvs():
    camera = PlateCamera.from_values({**PINHOLE, **LENS, "aspect": 1.01}, SHAPE)
    points = np.random.default_rng(1).uniform([-150, -110, -5], [150, 110, 40], (50, 3))
    found = np.column_stack(camera.project(*points.T))
    # Two writings of one formula in double precision.
    np.testing.assert_allclose(found, opencv_pixels(camera, points), atol=1e-8)


@pytest.mark.parametrize("telecentric", [False, True])
def test_rays_come_back_to_their_pixels(telecentric):
    values = {**EVERYTHING, "k1": -0.03, "k2": 0.0, "k3": 0.0} if telecentric else EVERYTHING
    camera = PlateCamera.from_values(values, SHAPE, telecentric=telecentric)
    rays = camera.rays(*PIXELS)
    for z_mm in (0.0, 25.0):
        u, v = camera.project(*rays.at(z_mm), z_mm)
        # Newton's method stops at 1e-12 of the half diagonal or better.
        np.testing.assert_allclose([u, v], PIXELS, atol=1e-7)


@pytest.mark.parametrize("values", [PINHOLE, EVERYTHING], ids=["plain", "everything"])
def test_frame_is_what_the_picture_says(values):
    camera = PlateCamera.from_values(values, SHAPE)
    u0, v0 = camera.centre_px
    assert (u0, v0) == (319.5, 239.5)
    rays = camera.rays(np.array([u0, u0 + 1e-3, u0]), np.array([v0, v0, v0 - 1e-3]))
    np.testing.assert_allclose([rays.ax[0], rays.ay[0]], 0, atol=1e-9)
    assert rays.ax[1] > 0
    assert abs(rays.ay[1]) < 1e-6 * rays.ax[1]  # x runs along +u; 1e-6 is the curvature over 1e-3 px
    assert rays.ay[2] > 0  # y up in the picture


def test_scale_of_a_square_on_camera_is_height_over_focal_length():
    camera = PlateCamera.from_values({"scale_mm_per_px": 0.5, "height_mm": 900.0}, SHAPE)
    assert camera.focal_px == pytest.approx(1800.0)
    rays = camera.rays(319.5 + 100, 239.5 - 40)
    assert (float(rays.ax), float(rays.ay)) == pytest.approx((50.0, 20.0))
    # The ray goes to the pupil: at 900 mm it is at 0, 0.
    assert rays.at(900.0)[0] == pytest.approx(0.0, abs=1e-9)
    assert camera.scale("mean").value == pytest.approx(0.5)


def test_telecentric_rays_are_parallel_and_lean_with_the_tilt():
    values = {"scale_mm_per_px": 0.2, "tilt_x_rad": 0.03, "tilt_y_rad": -0.01}
    camera = PlateCamera.from_values(values, SHAPE, telecentric=True)
    rays = camera.rays(*PIXELS)
    np.testing.assert_allclose(rays.bx, np.tan(0.03))
    np.testing.assert_allclose(rays.by, np.tan(-0.01))


def test_pixels_beyond_the_fold_of_a_lens_have_no_ray():
    camera = PlateCamera.from_values({"scale_mm_per_px": 1.0, "height_mm": 300.0, "k1": -0.4}, SHAPE)
    rays = camera.rays(*PIXELS)
    # r (1 - 0.4 r^2) is largest at r = 0.913: nothing farther than 0.609 focal lengths is imaged.
    reach = np.hypot(PIXELS[0] - 319.5, PIXELS[1] - 239.5) / 300.0
    np.testing.assert_array_equal(
        np.isnan(rays.ax[np.abs(reach - 0.609) > 0.01]), (reach > 0.609)[np.abs(reach - 0.609) > 0.01]
    )


def test_unknown_parameter_is_refused():
    with pytest.raises(KeyError, match="focus"):
        PlateCamera.from_values({"focus": 1.0}, SHAPE)
