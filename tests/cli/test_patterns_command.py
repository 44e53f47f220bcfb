"""`fringecal patterns`: what it writes is a session's capture, in which a camera finds the projector's pixels."""

import tomllib

import cv2
import numpy as np
import pytest

from fringecal.session import to_toml

SIZE = ("--projector", "160x100")


def test_a_camera_that_sees_the_patterns_finds_the_projectors_pixels(run, tmp_path):
    """Each camera pixel looks at one of the projector: its column and row are known."""
    out = tmp_path / "patterns"
    outcome = run("patterns", *SIZE, "--out", out, "--noise-rad", "0.03", "--json")
    assert outcome.code == 0, outcome.stderr
    assert outcome.document["frames"] == len(list(out.glob("*.png")))
    document = tomllib.loads((out / "patterns.toml").read_text(encoding="utf-8"))
    column, row = decoded(run, document, out, tmp_path)
    v, u = np.mgrid[:100, :160]
    assert np.isfinite(column).mean() > 0.99
    # Rounding of fringes of 20 px, 2e-3 rad of it, and of the camera's own grey values.
    assert np.nanmax(np.abs(column - u)) < 0.1
    assert np.nanmax(np.abs(row - v)) < 0.1


def test_a_gray_code_counts_from_the_first_pixel(run, tmp_path):
    out = tmp_path / "patterns"
    assert run("patterns", *SIZE, "--out", out, "--gray", "complementary").code == 0
    document = tomllib.loads((out / "patterns.toml").read_text(encoding="utf-8"))
    column, _ = decoded(run, document, out, tmp_path)
    u = np.mgrid[:100, :160][1]
    assert np.isfinite(column).mean() > 0.9
    assert np.nanmax(np.abs(column - u)) < 0.1


def decoded(run, document, patterns, folder):
    """Copy the capture into a session, let a camera see the frames, and read the projector's pixels that it finds."""
    session = folder / "session"
    session.mkdir()
    for file in patterns.glob("*.png"):
        frame = cv2.imread(str(file), cv2.IMREAD_UNCHANGED)
        cv2.imwrite(str(session / file.name), np.rint(20 + 0.8 * frame).astype(np.uint8))
    stated = {
        "format": 1,
        "rig": "bench",
        "captured": "2026-11-22T10:00:00Z",
        "camera": {"bits": 8},
        "projector": {"resolution_px": document["projector"]["resolution_px"]},
        "phase": document["phase"],
        "capture": [{"name": "part", "kind": "object"} | document["capture"]],
    }
    text = to_toml(stated).replace('"2026-11-22T10:00:00Z"', "2026-11-22T10:00:00Z")
    (session / "session.toml").write_text(text, encoding="utf-8")
    outcome = run("phase", session, "--out", folder / "phase")
    assert outcome.code == 0, outcome.stderr
    return [np.load(folder / "phase" / f"part-{axis}-projector.npz")["projector_px"] for axis in "uv"]


def test_a_response_is_undone_and_said(run, tmp_path):
    ladder = tmp_path / "ladder.csv"
    grey = np.arange(0, 256, 5)
    ladder.write_text("grey,light\n" + "".join(f"{g},{(g / 255) ** 2.2:.6f}\n" for g in grey), encoding="utf-8")
    outcome = run("patterns", *SIZE, "--out", tmp_path / "out", "--steps", "3", "--response", ladder, "--json")
    assert outcome.code == 0, outcome.stderr
    after, before = outcome.document["ripple_rad"]["rms"], outcome.document["ripple_without_response_rad"]["rms"]
    assert before > 0.15
    assert after < 0.01


@pytest.mark.parametrize(
    ("options", "code", "words"),
    [
        (("--projector", "320"), 2, "1920x1080"),
        ((*SIZE, "--axis", "w"), 2, "u, v, or both"),
        ((*SIZE, "--gray", "black"), 2, "none of none, plain, complementary"),
        ((*SIZE, "--period", "2"), 1, "nearest that can is 3 px"),
        ((*SIZE, "--period", "22.5", "--gray", "plain"), 1, "22 px (7.273 fringes) and 23 px"),
        ((*SIZE, "--noise-rad", "1.5"), 1, "no choice numbers"),
        ((*SIZE, "--response", "gamma:x"), 2, "no exponent"),
        ((*SIZE, "--response", "nowhere.csv"), 1, "nowhere.csv"),
        ((*SIZE, "--response", "gamma:9"), 1, "0.2 to 5"),
    ],
)
def test_what_cannot_be_drawn_is_refused_and_writes_nothing(run, tmp_path, options, code, words):
    outcome = run("patterns", *options, "--out", tmp_path / "out")
    assert outcome.code == code, outcome.stderr
    assert words in " ".join(outcome.stderr.replace("│", " ").split())
    assert not (tmp_path / "out").exists()
