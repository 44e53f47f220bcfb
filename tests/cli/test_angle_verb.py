"""`fringecal angle` from two grey pictures, as the thesis had them, and what it says of wrong ones."""

import json
import shutil
from types import SimpleNamespace

import pytest

from fringecal.cli.angle import _table
from fringecal.uncertainty.estimates import Estimate


@pytest.fixture
def two_pictures(data, tmp_path):
    """Grid and strips, one picture each, no phase shifting."""
    folder = tmp_path / "two"
    folder.mkdir()
    for name in ("grid.png", "strips-0.png", "t-grid.toml", "t-strips.toml"):
        shutil.copy(data / "oblique" / name, folder)
    (folder / "session.toml").write_text(
        """format = 1
rig = "two pictures"
captured = 2026-11-20T10:00:00Z

[camera]
height_mm = { value = 1102.0, u = 3.0 }

[projector]
position_mm = { value = [-179.0, -952.0, 982.0], u = [3.0, 3.0, 3.0] }

[phase]
steps_deg = []

[[capture]]
name = "grid"
kind = "grid"
target = "t-grid.toml"
images = ["grid.png"]

[[capture]]
name = "strips"
kind = "strips"
target = "t-strips.toml"
images = ["strips-0.png"]
"""
    )
    return folder


def test_two_pictures_are_enough(run, data, two_pictures, tmp_path):
    outcome = run("angle", two_pictures, "--out", tmp_path / "out", "--json")
    assert outcome.code == 0
    found = outcome.document
    truth = json.loads((data / "oblique" / "truth.json").read_text())
    assert found["estimator"] == "ridge"
    assert "normal" in found["convention"]
    # The bar of the ridge's mean is 0.1 deg; its stated u must cover what it errs by.
    error = found["angle"]["value"] - truth["angle_origin_deg"]
    assert abs(error) < min(0.1, 3 * found["angle"]["u"])
    assert found["projector"]["agrees"]
    assert len(found["columns"]) == 8
    assert len(found["breaks"]["strip"]) == len(found["breaks"]["shift_px"]) > 500
    assert {"report.html", "breaks.csv"} <= {path.name for path in (tmp_path / "out").iterdir()}


def test_phase_needs_phase_shifted_pictures(run, two_pictures):
    outcome = run("angle", two_pictures, "--estimator", "phase")
    assert outcome.code == 1
    assert "reference" in outcome.stderr


def test_an_unknown_estimator_is_a_matter_of_usage(run, two_pictures):
    outcome = run("angle", two_pictures, "--estimator", "spline")
    assert outcome.code == 2
    assert "skeleton" in outcome.stderr


def test_columns_that_would_be_empty_are_left_out():
    """Without a stated lamp there is no theory to print, and no En."""
    angle, lamp = Estimate(44.1, 0.06, "deg"), Estimate(44.09, 0.05, "deg")
    with_lamp, without = (set(headings_of(angle, theory)) for theory in (lamp, None))
    assert with_lamp - without == {"theory/deg", "En"}
    assert "apparent/deg" in without


def headings_of(angle, theory):
    at = {"axis": "u", "place_mm": 1.0, "breaks": 70, "shift_px": 5.8, "apparent_deg": 44.2}
    row = SimpleNamespace(**at, angle=angle, theory=theory, en=None if theory is None else 0.1)
    found = SimpleNamespace(estimator="ridge", angle=angle, apparent=angle, theory=theory, columns=(row,), rows=())
    return [column.header for column in _table(found).columns]
