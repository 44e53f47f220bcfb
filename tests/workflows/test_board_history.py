"""Calibrations by a board, and verifications by them, in a history: added, shown, charted."""

import json
from datetime import UTC, datetime

import pytest
import typer
from typer.testing import CliRunner

from fringecal.cli import history as verb
from fringecal.records import read_board_calibration, write_board_calibration


def run(*words):
    app = typer.Typer()
    app.callback()(lambda: None)
    verb.register(app)
    return CliRunner().invoke(app, ["history", *words])


@pytest.fixture(scope="module")
def database(board_record, tmp_path_factory):
    """Four calibrations a month apart, the baseline 0.01 mm longer each time; and one of them given again."""
    folder = tmp_path_factory.mktemp("history")
    written = read_board_calibration(board_record)
    for month in (1, 2, 3, 4):
        session = written.session.model_copy(update={"captured": datetime(2026, month, 1, tzinfo=UTC)})
        longer = written.baseline_mm.model_copy(update={"value": written.baseline_mm.value + 0.01 * month})
        one = written.model_copy(update={"session": session, "baseline_mm": longer})
        write_board_calibration(one, folder / str(month))
    files = [str(folder / str(month) / "calibration.json") for month in (1, 2, 3, 4)]
    db = str(folder / "h.sqlite")
    result = run("add", *files, files[0], "--db", db, "--json")
    assert result.exit_code == 0, result.output
    assert json.loads(result.stdout) == {"added": 4}
    return db


def test_a_history_shows_what_a_board_rig_is_known_by(database, board_record) -> None:
    result = run("show", "--db", database, "--json")
    assert result.exit_code == 0, result.output
    text = result.stdout
    for quantity in ("baseline", "angle of the rays amid the boards", "focal length of the projector"):
        assert quantity in text, text[:2000]


def test_values_and_u_are_those_of_the_record(database, board_record) -> None:
    from fringecal.history import open_history

    written = read_board_calibration(board_record)
    with open_history(database, create=False) as history:
        readings = history.readings(quantity="focal length of the camera")
    k = written.names.index("camera.fx_px")
    assert readings["value"].tolist() == pytest.approx([written.parameters[k]] * 4)
    assert readings["u"].tolist() == pytest.approx([written.covariance[k][k] ** 0.5] * 4)
