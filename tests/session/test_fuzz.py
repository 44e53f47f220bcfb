"""Nonsense of all kinds: a check answers with faults and never with another error."""

import contextlib
import tempfile
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from fringecal.session import check_session
from fringecal.session.faults import PictureError
from fringecal.session.parse import parse_text
from fringecal.session.pictures.picture import decode
from fringecal.session.toml_text import to_toml

Bench = Any  # the fixture of conftest.py
quietly = settings(
    max_examples=80,
    deadline=None,
    derandomize=True,
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)

WORDS = (
    "format rig captured operator camera projector phase capture name kind target images steps_deg periods "
    "gray repeat bits channel height_mm position_mm telecentric model value u nonsense"
)
KEYS = st.sampled_from(WORDS.split())
SCALARS = st.booleans() | st.integers(-5, 20) | st.floats() | st.sampled_from(
    ["", "grid", "strips", "a.png", "*", "**/x", "[", "../..", "glass-strips", "a\0b", "\n"]
)  # fmt: skip
VALUES = st.recursive(SCALARS, lambda v: st.lists(v, max_size=4) | st.dictionaries(KEYS, v, max_size=5), max_leaves=12)


@quietly
@given(st.dictionaries(KEYS, VALUES, max_size=8))
def test_documents_of_right_words_in_wrong_places(document: dict[str, Any]) -> None:
    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / "session.toml").write_text(to_toml(document), encoding="utf-8")
        check = check_session(folder)
    assert check.faults
    assert check.session is None


@quietly
@given(place=st.sampled_from(["rig", "camera", "phase", "projector", "capture"]), value=VALUES)
def test_one_table_replaced_by_anything(bench: Bench, place: str, value: object) -> None:
    document = {**bench.document, place: value}
    (bench.folder / "session.toml").write_text(to_toml(document), encoding="utf-8")
    check = check_session(bench.folder)
    assert bool(check.faults) != (check.session is not None)


@quietly
@given(key=KEYS, value=VALUES)
def test_one_key_of_a_capture_replaced_by_anything(bench: Bench, key: str, value: object) -> None:
    captures = [dict(capture) for capture in bench.document["capture"]]
    captures[3][key] = value
    (bench.folder / "session.toml").write_text(to_toml({**bench.document, "capture": captures}), encoding="utf-8")
    check = check_session(bench.folder)
    assert bool(check.faults) != (check.session is not None)


@quietly
@given(st.text(max_size=60))
def test_any_text(text: str) -> None:
    assert parse_text(text).faults


def pictures() -> dict[str, bytes]:
    frame = np.random.default_rng(3).integers(0, 255, (24, 31)).astype(np.uint8)
    return {ending: cv2.imencode(ending, frame)[1].tobytes() for ending in (".png", ".jpg", ".bmp", ".tif")}


PICTURES = pictures()


@quietly
@given(data=st.data(), ending=st.sampled_from(sorted(PICTURES)))
def test_pictures_with_some_bytes_changed(data: st.DataObject, ending: str) -> None:
    content = bytearray(PICTURES[ending])
    for _ in range(data.draw(st.integers(1, 4))):
        content[data.draw(st.integers(4, len(content) - 1))] = data.draw(st.integers(0, 255))
    with contextlib.suppress(PictureError):
        assert decode(bytes(content)).pixels.dtype in (np.uint8, np.uint16)


@quietly
@given(data=st.data(), ending=st.sampled_from(sorted(PICTURES)))
def test_pictures_cut_short(data: st.DataObject, ending: str) -> None:
    content = PICTURES[ending]
    # A TIFF's directory may stand at its end and its last tag's spare bytes carry nothing.
    spare = 16 if ending == ".tif" else 1
    with pytest.raises(PictureError):
        decode(content[: data.draw(st.integers(0, len(content) - spare))])
