"""Writing a session: what is written is what is read, and nothing is written by halves."""

import datetime
import math
import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fringecal.errors import SessionError
from fringecal.session import load_session, write_session
from fringecal.session.toml_text import to_toml
from fringecal.workflows.shared.stated_projector import projector_of

CAPTURED = datetime.datetime(2026, 11, 22, 10, tzinfo=datetime.UTC)


def document(**changed: Any) -> dict[str, Any]:
    captures = [{"name": "leaf", "kind": "object", "images": ["leaf-0.png", "leaf-1.png", "leaf-2.png"]}]
    base = {"format": 1, "rig": "virtual", "captured": CAPTURED, "phase": {"steps_deg": (0.0, 120.0, 240.0)}}
    return {**base, "capture": captures, **changed}


def frames(seed: int = 0, dtype: type = np.uint8) -> dict[str, np.ndarray]:
    random = np.random.default_rng(seed)
    return {f"leaf-{k}.png": random.integers(20, 220, (12, 16)).astype(dtype) for k in range(3)}


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
def test_what_is_written_is_read(tmp_path: Path, dtype: type) -> None:
    written = frames(dtype=dtype) if dtype is np.uint8 else {k: 257 * v for k, v in frames(dtype=dtype).items()}
    folder = write_session(tmp_path / "a" / "b", document(), written, extra_files={"truth/rig.toml": b"x = 1\n"})
    np.testing.assert_array_equal(load_session(folder).one("object").read(), list(written.values()))
    assert (folder / "truth" / "rig.toml").read_bytes() == b"x = 1\n"


def test_arrays_and_tuples_in_the_document(tmp_path: Path) -> None:
    projector = {"position_mm": {"value": np.array([0.0, 1222.0, 1000.0]), "u": (3.0, 3.0, 3.0)}}
    session = load_session(write_session(tmp_path / "s", document(projector=projector), frames()))
    assert session.projector is not None
    assert session.projector.position_mm.value == (0.0, 1222.0, 1000.0)


def test_a_folder_in_use_is_left_alone(tmp_path: Path) -> None:
    (tmp_path / "mine.txt").write_text("mine")
    with pytest.raises(SessionError, match="not empty"):
        write_session(tmp_path, document(), frames())
    with pytest.raises(SessionError, match="only a session is overwritten"):
        write_session(tmp_path, document(), frames(), overwrite=True)
    assert [path.name for path in tmp_path.iterdir()] == ["mine.txt"]


def test_a_session_is_replaced_as_a_whole(tmp_path: Path) -> None:
    folder = write_session(tmp_path / "s", document(), frames(), extra_files={"old.txt": b""})
    write_session(folder, document(rig="second"), frames(1), overwrite=True)
    assert load_session(folder).rig == "second"
    assert not (folder / "old.txt").exists()
    assert [path.name for path in tmp_path.iterdir()] == ["s"]


def test_all_faults_at_once_and_nothing_written(tmp_path: Path) -> None:
    wrong = {"../leaf-0.png": np.zeros((2, 2), np.uint8), "b.jpg": np.zeros((2, 2), np.uint8),
             "c.png": np.zeros((2, 2)), "d.png": np.zeros((2, 2, 3), np.uint8)}  # fmt: skip
    with pytest.raises(SessionError) as refused:
        write_session(tmp_path / "s", document(rigg="x"), wrong, extra_files={"session.toml": b""})
    said = "\n".join(refused.value.faults)
    for words in ("rigg", "../leaf-0.png", "b.jpg", "float64", "(2, 2, 3)", "made from the document"):
        assert words in said
    assert list(tmp_path.iterdir()) == []


def test_a_failure_half_way_leaves_the_old_session(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder = write_session(tmp_path / "s", document(), frames())

    def full_disk(*_: object) -> None:
        raise OSError("No space left on device")

    monkeypatch.setattr("fringecal.session.write._write_bytes", full_disk)
    with pytest.raises(OSError, match="No space"):
        write_session(folder, document(rig="second"), frames(1), overwrite=True)
    assert load_session(folder).rig == "virtual"
    assert [path.name for path in tmp_path.iterdir()] == ["s"]


KEYS = st.text(min_size=1, max_size=8)
SCALARS = (
    st.booleans()
    | st.integers(-(2**63), 2**63 - 1)
    | st.floats(allow_nan=False)
    | st.text(max_size=20)
    | st.datetimes(timezones=st.just(datetime.UTC))
)
VALUES = st.recursive(SCALARS, lambda inner: st.lists(inner, max_size=3) | st.dictionaries(KEYS, inner, max_size=3))


@settings(max_examples=80, deadline=None, derandomize=True)
@given(st.dictionaries(KEYS, VALUES, max_size=4))
def test_any_document_survives_the_standard_library_s_reader(given_document: dict[str, Any]) -> None:
    assert tomllib.loads(to_toml(given_document)) == given_document


def test_what_toml_cannot_hold() -> None:
    with pytest.raises(TypeError, match="complex"):
        to_toml({"a": 1j})
    assert math.isnan(tomllib.loads(to_toml({"a": math.nan}))["a"])


def test_a_mirror_is_read_beside_the_projector(tmp_path: Path) -> None:
    mirror = {"point_mm": {"value": (0.0, 1200.0, 1000.0), "u": 2.0}, "normal": (0.0, 1.0, -1.0)}
    projector = {"position_mm": {"value": (0.0, 400.0, 1000.0), "u": 3.0}, "mirror": mirror}
    session = load_session(write_session(tmp_path / "s", document(projector=projector), frames()))
    assert session.projector is not None
    assert session.projector.mirror is not None
    assert session.projector.mirror.normal == (0.0, 1.0, -1.0)
    # The plane through (., 1200, 1000) whose normal is (0, 1, -1): y and z about that point change places.
    stated = projector_of(session)
    assert stated is not None
    np.testing.assert_allclose(stated.value_mm, [0.0, 1200.0, 200.0], atol=1e-9)
