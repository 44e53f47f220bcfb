"""The centre of distortion against a known one: points of a tilted sheet through a lens, in closed form."""

import numpy as np
import pytest

from fringecal.camera.distortion.distortion_test import examine_distortion
from fringecal.camera.distortion.line_spacing import line_spacing_px
from fringecal.camera.lens.radial_lens import RadialLens
from fringecal.detect.grid.grid_search import FAMILIES, GridDetection, GridLine
from fringecal.detect.grid.line_profile import LineProfile

CENTRE = (1133.7, 1273.8)


def sheet(tilt, *, noise_px=0.05, other=None, seed=1):
    """34 x 40 lines, 62.3 px apart, before 2560 x 2160 px; `other` adds a displacement that no radial lens has."""
    rng = np.random.default_rng(seed)
    row, column = (axis.ravel() for axis in np.mgrid[:34, :40])
    x, y = (column - 19.5) * 62.3, (row - 16.5) * 62.3
    depth = 1 + (tilt[0] * x + tilt[1] * y) / 1246
    ideal = np.stack([x / depth + 1279.5, y / depth + 1079.5], axis=1)
    points = RadialLens(CENTRE, 1674.8, (0.00612, 0.00028)).distort(ideal)
    if other is not None:
        points = points + other(points / 1674.8)
    points = points + rng.normal(0, noise_px, points.shape)
    sigma = np.full(len(row), noise_px)
    lines = [
        GridLine(family, k, *points[index == k].T, sigma[index == k], np.zeros((index == k).sum(), np.int64))
        for family, index in zip(FAMILIES, (row, column), strict=True)
        for k in np.unique(index).tolist()
    ]
    return GridDetection(row, column, *points.T, sigma, tuple(lines), (2160, 2560), "dark", LineProfile(4.0, 0.8))


@pytest.mark.parametrize("tilt", [(0.0, 0.0), (-0.0004, -0.0016)])
def test_centre_is_found_beside_a_tilt(tilt):
    found = [examine_distortion(sheet(tilt, seed=seed)).centre for seed in range(4)]
    error = np.array([[u.value - CENTRE[0], v.value - CENTRE[1]] for u, v in found])
    u = np.array([[each.u for each in centre] for centre in found])
    # Of eight coordinates, none further than 4 u (1 in 15 000 by chance), and the fit tells the centre to 10 px.
    assert np.abs(error / u).max() < 4
    assert u.max() < 10


def test_without_tilt_the_centre_is_somewhere_else():
    tilted = sheet((-0.0004, -0.0016))
    centre = examine_distortion(tilted, centre="free", perspective=False).lens.centre_px
    # To first order a tilt t bends lines as a shift of the centre by t / (2 k1) half diagonals: over 100 px here.
    assert np.hypot(centre[0] - CENTRE[0], centre[1] - CENTRE[1]) > 100


def test_u_of_the_centre_knows_what_no_radial_lens_explains():
    def bend(at):
        return 0.1 * np.stack([np.sin(3 * at[:, 1]), np.cos(4 * at[:, 0])], axis=1)

    centre = examine_distortion(sheet((0.0, 0.0), other=bend)).centre
    error = np.array([centre[0].value - CENTRE[0], centre[1].value - CENTRE[1]])
    u = np.array([each.u for each in centre])
    # Scatter alone would say 3 px; a bend of 0.1 px displaces the centre by tens of px.
    assert np.hypot(*error) > 10
    assert np.all(np.abs(error) < 5.84 * u)  # 99 % of Student's t for 3 degrees of freedom
    assert centre[0].dof == 3


def test_spacing_once_the_lens_is_taken_out():
    grid = sheet((0.0, 0.0))
    lens = examine_distortion(grid).lens
    after = line_spacing_px(grid, lens)
    for family in FAMILIES:
        # The lens is known but for a common stretch: k1 alone says how large the middle is. 0.02 px of 62.3.
        assert after[family].value == pytest.approx(62.3, abs=0.02)
        assert line_spacing_px(grid)[family].value - 62.3 > 0.1
