"""What the verbs write and print, on the oblique rig: files that others can read, JSON that keeps its schema."""

import json
import os

import gwyfile
import laspy
import numpy as np
import pytest
import trimesh
from jsonschema import Draft202012Validator
from scipy.ndimage import maximum_filter, minimum_filter

from fringecal.records.schemas import published_schema
from fringecal.session.check_document import published_schema as check_schema

from ..report.reading import letters_of_sheets, texts_of_page

VALUE_KEYS = {"value", "u", "dof", "unit"}
# The design's promise: tools rely on these keys of a profile.
PROFILE_KEYS = [
    "name",
    "row_px",
    "y_mm",
    "n",
    "mean_mm",
    "sd_mm",
    "max_abs_mm",
    "mean_percent",
    "max_percent",
    "u_mm",
    "en",
]


def demand_no_leftovers(folder):
    """Expect nothing hidden beside a result folder: no staging, no half file."""
    assert [path.name for path in folder.parent.iterdir() if path.name.startswith(".")] == []
    assert [path for path in folder.rglob("*") if ".part" in path.name] == []


@pytest.fixture(scope="module")
def truth(data):
    return json.loads((data / "oblique" / "truth.json").read_text())


def test_commission_writes_what_it_promises(calibration, truth):
    names = {path.name for path in calibration.iterdir()}
    assert {"calibration.json", "camera.cameramodel", "report.html", "tables", "figures"} <= names
    assert any((calibration / "tables").glob("*.csv"))
    assert any((calibration / "figures").iterdir())
    document = json.loads((calibration / "calibration.json").read_text())
    Draft202012Validator(published_schema("calibration")).validate(document)
    assert set(document["scale"]["mean"]) >= VALUE_KEYS
    assert document["scale"]["mean"]["value"] == pytest.approx(truth["scale_h"], rel=3e-4)
    assert document["projection"]["angle"]["value"] == pytest.approx(truth["angle_origin_deg"], abs=0.05)
    assert document["distortion"]["verdict"] == truth["verdict"]
    assert [step["used"] for step in document["steps"]] == ["estimated", "estimated"]
    files = [row["file"] for row in document["inputs"]]  # every picture with its hash, session.toml and its targets
    assert len(files) == len(set(files)) == 14
    assert sum(name.endswith(".png") for name in files) == 10
    assert [row["file"] for row in document["inputs"] if not row["capture"]][0] == "session.toml"
    demand_no_leftovers(calibration)


def test_the_sheets_say_all_that_the_page_says(calibration):
    page = texts_of_page((calibration / "report.html").read_text(encoding="utf-8"))
    printed = letters_of_sheets(calibration / "report.pdf")
    assert "Commissioningofoblique" in page
    assert any(text.startswith("WhatwascheckedU:95%") for text in page)
    assert len(page) > 1000  # headings, sentences, cells and captions of a commissioning
    assert [text for text in page if text not in printed] == []


def test_the_report_is_one_file_and_whole(calibration):
    text = (calibration / "report.html").read_text(encoding="utf-8")
    assert text.rstrip().endswith("</html>")
    assert text.count("<figure") == text.count("</figure>") > 3
    for broken in ('src="http', 'src="figures', 'href="http', ">nan<", ">None<", "Traceback", "{{", "}}"):
        assert broken not in text


def test_commission_prints_the_record_that_it_writes(calibration, printed):
    Draft202012Validator(published_schema("calibration")).validate(printed)
    assert printed == json.loads((calibration / "calibration.json").read_text())


def test_verify(run, data, calibration, tmp_path):
    out = tmp_path / "verification"
    record = calibration / "calibration.json"
    outcome = run(
        "verify", data / "oblique", "--capture", "bars", "--calibration", record, "--out", out, "--no-filters", "--json"
    )
    assert outcome.code == 0
    Draft202012Validator(published_schema("verification")).validate(outcome.document)
    assert json.loads((out / "verification.json").read_text()) == outcome.document
    profiles = outcome.document["profiles"]
    assert [profile["name"] for profile in profiles] == list("ABCDE")
    for profile in profiles:
        assert list(profile) == [*PROFILE_KEYS, "dof"]
        assert abs(profile["mean_percent"]) <= 0.1
    models = {row["model"]: row for row in outcome.document["models"]}
    assert models["projective"]["max_percent"] < models["constant-angle"]["max_percent"]
    assert {"report.html", "tables", "figures"} <= {path.name for path in out.iterdir()}
    demand_no_leftovers(out)


@pytest.mark.usefixtures("blank_figures")
def test_verify_for_people_can_be_read_on_80_columns(run, data, calibration, tmp_path):
    options = ("--calibration", calibration, "--out", tmp_path / "v", "--rows", "200,300", "--no-filters")
    outcome = run("verify", data / "oblique", *options)
    assert outcome.code == 0
    assert "…" not in outcome.stdout
    (first,) = [line.split() for line in outcome.stdout.splitlines() if line.split()[:2] == ["A", "200"]]
    assert len(first) == len(PROFILE_KEYS)


def demand_true_flanks(maps, true, bands=10):
    """On lit flanks, three pixels off every edge: the mean, each band of height, and u(z) at each pixel."""
    full, height = float(true["bars"].max()), true["bars"]
    inside = (minimum_filter(height, 7) > 0.02 * full) & (maximum_filter(height, 7) < 0.97 * full)
    flank = inside & minimum_filter(true["lit"], 5) & maps["mask"]
    error, band = (maps["z"] - height)[flank], (height[flank] * bands / full).astype(int)
    assert np.count_nonzero(flank) > 100_000
    assert abs(error.mean()) < 0.002 * full
    assert max(abs(error[band == b].mean()) for b in range(bands)) < 0.004 * full
    assert 0.90 < np.mean(np.abs(error) <= 1.96 * maps["u_z"][flank]) < 0.98


def test_reconstruct(data, reconstructed):
    out, printed = reconstructed
    written = {path.name for path in out.iterdir()}
    assert {f"height.{suffix}" for suffix in ("npz", "tif", "ply", "stl", "obj", "x3p")} | {"report.html"} <= written
    with np.load(out / "height.npz") as maps, np.load(data / "oblique" / "truth.npz") as true:
        assert maps["z"].shape == true["bars"].shape == (520, 640)
        lit = maps["mask"] & true["lit"]
        # Median of all pixels, plate and bars: 0.003 mm of 3 mm strips, on 10 mm at most.
        assert abs(np.median((maps["z"] - true["bars"])[lit])) < 0.01
        demand_true_flanks(maps, true)
        assert printed["shares"]["valid"] == maps["mask"].mean()
        for points in (laspy.read(out / "height.las").xyz, trimesh.load(out / "height-cloud.ply").vertices):
            assert len(points) == maps["mask"].sum()
            np.testing.assert_allclose(points[:, 2], maps["z"][maps["mask"]], atol=1e-5)
    assert "/0/data" in gwyfile.load(str(out / "height.gwy"))
    assert printed["z_max_mm"] == pytest.approx(21.2, abs=0.5)
    demand_no_leftovers(out)


def test_check_says_what_is_there(run, data):
    outcome = run("check", data / "oblique", "--json")
    assert outcome.code == 0
    Draft202012Validator(json.loads(check_schema())).validate(outcome.document)
    assert [capture["name"] for capture in outcome.document["captures"]] == ["grid", "reference", "strips", "bars"]


def test_check_of_a_broken_session_keeps_its_schema(run, session):
    (session / "grid.png").unlink()
    (session / "bars-1.png").write_bytes(b"")
    outcome = run("check", session, "--json")
    assert outcome.code == 1
    Draft202012Validator(json.loads(check_schema())).validate(outcome.document)
    assert outcome.document["ok"] is False
    assert len(outcome.document["faults"]) == 2


def test_grid(run, data, truth, tmp_path):
    target = data / "oblique" / "t-grid.toml"
    outcome = run("grid", data / "oblique" / "grid.png", "--target", target, "--out", tmp_path / "g", "--json")
    assert outcome.code == 0
    scale = outcome.document["scale"]
    # The thesis's way, from distances between lines, does not know that the camera is tilted: 0.3 % is its bar.
    assert scale["mean"]["value"] == pytest.approx(truth["scale_h"], rel=3e-3)
    assert outcome.document["distortion"]["verdict"] == "barrel"
    assert all((tmp_path / "g" / name).is_file() for name in ("report.html", "distances-vertical-lines.csv"))
    assert (tmp_path / "g" / "figures" / "lines-and-crossings-found.png").is_file()


def test_phase_of_a_real_set(run, data):
    outcome = run("phase", data / "kamino_object1", "--json")
    assert outcome.code == 0
    periods = [capture["period"]["value_px"] for capture in outcome.document["captures"]]
    assert periods == pytest.approx([75.5, 115], rel=0.02)


def test_simulate_then_check(run, tmp_path):
    outcome = run("simulate", "thesis", "--captures", "grid,reference", "--seed", 1, "--out", tmp_path / "s", "--json")
    assert outcome.code == 0
    assert outcome.document["truth"]["scale_h_mm_per_px"] == pytest.approx(0.734, rel=1e-6)
    assert outcome.document["truth"]["angle_origin_deg"] == pytest.approx(50.7, abs=0.05)
    assert run("check", tmp_path / "s").code == 0


def test_targets_are_listed_and_shown(run):
    names = [row["target"] for row in run("targets", "list", "--json").document["targets"]]
    assert {"grid-10mm", "glass-strips", "flat-plate", "angle-bars"} <= set(names)
    shown = run("targets", "show", "angle-bars", "--json").document
    assert shown["derived"]["full_height_mm"]["value"] == pytest.approx(40 * np.sqrt(0.5))


def test_a_sheet_is_drawn(run, tmp_path):
    drawn = run("targets", "draw", "grid-10mm", "--out", tmp_path / "grid.pdf", "--json").document
    assert (tmp_path / "grid.pdf").read_bytes().startswith(b"%PDF")
    assert (drawn["width_mm"], drawn["height_mm"]) in {(210, 297), (297, 210)}  # A4


@pytest.mark.slow
@pytest.mark.usefixtures("blank_figures")
def test_demo(run, tmp_path, monkeypatch):
    monkeypatch.setattr(os, "cpu_count", lambda: 1)  # a second process would draw the figures
    out = tmp_path / "demo"
    outcome = run("demo", "--out", out, "--no-open", "--json")
    assert outcome.code == 0
    rows = {row["quantity"]: row for row in outcome.document["result"]}
    mean = rows["mean scale"]
    assert mean["measured"] == pytest.approx(mean["true"], rel=2e-4)
    assert mean["thesis 2008"] == 0.734
    angle = rows["projection angle at the origin"]
    assert angle["measured"] == pytest.approx(angle["true"], abs=0.1)
    for name in ("report.html", "calibration/calibration.json", "verification/verification.json", "leaf/height.npz"):
        assert (out / name).is_file(), name
    assert (out / "session" / "session.toml").is_file()
    for report in out.rglob("report.html"):
        text = report.read_text(encoding="utf-8")
        assert text.rstrip().endswith("</html>")
        assert 'src="http' not in text
        assert "Traceback" not in text
    for name, folder in (("calibration", "calibration"), ("verification", "verification")):
        document = json.loads((out / folder / f"{name}.json").read_text())
        Draft202012Validator(published_schema(name)).validate(document)
    assert run("check", out / "session").code == 0
