"""The rigs that the procedures are judged on: each commissioned and measured once, with its truth beside it."""

import json
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from fringecal.phase.diagnostics.finding_kinds import FINDING_TEXTS
from fringecal.projector.move_kinds import MOVE_TEXTS
from fringecal.session import Session, load_session, write_session
from fringecal.simulate import load_rig, simulate_session, truth_of
from fringecal.uncertainty.influences import TEXTS
from fringecal.workflows.audit.cause_kinds import CAUSE_TEXTS
from fringecal.workflows.commission import CalibratedSession, Commissioning, calibrate_session, judged_session
from fringecal.workflows.verify.run import Verification, verify

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
    found: CalibratedSession
    bars: Verification
    truth: dict[str, Any]
    maps: dict[str, np.ndarray]

    @cached_property
    def commissioned(self) -> Commissioning:
        """The calibrated session with all that judges it."""
        return judged_session(self.found)

    @property
    def scale_error(self) -> float:
        """Relative error of the mean scale."""
        return self.found.result.camera.scales["mean"].value / ((self.truth["scale_h"] + self.truth["scale_v"]) / 2) - 1

    @property
    def angle_error_deg(self) -> float:
        return self.found.result.origin.angle.value - self.truth["angle_origin_deg"]


def judged(folder: Path, truth: dict[str, Any], maps: dict[str, np.ndarray]) -> Judged:
    session = load_session(folder)
    found = calibrate_session(session)
    bars = verify(session, "bars", found.result.rig, with_filters=False)
    return Judged(session, found, bars, truth, maps)


def simulated(rig, folder: Path) -> Judged:
    taken = simulate_session(rig, seed=SEED)
    write_session(
        folder, taken.document, taken.frames, extra_files={n: f for n, f in taken.files.items() if "truth" not in n}
    )
    true = truth_of(rig)
    truth = {"scale_h": true.scale_h, "scale_v": true.scale_v, "angle_origin_deg": true.angle_origin_deg}
    return judged(folder, truth, {name: frames.z for name, frames in taken.captures.items()})


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
def oblique(request) -> Judged:
    folder = request.config.rootpath / "tests" / "data" / "oblique"
    with np.load(folder / "truth.npz") as maps:
        return judged(folder, json.loads((folder / "truth.json").read_text()), dict(maps))


@pytest.fixture
def renamed(monkeypatch):
    """Every influence, finding, move and cause under one and the same other text."""
    for table in TEXT_TABLES:
        for one in table:
            monkeypatch.setitem(table, one, "renamed")
