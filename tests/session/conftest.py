"""A small sound session that each test bends in one place."""

import copy
import datetime
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from fringecal.session import SessionCheck, check_session
from fringecal.session.toml_text import to_toml

STEPS_DEG = [0.0, 120.0, 240.0]
SHAPE = (40, 48)


def fringes(seed: int, *, shape: tuple[int, int] = SHAPE, step_deg: float = 0.0) -> np.ndarray:
    """One 8-bit fringe picture with noise of its own, between about 30 and 220."""
    rows = np.arange(shape[0])[:, None] * np.ones(shape[1])
    noise = np.random.default_rng(seed).normal(0, 1.5, shape)
    return np.clip(125 + 90 * np.cos(2 * np.pi * rows / 8 + np.deg2rad(step_deg)) + noise, 0, 255).astype(np.uint8)


def base_document() -> dict[str, Any]:
    def shifted(name: str, kind: str, target: str | None) -> dict[str, Any]:
        images = [f"{name}-{k}.png" for k in range(3)]
        return {"name": name, "kind": kind, "target": target, "images": images}

    return {
        "format": 1,
        "rig": "bench-1",
        "captured": datetime.datetime(2026, 11, 22, 10, tzinfo=datetime.UTC),
        "camera": {"height_mm": {"value": 1500.0, "u": 5.0}},
        "projector": {"position_mm": {"value": [0.0, 1222.0, 1000.0], "u": [3.0, 3.0, 3.0]}},
        "phase": {"steps_deg": list(STEPS_DEG)},
        "capture": [
            {"name": "grid", "kind": "grid", "target": "grid-10mm", "images": ["grid.png"]},
            shifted("reference", "reference", None),
            shifted("strips", "strips", "glass-strips"),
            shifted("bars", "artefact", "angle-bars"),
        ],
    }


def encoded(frame: np.ndarray, ending: str = ".png") -> bytes:
    return cv2.imencode(ending, frame)[1].tobytes()


@dataclass
class Bench:
    """A session folder in the making."""

    folder: Path
    document: dict[str, Any] = field(default_factory=base_document)
    fringes = staticmethod(fringes)
    encoded = staticmethod(encoded)

    def capture(self, name: str) -> dict[str, Any]:
        return next(c for c in self.document["capture"] if c["name"] == name)

    def put(self, name: str, content: bytes | np.ndarray) -> Path:
        path = self.folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(content if isinstance(content, bytes) else encoded(content, path.suffix))
        return path

    def save(self) -> None:
        (self.folder / "session.toml").write_text(to_toml(self.document), encoding="utf-8")

    def edit(self, old: str, new: str) -> None:
        """Change the text of session.toml, where the document itself could not hold the fault."""
        path = self.folder / "session.toml"
        text = path.read_text(encoding="utf-8")
        assert old in text
        path.write_text(text.replace(old, new, 1), encoding="utf-8")

    def check(self) -> SessionCheck:
        return check_session(self.folder)


@pytest.fixture
def bench(tmp_path: Path) -> Bench:
    made = Bench(tmp_path / "session", copy.deepcopy(base_document()))
    seed = 0
    for capture in made.document["capture"]:
        for k, name in enumerate(capture["images"]):
            made.put(name, fringes(seed, step_deg=STEPS_DEG[k]))
            seed += 1
    made.save()
    return made
