"""Two periods from the session to the surface: a rig commissioned and an isolated tall box measured with both."""

import hashlib
import json
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from fringecal.errors import PhaseError
from fringecal.records.phase_record import OrdersRecord
from fringecal.session import load_session, write_session
from fringecal.simulate import load_rig, simulate_session
from fringecal.workflows.commission import CalibratedSession, calibrate_session
from fringecal.workflows.reconstruct.run import reconstruct
from fringecal.workflows.shared.phase_notes import orders_of, orders_record

RATIO = 6  # 6 fringes of 16 mm are a height of some 79 mm at 50.7 deg
CAPTURES = ("grid", "reference", "strips")


def box(height_mm):
    size = {"width_mm": 60.0, "length_mm": 70.0, "height_mm": height_mm}
    target = {name: {"value": value, "u": 0.01} for name, value in size.items()}
    target |= {"format": 1, "kind": "box", "name": f"box {height_mm:g}", "certificate": "drawn"}
    place = {"position_mm": (40.0, -30.0), "rotation_deg": 25.0}
    return {"name": f"box-{height_mm:g}", "kind": "object", "target": target, **place}


def toml(target):
    lines = [f"{k} = {{ value = {v['value']}, u = {v['u']} }}" for k, v in target.items() if isinstance(v, dict)]
    lines += [f"{k} = {json.dumps(v)}" for k, v in target.items() if not isinstance(v, dict)]
    return "\n".join(lines).encode()


def small_rig():
    rig = load_rig("thesis")
    captures = [c.model_dump() for c in rig.capture if c.name in CAPTURES]
    small = {"width_px": 320, "height_px": 240, "scale_mm_per_px": 0.9}
    return rig.at(camera=small, projector={"pitch_mm": 16.0}, capture=[*captures, box(35.0)])


def two_periods(rig):
    """Take every phase-shifted capture with both periods, the long one first: document, frames, short set's truth."""
    sets = [simulate_session(rig.at(projector={"pitch_mm": 16.0 * k}), seed=k) for k in (RATIO, 1)]
    document, frames = sets[1].document, {}
    for capture in document["capture"]:
        names = capture["images"]
        for one, prefix in zip(sets, ("long-", ""), strict=True):
            frames |= {prefix + name: one.frames[name] for name in names}
        if capture["kind"] != "grid":
            capture |= {"images": ["long-" + name for name in names] + names, "periods": [16.0 * RATIO, 16.0]}
    return document, frames, sets[1].captures


@pytest.fixture(scope="module")
def taken():
    return two_periods(small_rig())


@pytest.fixture(scope="module")
def folder(taken, tmp_path_factory) -> Path:
    document, frames, _ = taken
    files = {"t-box-35.toml": toml(box(35.0)["target"])}
    path = tmp_path_factory.mktemp("periods") / "session"
    used = {name for capture in document["capture"] for name in capture["images"]}
    return write_session(path, document, {name: frames[name] for name in used}, extra_files=files)


@pytest.fixture(scope="module")
def found(folder) -> CalibratedSession:
    return calibrate_session(load_session(folder))


def errors(surface, truth):
    """Error of the height and which pixels the projector lights."""
    return np.where(surface.mask & truth.lit, surface.z - truth.z, np.nan), truth.lit


def test_an_isolated_tall_box_is_right_everywhere(found, folder, taken):
    written = OrdersRecord.model_validate_json(orders_record(found.result.rig.orders).model_dump_json())
    assert written.cycle == RATIO
    rig = replace(found.result.rig, orders=orders_of(written))
    measured = reconstruct(load_session(folder), "box-35", rig)
    truth = taken[2]["box-35"]
    error, lit = errors(measured.surface, truth)
    assert np.isfinite(error[lit]).mean() > 0.995  # the rest are pixels that see an edge
    # One fringe is 13 mm of height; noise is some 0.06 mm.
    assert np.nanmax(np.abs(error)) < 1.0
    on_top = lit & (truth.z > 34.9)
    assert np.isfinite(error[on_top]).mean() > 0.95
    assert np.nanmedian(error[on_top]) == pytest.approx(0, abs=0.05)
    assert "orders by 2 periods, known within 6 fringes" in measured.phase.sentence()


def test_one_period_alone_leaves_the_box_undecided(found, folder, taken):
    session = load_session(folder)
    one = session.captures["box-35"]
    session.captures["box-35"] = replace(one, paths=one.paths[3:], sha256=one.sha256[3:], periods=())
    measured = reconstruct(session, "box-35", found.result.rig)
    error, lit = errors(measured.surface, taken[2]["box-35"])
    assert np.isnan(error[lit & (taken[2]["box-35"].z > 34.9)]).mean() > 0.9


def test_swapped_periods_are_refused(found, folder):
    session = load_session(folder)
    one = session.captures["box-35"]
    session.captures["box-35"] = replace(one, periods=one.periods[::-1])
    with pytest.raises(PhaseError, match="box-35.*do not fit the stated periods"):
        reconstruct(session, "box-35", found.result.rig)


def test_a_gray_code_beside_one_period_does_as_well(found, folder, taken):
    truth = taken[2]["box-35"]
    number = np.floor((truth.phase + np.pi) / (2 * np.pi)).astype(int) + 16  # of 32; the fringes' jump is the code's
    gray = number ^ (number >> 1)
    names = []
    for bit in range(5):
        names.append(folder / f"gray-{bit}.png")
        light = truth.frames.mean(axis=0) * np.where(gray >> (4 - bit) & 1, 1.8, 0.2)
        cv2.imwrite(str(names[-1]), np.clip(light, 0, 255).astype(np.uint8))
    hashes = tuple(hashlib.sha256(name.read_bytes()).hexdigest() for name in names)
    session = load_session(folder)
    one = session.captures["box-35"]
    short = {"paths": one.paths[3:], "sha256": one.sha256[3:], "periods": ()}
    session.captures["box-35"] = replace(one, **short, gray_paths=tuple(names), gray_sha256=hashes)
    # Commissioned with other periods: the plate in the picture says how the rig counts.
    measured = reconstruct(session, "box-35", found.result.rig)
    error, lit = errors(measured.surface, truth)
    assert np.isfinite(error[lit]).mean() > 0.99
    # Pixels that see an edge mix two phases, which a code, unlike a second period, does not notice; the box's outline
    # is 290 px long. A wrong order would be 13 mm off.
    assert np.count_nonzero(np.abs(error) > 1.0) < 145
    assert np.nanmax(np.abs(error)) < 13
    assert "orders by Gray code of 32 fringes" in measured.phase.sentence()
