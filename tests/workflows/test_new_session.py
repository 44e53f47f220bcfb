"""A session document from pictures alone: kinds, phase shifts and periods by looking, the rest asked for by name."""

import json
from pathlib import Path

import cv2
import numpy as np
import pytest

from fringecal.cli.app import main
from fringecal.session import load_session
from fringecal.workflows.new import looked_at, series_of

DATA = Path(__file__).parents[1] / "data"
SHAPE = 180, 240
V, U = np.mgrid[: SHAPE[0], : SHAPE[1]].astype(float)


def fringes(period_px, steps, *, along="v", raised=0.0, contrast=0.6, seed=0):
    """Frames of one set with a grey level of noise; `raised` is added to the phase, rad, (H, W)."""
    rng = np.random.default_rng(seed)
    phase = 2 * np.pi * (V if along == "v" else U) / period_px + 0.004 * (U - 120) ** 2 / 120 + raised
    shifts = 2 * np.pi * np.arange(steps) / steps
    light = 120 * (1 + contrast * np.cos(phase + shifts[:, None, None])) * (1 - 0.2 * (V / SHAPE[0]))
    return np.clip(np.rint(light + rng.standard_normal(light.shape)), 0, 255).astype(np.uint8)


def grid_paper():
    picture = np.full(SHAPE, 220.0)
    picture[:, 8::12] = picture[6::12] = 90
    return cv2.GaussianBlur(picture, (0, 0), 0.7).astype(np.uint8)


def chessboard(left=30, top=24, side=18, columns=10, rows=7):
    picture = np.full(SHAPE, 235, np.uint8)
    for i in range(rows):
        for j in range(columns):
            if (i + j) % 2 == 0:
                picture[top + i * side : top + (i + 1) * side, left + j * side : left + (j + 1) * side] = 30
    return cv2.GaussianBlur(picture, (0, 0), 0.8)


def save(folder, name, frames):
    frames = frames if np.ndim(frames) == 3 else [frames]
    for k, frame in enumerate(frames):
        path = folder / (f"{name}{k}.png" if len(frames) > 1 else f"{name}.png")
        path.parent.mkdir(parents=True, exist_ok=True)
        cv2.imwrite(str(path), frame)


def blocks_raised(strips=3):
    raised = np.zeros(SHAPE)
    for k in range(strips):
        raised[:, 30 + 70 * k : 55 + 70 * k] = 2.0
    return raised


@pytest.mark.parametrize("steps", [3, 4, 5, 8])
@pytest.mark.parametrize("along", ["u", "v"])
def test_steps_and_bare_plate_are_seen(tmp_path, steps, along):
    save(tmp_path, "a-", fringes(9.3, steps, along=along))
    save(tmp_path, "b-", fringes(9.3, steps, along=along, raised=blocks_raised(), seed=1))
    plate, other = looked_at(series_of(tmp_path))
    assert plate.kind == "reference"
    assert other.kind is None  # nothing tells strips from an object
    assert [len(one.table["steps_deg"]) for one in (plate, other)] == [steps, steps]


def test_several_periods_are_told_with_their_ratios(tmp_path):
    save(tmp_path, "p-", np.concatenate([fringes(p, 4) for p in (8.0, 9.0, 11.0)]))
    (one,) = looked_at(series_of(tmp_path))
    assert len(one.table["steps_deg"]) == 4
    assert one.table["periods"] == pytest.approx([1.0, 9 / 8, 11 / 8], rel=2e-3)


def test_two_axes_with_white_black_and_code_are_taken_apart(tmp_path):
    white, black = np.full(SHAPE, 192, np.uint8), np.full(SHAPE, 48, np.uint8)
    code = np.where((V // 30) % 2, white, black).astype(np.uint8)
    save(tmp_path, "pose-01-u1-", fringes(240, 3, along="u"))
    save(tmp_path, "pose-01-u2-", fringes(12, 3, along="u"))
    save(tmp_path, "pose-01-v1-", fringes(240, 3))
    save(tmp_path, "pose-01-v2-", fringes(12, 3))
    for name, picture in (("white", white), ("black", black)):
        save(tmp_path, f"pose-01-{name}", picture)
    save(tmp_path, "coded-", np.concatenate([fringes(9, 3), code[None], white[None], black[None]]))
    coded, pose = looked_at(series_of(tmp_path))
    assert pose.table["axes"] == ["u", "v"]
    assert (pose.table["white"], pose.table["black"]) == (["pose-01-white.png"], ["pose-01-black.png"])
    assert len(pose.table["images"]) == 12
    assert (coded.table["gray"], coded.table["white"], coded.table["black"]) == (
        ["coded-3.png"],
        ["coded-4.png"],
        ["coded-5.png"],
    )


def test_boards_are_boards_with_or_without_fringes(tmp_path):
    board = chessboard() / 235.0
    save(tmp_path, "shown-", (fringes(9, 3) * board).astype(np.uint8))
    save(tmp_path, "views-", np.stack([chessboard(20 + 5 * k, 20 + 3 * k) for k in range(4)]))
    save(tmp_path, "paper", grid_paper())
    found = {one.name: (one.kind, one.target_kinds) for one in looked_at(series_of(tmp_path))}
    assert found == {
        "shown": ("board", ("chessboard",)),
        "views": ("board", ("chessboard",)),
        "paper": ("grid", ("line-grid",)),
    }


@pytest.mark.parametrize(
    ("folder", "kind", "steps"),
    [("kamino_gamma_plane", "reference", 3), ("kamino_object1", None, 3), ("opencv_chess_left", "board", 0)],
)
def test_real_pictures(folder, kind, steps):
    (one,) = looked_at(series_of(DATA / folder))
    assert (one.kind, len(one.table["steps_deg"])) == (kind, steps)


def bench(folder):
    save(folder, "grid", grid_paper())
    save(folder, "plate-", fringes(9.3, 3))
    save(folder, "strips-", fringes(9.3, 3, raised=blocks_raised(), seed=1))


def test_a_folder_becomes_a_session_that_loads(tmp_path, capsys):
    bench(tmp_path)
    stated = ["--height-mm", "1500", "--target", "grid=grid-10mm", "--target", "strips=glass-strips"]
    main_or_exit(["new", str(tmp_path), "--rig", "r", "--no-ask", *stated])
    session = load_session(tmp_path)
    assert {name: c.kind for name, c in session.captures.items()} == {
        "grid": "grid",
        "plate": "reference",
        "strips": "strips",
    }
    assert main_or_exit(["new", str(tmp_path), "--no-ask", *stated]) == 1  # what is there stays
    assert "is there already" in capsys.readouterr().err


def test_what_is_missing_is_asked_by_name_and_nothing_is_written(tmp_path, capsys):
    bench(tmp_path)
    assert main_or_exit(["new", str(tmp_path), "--json"]) == 1
    said = json.loads(capsys.readouterr().out)
    options = [one["option"].split("=")[0] for one in said["asked"]]
    assert options == ["--height-mm MM (or --telecentric, or --camera-model FILE)", "--target grid", "--target strips"]
    assert not (tmp_path / "session.toml").exists()


@pytest.mark.parametrize(
    "wrong",
    [["--kind", "plat=reference"], ["--kind", "plate=bord"], ["--target", "gird=grid-10mm"], ["--without", "x"]],
)
def test_what_is_stated_of_nothing_is_refused(tmp_path, capsys, wrong):
    bench(tmp_path)
    assert main_or_exit(["new", str(tmp_path), "--no-ask", *wrong]) == 1
    assert wrong[1].partition("=")[0] in capsys.readouterr().err
    assert not (tmp_path / "session.toml").exists()


def test_an_empty_folder_and_a_damaged_picture_are_refused(tmp_path, capsys):
    assert main_or_exit(["new", str(tmp_path)]) == 1
    (tmp_path / "a.png").write_bytes(b"\x89PNG\r\n\x1a\n")
    assert main_or_exit(["new", str(tmp_path)]) == 1
    assert "a.png" in capsys.readouterr().err


def main_or_exit(arguments):
    """Run the command in this process; return its exit code."""
    try:
        main(arguments)
    except SystemExit as stop:
        return stop.code
    return 0
