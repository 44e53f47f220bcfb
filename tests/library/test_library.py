"""The library on arrays: the numbers of the command to the last digit, refusals that say what to do."""

import hashlib
import json
import pickle
import re
import runpy
from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure

import fringecal
from fringecal.detect import find_grid, grid_of_crossings
from fringecal.errors import DetectionError, RecordError, SessionError
from fringecal.report import views
from fringecal.session import load_session
from fringecal.simulate import simulate_session
from fringecal.workflows.commission import calibration_record

from ..cli.victims import blank

ROOT = Path(__file__).parents[2]
OBLIQUE = ROOT / "tests" / "data" / "oblique"
NOTEBOOKS = sorted((ROOT / "docs" / "notebooks").glob("*.py"))


@pytest.fixture(scope="module")
def frames():
    """The oblique session's frames, as arrays that a camera's driver would give."""
    session = load_session(OBLIQUE)
    return {name: np.array(capture.read()) for name, capture in session.captures.items()}


@pytest.fixture(scope="module")
def calibration(frames):
    return fringecal.calibrate(
        grid=frames["grid"][0],
        grid_target=OBLIQUE / "t-grid.toml",
        plate=frames["reference"],
        strips=frames["strips"],
        strips_target=OBLIQUE / "t-strips.toml",
        artefacts={"bars": (frames["bars"], OBLIQUE / "t-bars.toml")},
        phase_shifts_deg=(0, 120, 240),
        camera_height_mm=fringecal.known(1102.0, u=3.0),
        projector_mm=fringecal.known([-179.0, -952.0, 982.0], u=3.0),
    )


def test_arrays_give_the_numbers_of_the_command_to_the_last_digit(calibration, oblique_commissioned):
    by_session = oblique_commissioned
    rig = by_session.calibrated.result.rig
    np.testing.assert_array_equal(calibration.rig.vector, rig.vector)
    np.testing.assert_array_equal(calibration.rig.covariance, rig.covariance)
    ours, theirs = (json.loads(r.model_dump_json()) for r in (calibration.record, calibration_record(by_session)))
    for key in ("scale", "distortion", "projection", "rig", "budgets", "camera"):
        assert ours[key] == theirs[key], key
    assert [check["value"] for check in ours["checks"]] == [check["value"] for check in theirs["checks"]]


def test_a_surface_is_what_the_truth_is(calibration, frames):
    surface = calibration.measure(frames["bars"], height_range_mm=(-5, 25))
    with np.load(OBLIQUE / "truth.npz") as truth:
        true = truth["bars"] if "bars" in truth.files else truth[truth.files[0]]
    error = (surface.z - true)[surface.mask]
    # The bench's bar on this rig (tests/cli/test_results.py): nine in ten pixels within 1.96 u.
    assert np.mean(np.abs(error) < 1.96 * surface.u_z[surface.mask]) > 0.9
    assert surface.x.shape == surface.mask.shape == frames["bars"].shape[1:]
    mean, u = surface.mean()
    assert u < surface.u_z[surface.mask].mean()
    assert mean == pytest.approx(float(surface.z[surface.mask].mean()))
    frame = surface.to_frame()
    assert len(frame) == surface.mask.sum()
    assert isinstance(surface.plot(), Figure)


def test_a_verification_has_its_table(calibration, frames):
    result = calibration.verify(frames["bars"], OBLIQUE / "t-bars.toml")
    assert result.verdict == "pass"
    assert set(result.table["name"]) >= {"A", "B", "C", "D", "E", "pooled"}
    assert (result.checks["decision"] == "pass").all()
    assert "bars" in repr(result)


def test_saved_and_loaded_it_measures_alike(calibration, frames, tmp_path):
    file = calibration.save(tmp_path / "calibration")
    again = fringecal.Calibration.load(file)
    np.testing.assert_array_equal(again.rig.vector, calibration.rig.vector)
    first, second = (one.measure(frames["strips"]) for one in (calibration, again))
    np.testing.assert_array_equal(first.z, second.z)
    with pytest.raises(RecordError, match="holds no pictures"):
        again.report(tmp_path / "report")


def test_an_audit_of_the_same_rig_finds_no_change(calibration):
    result = fringecal.audit(
        fringecal.Calibration(
            calibration.record.model_copy(
                update={"session": calibration.record.session.model_copy(update={"rig": "oblique"})}
            ),
            calibration.rig,
        ),
        OBLIQUE,
    )
    assert not result.found.changed
    assert "scale" in result.changes.index
    assert result.causes.empty


def test_tables_and_pictures(calibration):
    assert set(calibration.estimates.index) >= {"scale, mean", "projection angle"}
    budget = calibration.budget("scale.mean")
    assert budget["share of the variance / %"].sum() == pytest.approx(100)
    assert budget["contribution to u"].is_monotonic_decreasing
    variance = float((budget["contribution to u"] ** 2).sum())
    assert variance**0.5 == pytest.approx(calibration.estimates.loc["scale, mean", "u"], rel=0.01)
    assert isinstance(calibration.plot(), Figure)
    assert "projection angle" in repr(calibration)
    assert "<table" in calibration._repr_html_()
    with pytest.raises(RecordError, match=r"no budget of 'height'.*projection\.angle"):
        calibration.budget("height")


def test_crossings_stand_in_for_the_picture(calibration, frames):
    found = find_grid(frames["grid"][0])
    given = grid_of_crossings(
        found.row + 7,
        found.column - 3,
        found.u_px,
        found.v_px,
        shape=found.shape,
        sigma_px=found.sigma_px,
        scatter=found.scatter,
    )
    by_crossings = fringecal.calibrate(
        grid=given,
        grid_target=OBLIQUE / "t-grid.toml",
        plate=frames["reference"],
        strips=frames["strips"],
        strips_target=OBLIQUE / "t-strips.toml",
        phase_shifts_deg=(0, 120, 240),
        camera_height_mm=fringecal.known(1102.0, u=3.0),
        projector_mm=fringecal.known([-179.0, -952.0, 982.0], u=3.0),
    )
    # The same crossings and uncertainties: the camera is the same; the index starts elsewhere on the sheet only.
    np.testing.assert_allclose(by_crossings.rig.vector, calibration.rig.vector, rtol=1e-6, atol=1e-9)
    with pytest.raises(RecordError, match="grid's picture"):
        by_crossings.report("nowhere")


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"plate": None}, "no frames of the bare plate; pass plate"),
        ({"phase_shifts_deg": (0, 90, 180, 270)}, "need 4 frames, found 3"),
        ({"plate": "scaled"}, "uint8 or uint16; found float64"),
        ({"plate": "cropped"}, "differ in size"),
        ({"strips": "repeated"}, "two of its frames are identical"),
        ({"session": OBLIQUE}, "either a session or arrays"),
    ],
)
def test_what_contradicts_itself_is_refused(frames, changed, message):
    arrays = {
        "scaled": frames["reference"] / 255.0,
        "cropped": frames["reference"][:, 1:],
        "repeated": frames["strips"][[0, 1, 1]],
    }
    given = {
        "grid": frames["grid"][0],
        "plate": frames["reference"],
        "strips": frames["strips"],
        "phase_shifts_deg": (0, 120, 240),
    }
    given |= {name: arrays.get(value, value) if isinstance(value, str) else value for name, value in changed.items()}
    with pytest.raises(SessionError, match=message):
        fringecal.calibrate(**given)


def test_a_target_without_heights_is_refused(calibration, frames):
    with pytest.raises(SessionError, match="heights cannot be verified on it"):
        calibration.verify(frames["bars"], "grid-10mm")


@pytest.mark.parametrize(
    ("changed", "message"),
    [({"row": [0.5, 1, 2]}, "whole numbers"), ({"u_px": [1.0, 2.0]}, "of one length"), ({}, "3 x 3 lines")],
)
def test_crossings_that_are_none_are_refused(changed, message):
    given = {"row": [0, 1, 2], "column": [0, 0, 0], "u_px": [1.0, 1.0, 1.0], "v_px": [1.0, 9.0, 17.0]} | changed
    with pytest.raises(DetectionError, match=message):
        grid_of_crossings(**given, shape=(100, 100))


def test_the_lines_of_the_readme_run(frames, tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(views, "_encoded", blank)  # tests/workflows/test_reports.py draws them
    (lines,) = re.findall(r"```python\n(.*?)```", (ROOT / "README.md").read_text(encoding="utf-8"), flags=re.DOTALL)
    (tmp_path / "session").symlink_to(OBLIQUE, target_is_directory=True)
    monkeypatch.chdir(tmp_path)
    left = {"frames": frames["strips"]}
    exec(compile(lines, "README.md", "exec"), left)
    assert left["surface"].mask.mean() > 0.5  # the plate; strips are set apart, their order open without a height range
    assert "projection angle" in capsys.readouterr().out
    assert (tmp_path / "calibration" / "calibration.json").is_file()


def shared(function):
    """Call a function once for the same arguments, arrays being the same by their bytes."""
    kept = {}

    def called(*arguments, **named):
        key = hashlib.sha256(pickle.dumps((arguments, sorted(named.items())))).digest()
        if key not in kept:
            kept[key] = function(*arguments, **named)
        return kept[key]

    return called


DRAWN, CALIBRATED = shared(simulate_session), shared(fringecal.calibrate)


@pytest.mark.parametrize("notebook", NOTEBOOKS, ids=lambda path: path.stem)
def test_the_notebooks_run(notebook, monkeypatch, capsys):
    monkeypatch.chdir(ROOT)
    monkeypatch.setattr("fringecal.simulate.simulate_session", DRAWN)  # two of them begin alike
    monkeypatch.setattr(fringecal, "calibrate", CALIBRATED)
    left = runpy.run_path(str(notebook))
    assert left["calibration"].verdict in ("pass", "conditionalPass")
    assert capsys.readouterr().out.strip()
