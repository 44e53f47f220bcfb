"""Captures whose fringes vary along the projector's axes: read in their order, refused where they cannot be so."""

import re
from typing import Any

import numpy as np
import pytest

from fringecal.errors import SessionError
from fringecal.session import check_session, load_session
from fringecal.session.fringes.fringe_axes import first_ambiguity_px

Bench = Any  # the fixture of conftest.py


def add_pose(bench: Bench, *, n_u: int = 2, n_v: int = 2, **keys: Any) -> dict[str, Any]:
    """Put a board pose of both axes into a session, each picture of its own brightness."""
    names = [
        f"pose-{axis}{k}-{n}.png" for axis, count in (("u", n_u), ("v", n_v)) for k in range(count) for n in (0, 1, 2)
    ]
    table = {"name": "pose", "kind": "board", "target": "chessboard-9x6-25mm", "images": names, "axes": ["u", "v"]}
    table |= {"fringes": [1, 8], "white": ["pose-white.png"], "black": ["pose-black.png"]} | keys
    bench.document["capture"].append({key: value for key, value in table.items() if value is not None})
    bench.document["projector"]["resolution_px"] = [192, 96]
    for seed, name in enumerate((*names, "pose-white.png", "pose-black.png")):
        bench.put(name, bench.fringes(900 + seed))
    return bench.document["capture"][-1]


def said(bench: Bench) -> list[str]:
    bench.save()
    return [str(fault) for fault in check_session(bench.folder).faults]


def test_axes_come_in_the_order_repeat_axis_period_step(bench: Bench) -> None:
    add_pose(bench)
    bench.save()
    capture = load_session(bench.folder).captures["pose"]
    assert [axis.name for axis in capture.axes] == ["u", "v"]
    assert capture.axes[0].periods_px == (192, 24)
    assert capture.axes[1].periods_px == (96, 12)
    frames = capture.read()
    assert np.array_equal(capture.along("v").read_set(period=1), frames[9:12])
    assert np.array_equal(capture.along("u").read_set(period=0), frames[:3])
    assert np.array_equal(capture.read_set(period=1), frames[3:6])
    assert capture.read_light("white").shape == capture.shape
    assert len(capture.files) == 14


def test_repeats_are_whole_sets_of_both_axes(bench: Bench) -> None:
    table = add_pose(bench)
    more = [name.replace("pose-", "again-") for name in table["images"]]
    for seed, name in enumerate(more):
        bench.put(name, bench.fringes(970 + seed))
    table.update(images=[*table["images"], *more], repeat=2)
    bench.save()
    capture = load_session(bench.folder).captures["pose"]
    assert np.array_equal(capture.along("v").read_set(repeat=1, period=0), capture.read()[18:21])


def test_axes_may_differ_in_their_periods(bench: Bench) -> None:
    add_pose(bench, n_v=1, fringes={"u": [1, 8], "v": [0.9]})
    bench.save()
    capture = load_session(bench.folder).captures["pose"]
    assert capture.axes[1].periods_px == pytest.approx((96 / 0.9,))


def test_an_axis_that_is_not_there_is_refused(bench: Bench) -> None:
    add_pose(bench, n_v=0, axes=["u"])
    bench.save()
    with pytest.raises(SessionError, match="no fringes vary along v, only along u"):
        load_session(bench.folder).captures["pose"].along("v")


@pytest.mark.parametrize(
    ("keys", "words"),
    [
        ({"fringes": None}, ["no fringe period along u"]),
        ({"periods": [8, 64]}, ["two statements of one fact", "keep periods"]),
        ({"axes": ["u", "u"]}, ["listed twice"]),
        ({"axes": ["u", "w"]}, ["axes", "columns are counted along u"]),
        ({"fringes": {"u": [1, 8]}}, ["stated for u, while axes"]),
        ({"fringes": {"u": [1, 8], "w": [1]}}, ['unknown key "w"']),
        ({"fringes": [1, 8, 8]}, ["equal fringes"]),
        ({"zeros_deg": [10.0]}, ["1 phase zeros for 2 periods along u"]),
        ({"falling": ["v"], "axes": ["u"], "fringes": [1, 8, 3, 5]}, ["falling", "v is no axis"]),
        ({"gray": ["g.png"]}, ["one list of pictures for two axes"]),
        ({"axes": None}, ["fringes", "white", "black", 'state axes = ["u"]']),
        ({"steps_deg": []}, ["fringes without phase shifts"]),
    ],
)
def test_what_does_not_go_together_is_named(bench: Bench, keys: dict[str, Any], words: list[str]) -> None:
    add_pose(bench, **keys)
    faults = " ".join(said(bench))
    assert all(word in faults for word in words), faults


def test_axes_need_the_projectors_pixels(bench: Bench) -> None:
    add_pose(bench)
    del bench.document["projector"]["resolution_px"]
    assert [fault for fault in said(bench) if "resolution_px = [columns, rows]" in fault]


def test_a_list_that_is_right_as_numbers_of_fringes_says_so(bench: Bench) -> None:
    add_pose(bench, axes=["u"], n_u=3, n_v=0, fringes=None, periods=[18, 20, 24])
    bench.document["projector"]["resolution_px"] = [1920, 1080]
    (fault,) = said(bench)
    # 360 is the least common multiple of 18, 20 and 24; as numbers they share the divisor 2: no better.
    assert "look the same again after 360 px" in fault
    assert "add a longer period" in fault
    bench.document["capture"][-1]["periods"] = [18, 20, 25]
    (fault,) = said(bench)
    assert "look the same again after 900 px" in fault
    assert "as fringes = [18, 20, 25] they would not" in fault


def test_a_list_that_is_right_as_lengths_says_so(bench: Bench) -> None:
    add_pose(bench, axes=["u"], n_u=2, n_v=0, fringes=[40, 50])
    bench.document["projector"]["resolution_px"] = [190, 96]
    (fault,) = said(bench)
    # 40 and 50 fringes meet again after a tenth of the picture; as lengths, after 200 px.
    assert "look the same again after 19 px" in fault
    assert "as periods = [40, 50] they would not" in fault


def test_a_projector_table_says_something(bench: Bench) -> None:
    bench.document["projector"] = {}
    assert any("resolution_px" in fault for fault in said(bench))
    point = {"value": [0.0, 1.0, 2.0], "u": 1.0}
    mirror = {"point_mm": point, "normal": [0.0, 0.0, 1.0]}
    bench.document["projector"] = {"mirror": mirror, "resolution_px": [8, 8]}
    assert any("mirror without position_mm" in fault for fault in said(bench))


@pytest.mark.parametrize("periods", [(18, 20), (7.5, 9, 10)])
def test_the_first_ambiguity_is_the_least_common_multiple(periods) -> None:
    doubled = [round(2 * p) for p in periods]
    assert first_ambiguity_px(periods, 10_000) == pytest.approx(np.lcm.reduce(doubled) / 2)


PATTERNS = """
format = "fringecal-patterns/1"
[projector]
resolution_px = [192, 96]
[phase]
steps_deg = [0.0, 120.0, 240.0]
[capture]
axes = ["u"]
periods = [16.0, 192.0]
zeros_deg = [0.0, 0.0]
falling = []
images = ["u-1-0.png"]
"""


def with_patterns(bench: Bench, **keys: Any) -> None:
    (bench.folder / "patterns.toml").write_text(PATTERNS, encoding="utf-8")
    files = [bench.put(f"p{k}.png", bench.fringes(800 + k)).name for k in range(6)]
    capture = {"name": "surface", "kind": "object", "images": files, "patterns": "patterns.toml"}
    bench.document["capture"].append(capture | keys)


def test_a_capture_takes_axes_periods_and_steps_from_its_patterns(bench: Bench) -> None:
    with_patterns(bench)
    bench.document["projector"].pop("resolution_px", None)
    assert said(bench) == []
    session = load_session(bench.folder)
    (axis,) = session.captures["surface"].axes
    assert (axis.name, axis.extent_px, axis.periods_px, axis.falls) == ("u", 192, (16.0, 192.0), False)
    assert np.allclose(np.degrees(session.captures["surface"].phase_shifts_rad), [0, 120, 240])
    assert "patterns.toml" in session.inputs


@pytest.mark.parametrize(
    ("keys", "resolution", "words"),
    [
        ({"fringes": [1, 12]}, [192, 96], "fringes stated beside it, which the set says already"),
        ({}, [192, 108], r"the set is drawn for \[192, 96\] px, and projector.resolution_px = \[192, 108\]"),
        ({"patterns": "other.toml"}, [192, 96], "other.toml"),
        ({"patterns": "session.toml"}, [192, 96], "describes no set of patterns"),
        ({"patterns": "../patterns.toml"}, [192, 96], "outside the session folder"),
        ({"pose": "1"}, [192, 96], "a capture of kind object has none"),
    ],
)
def test_patterns_that_contradict_or_are_none_are_refused(bench: Bench, keys, resolution, words: str) -> None:
    with_patterns(bench, **keys)
    bench.document["projector"]["resolution_px"] = resolution
    assert re.search(words, " ".join(said(bench)))
