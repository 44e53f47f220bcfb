"""Captures that went wrong at the bench, end to end: each refusal names its cause and says what to do."""

import numpy as np
import pytest

from fringecal.errors import DetectionError, FitError, FringecalError, SessionError
from fringecal.session import temporary_session
from fringecal.simulate import RigSpec, simulate_session
from fringecal.workflows.angle.run import picture_angles
from fringecal.workflows.commission import calibrate_session, commission

COMMON = {"format": 1, "certificate": "drawn"}
GRID = COMMON | {
    "kind": "line-grid",
    "name": "grid",
    "polarity": "dark",
    "pitch_mm": {"value": 20.0, "u": 0.004},
    "line_width_mm": {"value": 2.0, "u": 0.05},
}
STRIPS = COMMON | {
    "kind": "strips",
    "name": "strips",
    "count": 8,
    "width_mm": {"value": 20.0, "u": 0.05},
    "gap_mm": {"value": 20.0, "u": 0.05},
    "height_mm": {"value": 3.0, "u": 0.005},
    "length_mm": {"value": 600.0, "u": 0.5},
}


def rig(**sections):
    """A small rig, 0.9 mm/px, fringes of 11 px; strips shift them by a third of a period."""
    document = {
        "name": "small",
        "camera": {"width_px": 360, "height_px": 270, "scale_mm_per_px": 0.9, "height_mm": 1500.0, "defocus_px": 0.5},
        "projector": {"position_mm": (0.0, 1222.0, 1000.0), "pitch_mm": 10.0, "contrast": 0.9},
        "light": {"ambient": 0.1},
        "capture": [
            {"name": "grid", "kind": "grid", "target": GRID},
            {"name": "reference", "kind": "reference"},
            {"name": "strips", "kind": "strips", "target": STRIPS},
        ],
    }
    return RigSpec.model_validate(document | {name: document.get(name, {}) | own for name, own in sections.items()})


@pytest.fixture(scope="module")
def taken():
    return simulate_session(rig(), seed=3, with_truth=False)


def anew(name, *, seed=5, **sections):
    """The frames of one capture taken again."""
    return simulate_session(rig(**sections), captures=[name], seed=seed, with_truth=False).frames


def moved(frames):
    """The bare plate two pixels further down the picture: 1.8 mm."""
    return {name: np.roll(frame, 2, axis=0) for name, frame in frames.items() if name.startswith("reference")}


def half_dark(frames):
    """The right half of the strips in a shadow that leaves 3 % of the light, with the camera's noise."""
    rng = np.random.default_rng(8)
    dark = {name: frame.astype(float) for name, frame in frames.items() if name.startswith("strips")}
    for frame in dark.values():
        frame[:, 180:] = 0.03 * frame[:, 180:] + rng.standard_normal((len(frame), 180))
    return {name: np.clip(np.round(frame), 0, 255).astype(np.uint8) for name, frame in dark.items()}


FAULTS = {
    "room-light": (
        lambda _: anew("strips", projector={"contrast": 0.0}),
        DetectionError,
        r"'strips': only . % of the picture carries fringes.*projector's light must carry fringes",
    ),
    "moved": (moved, FitError, r"-1\.1. rad.*plate, projector or mirror moved between the two"),
    "swapped": (
        lambda frames: {"strips-1.png": frames["strips-2.png"], "strips-2.png": frames["strips-1.png"]},
        DetectionError,
        "'strips', swapped frames: .*check the order of the files",
    ),
    "copied": (
        lambda frames: {"strips-1.png": frames["strips-0.png"]},
        SessionError,
        "strips-0.png, strips-1.png are byte for byte the same file",
    ),
    "not-stepped": (
        lambda _: {"strips-1.png": anew("strips", seed=77)["strips-0.png"]},
        DetectionError,
        "'strips', duplicate frames: frames 1 and 2 are of the same phase shift",
    ),
    "saturated": (
        lambda _: anew("reference", light={"mid_grey": 0.75}) | anew("strips", light={"mid_grey": 0.75}),
        FitError,
        "'reference': only .*is saturated; expose shorter",
    ),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_a_refusal_names_its_cause(taken, fault):
    spoil, kind, words = FAULTS[fault]
    with (
        pytest.raises(FringecalError, match=words) as refused,
        temporary_session(taken.document, taken.frames | spoil(taken.frames), extra_files=taken.files) as session,
    ):
        commission(session)
    assert isinstance(refused.value, kind)
    assert str(refused.value).count("ither ") <= 1  # a cause that is known leaves nothing to guess


def test_half_the_strips_in_shadow_leave_the_other_half(taken):
    """1000 mm up and 1222 mm to the side: 50.71 deg at the origin, whatever part of the strips is lit."""
    frames = taken.frames | half_dark(taken.frames)
    with temporary_session(taken.document, frames, extra_files=taken.files) as session:
        found = calibrate_session(session).result
        ridge = picture_angles(session, found.camera, estimator="ridge")
    for angle in (found.origin.angle, ridge.angle):
        assert abs(angle.value - np.degrees(np.arctan(1.222))) < 2 * angle.u
        assert angle.u < 0.12
    dark = found.strips.found.regions.labels[:, 190:]
    assert not np.isfinite(found.strips.found.difference_rad[:, 190:][dark > 0]).any()
