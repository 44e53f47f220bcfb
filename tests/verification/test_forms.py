"""Form, size and spacing of spheres and planes against closed forms (exact lattice sphere, normal noise, a bowl)."""

import itertools

import numpy as np
import pytest

from fringecal.errors import FitError
from fringecal.verification.forms.fitted_forms import (
    fit_plane,
    fit_sphere,
    flatness,
    sphere_form,
    sphere_size,
    sphere_spacing,
)

LATTICE = np.array([d for d in itertools.product((-1, 0, 1), repeat=3) if any(d)], float)


def lattice_sphere() -> np.ndarray:
    """26 directions with radii 25.030 (faces), 24.990 (edges), 24.9925 (corners): mean deviation exactly 0."""
    deviation = np.array([0.030, -0.010, -0.0075])[np.count_nonzero(LATTICE, axis=1) - 1]
    return LATTICE / np.linalg.norm(LATTICE, axis=1)[:, None] * (25 + deviation)[:, None]


def cap(half_angle_deg: float, n: int, rng: np.random.Generator, *, radius: float = 25.0) -> np.ndarray:
    height = rng.uniform(np.cos(np.deg2rad(half_angle_deg)), 1, n)
    around = rng.uniform(0, 2 * np.pi, n)
    across = np.sqrt(1 - height**2)
    return radius * np.stack([across * np.cos(around), across * np.sin(around), height], axis=1)


def test_exact_lattice_sphere() -> None:
    points = lattice_sphere() + [10.0, -4.0, 25.0]
    form, fit = sphere_form(points, discard=0.0)
    assert form.value_mm == pytest.approx(0.0400, abs=1e-9)
    assert fit.diameter_mm == pytest.approx(50.0, abs=1e-9)
    assert fit.centre_mm == pytest.approx([10.0, -4.0, 25.0], abs=1e-9)
    assert sphere_size(points, 49.9) == pytest.approx(0.1, abs=1e-9)


def test_three_definitions_on_the_same_noise() -> None:
    # Laws for normal noise of 10 um: 2 x 2.968 sigma and 3.92 sigma; the range of 35 000 about 8.5 sigma.
    # Their scatter at this number of points is about 1 %.
    rng = np.random.default_rng(1)
    points = cap(90, 35_000, rng)
    points += points / 25 * rng.normal(0, 0.010, 35_000)[:, None]
    assert sphere_form(points)[0].value_mm == pytest.approx(2 * 2.968 * 0.010, rel=0.03)
    assert sphere_form(points, definition="iso10360-13")[0].value_mm == pytest.approx(0.0392, rel=0.03)
    everything = sphere_form(points, discard=0.0)[0]
    assert 0.075 < everything.value_mm < 0.105
    assert everything.discarded_share == 0
    assert everything.points == 35_000


@pytest.mark.parametrize(
    ("half_angle_deg", "sd_diameter", "sd_free", "sd_fixed"), [(30, 6.1, 3.2, 0.16), (60, 1.4, 0.88, 0.19)]
)
def test_a_small_cap_wants_a_fixed_radius(
    half_angle_deg: int, sd_diameter: float, sd_free: float, sd_fixed: float
) -> None:
    rng = np.random.default_rng(2)
    found = []
    for _ in range(100):
        points = cap(half_angle_deg, 5000, rng)
        points += points / 25 * rng.normal(0, 0.010, 5000)[:, None]
        free, fixed = fit_sphere(points), fit_sphere(points, radius_mm=25.0)
        found.append((free.diameter_mm, free.centre_mm[2], fixed.centre_mm[2]))
    # The standard deviation of 100 values scatters by 7 %: three of it.
    assert 1e3 * np.std(found, axis=0) == pytest.approx([sd_diameter, sd_free, sd_fixed], rel=0.21)


def test_flatness_of_a_bowl() -> None:
    # On a raster of 5 mm; a finer one tends to rms 0.0147 (2e-6 sqrt(4 (150^4 + 100^4) / 45)) and width 0.0485.
    x, y = np.meshgrid(np.linspace(-150, 150, 61), np.linspace(-100, 100, 41))
    bowl = np.stack([x, y, 2e-6 * (x**2 + y**2)], axis=-1).reshape(-1, 3)
    form, fit = flatness(bowl, discard=0.0)
    assert form.value_mm == pytest.approx(0.0650, abs=1e-4)
    assert np.std(fit.residual_mm) == pytest.approx(0.0152, abs=5e-5)
    assert flatness(bowl, definition="iso10360-13")[0].value_mm == pytest.approx(0.0500, abs=1e-4)


def test_a_plane_is_found_at_any_tilt() -> None:
    rng = np.random.default_rng(3)
    normal = np.array([0.3, -0.2, 0.9]) / np.linalg.norm([0.3, -0.2, 0.9])
    points = rng.normal(size=(50, 3)) * 30
    points -= ((points - [1, 2, 3]) @ normal)[:, None] * normal
    fit = fit_plane(points)
    assert fit.normal == pytest.approx(normal, abs=1e-12)
    assert np.abs(fit.residual_mm).max() < 1e-12


def test_spacing_of_two_balls() -> None:
    rng = np.random.default_rng(4)
    first = cap(50, 500, rng, radius=10.0)
    second = cap(50, 500, rng, radius=12.0) + [60.05, 0, 2]
    expected = np.hypot(60.05, 2) - 60.0
    assert sphere_spacing(first, second, (20.0, 24.0), 60.0) == pytest.approx(expected, abs=1e-9)


def test_what_is_no_sphere_or_plane_is_refused() -> None:
    flat = np.column_stack([np.random.default_rng(5).normal(size=(20, 2)), np.zeros(20)])
    with pytest.raises(FitError, match="plane"):
        fit_sphere(flat)
    with pytest.raises(FitError, match="line"):
        fit_plane(np.outer(np.arange(5.0), [1, 2, 3]))
    with pytest.raises(FitError, match="at least 4"):
        fit_sphere(np.full((10, 3), np.nan))
    with pytest.raises(ValueError, match="definition"):
        sphere_form(lattice_sphere(), definition="mine")  # type: ignore[arg-type]
