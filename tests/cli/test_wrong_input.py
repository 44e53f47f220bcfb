"""Wrong input to every verb: one clear error on stderr, its exit code, no traceback, nothing written."""

import json
import os
import shutil

import pytest

REFUSED, USAGE = 1, 2


def demand_refusal(outcome, *words, code=REFUSED):
    """Expect an error on stderr that names what is wrong."""
    assert outcome.code == code
    # A usage error is framed and wrapped; take the frame off to read it.
    said = " ".join(outcome.stderr.replace("│", " ").split())
    assert "error" in said.lower()
    for word in words:
        assert word in said
    assert "Traceback" not in outcome.stdout + outcome.stderr


@pytest.fixture
def out(tmp_path):
    """A place for results that must stay empty."""
    place = tmp_path / "results" / "here"
    yield place
    assert not place.exists()
    assert not place.parent.exists() or list(place.parent.iterdir()) == []


def rewrite(path, old, new):
    text = path.read_text(encoding="utf-8")
    assert old in text
    path.write_text(text.replace(old, new), encoding="utf-8")


# ---- sessions -------------------------------------------------------------------------------------
def test_no_such_folder(run, out, tmp_path):
    demand_refusal(run("commission", tmp_path / "nowhere", "--out", out), "nowhere", "is not there")


def test_an_empty_picture(run, out, session):
    (session / "strips-1.png").write_bytes(b"")
    demand_refusal(run("commission", session, "--out", out), "strips-1.png", "empty")


def test_a_folder_of_unrelated_pictures(run, out, data, tmp_path):
    pictures = tmp_path / "holiday"
    pictures.mkdir()
    shutil.copy(data / "fpp_tools_lens" / "lens_orig_000.jpg", pictures)
    demand_refusal(run("commission", pictures, "--out", out), "no session.toml")


def test_unrelated_pictures_under_the_right_names(run, out, session):
    """Noise everywhere: the grid is the first thing looked for."""
    import cv2
    import numpy as np

    noise = np.random.default_rng(5)
    for picture in session.glob("*.png"):
        cv2.imwrite(str(picture), noise.integers(60, 190, (520, 640), dtype=np.uint8))
    demand_refusal(run("commission", session, "--out", out), "grid")


def test_strips_and_reference_swapped(run, out, session):
    for number in range(3):
        first, second = session / f"strips-{number}.png", session / f"reference-{number}.png"
        one, other = first.read_bytes(), second.read_bytes()
        first.write_bytes(other)
        second.write_bytes(one)
    demand_refusal(run("commission", session, "--out", out))


def test_all_faults_at_once(run, out, session):
    (session / "grid.png").unlink()
    (session / "reference-2.png").write_bytes((session / "reference-1.png").read_bytes())
    rewrite(session / "t-strips.toml", "count = 8", "count = -8")
    demand_refusal(run("commission", session, "--out", out), "grid.png", "reference-2.png", "t-strips.toml")


def test_captures_that_commissioning_needs(run, out, data):
    demand_refusal(run("commission", data / "fpp_tools_lens", "--out", out), "'grid'", "'reference'", "'strips'")


# ---- captures and targets -------------------------------------------------------------------------
def test_bars_that_are_said_to_be_strips(run, out, session, calibration):
    rewrite(session / "session.toml", '"t-bars.toml"', '"t-strips.toml"')
    demand_refusal(
        run("verify", session, "--calibration", calibration, "--out", out), "bars", "no strips in the picture"
    )


def test_bars_of_another_size(run, out, session, calibration):
    rewrite(session / "session.toml", '"t-bars.toml"', '"angle-bars"')  # legs of 40 mm, not 30
    outcome = run("verify", session, "--calibration", calibration, "--out", out, "--no-filters")
    demand_refusal(outcome, "56.6 mm", "leg_mm")  # 40 sqrt 2 between ridges


def test_no_such_capture(run, out, data, calibration):
    outcome = run("reconstruct", data / "oblique", "--capture", "leaf", "--calibration", calibration, "--out", out)
    demand_refusal(outcome, "leaf", "bars, grid, reference, strips")


def test_a_capture_without_steps(run, out, data, calibration):
    outcome = run("reconstruct", data / "oblique", "--capture", "grid", "--calibration", calibration, "--out", out)
    demand_refusal(outcome, "steps")


# ---- calibrations ---------------------------------------------------------------------------------
def test_calibration_of_another_picture_size(run, out, data, calibration, tmp_path):
    other = tmp_path / "other"
    shutil.copytree(data / "fpp_tools_lens", other)
    document = other / "session.toml"
    text = document.read_text(encoding="utf-8")
    document.write_text(text.replace('rig = "fpp_tools"', 'rig = "oblique"'), encoding="utf-8")
    outcome = run("reconstruct", other, "--calibration", calibration, "--out", out)
    demand_refusal(outcome, "933 x 862", "640 x 520")


def broken_records(document):
    """Texts that are no calibration, and a word of what must be said of each."""
    text = json.dumps(document)
    yield "", "JSON"
    yield text[: len(text) // 2], "cut short"
    yield "[]", "object"
    yield json.dumps({**document, "rig": {}}), "rig.parameters"
    yield json.dumps({**document, "format": "fringecal-calibration/2"}), "newer"
    yield json.dumps({**document, "format": "fringecal-verification/1"}), "another kind"


@pytest.mark.parametrize("number", range(6))
def test_a_damaged_calibration(run, out, data, calibration, tmp_path, number):
    document = json.loads((calibration / "calibration.json").read_text())
    text, word = list(broken_records(document))[number]
    damaged = tmp_path / "damaged.json"
    damaged.write_text(text)
    for verb in ("verify", "reconstruct"):
        outcome = run(verb, data / "oblique", "--capture", "bars", "--calibration", damaged, "--out", out)
        demand_refusal(outcome, "damaged.json", word)


def test_no_calibration(run, out, data, tmp_path):
    outcome = run("verify", data / "oblique", "--calibration", tmp_path / "none.json", "--out", out)
    demand_refusal(outcome, "none.json")


# ---- options --------------------------------------------------------------------------------------
@pytest.mark.parametrize("inside", ["", "deeper/still"])
def test_out_is_a_file(run, data, calibration, tmp_path, inside):
    file = tmp_path / "taken"
    file.write_text("a letter")
    place = file / inside if inside else file
    record = ("--calibration", calibration)
    for arguments in (
        ("commission", data / "oblique"),
        ("verify", data / "oblique", *record),
        ("reconstruct", data / "oblique", "--capture", "bars", *record),
        ("demo", "--no-open"),
    ):
        demand_refusal(run(*arguments, "--out", place), "taken", "is a file")
    assert file.read_text() == "a letter"


def test_out_may_not_be_written(run, data, calibration, tmp_path):
    if os.geteuid() == 0:
        pytest.skip("the superuser may write everywhere")
    tmp_path.chmod(0o500)
    outcome = run(
        "reconstruct", data / "oblique", "--capture", "bars", "--calibration", calibration, "--out", tmp_path / "x"
    )
    tmp_path.chmod(0o700)
    demand_refusal(outcome, "nothing may be written in")


@pytest.mark.parametrize(
    ("options", "word"),
    [
        (("--model", "magic"), "projective"),
        (("--also", "dwg"), "ply, ply-text, las, e57, gwy"),
        (("--lowest-mm", "20", "--highest-mm", "10"), "not below"),
        (("--height", "3"), "No such option"),
    ],
)
def test_usage_of_reconstruct(run, out, data, calibration, options, word):
    arguments = ("--capture", "bars", "--calibration", calibration, "--out", out)
    demand_refusal(run("reconstruct", data / "oblique", *arguments, *options), word, code=USAGE)


def test_heights_that_the_object_has_not(run, out, data, calibration):
    outcome = run(
        "reconstruct", data / "oblique", "--capture", "bars", "--calibration", calibration, "--out", out,
        "--lowest-mm", "500", "--highest-mm", "600",
    )  # fmt: skip
    demand_refusal(outcome, "between the stated 500 and 600 mm")


def test_rows_that_are_no_numbers(run, out, data, calibration):
    outcome = run("verify", data / "oblique", "--calibration", calibration, "--out", out, "--rows", "10,x")
    demand_refusal(outcome, "'10,x'", code=USAGE)


@pytest.mark.parametrize("verb", ["commission", "verify", "reconstruct", "check", "grid", "simulate", "phase"])
def test_a_verb_without_its_arguments(run, verb):
    demand_refusal(run(verb), code=USAGE)


# ---- pictures, rigs, targets ----------------------------------------------------------------------
def test_a_grid_in_a_picture_without_one(run, data, tmp_path):
    demand_refusal(run("grid", data / "fpp_tools_lens" / "lens_orig_000.jpg"), "no line grid")
    (tmp_path / "empty.png").write_bytes(b"")
    demand_refusal(run("grid", tmp_path / "empty.png"), "empty.png")
    demand_refusal(run("grid", tmp_path), "a folder, a file was needed")


def test_an_unknown_rig_and_an_unknown_target(run, out):
    demand_refusal(run("simulate", "thesiss", "--out", out), "did you mean 'thesis'")
    demand_refusal(run("targets", "show", "angle-bar"), "angle-bars")


@pytest.mark.parametrize("verb", [("verify", "--capture", "bars"), ("reconstruct", "--capture", "bars"), ("audit",)])
def test_a_calibration_of_another_rig(run, out, session, calibration, verb):
    document = session / "session.toml"
    document.write_text(document.read_text(encoding="utf-8").replace('rig = "', 'rig = "other-', 1), encoding="utf-8")
    name, *options = verb
    outcome = run(name, session, *options, "--calibration", calibration, "--out", out)
    demand_refusal(outcome, "of rig 'other-", "name the calibration of this rig")
