"""The rigs that the procedures are judged on: each commissioned and measured once, with its truth beside it."""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from fringecal.phase.diagnostics.finding_kinds import FINDING_TEXTS
from fringecal.projector import BOARD_RIG_NAMES
from fringecal.projector.move_kinds import MOVE_TEXTS
from fringecal.records import BoardCalibrationRecord, write_board_calibration
from fringecal.session import Session, load_session, write_session
from fringecal.simulate import (
    load_raster_rig,
    load_rig,
    raster_truth,
    simulate_raster_session,
    simulate_session,
    truth_of,
)
from fringecal.uncertainty.influences import TEXTS
from fringecal.workflows.audit.cause_kinds import CAUSE_TEXTS
from fringecal.workflows.commission import CalibratedSession, Commissioning, commission
from fringecal.workflows.shared import inputs_of, session_note
from fringecal.workflows.verify import Verification, studied

SEED = 2008
TEXT_TABLES = (TEXTS, FINDING_TEXTS, MOVE_TEXTS, CAUSE_TEXTS)

# Low enough for a step under half a fringe, wider than long, in the picture's upper right: x > 0, y > 0.
BOX = {
    "name": "box",
    "kind": "object",
    "position_mm": (110.0, 95.0),
    "target": {
        "format": 1,
        "kind": "box",
        "name": "low box",
        "certificate": "drawn",
        "width_mm": {"value": 80.0, "u": 0.01},
        "length_mm": {"value": 40.0, "u": 0.01},
        "height_mm": {"value": 2.0, "u": 0.01},
    },
}

# Tops up to seven fringes above the plate, turned, so that their shadows fall across the raster.
BLOCK = {
    "name": "block",
    "kind": "artefact",
    "position_mm": (10.0, -15.0),
    "rotation_deg": 20.0,
    "target": "step-block",
}


@dataclass(frozen=True)
class Judged:
    """A rig as commissioned and verified, and what is true of it."""

    session: Session
    commissioned: Commissioning
    bars: Verification
    truth: dict[str, Any]
    maps: dict[str, np.ndarray]

    @property
    def found(self) -> CalibratedSession:
        return self.commissioned.calibrated

    @property
    def scale_error(self) -> float:
        """Relative error of the mean scale."""
        return self.found.result.camera.scales["mean"].value / ((self.truth["scale_h"] + self.truth["scale_v"]) / 2) - 1

    @property
    def angle_error_deg(self) -> float:
        return self.found.result.origin.angle.value - self.truth["angle_origin_deg"]


def judged(commissioned: Commissioning, truth: dict[str, Any], maps: dict[str, np.ndarray]) -> Judged:
    (bars,) = commissioned.verified.bars
    bars = studied(bars, commissioned.calibrated.result.rig, with_filters=False)
    return Judged(commissioned.calibrated.session, commissioned, bars, truth, maps)


def simulated(rig, folder: Path) -> Judged:
    taken = simulate_session(rig, seed=SEED)
    write_session(
        folder, taken.document, taken.frames, extra_files={n: f for n, f in taken.files.items() if "truth" not in n}
    )
    true = truth_of(rig)
    truth = {"scale_h": true.scale_h, "scale_v": true.scale_v, "angle_origin_deg": true.angle_origin_deg}
    return judged(commission(load_session(folder)), truth, {name: frames.z for name, frames in taken.captures.items()})


@pytest.fixture(scope="session")
def thesis(tmp_path_factory) -> Judged:
    rig = load_rig("thesis")
    captures = [c.model_dump() for c in rig.capture if c.name != "leaf"]
    return simulated(rig.at(capture=[*captures, BOX, BLOCK]), tmp_path_factory.mktemp("thesis") / "session")


@pytest.fixture(scope="session")
def thesis_7(tmp_path_factory) -> Judged:
    rig = load_rig("thesis-7")
    captures = [c.model_dump() for c in rig.capture if c.name != "leaf"]
    return simulated(rig.at(capture=captures), tmp_path_factory.mktemp("thesis-7") / "session")


@pytest.fixture(scope="session")
def oblique(oblique_commissioned) -> Judged:
    folder = oblique_commissioned.calibrated.session.folder
    with np.load(folder / "truth.npz") as maps:
        return judged(oblique_commissioned, json.loads((folder / "truth.json").read_text()), dict(maps))


@pytest.fixture
def renamed(monkeypatch):
    """Every influence, finding, move and cause under one and the same other text."""
    for table in TEXT_TABLES:
        for one in table:
            monkeypatch.setitem(table, one, "renamed")


# ---- a rig with a raster projector
VOLUME_PX = (360, 288)
VOLUME_CAMERA = {
    "width_px": VOLUME_PX[0],
    "height_px": VOLUME_PX[1],
    "focal_px": 675.0,
    "principal_offset_px": (1.5, -0.9),
}
VOLUME_PLACES = {
    "ball": ((0.0, 0.0, 630.0), (4.0, -6.0, 0.0)),
    "bar": ((0.0, 0.0, 620.0), (-6.0, 9.0, 25.0)),
    "flat": ((0.0, 0.0, 600.0), (14.0, -10.0, 0.0)),
    "block": ((0.0, 0.0, 620.0), (-10.0, 8.0, 30.0)),
}
DRAWN = {"format": 1, "certificate": "virtual"}
VOLUME_TARGETS = {
    "ball": {"kind": "sphere", "diameter_mm": {"value": 50.0, "u": 0.0005}},
    "bar": {"kind": "ball-bar", "diameters_mm": {"value": [50.0, 50.0], "u": 0.0005},
            "spacing_mm": {"value": 130.0, "u": 0.0005}},
    "flat": {"kind": "flat", "flatness_mm": {"value": 0.0, "u": 0.0005}},
    "block": {"kind": "steps", "heights_mm": {"value": [10.0, 20.0, 30.0], "u": 0.001},
              "width_mm": {"value": [30.0] * 3, "u": 0.01}, "length_mm": {"value": 80.0, "u": 0.05}},
}  # fmt: skip


@pytest.fixture(scope="session")
def volume_rig():
    """The shipped rig with small pictures, and artefacts in poses of their own."""
    captures = [
        {"name": name, "kind": "artefact", "target": DRAWN | {"name": name} | VOLUME_TARGETS[name],
         "position_mm": at, "turn_deg": turn}
        for name, (at, turn) in VOLUME_PLACES.items()
    ]  # fmt: skip
    return load_raster_rig("dlp-small").at(camera=VOLUME_CAMERA, capture=captures)


@pytest.fixture(scope="session")
def volume_folder(volume_rig, tmp_path_factory):
    made = simulate_raster_session(volume_rig, seed=5)
    return write_session(tmp_path_factory.mktemp("volume") / "session", made.document, made.frames,
                         extra_files=made.files)  # fmt: skip


@pytest.fixture(scope="session")
def board_record(volume_rig, volume_folder, tmp_path_factory):
    """The file of the record that a board would give: the truth, known as well as fifteen poses tell it."""
    truth, session = raster_truth(volume_rig), load_session(volume_folder)
    u = np.array([0.05, 0.05, 0.1, 0.1, 1e-3, 5e-3, 1e-5, 1e-5, 1e-4] * 2 + [1e-5] * 3 + [0.01] * 3)
    values = np.array([*truth["camera"], *truth["projector"], 0.0, 0.0, 0.0, *truth["shift_mm"]])
    # The records' order of Brown's terms is k1, k2, p1, p2, k3, as the truth's.
    corners = [(x, y, z) for x in (-60.0, 60.0) for y in (-45.0, 45.0) for z in (540.0, 660.0)]
    rasters = [
        {"axis": axis, "extent_px": extent, "periods_px": [extent / n for n in volume_rig.fringes.fringes],
         "zeros_rad": [0.0] * 3, "falls": False}
        for axis, extent in (("u", 640), ("v", 360))
    ]  # fmt: skip
    number = {"value": 260.0, "u": 0.02, "unit": "mm"}
    record = BoardCalibrationRecord(
        software={"fringecal": "test"}, session=session_note(session), inputs=inputs_of(session, only=()),
        image={"width": VOLUME_PX[0], "height": VOLUME_PX[1], "white_level": 255}, columns=640, rows=360,
        names=BOARD_RIG_NAMES,
        parameters=tuple(values.tolist()), rotation=truth["rotation"], covariance=np.diag(u**2).tolist(),
        camera_rms_px=0.03, projector_rms_px=0.03, stereo_rms_px=0.04, camera_s_px=0.03, projector_s_px=0.03,
        axes=("u", "v"), raster=rasters, poses=(),
        volume={"points_mm": corners, "u_least_mm": 0.01, "u_largest_mm": 0.02},
        baseline_mm=number, angle_deg=number | {"unit": "deg"},
        targets={"board": {"kind": "chessboard", "name": "board", "certificate": "virtual"}},
        checks=[{"name": "poses used", "value": 100, "limit": 70, "unit": "%", "decision": "pass",
                 "rule": "15 of 15 poses of the board take part, at least the limit"}],
    )  # fmt: skip
    return write_board_calibration(record, tmp_path_factory.mktemp("calibration"))
