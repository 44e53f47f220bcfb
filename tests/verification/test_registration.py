"""The pose found must be the pose put in; what is no zig-zag must be refused by name."""

# ruff: noqa: ARG005  # errors are functions of x, y and height, whichever they use

import math
from dataclasses import replace

import numpy as np
import pytest

from fringecal.errors import FitError
from fringecal.verification import register_zigzag


def difference_deg(found_rad, put_deg):
    return (math.degrees(found_rad) - put_deg + 90) % 180 - 90


@pytest.mark.parametrize("rotation_deg", [0.0, 3.0, 30.0, 90.0, -45.0, -88.0])
def test_pose_at_any_rotation(make_scene, make_bars, rotation_deg):
    surface = make_scene(rotation_deg=rotation_deg, centre=(6.0, -9.0), length=200.0, noise=0.1)
    pose = register_zigzag(surface, make_bars(length=200.0))
    # noise of 0.1 mm over 60 000 pixels leaves 0.4 um across; 0.01 mm and deg leave room for pixels at edges
    assert abs(difference_deg(pose.rotation_rad, rotation_deg)) < 0.01
    c, s = math.cos(math.radians(rotation_deg)), math.sin(math.radians(rotation_deg))
    dx, dy = pose.x_mm - 6.0, pose.y_mm + 9.0
    assert abs(c * dx + s * dy) < 0.01
    assert abs(c * dy - s * dx) < 1.0  # the ends are seen to about a pixel, 0.73 mm
    assert pose.bars_seen == 4
    assert pose.inlier_share > 0.999
    assert pose.residual_sd_mm == pytest.approx(0.1, rel=0.03)


def test_outliers_do_not_pull(make_scene, make_bars):
    surface = make_scene(rotation_deg=3.0, noise=0.1, outliers=0.05)
    pose = register_zigzag(surface, make_bars())
    assert abs(difference_deg(pose.rotation_rad, 3.0)) < 0.01
    assert abs(pose.x_mm) < 0.05
    assert pose.inlier_share == pytest.approx(0.95, abs=0.01)  # the share put in


@pytest.mark.parametrize("what", ["left half", "every second pixel", "upper end in shadow"])
def test_half_missing(make_scene, make_bars, what):
    surface = make_scene(noise=0.05)
    mask = surface.mask.copy()
    if what == "left half":
        mask[:, : mask.shape[1] // 2] = False
    elif what == "upper end in shadow":
        mask[:120] = False
    else:
        mask = np.random.default_rng(3).random(mask.shape) < 0.5
    hidden = {name: np.where(mask, getattr(surface, name), np.nan) for name in ("x", "y", "z")}
    pose = register_zigzag(replace(surface, mask=mask, **hidden), make_bars())
    assert abs(pose.x_mm) < 0.02
    assert abs(pose.rotation_deg) < 0.02
    assert abs(pose.y_mm) < max(1.0, 3 * pose.u_along_mm)
    assert pose.bars_seen == (2 if what == "left half" else 4)


def test_covariance_is_the_scatter_over_repeats(make_scene, make_bars):
    poses = [register_zigzag(make_scene(noise=0.2, size=(220, 240), scale_mm=1.468, seed=s), make_bars())
             for s in range(24)]  # fmt: skip
    spread = np.std([p.x_mm for p in poses], ddof=1)
    stated = math.sqrt(poses[0].covariance[0, 0])
    assert 0.6 < spread / stated < 1.45  # sd of 24 values is known to 15 %, three of them


def test_free_seat_finds_tilt_and_height(make_scene, make_bars):
    surface = make_scene(error=lambda x, y, z: 0.4 + 0.003 * x - 0.002 * y, noise=0.05)
    pose = register_zigzag(surface, make_bars(), seating="free")
    assert pose.names == ("across_mm", "rotation_rad", "z_mm", "tilt_x_rad", "tilt_y_rad")
    assert pose.z_mm == pytest.approx(0.4 + 0.003 * pose.x_mm - 0.002 * pose.y_mm, abs=0.003)
    assert pose.tilt_x_rad == pytest.approx(0.003, abs=2e-5)
    assert pose.tilt_y_rad == pytest.approx(-0.002, abs=2e-5)


def test_a_wrong_scale_is_not_absorbed(make_scene, make_bars):
    pose = register_zigzag(make_scene(error=lambda x, y, z: 0.05 * z), make_bars(), seating="on-plate")
    assert (pose.z_mm, pose.tilt_x_rad, pose.tilt_y_rad) == (0.0, 0.0, 0.0)
    assert abs(pose.x_mm) < 0.02


def test_one_angle_over_the_whole_field_still_registers(make_scene, make_bars):
    """The thesis's height model: +10 % at one end of the field and -8 % at the other."""
    surface = make_scene(error=lambda x, y, z: (0.012 - 0.0006 * y) * z, length=300.0, size=(520, 480))
    pose = register_zigzag(surface, make_bars(length=300.0))
    assert abs(pose.x_mm) < 0.05
    assert pose.inlier_share > 0.99


def test_bars_larger_than_the_picture(make_scene, make_bars):
    surface = make_scene(count=8, length=600.0, size=(300, 300), noise=0.05)
    pose = register_zigzag(surface, make_bars(count=8, length=600.0))
    across, _ = pose.across_along(surface.x, surface.y)
    whole = across / (2 * 40 * math.sin(math.pi / 4))
    assert np.nanmax(np.abs((whole - surface.x / 56.568542) % 1 % 0.99999)) < 0.01  # right but for whole bars
    assert pose.u_along_mm > 50.0  # no end is seen


@pytest.mark.parametrize(
    ("scene", "target", "cause"),
    [
        ({"error": lambda x, y, z: -z}, {}, "flat"),
        ({"apex_deg": 80.0}, {}, "apex of 80"),
        ({"apex_deg": 60.0}, {}, "steep ones stand at 60"),
        ({"leg": 36.0}, {}, "repeats every 5[01]"),
        ({"count": 3}, {}, "3 bars where the target states 4"),
        ({"count": 5, "size": (440, 600)}, {}, "5 bars where the target states 4"),
        ({"count": 2}, {}, "2 bars where the target states 4"),
        ({"length": 200.0}, {}, "shorter than the 240 mm"),
        ({"length": 300.0}, {}, "longer than the 240 mm"),
    ],
    ids=["plane", "apex 80", "apex 60", "period", "3 bars", "5 bars", "2 bars", "shorter", "longer"],
)
def test_refused_with_its_cause(make_scene, make_bars, scene, target, cause):
    with pytest.raises(FitError, match=cause):
        register_zigzag(make_scene(noise=0.05, **scene), make_bars(**target))


def test_nonsense_is_refused(make_scene, make_bars):
    surface = make_scene()
    noise = np.random.default_rng(0).normal(0, 10, surface.z.shape)
    for wrong in (
        replace(surface, z=noise),
        replace(surface, z=np.full_like(noise, np.nan)),
        replace(surface, mask=np.zeros(noise.shape, bool)),
        replace(surface, z=-surface.z),
        replace(surface, z=surface.x.copy()),
        replace(surface, z=surface.z[:-1]),
        replace(surface, z=15 + 10 * np.sin(surface.x / 9) + 10 * np.sin(surface.y / 9)),
    ):
        with pytest.raises(FitError):
            register_zigzag(wrong, make_bars())
    with pytest.raises(ValueError, match="seating"):
        register_zigzag(surface, make_bars(), seating="floating")
