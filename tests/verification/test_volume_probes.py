"""Artefacts in any pose in a picture of points: found without a plate, and measured by closed forms."""

import numpy as np
import pytest

from fringecal.errors import FitError
from fringecal.targets import parse_target
from fringecal.verification import PointPicture, volume_probe

SHAPE = (150, 200)
AWAY = np.array([0.2, 0.0, 1.0])
ABOUT = {"format": 1, "name": "artefact", "certificate": "none"}
NOISE_MM = 0.01


def turned(x_deg: float, y_deg: float) -> np.ndarray:
    """Rotation about x, then y."""
    (a, b), (c, d) = ((np.cos(t), np.sin(t)) for t in np.radians([x_deg, y_deg]))
    return np.array([[c, 0, d], [0, 1, 0], [-d, 0, c]]) @ np.array([[1, 0, 0], [0, a, -b], [0, b, a]])


def grid() -> tuple[np.ndarray, np.ndarray]:
    """Places of the pixels, half a millimetre apart, x right and y up."""
    v, u = np.mgrid[: SHAPE[0], : SHAPE[1]].astype(float)
    return 0.5 * (u - SHAPE[1] / 2), -0.5 * (v - SHAPE[0] / 2)


def picture(z: np.ndarray, *, noise: float = NOISE_MM) -> PointPicture:
    """A surface seen along z, with noise."""
    x, y = grid()
    z = z + noise * np.random.default_rng(4).standard_normal(SHAPE)
    return PointPicture.of(np.stack([x, y, z], axis=-1), np.isfinite(z), AWAY)


def ball(centre: tuple[float, float, float], radius: float) -> np.ndarray:
    x, y = grid()
    square = radius**2 - (x - centre[0]) ** 2 - (y - centre[1]) ** 2
    return centre[2] + np.sqrt(np.where(square > 0, square, np.nan))


def tilted_steps(turn: np.ndarray, heights: tuple[float, ...], *, ground: bool = True) -> np.ndarray:
    """Treads of 14 mm, side by side along x and 30 mm long, on a ground that goes on."""
    x, y = grid()
    z = -(x * turn[0, 2] + y * turn[1, 2]) / turn[2, 2] + (0.0 if ground else np.nan)
    for k, height in enumerate(heights):
        top = (height - x * turn[0, 2] - y * turn[1, 2]) / turn[2, 2]
        local = np.stack([x, y, top], axis=-1) @ turn
        edge = 14.0 * (k - len(heights) / 2)
        on = (local[..., 0] >= edge) & (local[..., 0] < edge + 14) & (np.abs(local[..., 1]) < 15)
        z = np.where(on, np.fmax(top, z), z)
    return z


def numbers_of(target, seen: PointPicture) -> dict[str, float]:
    probe = volume_probe(target, seen)
    cloud = seen.points.reshape(-1, 3)
    return probe.numbers([cloud[group] for group in probe.groups])


def test_a_ball_on_a_tilted_ground_is_found_and_measured() -> None:
    ground = 0.3 * grid()[0] - 40
    target = parse_target(ABOUT | {"kind": "sphere", "diameter_mm": {"value": 30.0, "u": 0.001}})
    found = numbers_of(target, picture(np.fmax(ball((5, -8, -20), 15), ground)))
    # A cap of 50 deg of some 2000 points: the diameter is known to about eight times the noise over their root.
    assert found["size"] == pytest.approx(30.0, abs=0.01)


def test_balls_of_a_bar_are_counted_from_the_left_and_their_distance_is_that_of_the_centres() -> None:
    both = np.fmax(ball((-30, 5, 0), 12), ball((25, -10, 14), 12))
    sizes = {"diameters_mm": {"value": [24.0, 24.0], "u": 0.001}, "spacing_mm": {"value": 58.7, "u": 0.001}}
    seen = picture(both)
    probe = volume_probe(parse_target(ABOUT | {"kind": "ball-bar"} | sizes), seen)
    cloud = seen.points.reshape(-1, 3)
    assert cloud[probe.groups[0], 0].mean() < 0 < cloud[probe.groups[1], 0].mean()
    found = probe.numbers([cloud[group] for group in probe.groups])
    assert found["spacing"] == pytest.approx(np.sqrt(55**2 + 15**2 + 14**2), abs=0.003)


@pytest.mark.parametrize("ground", [True, False])
def test_steps_are_counted_over_what_they_stand_on_or_from_the_lowest(ground: bool) -> None:
    heights = (4.0, 8.0, 12.0)
    seen = picture(tilted_steps(turned(12.0, -15.0), heights, ground=ground))
    wide = {"width_mm": {"value": [14.0] * 3, "u": 0.01}, "length_mm": {"value": 30.0, "u": 0.01}}
    target = parse_target(ABOUT | {"kind": "steps", "heights_mm": {"value": list(heights), "u": 0.001}} | wide)
    found = numbers_of(target, seen)
    over = {f"step of {h:g} mm": h for h in heights}
    if not ground:
        over = {f"step of {h:g} mm over that of 4 mm": h - 4 for h in heights[1:]}
    for name, height in over.items():
        assert found[name] == pytest.approx(height, abs=0.005)  # means of 400 points and more: 0.0005
    assert found["amplification coefficient"] == pytest.approx(1.0, abs=1e-3)


def test_a_flat_is_judged_by_the_largest_plane_and_its_bows() -> None:
    x, y = grid()
    bowed = 0.2 * x - 0.1 * y - 0.05 * (x / 50) ** 2 + 0.02 * (x / 50) * (y / 37.5)
    beside = np.where((np.abs(x) < 8) & (np.abs(y) < 8), 15.0, bowed)  # a block lies on it
    target = parse_target(ABOUT | {"kind": "flat", "flatness_mm": {"value": 0.0, "u": 0.001}})
    found = numbers_of(target, picture(beside))
    # Distances are along the normal: less than along z by the tilt's cosine.
    cosine = 1 / np.sqrt(1 + 0.2**2 + 0.1**2)
    assert found["bow along columns"] == pytest.approx(0.05 * cosine, abs=0.004)
    assert found["bow along rows"] == pytest.approx(0.0, abs=0.004)
    assert found["twist"] == pytest.approx(0.02 * cosine, abs=0.004)


def test_what_is_not_there_is_refused_with_the_reason() -> None:
    flat = picture(0.1 * grid()[0])
    with pytest.raises(FitError, match="no ball of 30 mm"):
        volume_probe(parse_target(ABOUT | {"kind": "sphere", "diameter_mm": {"value": 30.0, "u": 0.001}}), flat)
    wedge = {"kind": "wedge", "width_mm": {"value": 30, "u": 1}, "length_mm": {"value": 30, "u": 1},
             "angle_deg": {"value": 10, "u": 0.1}}  # fmt: skip
    with pytest.raises(FitError, match="use flat, steps, sphere or ball-bar"):
        volume_probe(parse_target(ABOUT | wedge), flat)
