"""Fringes' centres in drawn pictures whose centres are known in closed form."""

import numpy as np
import pytest

from fringecal.detect.fringes.ridge import grey_noise, ridge_centres
from fringecal.detect.fringes.skeleton import skeleton_centres, thinned
from fringecal.errors import DetectionError


def fringes(period, *, slope=0.0, shape=(120, 90), noise=0.0, gradient=0.0, offset=0.0, seed=0):
    """Fringes along rows; `slope` tilts them, `gradient` is the relative fall of the light from top to bottom."""
    v, u = np.mgrid[: shape[0], : shape[1]].astype(float)
    light = 1 - gradient * v / shape[0]
    grey = light * (120 + 90 * np.cos(2 * np.pi * (v - offset - slope * u) / period))
    return grey + noise * np.random.default_rng(seed).standard_normal(shape)


def errors(found, period, *, slope=0.0, offset=0.0):
    """Distance of each centre from the nearest true one; inner rows only, a window's width from the rim."""
    turns = (found.v_px - offset - slope * found.u_px) / period
    half = np.where(found.bright, 0.0, 0.5)
    inner = (found.v_px > period) & (found.v_px < 119 - period) & (found.u_px > 4) & (found.u_px < 85)
    return ((turns - half - np.round(turns - half)) * period)[inner]


@pytest.mark.parametrize("period", [6.0, 10.77, 23.3, 40.0])
def test_ridges_and_valleys_are_where_the_cosine_has_them(period):
    found = ridge_centres(fringes(period, slope=0.03, offset=1.7), period)
    off = errors(found, period, slope=0.03, offset=1.7)
    assert off.size > 100
    # The straight line between two pixels errs by w^2 / 62 px at most: 0.018 px at 6 px a period.
    assert np.abs(off).max() < (2 * np.pi / period) ** 2 / 62 + 1e-3
    assert abs(off.mean()) < 1e-3


def test_uneven_light_moves_ridges_and_valleys_in_opposite_ways():
    found = ridge_centres(fringes(16.0, gradient=0.5), 16.0)
    turns = found.v_px / 16.0
    half = np.where(found.bright, 0.0, 0.5)
    off = (turns - half - np.round(turns - half)) * 16
    inner = (found.v_px > 16) & (found.v_px < 104)
    bright, dark = off[inner & found.bright].mean(), off[inner & ~found.bright].mean()
    # A Gaussian of s turns l (A + B cos) into l A + a B (l cos - l' s^2 w sin), a = exp(-(s w)^2 / 2). Its derivative
    # vanishes l'/l (A +- a B (1 - s^2 w^2)) / (a B w^2) off, and s w is 1.
    moved = -0.5 / 120 / (1 - 0.25) * 120 / (90 * np.exp(-0.5)) / (2 * np.pi / 16) ** 2
    assert bright == pytest.approx(moved, rel=0.1)  # the light is taken at the middle
    assert dark == pytest.approx(-moved, rel=0.1)
    assert abs(bright + dark) < 0.05 * abs(moved)  # two whole ridges more than valleys are in the range


def test_stated_sigma_is_the_scatter():
    found = ridge_centres(fringes(12.0, noise=4.0), 12.0)
    off = errors(found, 12.0)
    assert np.median(found.sigma_px) == pytest.approx(off.std(), rel=0.15)  # 1500 points, four of them hang together


def test_noise_is_seen_through_fringes():
    assert grey_noise(fringes(12.0, noise=3.0)) == pytest.approx(3.0, rel=0.1)
    assert grey_noise(fringes(12.0)) == pytest.approx(1 / np.sqrt(12))  # rounding at least


def test_fringes_along_columns_are_the_same_turned():
    picture = fringes(14.0, slope=0.02)
    straight, turned = ridge_centres(picture, 14.0), ridge_centres(picture.T, 14.0, along="columns")
    assert sorted(zip(straight.u_px, straight.v_px, strict=True)) == sorted(zip(turned.v_px, turned.u_px, strict=True))


def test_a_skeleton_read_as_the_thesis_did_errs_by_whole_rows():
    found = skeleton_centres(fringes(12.0, offset=0.3, noise=1.0), 12.0, whole_rows=True)
    assert np.all(found.v_px % 1 == 0)
    # Half a row of what is thinned, as much again where a band of even width has no middle row; and noise.
    assert 0.1 < np.abs(errors(found, 12.0, offset=0.3)).max() < 1.2
    assert found.bright.all()


@pytest.mark.parametrize("period", [6.0, 12.0, 23.3])
@pytest.mark.parametrize("gradient", [0.0, 0.5])
def test_the_middle_between_a_bands_edges_is_the_fringes_centre(period, gradient):
    """Whole periods would err alike on all fringes if rows were read; edges are interpolated."""
    found = skeleton_centres(fringes(period, offset=0.3, gradient=gradient), period)
    off = errors(found, period, offset=0.3)
    assert off.size > 300
    # A tenth of the 0.29 px by which whole rows err. Light that falls by g per px moves both edges of a band by
    # g / w^2, its local mean by as much again: g is 0.5 / 90 at the lower rim of this picture.
    moved = 2 * gradient / 90 / (2 * np.pi / period) ** 2
    assert abs(off.mean()) < 0.03 + moved
    assert np.abs(off).max() < 0.06 + 2 * moved


def test_a_shift_is_read_alike_wherever_the_fringes_lie_between_the_rows():
    """The common error of a break: whole periods repeat it on every fringe, so that no scatter shows it."""
    random = np.random.default_rng(5)
    wrong = []
    for period in (6.0, 7.0, 8.0, 10.0, 11.0, 12.0, 13.0, 16.0):
        for offset in random.uniform(0, period, 6):
            found = skeleton_centres(fringes(period, offset=offset, shape=(120, 24)), period)
            inner = (found.v_px > 2 * period) & (found.v_px < 119 - 2 * period)
            turns = (found.v_px[inner] - offset) / period
            wrong.append(period * np.mean(turns - np.round(turns)))
    # Whole rows err by up to 0.5 px, evenly: 0.29. A twentieth is 0.2 deg in a break of 4 px at 45 deg, at the worst.
    assert np.max(np.abs(np.subtract.outer(wrong, wrong))) < 0.029


def test_the_stated_sigma_of_a_thinned_lines_reading_is_its_scatter():
    found = skeleton_centres(fringes(12.0, noise=4.0), 12.0)
    off = errors(found, 12.0)
    assert np.median(found.sigma_px) == pytest.approx(off.std(), rel=0.3)  # a median is no mean: 25 % off at most


def test_thinned_lines_are_one_pixel_wide():
    lines = thinned(fringes(12.0, noise=0.1), 12.0)
    inner = lines[12:-12, 6:-6]
    # Seven or eight ridges in 96 rows; one more where a line steps from one row to the next.
    assert set(inner.sum(axis=0)) <= {7, 8, 9}
    # Where a line steps to the next row its two ends may stand one above the other.
    assert np.mean(inner[1:] & inner[:-1]) < 0.1 * np.mean(inner)


@pytest.mark.parametrize("find", [ridge_centres, skeleton_centres])
def test_what_has_no_centres_is_refused(find):
    with pytest.raises(DetectionError, match="too fine|cannot be distinguished"):
        find(fringes(4.0), 4.0)
    with pytest.raises(DetectionError, match="shape"):
        find(np.zeros(30), 12.0)
    with pytest.raises(DetectionError, match="finite"):
        find(np.full((40, 40), np.nan), 12.0)
