"""Pictures of grid and plate that are not what the session says: the picture is named."""

from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest

from fringecal.workflows.commission.calibrated_session import _pose_of_plate
from fringecal.workflows.commission.checks import evenness_check


@pytest.fixture
def rng():
    return np.random.default_rng(11)


def lines(distances):
    """Make the table of distances of neighbouring lines."""
    number = np.arange(len(distances))
    return pd.DataFrame({"first_line": number, "last_line": number + 1, "span": 1, "distance_px": distances})


def test_rows_missing_in_the_grids_picture_are_named(rng):
    even = 20 + np.linspace(-0.4, 0.4, 24) + 0.03 * rng.standard_normal(24)  # perspective
    scale = SimpleNamespace(horizontal_lines=lines(even), vertical_lines=lines(even))
    assert evenness_check(scale).decision == "pass"
    cut = even.copy()
    cut[9] -= 3
    check = evenness_check(SimpleNamespace(horizontal_lines=lines(cut), vertical_lines=lines(even)))
    assert check.decision == "fail"
    assert "between horizontal lines 9 and 10: rows of the grid's picture are missing" in check.rule


def test_an_uneven_sheet_misses_no_rows(rng):
    uneven = 20 + 0.5 * rng.standard_normal(24)
    scale = SimpleNamespace(horizontal_lines=lines(uneven), vertical_lines=lines(uneven))
    assert evenness_check(scale).decision == "pass"


@pytest.mark.parametrize(
    ("pose", "words"),
    [
        (np.s_[:, ::-1], "mirrored left to right"),
        (np.s_[::-1], "mirrored top to bottom"),
        (np.s_[::-1, ::-1], "turned by 180 deg"),
        (np.s_[:], None),
    ],
)
def test_plates_that_are_turned_over_are_named(pose, words):
    v, u = np.mgrid[:120, :160].astype(float)
    phase = np.angle(np.exp(1j * (2 * np.pi * (u + 0.3 * v) / 13 + 0.0004 * (u - 40) ** 2)))
    valid = np.ones(phase.shape, bool)
    plate = SimpleNamespace(phase=SimpleNamespace(phase=phase[pose], valid=valid))
    strips = SimpleNamespace(map=SimpleNamespace(phase=np.where(u % 40 < 18, phase + 2.1, phase), valid=valid))
    assert _pose_of_plate(plate, strips) == words
