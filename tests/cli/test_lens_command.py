"""`fringecal lens`: files, JSON and refusals."""

import json
from pathlib import Path

import jsonschema
import pytest

from fringecal.records import read_lens
from fringecal.records.schemas import published_schema

PICTURES = sorted((Path(__file__).parents[1] / "data" / "opencv_chess_left").glob("*.jpg"))[:5]
BOARD = ("--target", "chessboard-9x6-25mm")


def test_results_are_written_and_agree(run, tmp_path):
    out = tmp_path / "lens"
    outcome = run("lens", *PICTURES, *BOARD, "--solver", "opencv", "--json", "--out", out)
    assert outcome.code == 0, outcome.stderr
    document = outcome.document
    jsonschema.Draft202012Validator(published_schema("lens")).validate(document)
    assert json.loads((out / "lens.json").read_text(encoding="utf-8"))["lens"] == document["lens"]
    assert sorted(document["inputs"]) == [path.name for path in PICTURES]
    for name in ("lens.cameramodel", "lens.yml"):
        assert read_lens(out / name)["fx_px"] == pytest.approx(document["lens"]["parameters"][0])
    assert (out / "report.html").is_file()
    assert len(list((out / "figures").iterdir())) == 4


@pytest.mark.parametrize(
    ("arguments", "code", "words"),
    [
        ([*PICTURES], 2, "--target"),
        ([*PICTURES, *BOARD, "--solver", "magic"], 2, "none of auto, mrcal, opencv"),
        ([*PICTURES, *BOARD, "--model", "magic"], 2, "none of brown"),
        ([*PICTURES, *BOARD, "--distance-mm", "-5"], 2, "above zero"),
        ([*PICTURES, "--target", "no-such-board"], 1, "no-such-board"),
        ([*PICTURES[:1], *BOARD], 1, "square-on"),
        (["nowhere.png", *BOARD], 1, "nowhere.png"),
        ([PICTURES[0].parent], 1, "session.toml"),
    ],
)
def test_wrong_input_is_refused_and_writes_nothing(run, tmp_path, arguments, code, words):
    outcome = run("lens", *arguments, "--out", tmp_path / "out")
    assert outcome.code == code
    assert words in " ".join(outcome.stderr.replace("│", " ").split())
    assert "Traceback" not in outcome.stderr
    assert not (tmp_path / "out").exists()
