"""The verb on real sessions and on wrong input; what it writes and what it says."""

import json
import re

import cv2
import numpy as np
import pytest
import typer
from typer.testing import CliRunner

from fringecal.cli import phase as verb
from fringecal.cli.shared.judged_options import judge_options
from fringecal.errors import PhaseError, SessionError

app = typer.Typer()


@app.callback()
def root():
    """Keep the verb's name on the command line."""


verb.register(app)
judge_options(app)
runner = CliRunner()


@pytest.fixture(scope="module")
def lens(request):
    return request.config.rootpath / "tests" / "data" / "fpp_tools_lens"


def run(*arguments):
    result = runner.invoke(app, ["phase", *map(str, arguments)])
    if isinstance(result.exception, Exception) and not isinstance(result.exception, SystemExit):
        raise result.exception
    return result


def test_session_as_json_with_maps_and_figure(lens, tmp_path):
    result = run(lens, "--out", tmp_path, "--json")
    assert result.exit_code == 0
    (one,) = json.loads(result.stdout)["captures"]
    assert one["name"] == "lens"
    # Known of the data: steps 0, 90.4, 180.3, 270.1 deg, and about half of the picture is board and lens.
    np.testing.assert_allclose(one["steps"]["found_deg"], [0, 90.4, 180.3, 270.1], atol=0.5)
    assert 0.45 < one["shares"]["valid"] < 0.6
    assert sorted(path.name for path in tmp_path.iterdir()) == ["lens.npz", "lens.png"]
    with np.load(tmp_path / "lens.npz") as maps:
        assert maps["phase_rad"].shape == (862, 933)
        np.testing.assert_array_equal(np.isnan(maps["phase_rad"]), maps["reasons"] > 0)


def test_pictures_give_the_same_as_their_session(lens):
    names = [lens / f"lens_orig_{angle:03d}.jpg" for angle in (0, 90, 180, 270)]
    by_pictures = json.loads(run(*names, "--steps", "0,90,180,270", "--json").stdout)["captures"][0]
    by_session = json.loads(run(lens, "--json").stdout)["captures"][0]
    assert by_pictures["shares"] == by_session["shares"]
    assert by_pictures["steps"] == by_session["steps"]


def test_table_for_people(lens):
    result = run(lens)
    assert result.exit_code == 0
    # Published: 0, 90.4, 180.3, 270.1 deg; a difference to the stated steps that is known to 0.05 deg is said.
    assert "lens" in result.stdout
    # At 80 columns no heading is broken within a word.
    assert all(
        re.search(rf"\b{word}", result.stdout)
        for word in ("masked because", "levels", r"u\(phase\)", "period", "shifts")
    )
    assert "differ significantly from the stated 0, 90, 180, 270 deg" in result.stdout


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["a.png", "b.png", "c.png"], "state the phase shifts"),
        (["a.png", "--steps", "0,x"], "not a list of numbers"),
        (["a.png", "--steps", "0,120,240", "--capture", "x"], "give a session folder"),
        (["a.png", "--steps", "0,120,240", "--counts=1,8", "--periods=8,1"], "counts say what --periods"),
        (["a.png", "--steps", "0,120,240", "--counts=0,8"], "counts of fringes are above 0"),
        (["a.png", "--steps", "0,120,240", "--periods=8,1", "--extent=nan"], "finite number"),
    ],
)
def test_usage_errors(arguments, message):
    result = runner.invoke(app, ["phase", *arguments])
    assert result.exit_code == 2
    assert message in " ".join(result.output.replace("│", " ").split())


def test_a_session_states_its_own_steps(lens):
    assert runner.invoke(app, ["phase", str(lens), "--steps", "0,1,2"]).exit_code == 2


def test_unknown_capture_lists_those_there(lens):
    with pytest.raises(PhaseError, match="'plate'; there are: lens"):
        run(lens, "--capture", "plate")


def test_pictures_of_different_size(lens, request):
    other = request.config.rootpath / "tests" / "data" / "kamino_object1" / "pat00.png"
    first = lens / "lens_orig_000.jpg"
    with pytest.raises(PhaseError, match="one size and depth"):
        run(first, first, other, "--steps", "0,120,240")


def test_missing_or_broken_picture(tmp_path):
    broken = tmp_path / "broken.png"
    broken.write_bytes(b"\x89PNG\r\n\x1a\nnonsense")
    with pytest.raises(SessionError, match="broken.png"):
        run(broken, broken, broken, "--steps", "0,120,240")
    with pytest.raises(SessionError, match="missing.png"):
        run(tmp_path / "missing.png", "--steps", "0,120,240")


def test_wrong_number_of_steps(lens):
    names = [lens / f"lens_orig_{angle:03d}.jpg" for angle in (0, 90, 180)]
    with pytest.raises(PhaseError, match="one frame per phase shift"):
        run(*names, "--steps", "0,90,180,270")


@pytest.fixture(scope="module")
def wall(request):
    folder = request.config.rootpath / "tests" / "data" / "kamino_gamma_plane"
    return [folder / f"pat0{k}.png" for k in range(3)]


def test_diagnostics_names_gamma_and_exits_with_3(wall, tmp_path):
    found = run(*wall, "--steps=-120,0,120", "--diagnose", "--mm-per-rad", "1.5", "--out", tmp_path, "--json")
    assert found.exit_code == 3
    (one,) = json.loads(found.stdout)["captures"]
    (gamma,) = one["findings"]
    assert gamma["name"] == "gamma"
    assert gamma["cost_mm"] == pytest.approx(1.5 * gamma["cost_rad"])
    assert one["ripple_rad"]["3"] > 0.2
    assert (tmp_path / "pat00-diagnostics.png").stat().st_size > 10_000


def test_diagnostics_says_what_to_do_and_that_nothing_is_wrong(wall, tmp_path, camera, rng):
    ill = run(*wall, "--steps=-120,0,120", "--diagnose")
    assert "GAMMA" in ill.stdout
    assert "switch gamma off" in ill.stdout
    v, u = np.mgrid[:160, :200]
    steps = np.deg2rad([0, 120, 240])[:, None, None]
    files = [tmp_path / f"{k}.png" for k in range(3)]
    clean = camera(110 + 70 * np.cos(2 * np.pi * (u + 0.2 * v) / 14 + steps), rng, sigma=1.0)
    for file, frame in zip(files, clean, strict=True):
        cv2.imwrite(str(file), frame)
    well = run(*files, "--steps=0,120,240", "--diagnose")
    assert well.exit_code == 0
    assert "the diagnostics find nothing wrong in what they could see" in well.stdout
    assert "could not look for: frames in another order (3 frames fit in any order" in well.stdout


def test_frames_that_are_no_set_are_named_and_no_map_is_written(wall, fringed, tmp_path):
    names = written(tmp_path / "set", fringed([0, 120, 240]))
    names[2] = written(tmp_path / "other", fringed([240], ratio=1.6))[0]
    ill = run(*names, "--steps=0,120,240", "--diagnose", "--out", tmp_path / "out", "--json")
    assert ill.exit_code == 3
    (one,) = json.loads(ill.stdout)["captures"]
    assert [finding["name"] for finding in one["findings"]] == ["frame of another period"]
    assert one["undone"] == []
    assert [path.name for path in (tmp_path / "out").iterdir()] == ["0-diagnostics.png"]
    with pytest.raises(PhaseError, match="frame 3 shows fringes of"):
        run(*names, "--steps=0,120,240", "--out", tmp_path / "none")
    assert not (tmp_path / "none").exists()


@pytest.mark.parametrize(
    ("shift", "stated", "white"), [(4, None, 65520), (0, None, 4095), (0, 12, 4095), (4, 12, 65520)]
)
def test_twelve_bits_in_sixteen_saturate_where_they_end(shift, stated, white, fringed, tmp_path):
    bright = np.minimum(fringed([0, 120, 240], sigma=0.0).astype(int) * 24, 4095).astype(np.uint16) << shift
    names = written(tmp_path / "set", bright)
    bits = () if stated is None else (f"--bits={stated}",)
    found = run(*names, "--steps=0,120,240", "--diagnose", "--json", *bits)
    (one,) = json.loads(found.stdout)["captures"]
    assert "saturation" in [finding["name"] for finding in one["findings"]]
    assert "clipped slide" not in [finding["name"] for finding in one["findings"]]
    assert f"at {white:g}" in next(look["words"] for look in one["looked"] if look["subject"] == "saturation")


def test_bits_that_the_values_contradict_are_refused(fringed, tmp_path):
    names = written(tmp_path / "set", fringed([0, 120, 240]).astype(np.uint16) * 31)
    with pytest.raises(PhaseError, match="--bits 12 allows values up to 4095"):
        run(*names, "--steps=0,120,240", "--bits=12")


def written(folder, frames, pattern="{}.png"):
    """Write frames in a folder; return their names."""
    folder.mkdir(exist_ok=True)
    names = [folder / pattern.format(k) for k in range(len(frames))]
    for name, frame in zip(names, frames, strict=True):
        cv2.imwrite(str(name), frame)
    return names


@pytest.fixture
def fringed(fringes, camera, rng):
    """Give a camera's frames of a smooth scene for any steps in deg."""
    v, u = np.mgrid[:120, :200]
    truth = 2 * np.pi * (u + 0.2 * v) / 14 + 0.6 * np.exp(-((u - 100) ** 2 + (v - 60) ** 2) / 800)

    def taken(steps_deg, *, ratio=1.0, **options):
        return camera(fringes(ratio * truth, np.deg2rad(steps_deg)), rng, **({"sigma": 1.0} | options))

    return taken


def test_a_folder_of_pictures_in_natural_order(fringed, tmp_path):
    steps = [30 * k for k in range(12)]
    written(tmp_path / "set", fringed(steps))  # 10.png comes after 9.png
    found = json.loads(run(tmp_path / "set", "--steps", ",".join(map(str, steps)), "--json").stdout)["captures"][0]
    assert not found["steps"]["differ"]
    assert found["shares"]["valid"] == 1


def test_sixteen_bits_and_colour(fringed, tmp_path):
    deep = written(tmp_path / "deep", (fringed([0, 120, 240]).astype(np.uint16) * 257), "{}.tif")
    found = json.loads(run(*deep, "--steps=0,120,240", "--json").stdout)["captures"][0]
    assert found["modulation"] == pytest.approx(80 * 257, rel=0.01)
    colour = written(tmp_path / "colour", [np.dstack([f // 2, f, f // 3]) for f in fringed([0, 120, 240])])
    with pytest.raises(SessionError, match="colour without a rule"):
        run(*colour, "--steps=0,120,240")
    found = json.loads(run(*colour, "--steps=0,120,240", "--channel=green", "--json").stdout)["captures"][0]
    assert found["modulation"] == pytest.approx(80, rel=0.01)


@pytest.mark.parametrize("value", [0, 255])
def test_pictures_without_fringes_are_refused_and_nothing_is_written(value, tmp_path):
    names = written(tmp_path / "set", np.full((3, 60, 80), value, np.uint8))
    with pytest.raises(PhaseError, match="0.00% of the pixels carry fringes .(dark|saturated) 100%"):
        run(*names, "--steps=0,120,240", "--out", tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_a_wrong_order_that_cannot_be_undone_is_said(fringed, tmp_path):
    names = written(tmp_path / "set", fringed([0, 180, 90, 270]))
    with pytest.raises(PhaseError, match="in the order 1, 3, 2, 4"):
        run(*names, "--steps=0,90,180,270")
    assert "SWAPPED FRAMES" in run(*names, "--steps=0,90,180,270", "--diagnose").stdout


def test_wrong_counts_name_the_pictures(fringed, tmp_path):
    names = written(tmp_path / "set", fringed([0, 72, 144, 216]))
    with pytest.raises(PhaseError, match="found 4 pictures .0.png, 1.png, 2.png, 3.png. for 5 phase shifts"):
        run(*names, "--steps=0,72,144,216,288")
    with pytest.raises(PhaseError, match="for 2 phase shifts and 3 periods; needed: 6"):
        run(*names, "--steps=0,90", "--periods=8,64,512")
    (tmp_path / "none").mkdir()
    with pytest.raises(PhaseError, match="neither session.toml nor pictures"):
        run(tmp_path / "none", "--steps=0,120,240")


def test_two_periods_give_an_absolute_phase(fringed, tmp_path):
    steps = [0, 120, 240]
    sets = np.concatenate([fringed(steps, ratio=1 / 16), fringed(steps)])  # 17 fringes: a little more than a cycle
    names = written(tmp_path / "set", sets)
    found = run(*names, "--steps=0,120,240", "--periods=240,15", "--out", tmp_path / "out", "--json")
    (orders,) = json.loads(found.stdout)["orders"]
    assert orders["cycle"] == 16
    assert orders["undecided"] < 1e-3
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == [
        f"0-{part}.{kind}" for part in ("absolute", "period1", "period2") for kind in ("npz", "png")
    ]
    with np.load(tmp_path / "out" / "0-absolute.npz") as maps:
        v, u = np.mgrid[:120, :200]
        truth = 2 * np.pi * (u + 0.2 * v) / 14 + 0.6 * np.exp(-((u - 100) ** 2 + (v - 60) ** 2) / 800)
        off = (maps["absolute_phase_rad"] - truth) / (2 * np.pi)
    np.testing.assert_allclose(off, np.round(off[0, 0]), atol=0.05)
    assert "known within 16 fringes" in run(*names, "--steps=0,120,240", "--periods=240,15").stdout
    with pytest.raises(PhaseError, match="0: the pictures do not fit the stated periods"):
        run(*names, "--steps=0,120,240", "--periods=15,240")


def test_counts_or_an_extent_say_how_many_fringes_are_projected(fringed, tmp_path):
    sets = np.concatenate([fringed([0, 120, 240], ratio=1 / 16), fringed([0, 120, 240])])  # 16 fringes in the picture
    names = written(tmp_path / "set", sets)
    for stated in (("--counts=1.25,20",), ("--periods=16,1", "--extent=20")):
        (orders,) = json.loads(run(*names, "--steps=0,120,240", *stated, "--json").stdout)["orders"]
        assert orders["known_by"] == "displacement"  # a cycle of 16
    (orders,) = json.loads(run(*names, "--steps=0,120,240", "--periods=240,15", "--extent=240", "--json").stdout)[
        "orders"
    ]
    assert orders["known_by"] == "numbers"


def test_a_session_with_axes_writes_the_projectors_pixels(tmp_path):
    columns = np.linspace(10, 118, 160)[None, :] * np.ones((60, 1))
    rng, names = np.random.default_rng(5), []
    for count in (1, 8):
        for k, step in enumerate((0.0, 120.0, 240.0)):
            frame = 120 + 80 * np.cos(2 * np.pi * count * columns / 128 + np.deg2rad(step))
            names.append(f"{count}-{k}.png")
            cv2.imwrite(str(tmp_path / names[-1]), np.rint(frame + rng.normal(0, 1, frame.shape)).astype(np.uint8))
    (tmp_path / "session.toml").write_text(
        "format = 1\nrig = 'dlp'\ncaptured = 2026-11-22T10:00:00Z\n[projector]\nresolution_px = [128, 96]\n"
        "[phase]\nsteps_deg = [0.0, 120.0, 240.0]\n[[capture]]\nname = 'wall'\nkind = 'object'\naxes = ['u']\n"
        f"fringes = [1, 8]\nimages = {names}\n"
    )
    document = json.loads(run(tmp_path, "--out", tmp_path / "maps", "--json").stdout)
    (found,) = document["projector"]
    assert (found["name"], found["axis"], found["outside"]) == ("wall-u", "u", 0.0)
    with np.load(tmp_path / "maps" / "wall-u-projector.npz") as written:
        error = (written["projector_px"] - columns) / written["u_px"]
    # Each is right within its own uncertainty: 1 grey level on a modulation of 80, three steps, 16 px a fringe.
    assert np.nanstd(error) == pytest.approx(1, abs=0.06)
    assert np.nanmax(np.abs(error)) < 6
