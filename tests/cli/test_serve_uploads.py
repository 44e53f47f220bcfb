"""Names and sizes of what a browser sends: only a session's own files, whole or not at all."""

import io

import pytest

from fringecal.serve.access import Refused
from fringecal.serve.uploads import Bounds, places_of, receive


def parts(*names, size=10):
    return [(name, io.BytesIO(b"x" * size)) for name in names]


def test_a_folder_is_written_as_it_was_chosen(tmp_path):
    sent = [("rig 1/session.toml", io.BytesIO(b"format = 1")), ("rig 1/grid/Ä-0.PNG", io.BytesIO(b"picture"))]
    folder = receive(sent, tmp_path / "new", Bounds())
    assert sorted(str(file.relative_to(folder)) for file in folder.rglob("*") if file.is_file()) == [
        "grid/Ä-0.PNG", "session.toml"
    ]  # fmt: skip
    assert (folder / "grid" / "Ä-0.PNG").read_bytes() == b"picture"
    assert folder.stat().st_mode & 0o077 == 0  # for its owner alone


@pytest.mark.parametrize(
    "name",
    [
        "../session.toml",
        "a/../../b.png",
        "a/..",
        "/etc/passwd.png",
        "//server/share.png",
        "C:/windows/a.png",
        "C:\\windows\\a.png",
        "..\\a.png",
        "a\0.png",
        "a\n.png",
        "a\u202egnp.png",  # shown in another order than it is written
        ".hidden.png",
        "./a.png",
        "a//b.png",
        "a/",
        "",
        ".",
        "nul.png",
        "a .png/ ",
        "x" * 200 + ".png",
        "~/a?.png",
    ],
)
def test_names_that_lead_elsewhere_are_refused_and_leave_nothing(name, tmp_path):
    with pytest.raises(Refused, match="plain names"):
        receive(parts("session.toml", name), tmp_path / "new", Bounds())
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("name", ["run.sh", "grid.png.exe", "page.html", "png", "truth.npz", "README"])
def test_other_files_than_those_of_sessions_are_refused(name, tmp_path):
    with pytest.raises(Refused, match=r"no file that sessions use.*\.png") as refused:
        receive(parts("session.toml", name), tmp_path / "new", Bounds())
    assert refused.value.code == 415
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("names", "words"),
    [
        (["a/b/session.toml", "a/b/grid/x/y.png"], "folders in folders"),
        (["session.toml", "grid.png", "GRID.png"], "stand twice"),
        (["session.toml", "a.png", "a.png/b.png"], "stand twice"),
        (["other/grid.png", "other/strips.png"], r"no session\.toml"),
        ([], r"no session\.toml"),
        (["one/session.toml", "two/session.toml"], r"no session\.toml"),
    ],
)
def test_what_is_no_session_folder_is_refused(names, words):
    with pytest.raises(Refused, match=words):
        places_of(names)


def test_more_than_is_taken_is_refused_and_leaves_nothing(tmp_path):
    names = [f"{k}.png" for k in range(4)]
    assert len(places_of(["session.toml", *names], Bounds(files=5))) == 5
    with pytest.raises(Refused, match="5 files were sent, at most 4") as many:
        receive(parts("session.toml", *names), tmp_path / "many", Bounds(files=4))
    # Five files of 0.3 MB: the fourth goes past 1 MB, when three are already written.
    with pytest.raises(Refused, match="too large") as large:
        receive(parts("session.toml", *names, size=300_000), tmp_path / "large", Bounds(megabytes=1))
    assert many.value.code == large.value.code == 413
    assert list(tmp_path.iterdir()) == []


def test_a_folder_that_is_there_is_not_written_into(tmp_path):
    (tmp_path / "session.toml").write_text("mine")
    with pytest.raises(FileExistsError):
        receive(parts("session.toml"), tmp_path, Bounds())
    assert (tmp_path / "session.toml").read_text() == "mine"
