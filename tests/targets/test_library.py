import copy

import pytest
from pydantic import TypeAdapter

from fringecal.errors import TargetError
from fringecal.targets import Target, list_targets, load_target, parse_target


def mm(value, u=0.01):
    return {"value": value, "u": u}


def stated(kind, **fields):
    return {"format": 1, "kind": kind, "name": "a target", "certificate": "nominal", **fields}


GOOD = {
    "line-grid": stated("line-grid", pitch_mm=mm(10.0), line_width_mm=mm(0.9), lines=[5, 7], polarity="light"),
    "chessboard": stated("chessboard", columns=9, rows=6, square_mm=mm(25.0)),
    "charuco": stated("charuco", squares=[5, 7], square_mm=mm(30.0), marker_mm=mm(22.0), dictionary="DICT_4X4_50"),
    "dots": stated("dots", columns=4, rows=11, pitch_mm=mm(10.0), diameter_mm=mm(12.0), asymmetric=True),
    "flat": stated("flat", flatness_mm=mm(0.0)),
    "strips": stated(
        "strips",
        count=3,
        width_mm=mm(10.0),
        gap_mm=mm([9.0, 11.0]),
        height_mm=mm([3, 3.1, 3]),
        length_mm=mm(400.0),
    ),
    "zigzag": stated(
        "zigzag", count=5, leg_mm=mm(40.0), apex_deg=mm(90.0), length_mm=mm(350.0), ridge_radius_mm=mm(1.0)
    ),
    "steps": stated("steps", heights_mm=mm([5.0, 10.0]), width_mm=mm(30.0), length_mm=mm(60.0)),
    "wedge": stated("wedge", angle_deg=mm(20.0), width_mm=mm(80.0), length_mm=mm(60.0)),
    "box": stated("box", width_mm=mm(1.0), length_mm=mm(2.0), height_mm=mm(3.0)),
    "sphere": stated("sphere", diameter_mm=mm(20.0)),
    "ball-bar": stated("ball-bar", diameters_mm=mm([20.0, 30.0]), spacing_mm=mm(100.0)),
}


@pytest.mark.parametrize("kind", GOOD)
def test_every_kind_is_read_and_survives_json(kind):
    target = parse_target(GOOD[kind])
    assert target.kind == kind
    again = TypeAdapter(Target).validate_json(target.model_dump_json())
    assert again == target


def test_shipped_targets_carry_the_sizes_of_the_thesis():
    assert {"grid-10mm", "glass-strips", "flat-plate", "angle-bars", "rectangle", "step-block"} <= set(list_targets())
    strips = load_target("glass-strips")
    assert (strips.count, strips.width_mm.value, strips.gap_mm.value) == (12, 10.0, 10.0)
    assert (strips.height_mm.value, strips.length_mm.value) == (3.0, 400.0)
    bars = load_target("angle-bars")
    assert (bars.leg_mm.value, bars.apex_deg.value) == (40.0, 90.0)
    assert load_target("grid-10mm").pitch_mm.value == 10.0


@pytest.mark.parametrize("name", list_targets())
def test_shipped_targets_do_not_claim_a_calibration(name):
    target = load_target(name)
    assert target.certificate.startswith("nominal, not calibrated")


def test_a_path_is_relative_to_its_folder(tmp_path):
    text = 'format = 1\nkind = "sphere"\nname = "ball"\ncertificate = "x"\n'
    text += "diameter_mm = { value = 20, u = 0.1 }\n"
    (tmp_path / "ball.toml").write_text(text)
    assert load_target("ball.toml", folder=tmp_path).diameter_mm.value == 20.0
    assert load_target(tmp_path / "ball.toml").name == "ball"
    with pytest.raises(TargetError, match=r'for the file beside it write "ball\.toml"'):
        load_target("ball", folder=tmp_path)


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("grid-10", "nearest: grid-10mm"),
        ("qqqq", "nearest: angle-bars, charuco"),
        ("", "nearest: angle-bars"),
        ("../secret", "no shipped target"),
        ("missing.toml", "no such target file"),
    ],
)
def test_unknown_names_are_answered_with_the_nearest(name, message):
    with pytest.raises(TargetError, match=message):
        load_target(name)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", "2 faults"),
        (b"format = 1\nkind = ", "not valid TOML: Invalid value"),
        (b"\xff\xfe\x00", "not UTF-8"),
        (b"\x89PNG\r\n", "not UTF-8"),
    ],
)
def test_files_that_are_no_targets(tmp_path, content, message):
    (tmp_path / "t.toml").write_bytes(content)
    with pytest.raises(TargetError, match=message):
        load_target("t.toml", folder=tmp_path)


def test_a_folder_is_no_target(tmp_path):
    (tmp_path / "t.toml").mkdir()
    with pytest.raises(TargetError, match="is a folder"):
        load_target("t.toml", folder=tmp_path)


@pytest.mark.parametrize(
    ("kind", "change", "message"),
    [
        ("strips", {"format": 2}, r"format: this version reads format = 1, found 2"),
        ("strips", {"format": True}, "format: .* found True"),
        ("strips", {"kind": "strip"}, 'did you mean "strips"'),
        ("strips", {"kind": ["strips"]}, "kind: .* is unknown"),
        ("strips", {"certificate": None}, "certificate: is missing; state where the numbers come from"),
        ("strips", {"certificate": "  "}, "certificate: .*at least 1 character"),
        ("strips", {"name": 7}, "name: .*string"),
        ("strips", {"hieght_mm": 3}, 'hieght_mm: unknown key; did you mean "height_mm"'),
        ("strips", {"width_mm": mm(1.0) | {"distributoin": "x"}}, 'unknown key; did you mean "distribution"'),
        ("strips", {"width_mm": {"value": 1.0}}, "width_mm.u: is missing; write"),
        ("strips", {"width_mm": 10.0}, "width_mm: found 10.0 without its uncertainty"),
        ("strips", {"width_mm": None}, "width_mm: is missing; write"),
        ("strips", {"count": 0}, "count: .*greater than or equal to 1"),
        ("strips", {"count": 2.5}, "count: .*integer, found 2.5"),
        ("strips", {"count": "3"}, "count: .*integer, found '3'"),
        ("strips", {"height_mm": mm([3.0, 3.0])}, "height_mm: 2 values for 3 strips; give one value or 3"),
        ("strips", {"gap_mm": mm([1.0, 2.0, 3.0])}, "gap_mm: 3 values for 2 gaps"),
        ("strips", {"gap_mm": mm(0.0)}, "gap_mm: must be greater than zero, found 0"),
        ("strips", {"gap_mm": None}, "gap_mm: is missing; 3 strips have 2 gaps"),
        ("strips", {"height_mm": mm([3, -1, 3])}, "height_mm: must be greater than zero, found -1"),
        ("zigzag", {"apex_deg": mm(180.0)}, "apex_deg: .*below 180"),
        ("zigzag", {"ridge_radius_mm": mm(40.0)}, "ridge_radius_mm: .*must be below 40"),
        ("zigzag", {"leg_mm": mm([40.0, 41.0])}, "leg_mm.value: one finite number"),
        ("charuco", {"marker_mm": mm(30.0)}, "marker_mm: 30 must be smaller than square_mm 30"),
        ("charuco", {"dictionary": "DICT_4x4_5O"}, 'did you mean "DICT_4X4_50"'),
        ("charuco", {"squares": [20, 20]}, "DICT_4X4_50 has 50 markers and the board needs 200"),
        ("charuco", {"squares": [5]}, "squares"),
        ("dots", {"diameter_mm": mm(15.0)}, "diameter_mm: dots of 15 overlap at 14.1421"),
        ("dots", {"asymmetric": False}, "diameter_mm: dots of 12 overlap at 10"),
        ("line-grid", {"line_width_mm": mm(10.0)}, "line_width_mm: 10 must be smaller than pitch_mm 10"),
        ("line-grid", {"polarity": "grey"}, "polarity: .*'dark' or 'light'"),
        ("line-grid", {"lines": [1, 7]}, r"lines\.0: .*greater than or equal to 2"),
        ("line-grid", {"heavy_width_mm": mm(2.0)}, "heavy_width_mm without heavy_every"),
        ("flat", {"flatness_mm": mm(-0.1)}, "flatness cannot be negative"),
        ("steps", {"width_mm": mm([1.0, 2.0, 3.0])}, "width_mm: 3 values for 2 steps"),
        ("wedge", {"angle_deg": mm(90.0)}, "angle_deg: .*below 90"),
        ("ball-bar", {"diameters_mm": mm([1.0, 2.0, 3.0])}, "3 values for 2 balls"),
        ("ball-bar", {"spacing_mm": mm(24.0)}, "balls overlap: 24 between centres, radii sum to 25"),
    ],
)
def test_one_fault_is_named_with_its_remedy(kind, change, message):
    broken = copy.deepcopy(GOOD[kind]) | change
    broken = {key: value for key, value in broken.items() if value is not None}
    with pytest.raises(TargetError, match=message) as refusal:
        parse_target(broken, where="bench/t.toml")
    assert str(refusal.value).startswith("bench/t.toml: 1 fault")


def test_all_faults_are_listed_at_once():
    broken = stated(
        "strips",
        count=3,
        width_mm=10.0,
        gap_mm=mm(-1.0),
        height_mm=mm([3.0, 3.0]),
        lenght_mm=mm(400.0),
        format=3,
    )
    del broken["certificate"]
    with pytest.raises(TargetError) as refusal:
        parse_target(broken)
    message = str(refusal.value)
    assert "7 faults" in message
    for where in ("format", "certificate", "width_mm", "gap_mm", "height_mm", "length_mm", "lenght_mm"):
        assert f"\n  - {where}: " in message


def test_one_strip_needs_no_gap():
    one = {key: value for key, value in GOOD["strips"].items() if key != "gap_mm"}
    assert parse_target(one | {"count": 1, "height_mm": mm(3.0)}).gap_mm is None
