"""`fringecal lens` on calibrations of other programs: the verdict, exit codes, files, and refusals."""

import json
from pathlib import Path

import jsonschema
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from fringecal.camera import Lens
from fringecal.projector import StatedPair
from fringecal.records import read_pair, write_pair
from fringecal.records.schemas import published_schema

DATA = Path(__file__).parents[1] / "data"
KNOWN = np.diag(np.array([1.0, 1, 1, 1, 1e-3, 1e-3, 1e-4, 1e-4, 1e-3]) ** 2)
CAMERA = Lens(np.array([1754.1, 1752.9, 645.4, 529.5, -0.07, -0.04, 2e-4, 5e-4, 0.01]), KNOWN, 1280, 1024)
PROJECTOR = Lens(np.array([2496.6, 2495.8, 990.3, 1047.0, 0.04, -0.02, 1e-4, 2e-4, 0.0]), KNOWN, 1920, 1080)
ROTATION = Rotation.from_rotvec([-0.1, 0.30, 0.01]).as_matrix()
PAIR = StatedPair(CAMERA, PROJECTOR, ROTATION, -ROTATION @ [150.0, -5.0, 10.0])
# hezhao/Calibrator issue 8, as its user posted it, with a pose that is one.
REPORTED = """%YAML:1.0
cam_K: !!opencv-matrix
   rows: 3
   cols: 3
   dt: d
   data: [ 3.0391166108821071e+003, 0., 6.4494818391851982e+002, 0.,
       4.8140290950005083e+003, 4.3132605068939699e+002, 0., 0., 1. ]
cam_kc: !!opencv-matrix
   rows: 1
   cols: 5
   dt: d
   data: [ 4.4577008243883992e-001, -2.1770480646039530e+001,
       -1.8667064777688067e-002, 2.0741764453481783e-002, 0. ]
proj_K: !!opencv-matrix
   rows: 3
   cols: 3
   dt: d
   data: [ 7.9387539734181291e+002, 0., 3.4504813864214566e+002, 0.,
       9.9994218716576131e+002, 8.4563472852466660e+001, 0., 0., 1. ]
proj_kc: !!opencv-matrix
   rows: 1
   cols: 5
   dt: d
   data: [ 2.7607946613233398e+001, -2.3445584254554888e+003,
       7.9733639983738671e+000, 1.0360114607753822e+001, 0. ]
R: !!opencv-matrix
   rows: 3
   cols: 3
   dt: d
   data: [ 1., 0., 0., 0., 1., 0., 0., 0., 1. ]
T: !!opencv-matrix
   rows: 3
   cols: 1
   dt: d
   data: [ -100., 0., 0. ]
"""


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    folder = tmp_path_factory.mktemp("pair")
    write_pair(folder, PAIR)
    return folder


def test_a_calibration_that_failed_is_refused_with_its_reasons(run, tmp_path):
    (tmp_path / "theirs.yml").write_text(REPORTED, encoding="utf-8")
    sizes = ("--camera-size", "1280x960", "--projector-size", "1024x768")
    outcome = run("lens", tmp_path / "theirs.yml", *sizes, "--json")
    assert outcome.code == 3
    document = outcome.document
    jsonschema.Draft202012Validator(published_schema("pair")).validate(document)
    assert document["decision"] == "fail"
    refused = {(doubt["subject"], doubt["name"]) for doubt in document["doubts"] if doubt["refused"]}
    assert {("camera", "pixel aspect"), ("projector", "distortion folds")} <= refused
    printed = run("lens", tmp_path / "theirs.yml", *sizes)
    assert printed.code == 3
    words = " ".join(printed.stdout.split())
    assert "refused: camera, pixel aspect" in words
    assert "k2 = -2345" in words


def test_a_pair_with_its_uncertainty_is_trusted_and_written_in_every_format(run, written, tmp_path):
    out = tmp_path / "out"
    outcome = run("lens", written / "camera.cameramodel", written / "projector.cameramodel", "--out", out)
    assert outcome.code == 0, outcome.stderr
    assert "TRUSTED" in outcome.stdout
    assert json.loads((out / "pair.json").read_text(encoding="utf-8"))["decision"] == "pass"
    assert (out / "report.html").is_file()
    np.testing.assert_allclose(read_pair([out / "slstudio.xml"]).shift_mm, PAIR.shift_mm)


def test_a_pair_without_uncertainty_is_open(run, written):
    outcome = run("lens", written / "slstudio.xml", "--json")
    assert outcome.code == 0
    assert outcome.document["decision"] == "conditionalPass"
    assert outcome.document["camera"]["covariance"] is None


def test_one_device_is_a_camera(run, written, tmp_path):
    outcome = run("lens", written / "camera.cameramodel", "--json", "--out", tmp_path / "out")
    assert outcome.code == 0
    assert outcome.document["projector"] is None
    assert (tmp_path / "out" / "lens.yml").is_file()


def board_places(noise_px=0.02):
    """Six poses of a board, seen by the pair's own projection with noise."""
    rng = np.random.default_rng(5)
    x, y = (axis.ravel() for axis in np.meshgrid(np.arange(9) * 12.0, np.arange(7) * 12.0))
    board = np.column_stack([x, y, 0 * x])
    camera, projector = [], []
    for k in range(8):
        turn = Rotation.from_euler("xyz", [25 * np.cos(k), 25 * np.sin(k), 20 * k], degrees=True)
        points = turn.apply(board - [48, 36, 0]) + [*rng.uniform(-25, 25, 2), rng.uniform(470, 560)]
        camera.append(CAMERA.project(points) + rng.normal(0, noise_px, (len(points), 2)))
        projector.append(PAIR.light(points) + rng.normal(0, noise_px, (len(points), 2)))
    return {"board_mm": board, "camera_px": np.array(camera), "projector_px": np.array(projector)}


def test_places_judge_a_pair_and_make_one(run, written, tmp_path):
    np.savez(tmp_path / "places.npz", **board_places())
    judged = run("lens", written / "slstudio.xml", "--pairs", tmp_path / "places.npz", "--json")
    assert judged.code == 0, judged.stderr
    assert judged.document["pairs"]["points"] == 8 * 63
    assert judged.document["pairs"]["scale"] == pytest.approx(1.0, abs=1e-3)
    sizes = ("--camera-size", "1280x1024", "--projector-size", "1920x1080")
    made = run("lens", tmp_path / "places.npz", *sizes, "--json")
    assert made.code in (0, 3), made.stderr
    found = made.document
    # The truth lies within a few of the stated u; a covariance comes with it.
    sigma = np.sqrt(np.diag(found["camera"]["covariance"]))
    error = np.array(found["camera"]["parameters"]) - CAMERA.values
    assert np.abs(error[:4] / sigma[:4]).max() < 4


def test_a_real_rig_is_solved_as_opencv_solves_it_and_judged_by_its_own_places(run, tmp_path):
    """DP-TPU's nine poses: OpenCV gives 138.6 mm and focal lengths of 1735.8 and 3470.0 px (tests/data, README)."""
    places = DATA / "dp_tpu_ball" / "real.npz"
    sizes = ("--camera-size", "640x480", "--projector-size", "912x1140", "--pixel-aspect", "0.5")
    made = run("lens", places, *sizes, "--json", "--out", tmp_path / "rig")
    assert made.code == 0, made.stderr
    projector = made.document["projector"]
    assert np.linalg.norm(made.document["shift_mm"]) == pytest.approx(138.6, abs=0.3)
    u = np.sqrt(np.diag(projector["covariance"]))[:2]
    assert (np.abs(np.array(projector["parameters"][:2]) - [1735.8, 3470.0]) < 3 * u).all()
    judged = run("lens", tmp_path / "rig" / "stereo.yml", "--pairs", places, "--json")
    assert judged.code == 0, judged.stderr
    found = judged.document["pairs"]
    assert found["points"] == 9 * 35
    # One degree of freedom of four is left of the 0.21 px that both pictures leave.
    assert found["camera_rms_px"] < 0.21
    assert found["projector_rms_px"] < 0.21
    assert found["scale"] == pytest.approx(1.0, abs=1e-3)


@pytest.mark.parametrize(
    ("arguments", "code", "words"),
    [
        (["slstudio.xml", "--projector-size", "1920"], 2, "1920x1080"),
        (["slstudio.xml", "--projector-size", "0x99999999"], 2, "65535"),
        (["slstudio.xml", "--unit", "furlong"], 2, "none of mm, m, in"),
        (["caliInfo.yml"], 1, "--projector-size"),
        (["slstudio.xml", "stereo.yml", "caliInfo.yml"], 1, "3 files"),
        (["nowhere.xml"], 1, "nowhere.xml"),
        (["camera.cameramodel", "--pairs", "camera.yaml"], 1, "holds one lens"),
        (["slstudio.xml", "--pairs", "camera.yaml"], 1, "camera_u_px is missing"),
    ],
)
def test_what_cannot_be_judged_is_refused(run, written, tmp_path, arguments, code, words):
    given = [written / word if "." in word else word for word in arguments]
    outcome = run("lens", *given, "--out", tmp_path / "out")
    assert outcome.code == code
    assert words in " ".join(outcome.stderr.replace("│", " ").split())
    assert not (tmp_path / "out").exists()


def test_options_of_stated_files_are_none_of_pictures(run, tmp_path):
    outcome = run("lens", tmp_path / "a.png", "--target", "grid-10mm", "--unit", "mm")
    assert outcome.code == 2
    assert "--unit" in outcome.stderr
