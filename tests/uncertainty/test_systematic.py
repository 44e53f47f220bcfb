"""Random and systematic parts of a map: closed forms, a full covariance, and the libraries' answer."""

import math

import numpy as np
import pytest
from uncertainties import covariance_matrix, ufloat

from fringecal.uncertainty.systematic import combined_map, linear_uncertainty, mean_uncertainty


def test_average_keeps_the_systematic_part():
    u = mean_uncertainty(np.full(10_000, 0.05), sensitivities=np.ones((1, 10_000)), covariance=[0.03])
    assert u == pytest.approx(math.hypot(0.05 / 100, 0.03))


def test_against_the_full_covariance():
    rng = np.random.default_rng(8)
    u_r, c = rng.uniform(0.1, 0.3, 40), rng.normal(0, 1, (3, 40))
    root = rng.normal(0, 0.1, (3, 3))
    matrix = root @ root.T
    full = np.diag(u_r**2) + c.T @ matrix @ c
    w = rng.normal(0, 1, 40)
    found = linear_uncertainty(w, u_r, sensitivities=c, covariance=matrix)
    assert found == pytest.approx(math.sqrt(w @ full @ w), rel=1e-12)
    assert combined_map(u_r, c, matrix) == pytest.approx(np.sqrt(np.diag(full)), rel=1e-12)


def test_map_of_any_shape():
    found = combined_map(np.full((4, 5), 3.0), np.full((1, 4, 5), 2.0), [2.0])
    assert found.shape == (4, 5)
    assert found == pytest.approx(np.full((4, 5), 5.0))


def test_flank_slope_against_uncertainties():
    """A slope through heights with a common scale error, worked by the library from independent numbers."""
    across = np.linspace(0, 20, 9)
    scale = ufloat(1.0, 0.01)
    heights = [scale * z + ufloat(0, 0.05) for z in across]
    centred = across - across.mean()
    slope = sum(w * h for w, h in zip(centred / (centred @ centred), heights, strict=True))
    found = linear_uncertainty(centred / (centred @ centred), 0.05, sensitivities=[across], covariance=[0.01])
    assert found == pytest.approx(slope.std_dev, rel=1e-9)
    assert np.sqrt(np.diag(covariance_matrix(heights))) == pytest.approx(
        combined_map(np.full(9, 0.05), across[None], [0.01])
    )


def test_sizes_must_agree():
    with pytest.raises(ValueError, match="2 sensitivity maps"):
        mean_uncertainty([0.1, 0.1], sensitivities=[[1, 1], [1, 1]], covariance=[0.1])
