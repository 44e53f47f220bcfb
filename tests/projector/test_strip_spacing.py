"""The distance of strips by the grid's scale against the stated one, on drawn phase whose strips are known."""

from types import SimpleNamespace

import numpy as np
import pytest

from fringecal.detect import StripRegions
from fringecal.projector import strip_spacing
from fringecal.projector.standards.strip_phase import StripPhase
from fringecal.targets import Strips
from fringecal.uncertainty import Estimate, en_score

SHAPE = (60, 520)
SCALE = 0.5  # mm/px


@pytest.fixture
def rng():
    return np.random.default_rng(11)


def strips(count=6, u=0.01):
    quantity = {"value": 12.0, "u": u}
    return Strips(
        format=1, kind="strips", name="s", certificate="drawn", count=count, width_mm=quantity,
        gap_mm={"value": 16.0, "u": u}, height_mm={"value": 3.0, "u": 0.01}, length_mm={"value": 100.0, "u": 0.1},
    )  # fmt: skip


def drawn(rng, *, enlarged=1.0, coarse_off=0.0, shadow=3, step=2.2):
    """Draw the phase over strips of 24 px and gaps of 32 px from 20.3 px on; one side of each strip lies in shadow."""
    u = np.arange(SHAPE[1]) + np.zeros(SHAPE)
    starts = 20.3 + 56.0 * enlarged * np.arange(6)
    edges = np.column_stack([starts, starts + 24.0 * enlarged])
    phase = 0.05 * rng.standard_normal(SHAPE)
    for low, high in edges:
        covered = np.clip(u + 0.5 - low, 0, 1) * np.clip(high - u + 0.5, 0, 1)  # of a pixel
        phase += step * covered
        phase[(u > high + 0.5) & (u < high + shadow)] = np.nan
    labels = np.zeros(SHAPE, np.int16)
    for k, (low, high) in enumerate(edges):
        labels[(u > low + 4) & (u < high - 4)] = k + 1
    found = edges * (1 + coarse_off) + 0.6  # as a comb of another size puts them
    return StripPhase(StripRegions(labels, 90.0, u, found), phase, labels, (), 0.0, strips()), phase


def camera(u=0.00005):
    return SimpleNamespace(scale=lambda _: Estimate(SCALE, u, "mm/px"))


@pytest.mark.parametrize("coarse_off", [0.0, -0.004])
@pytest.mark.parametrize("step", [2.2, 5.0])
def test_the_distance_is_that_of_the_phase_wherever_the_comb_lies(rng, coarse_off, step):
    spacing = strip_spacing(*drawn(rng, coarse_off=coarse_off, step=step), camera())
    assert spacing.stated.value == 28.0
    # One u for all widths and one for all gaps: 0.01 mm each in every distance.
    assert spacing.stated.u == pytest.approx(np.hypot(0.01, 0.01))
    assert spacing.by_grid.value == pytest.approx(28.0, abs=0.02)  # 0.1 px in an edge, six strips
    assert abs(en_score(spacing.by_grid, spacing.stated)) < 1


def test_a_grid_printed_half_a_percent_too_small_is_seen(rng):
    # The stated pitch is 0.5 % more than the sheet's: strips seem that much farther apart.
    spacing = strip_spacing(*drawn(rng), SimpleNamespace(scale=lambda _: Estimate(SCALE / 0.995, 5e-5, "mm/px")))
    assert spacing.ratio == pytest.approx(1 / 0.995, abs=0.001)
    assert en_score(spacing.by_grid, spacing.stated) > 2


def test_u_of_the_scale_belongs_to_the_distance(rng):
    found, phase = drawn(rng)
    assert strip_spacing(found, phase, camera(0.005)).by_grid.u == pytest.approx(0.28, rel=0.02)


def test_fewer_than_three_whole_strips_say_nothing(rng):
    found, phase = drawn(rng)
    assert strip_spacing(found, np.where(np.arange(SHAPE[1]) < 120, phase, np.nan), camera()) is None
