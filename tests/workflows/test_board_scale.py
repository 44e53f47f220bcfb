"""A board on the plate in place of the line grid: the scale it gives is that of the rig it was drawn by."""

import pytest

from fringecal.errors import DetectionError
from fringecal.session import load_session, write_session
from fringecal.simulate import load_rig, simulate_session, truth_of
from fringecal.workflows.commission import measure_camera

SQUARE = {"value": 25.0, "u": 0.01}
PITCH, DOT = {"value": 20.0, "u": 0.008}, {"value": 8.0, "u": 0.05}
BOARDS = {
    "charuco": {
        "squares": [14, 10],
        "square_mm": SQUARE,
        "marker_mm": {"value": 18.0, "u": 0.05},
        "dictionary": "DICT_5X5_100",
    },
    "dots": {"columns": 17, "rows": 13, "pitch_mm": PITCH, "diameter_mm": DOT},
}


def session_with(folder, target):
    """The thesis's rig with another target in place of its grid paper."""
    rig = load_rig("thesis")
    lying = tuple(c.model_copy(update={"target": target}) if c.kind == "grid" else c for c in rig.capture)
    rig = rig.model_copy(update={"capture": lying})
    taken = simulate_session(rig, ["grid"], seed=2)
    extra = {name: file for name, file in taken.files.items() if "truth" not in name}
    write_session(folder, taken.document, taken.frames, extra_files=extra)
    return load_session(folder), truth_of(rig)


@pytest.mark.parametrize("kind", BOARDS)
def test_a_board_gives_the_scale_within_its_uncertainty(kind, tmp_path):
    target = {"format": 1, "kind": kind, "name": kind, "certificate": "drawn", **BOARDS[kind]}
    session, true = session_with(tmp_path / "session", target)
    found = measure_camera(session)
    scale = found.scales["mean"]
    assert scale.value == pytest.approx((true.scale_h + true.scale_v) / 2, abs=scale.expanded().U)
    assert scale.u / scale.value < 1e-3  # the print's own 4e-4 and what a hundred corners leave
    assert found.distortion.verdict == "none"


def test_asymmetric_dots_are_refused_with_what_to_use(tmp_path):
    target = {"format": 1, "kind": "dots", "name": "dots", "certificate": "drawn", **BOARDS["dots"]}
    target |= {"columns": 8, "asymmetric": True}
    session, _ = session_with(tmp_path / "session", target)
    with pytest.raises(DetectionError, match="symmetric dots, a chessboard"):
        measure_camera(session)
