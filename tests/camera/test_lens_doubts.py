"""What speaks against a stated lens: published calibrations that failed, closed forms, and lenses as they are built."""

import numpy as np
import pytest

from fringecal.camera import Lens, lens_doubts
from fringecal.camera.lens.lens_doubts import lens_reach

KNOWN = np.diag(np.array([1.0, 1, 1, 1, 1e-3, 1e-3, 1e-4, 1e-4, 1e-3]) ** 2)


def lens(*values, size=(1280, 1024), known=True):
    return Lens(np.array(values, dtype=float), KNOWN if known else np.zeros((9, 9)), *size, covariance_known=known)


def named(doubts):
    return {doubt.name: doubt.refused for doubt in doubts}


# As reported by users: hezhao/Calibrator issue 8, with the camera of a camera and projector, and the projector.
REPORTED_CAMERA = lens(
    3039.117, 4814.029, 644.948, 431.326, 0.44577, -21.77048, -0.018667, 0.020742, 0, size=(1280, 960)
)
REPORTED_PROJECTOR = lens(793.875, 999.942, 345.048, 84.563, 27.608, -2344.558, 7.9734, 10.3601, 0, size=(1024, 768))


def test_an_aspect_of_1_58_and_a_k2_of_minus_2344_are_refused_with_their_reasons():
    camera, projector = lens_doubts(REPORTED_CAMERA), lens_doubts(REPORTED_PROJECTOR, "projector")
    assert named(camera)["pixel aspect"]
    assert "1.584" in next(doubt.sentence for doubt in camera if doubt.name == "pixel aspect")
    assert named(projector)["distortion folds"]
    assert "k2 = -2345" in next(doubt.sentence for doubt in projector if doubt.name == "distortion folds")
    assert named(projector)["tangential terms"]


def test_a_k3_of_minus_24_with_the_centre_pinned_is_refused():
    # 24 of 0.337^6 is 3.5 % of the radius at the corner, while k1 and k2 are none: no fold yet.
    pinned = lens(1900.0, 1900.0, 511.5, 383.5, 0.01, 0.0, 0, 0, -24.0, size=(1024, 768))
    found = named(lens_doubts(pinned, "projector"))
    assert "distortion folds" not in found
    assert found["distortion's terms"]
    assert not found["centre pinned"]
    # Nearer by, it folds: 7 * 24 r^6 passes 1 at r = 0.43.
    wide = lens(1000.0, 1000.0, 511.5, 383.5, 0, 0, 0, 0, -24.0, size=(1024, 768))
    assert named(lens_doubts(wide, "projector"))["distortion folds"]


@pytest.mark.parametrize(("k1", "k2", "k3"), [(-1.0, 0, 0), (0, -3.0, 0), (0, 0, -24.0), (0.5, -6.0, 0)])
def test_the_fold_is_where_the_polynomial_has_its_maximum(k1, k2, k3):
    # d/dr of r (1 + k1 r^2 + k2 r^4 + k3 r^6) = 0, by the roots of a cubic in r^2.
    roots = np.roots([7 * k3, 5 * k2, 3 * k1, 1.0])
    r2 = min(root.real for root in roots if abs(root.imag) < 1e-12 and root.real > 0)
    at_px = 1000 * np.sqrt(r2) * (1 + r2 * (k1 + r2 * (k2 + r2 * k3)))
    far = lens(1000.0, 1000.0, 1500.0, 1500.0, k1, k2, 0, 0, k3, size=(3001, 3001))
    # The radius is interpolated to a per cent, and the polynomial is flat at its maximum.
    assert lens_reach(far).fold_px == pytest.approx(at_px, rel=1e-4)


def test_a_fold_outside_the_picture_is_none():
    # k1 = -1 folds at 577 ideal px, which are 385 px in the picture; the corner of this one is at 354 px.
    assert lens_reach(lens(1000.0, 1000.0, 250.0, 250.0, -1, 0, 0, 0, 0, size=(501, 501))).fold_px is None
    assert lens_reach(lens(1000.0, 1000.0, 280.0, 280.0, -1, 0, 0, 0, 0, size=(561, 561))).fold_px is not None


def test_the_corner_is_where_the_last_ray_is_seen():
    plain = lens_reach(lens(1000.0, 1000.0, 639.5, 511.5, 0, 0, 0, 0, 0))
    # One of 72 directions runs within 2.5 deg of the corner.
    assert plain.corner == pytest.approx(np.hypot(640, 512) / 1000, rel=0.04)
    assert plain.least_slope == pytest.approx(1.0)


@pytest.mark.parametrize(
    ("values", "device", "name"),
    [
        ((1700, 1700, 1240, 500), "camera", "principal point"),  # of twice the resolution
        ((100, 100, 630, 500), "camera", "field of view"),
        ((60000, 60000, 630, 500), "camera", "field of view"),
        ((1700, 1700, 639.5, 511.5), "camera", "centre pinned"),
        ((1700, 1700, 640, 512), "projector", "centre pinned"),
        ((1700, 1735, 630, 500), "camera", "pixel aspect"),
        ((1700, 1735, 630, 500), "projector", "pixel aspect"),
        ((1700, 3400, 630, 500), "camera", "pixel aspect"),
    ],
)
def test_each_is_named(values, device, name):
    assert name in named(lens_doubts(lens(*values, 0, 0, 0, 0, 0), device))


@pytest.mark.parametrize(
    ("values", "device", "aspect"),
    [
        ((1700, 1702, 630, 500, -0.2, 0.1, 1e-4, 2e-4, 0.02), "camera", None),
        # A DLP4500's diamonds, and a projector that throws upward by half of its frame.
        ((1736, 3470, 443, 588, -0.05, 0.01, 1e-4, 2e-4, 0), "projector", None),
        ((2500, 2498, 990, 1180, -0.04, -0.02, 7e-4, 1e-3, 0), "projector", None),
        # 1024 columns shown on the width of 1280: rows lie nearer together than columns.
        ((1360, 1700, 630, 500, 0, 0, 0, 0, 0), "projector", 0.8),
    ],
)
def test_devices_as_they_are_built_raise_no_doubt(values, device, aspect):
    size = {"camera": (1280, 1024), "projector": (1920, 1080)}[device]
    size = (912, 1140) if values[0] == 1736 else (1280, 1024) if aspect else size
    assert lens_doubts(lens(*values, size=size), device, pixel_aspect=aspect) == ()


def test_no_uncertainty_is_open_and_an_unknown_focal_length_refused():
    values = (1700, 1702, 630, 500, -0.2, 0.1, 1e-4, 2e-4, 0.02)
    assert named(lens_doubts(lens(*values, known=False))) == {"no uncertainty": False}
    poor = Lens(np.array(values, dtype=float), 2500 * KNOWN, 1280, 1024)  # 50 px of 1700
    assert named(lens_doubts(poor))["focal length undetermined"]


def random_lens(rng):
    """A lens as they are built, by shares of the radius at the corner; for camera or projector."""
    device = "camera" if rng.random() < 0.5 else "projector"
    width = int(rng.integers(600, 5000))
    size = (width, int(width * rng.uniform(0.5, 1.0)))
    focal = width * rng.uniform(0.6, 6.0)
    up = rng.uniform(0, 0.75) if device == "projector" else 0.0
    centre = [(size[0] - 1) / 2 * (1 + rng.normal(0, 0.03)), (size[1] - 1) * (0.5 + up) * (1 + rng.normal(0, 0.03))]
    shape = rng.choice([1.0, 1.0, 2.0, 0.5]) if device == "projector" else 1.0
    far = [max(c, side - c) for c, side in zip(centre, size, strict=True)]
    corner = np.hypot(far[0], far[1] / shape) / focal
    k1 = rng.uniform(-0.1, 0.05)
    k2 = k1 * rng.uniform(-0.5, 0.15)  # a polynomial all of whose terms are -0.1 does fold inside the picture
    k3 = k2 * rng.uniform(-0.5, 0.15)
    tangential = rng.normal(0, 0.001, 2) / 3
    terms = [k1 / corner**2, k2 / corner**4, *tangential / corner, k3 / corner**6]
    return lens(focal, focal * shape * (1 + rng.normal(0, 0.002)), *centre, *terms, size=size), device


def test_of_many_lenses_as_they_are_built_none_is_refused():
    # Odd seeds: no limit was chosen by them.
    refused = {}
    for seed in range(1, 240, 2):
        found, device = random_lens(np.random.default_rng(seed))
        doubts = [doubt for doubt in lens_doubts(found, device) if doubt.refused]
        if doubts:
            refused[seed] = doubts
    assert refused == {}
