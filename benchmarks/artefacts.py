"""Is every kind of artefact found, measured within its uncertainty, and refused or failed when it is wrong?

Run: python benchmarks/artefacts.py [--kinds wedge sphere] [--count 20] [--frozen] [--cache DIR]. Draws kinds
x sizes x poses over the shipped rigs and some random ones (pictures cut to 380 x 340 px for speed): turned by any
angle, anywhere in the picture, in three of ten partly in the shadow of something tall, in three of ten beside a second
object. Even seeds are for work, odd ones (`--frozen`) for judging; no rule may be chosen on those. With `--wrong` the
artefact is not what its certificate says, or its frames are not what they should be.
"""

import argparse
import math
import pickle
import tempfile
import time
import zlib
from collections import Counter
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from fringecal.errors import FringecalError
from fringecal.projector import RigCalibration
from fringecal.session import capture_of_arrays, session_of_captures, temporary_session
from fringecal.simulate import RigSpec, list_rigs, load_rig, render, scene_of, simulate_session
from fringecal.simulate.scene.objects import box
from fringecal.simulate.scene.scene import Scene, together
from fringecal.targets import Artefact, footprint_mm, parse_target, surface_mm
from fringecal.workflows.commission import calibrate_session
from fringecal.workflows.verify import Verification, artefact_checks, verification_checks, verify_capture

WIDTH_PX, HEIGHT_PX = 380, 340
RANDOM_RIGS = 4
EXPOSURE = 0.75  # of the plate's own
KINDS = ("strips", "zigzag", "steps", "wedge", "box", "flat", "tilted-flat", "sphere", "ball-bar")
WRONGS = ("size", "size-much", "frame", "fringe", "lifted", "other")

Target = Artefact


def rigs() -> dict[str, RigSpec]:
    """Return the rigs that artefacts are shown to: those that ship, one like a DLP projector's, and random ones."""
    shipped = {name: cut(load_rig(name)) for name in list_rigs()}
    return shipped | {"dlp": dlp_rig()} | {f"random-{k}": random_rig(k) for k in range(RANDOM_RIGS)}


def cut(rig: RigSpec) -> RigSpec:
    """Show a part of a rig's picture, with a grid and strips that fit into it."""
    camera = {"width_px": WIDTH_PX, "height_px": HEIGHT_PX, "principal_offset_px": (0.0, 0.0)}
    return rig.at(camera=camera, capture=_calibrating(rig))


def _calibrating(rig: RigSpec) -> list[dict[str, Any]]:
    field = rig.camera.scale_mm_per_px * min(WIDTH_PX, HEIGHT_PX)
    lines = int(0.9 * field / 10.0)
    width = 10.0 if field > 200 else 7.0
    strips = {
        "format": 1, "kind": "strips", "name": "strips", "certificate": "drawn", "count": int(0.75 * field / 2 / width),
        "width_mm": {"value": width, "u": 0.02}, "gap_mm": {"value": width, "u": 0.02},
        "height_mm": {"value": 3.0, "u": 0.002}, "length_mm": {"value": 2 * field, "u": 0.2},
    }  # fmt: skip
    grid = {
        "format": 1, "kind": "line-grid", "name": "grid", "certificate": "drawn", "lines": [lines, lines],
        "pitch_mm": {"value": 10.0, "u": 0.001}, "line_width_mm": {"value": 0.9, "u": 0.05},
    }  # fmt: skip
    return [
        {"name": "grid", "kind": "grid", "target": grid, "rotation_deg": 0.4},
        {"name": "reference", "kind": "reference"},
        {"name": "strips", "kind": "strips", "target": strips, "rotation_deg": 0.3, "direction": _strips_along(rig)},
    ]


def _strips_along(rig: RigSpec) -> str:
    """Lay the strips across the fringes, so that each crosses many."""
    return "columns" if abs(math.sin(math.radians(rig.projector.across_deg))) > 0.5 else "rows"


def dlp_rig() -> RigSpec:
    """Return a rig with a slanting camera beside an upright projector, vertical fringes, eight steps and gamma."""
    thesis = load_rig("thesis")
    rig = thesis.at(
        name="dlp",
        camera={"scale_mm_per_px": 0.6, "height_mm": 900.0, "tilt_deg": (25.0, 0.0), "defocus_px": 0.5},
        projector={"position_mm": (-60.0, 30.0, 850.0), "across_deg": 1.0, "pitch_mm": 8.0, "gamma": 1.15},
        steps={"nominal_deg": tuple(45.0 * k for k in range(8))},
    )
    return cut(rig)


def random_rig(number: int) -> RigSpec:
    """Draw a rig: heights, angles, pitch, lens, noise."""
    rng = np.random.default_rng([20, number])
    angle, azimuth = math.radians(rng.uniform(25, 52)), rng.uniform(0, 2 * math.pi)
    height = rng.uniform(650, 1200)
    away = height * math.tan(angle)
    position = away * math.cos(azimuth), away * math.sin(azimuth), height
    across = math.degrees(azimuth) + rng.uniform(-15, 15)
    rig = load_rig("thesis").at(
        name=f"random-{number}",
        camera={
            "scale_mm_per_px": rng.uniform(0.45, 0.8), "height_mm": rng.uniform(800, 1600),
            "tilt_deg": tuple(rng.uniform(-3, 3, 2)), "distortion": (rng.uniform(-0.1, 0.05), 0.0, 0.0, 0.0, 0.0),
            "defocus_px": rng.uniform(0.3, 0.8),
        },
        projector={"position_mm": position, "across_deg": across, "pitch_mm": rng.uniform(6, 11)},
        steps={"nominal_deg": tuple(np.arange(n) * 360.0 / n)} if (n := int(rng.integers(3, 6))) else {},
        noise={"read_levels": rng.uniform(0.6, 1.5)},
    )  # fmt: skip
    return cut(rig)


def calibrated(name: str, rig: RigSpec, cache: Path) -> RigCalibration | None:
    """Commission a rig once and keep it; None where it cannot be."""
    file = cache / f"{name}-{zlib.crc32(rig.model_dump_json().encode()):08x}.pickle"
    if file.exists():
        return pickle.loads(file.read_bytes())  # noqa: S301 -- written by this script
    taken = simulate_session(rig, seed=1, with_truth=False)
    try:
        with temporary_session(taken.document, taken.frames, extra_files=taken.files) as session:
            found = calibrate_session(session).result.rig
    except FringecalError as error:
        print(f"{name}: not commissioned: {error}")
        return None
    cache.mkdir(parents=True, exist_ok=True)
    file.write_bytes(pickle.dumps(found))
    return found


# ---------------------------------------------------------------- what is shown


@dataclass(frozen=True)
class Case:
    """An artefact as it is (`true`), as its certificate states it, and what the camera saw."""

    kind: str
    seed: int
    rig: str
    wrong: str | None
    true: Target
    stated: Target
    frames: np.ndarray
    about: str


def _q(value: float | list[float], u: float | list[float]) -> dict[str, Any]:
    return {"value": value, "u": u}


def document(kind: str, rng: np.random.Generator, field: float) -> dict[str, Any]:
    """Draw an artefact's size; `field` is the shorter side of the picture in mm."""
    size = rng.uniform
    if kind == "strips":
        count = int(rng.integers(1, 7))
        nominal, width = size(2, 30), size(12, 25)
        heights = (nominal + 0.02 * rng.standard_normal(count)).tolist()
        extra = {"gap_mm": _q(size(0.5, 1.0) * width, 0.05)} if count > 1 else {}
        length = size(0.3, 0.7) * field
        width *= min(1, 0.7 * field / (1.8 * width * count))
        return {"kind": "strips", "count": count, "width_mm": _q(width, 0.05),
                "height_mm": _q(heights, [0.002] * count), "length_mm": _q(length, 0.1)} | extra  # fmt: skip
    if kind == "zigzag":
        count, base = int(rng.integers(2, 5)), size(20, 60)
        apex = size(80, 130)
        base = min(base, 0.75 * field / count)
        return {"kind": "zigzag", "count": count, "leg_mm": _q(base / 2 / math.sin(math.radians(apex) / 2), 0.01),
                "apex_deg": _q(apex, 0.02), "length_mm": _q(size(0.4, 0.75) * field, 0.1)}  # fmt: skip
    if kind == "steps":
        count = int(rng.integers(3, 6))
        rise = np.cumsum(size(3, 14, count))
        return {"kind": "steps", "heights_mm": _q(rise.tolist(), [0.003] * count),
                "width_mm": _q(0.7 * field / count * size(0.7, 1), 0.02),
                "length_mm": _q(size(0.2, 0.5) * field, 0.02)}  # fmt: skip
    if kind == "wedge":
        return {"kind": "wedge", "angle_deg": _q(size(3, 25), 0.005), "width_mm": _q(size(0.3, 0.7) * field, 0.05),
                "length_mm": _q(size(0.2, 0.5) * field, 0.05)}  # fmt: skip
    if kind == "box":
        return {"kind": "box", "height_mm": _q(size(4, 60), 0.003), "width_mm": _q(size(0.12, 0.5) * field, 0.02),
                "length_mm": _q(size(0.12, 0.5) * field, 0.02)}  # fmt: skip
    if kind == "flat":
        return {"kind": "flat", "flatness_mm": _q(0.0, 0.003), "height_mm": _q(size(3, 40), 0.004),
                "width_mm": _q(size(0.3, 0.75) * field, 0.1),
                "length_mm": _q(size(0.3, 0.75) * field, 0.1)}  # fmt: skip
    if kind == "tilted-flat":
        return {"kind": "flat", "flatness_mm": _q(0.0, 0.003)}
    if kind == "sphere":
        return {"kind": "sphere", "diameter_mm": _q(size(20, 80), 0.002)}
    low, high = np.sort(size(18, 45, 2)) if rng.random() < 0.5 else [size(18, 50)] * 2
    spacing = size(1.1, 1.6) * (low + high) if (low + high) * 1.6 < 0.7 * field else (low + high) * size(0.6, 0.9)
    return {
        "kind": "ball-bar",
        "diameters_mm": _q([float(low), float(high)], [0.002] * 2),
        "spacing_mm": _q(float(min(spacing, 0.7 * field)), 0.005),
    }


def drawn(doc: dict[str, Any], rng: np.random.Generator) -> dict[str, Any]:
    """Return the artefact as it is, when its certificate states the document: every size off by its u."""
    moved = {}
    for key, value in doc.items():
        if isinstance(value, dict):
            mean, u = np.array(value["value"]), np.array(value["u"])
            true = np.abs(mean + u * rng.standard_normal(mean.shape))
            moved[key] = value | {"value": true.tolist() if true.ndim else float(true)}
        else:
            moved[key] = value
    if doc["kind"] == "flat":
        moved["flatness_mm"] = doc["flatness_mm"]
    return moved


def made(doc: dict[str, Any]) -> Target:
    """Make a target of a document."""
    return parse_target({"format": 1, "name": doc["kind"], "certificate": "drawn"} | doc)


SIZE_KEY = {
    "strips": "height_mm", "zigzag": "leg_mm", "steps": "heights_mm", "wedge": "angle_deg", "box": "height_mm",
    "flat": "height_mm", "sphere": "diameter_mm", "ball-bar": "spacing_mm",
}  # fmt: skip


def wronged(doc: dict[str, Any], wrong: str, rig: RigSpec, rng: np.random.Generator) -> dict[str, Any]:
    """Return an artefact that is not what its certificate says: by so much, or by a whole fringe."""
    key = SIZE_KEY.get(doc["kind"])
    if wrong not in ("size", "size-much", "fringe"):
        return doc
    if key is None or key not in doc:
        raise FringecalError("nothing to be wrong about")
    value = np.array(doc[key]["value"], float)
    factor = {"size": 1.03, "size-much": rng.choice([0.85, 1.2]), "fringe": 1.0}[wrong]
    value = value * factor
    if wrong == "fringe" and doc["kind"] in ("box", "flat", "steps", "strips", "sphere"):
        value = value + fringe_height_mm(rig) * rng.choice([1, 2])
    elif wrong == "fringe":
        raise FringecalError("no whole fringe to be wrong by")
    return doc | {key: doc[key] | {"value": value.tolist() if value.ndim else float(value)}}


def fringe_height_mm(rig: RigSpec) -> float:
    """Height of one fringe at the middle of the picture."""
    x, y, z = rig.projector.position_mm
    turn = math.radians(rig.projector.across_deg)
    tangents = [math.tan(math.radians(t)) if rig.camera.kind == "pinhole" else 0.0 for t in rig.camera.tilt_deg]
    slope = (x / z - tangents[0]) * math.cos(turn) + (y / z - tangents[1]) * math.sin(turn)
    return rig.projector.pitch_mm / max(abs(slope), 0.05)


def placed(
    doc: dict[str, Any], true: Target, rig: RigSpec, rng: np.random.Generator
) -> tuple[Scene, tuple[float, float, float]]:
    """Lay an artefact anywhere in the picture, turned by any angle, its footprint and top inside."""
    scale = rig.camera.scale_mm_per_px
    half = np.array([WIDTH_PX, HEIGHT_PX]) * scale / 2 * 0.97 - 3
    if doc["kind"] == "flat" and "height_mm" not in doc:
        return Scene().on_flat(float(rng.uniform(0, 6)), *rng.uniform(-2, 2, 2)), (0.0, 0.0, 0.0)
    width, length = footprint_mm(true)
    tallest = float(
        np.max(
            surface_mm(true, np.linspace(-width / 2, width / 2, 301)[:, None], np.linspace(-length / 2, length / 2, 31))
        )
    )
    half = half * (1 - tallest / rig.camera.height_mm if rig.camera.kind == "pinhole" else 1)
    half[0] -= 0.5 * tallest * abs(math.tan(math.radians(rig.camera.tilt_deg[0])))
    for _ in range(400):
        turn = rng.uniform(-180, 180)
        c, s = abs(math.cos(math.radians(turn))), abs(math.sin(math.radians(turn)))
        room = half - 0.5 * np.array([c * width + s * length, s * width + c * length])
        if np.all(room >= 0):
            # A quarter of the places is at the picture's edge.
            share = rng.uniform(-1, 1, 2) if rng.random() < 0.75 else rng.choice([-1, 1], 2) * [1, rng.uniform(-1, 1)]
            x, y = room * share
            return scene_of(true).placed(float(x), float(y), float(turn)), (float(x), float(y), float(turn))
    raise FringecalError("does not fit into the picture")


def beside(
    pose: tuple[float, float, float], true: Target, rig: RigSpec, rng: np.random.Generator, shadow: bool
) -> Scene | None:
    """Stand a second object beside the artefact; or a tall one whose shadow falls on it."""
    width, length = footprint_mm(true)
    if not math.isfinite(width):
        return None
    radius = math.hypot(width, length) / 2
    if shadow:
        px, py, pz = rig.projector.position_mm
        toward = math.atan2(py - pose[1], px - pose[0]) if math.hypot(px, py) > 100 else rng.uniform(0, 2 * math.pi)
        tall, side = rng.uniform(20, 50), 8.0
        slope = max(math.hypot(px - pose[0], py - pose[1]) / pz, 0.2)
        distance = min(width, length) / 2 + side + rng.uniform(0.1, 0.5) * tall * slope
    else:
        toward, tall, side = rng.uniform(0, 2 * math.pi), rng.uniform(3, 25), rng.uniform(8, 20)
        distance = radius + side * 1.5
    x, y = pose[0] + distance * math.cos(toward), pose[1] + distance * math.sin(toward)
    if _inside_footprint(x, y, pose, width, length, 1.5 * side):
        x, y = pose[0] + (radius + 1.5 * side) * math.cos(toward), pose[1] + (radius + 1.5 * side) * math.sin(toward)
    return Scene(solids=(box((-side, side), (-side, side), tall, albedo=0.8),)).placed(x, y, math.degrees(toward))


def _inside_footprint(
    x: float, y: float, pose: tuple[float, float, float], width: float, length: float, room: float
) -> bool:
    c, s = math.cos(math.radians(pose[2])), math.sin(math.radians(pose[2]))
    dx, dy = x - pose[0], y - pose[1]
    return abs(c * dx + s * dy) < width / 2 + room and abs(c * dy - s * dx) < length / 2 + room


def case(kind: str, seed: int, rig_name: str, rig: RigSpec, wrong: str | None = None) -> Case:
    """Draw one artefact on one rig."""
    rng = np.random.default_rng([seed, zlib.crc32(kind.encode())])
    field = rig.camera.scale_mm_per_px * HEIGHT_PX * 0.9
    doc = document(kind, rng, field)
    stated = made(doc)
    true_doc = drawn(doc, rng)
    if wrong is not None:
        true_doc = wronged(true_doc, wrong, rig, rng)
    if wrong == "other":
        others = [k for k in KINDS if k not in (kind, "tilted-flat", "flat")]
        true_doc = document(str(rng.choice(others)), rng, field)
    true = made(true_doc)
    scene, pose = placed(true_doc, true, rig, rng)
    shadow, second = rng.random() < 0.3, rng.random() < 0.3
    for wanted, tall in ((shadow, True), (second, False)):
        other = beside(pose, true, rig, rng, tall) if wanted else None
        scene = together([scene, other]) if other is not None else scene
    if wrong == "lifted":
        scene = lifted(scene, rng)
    # Flanks that face the lamp are brighter than the plate: exposed so that they do not saturate.
    frames = render(rig.at(light={"mid_grey": EXPOSURE * rig.light.mid_grey}), scene, seed=[seed, 7]).frames
    if wrong == "frame":
        frames = with_frame_moved(frames, rig, rng)
    words = "".join(word * given for word, given in ((" in shadow", shadow), (" beside another", second)))
    about = f"{_sizes(true_doc)} at ({pose[0]:.0f}, {pose[1]:.0f}) mm turned {pose[2]:.0f} deg{words}"
    return Case(kind, seed, rig_name, wrong, true, stated, frames, about)


def with_frame_moved(frames: np.ndarray, rig: RigSpec, rng: np.random.Generator) -> np.ndarray:
    """Move one frame by two pixels across the fringes, as a camera does that is touched between frames."""
    across = math.radians(rig.projector.across_deg)
    axis = 0 if abs(math.sin(across)) > abs(math.cos(across)) else 1
    frames, number = frames.copy(), int(rng.integers(len(frames)))
    frames[number] = np.roll(frames[number], int(rng.choice([-2, 2])), axis=axis)
    return frames


def lifted(scene: Scene, rng: np.random.Generator) -> Scene:
    """Lay something under one edge of what stands on the plate: it is higher by 0.5 mm and tilted by half a degree."""
    tilt, toward = math.radians(rng.uniform(0.5, 1.0)), rng.uniform(0, 2 * math.pi)
    axis = np.array([math.cos(toward), math.sin(toward), 0.0])
    cross = np.array([[0, 0, axis[1]], [0, 0, -axis[0]], [-axis[1], axis[0], 0]])
    turn = np.eye(3) + math.sin(tilt) * cross + (1 - math.cos(tilt)) * cross @ cross
    shift = np.array([0.0, 0.0, rng.uniform(0.5, 1.0)])
    solids = []
    for solid in scene.solids:
        normals = solid.planes[:, :3] @ turn.T
        planes = np.column_stack([normals, solid.planes[:, 3] + normals @ shift])
        solids.append(replace(solid, planes=planes, corners=solid.corners @ turn.T + shift))
    return replace(scene, solids=tuple(solids))


def _sizes(doc: dict[str, Any]) -> str:
    parts = [f"{k.removesuffix('_mm')} {np.round(v['value'], 2)}" for k, v in doc.items() if isinstance(v, dict)]
    return ", ".join(parts)


# ---------------------------------------------------------------- what is found


@dataclass(frozen=True)
class Outcome:
    """What `verify` made of a case: "passed", "failed" or "refused", and its words."""

    case: Case
    verdict: str
    inside: bool | None
    words: str


def judged_case(one: Case, rig: RigSpec, calibration: RigCalibration) -> Outcome:
    """Verify a case; `inside` says whether every certified number lies within its U of what was drawn."""
    capture = capture_of_arrays(
        one.kind, "artefact", one.frames, target=one.stated, phase_shifts_deg=rig.steps.nominal_deg, use="verification"
    )
    session = session_of_captures([capture], rig=rig.name)
    try:
        found = verify_capture(session, capture, calibration)
    except FringecalError as error:
        return Outcome(one, "refused", None, str(error))
    if isinstance(found, Verification):
        checks = verification_checks(found)
        pooled = found.errors.pooled
        inside, words = (
            abs(pooled.en or 0) <= 1,
            f"mean {pooled.mean_mm:+.4f} sd {pooled.sd_mm:.4f} max {pooled.max_abs_mm:.3f}",
        )
    else:
        checks = artefact_checks(found)
        inside, words = _inside(found)
    gone = (found.errors if isinstance(found, Verification) else found).departures
    words = f"departures {gone.ratio:.2f} {gone.largest_ratio:.1f}/{gone.allowed_ratio:.1f}; {words}" if gone else words
    bad = [f"{c.name} {c.value}" for c in checks if c.decision in ("fail", "conditionalFail")]
    return Outcome(one, "failed" if bad else "passed", inside, f"{words}; {', '.join(bad)}")


def _inside(found: Any) -> tuple[bool, str]:
    """Whether every certified number agrees: a certificate differs from what was drawn by what its u says."""
    words = [f"{r.name} {r.error:+.4f} (En {r.en:+.2f})" for r in found.readings if r.en is not None]
    return all(abs(r.en) <= 1 for r in found.readings if r.en is not None), ", ".join(words)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--kinds", nargs="+", default=KINDS)
    parser.add_argument("--rigs", nargs="+")
    parser.add_argument("--count", type=int, default=20)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--frozen", action="store_true")
    parser.add_argument("--wrong", nargs="*")
    parser.add_argument("--quiet", action="store_true")
    parser.add_argument("--all", action="store_true")
    parser.add_argument("--cache", type=Path, default=Path(tempfile.gettempdir()) / "fringecal-artefacts")
    options = parser.parse_args()
    known = {name: (rig, calibrated(name, rig, options.cache)) for name, rig in rigs().items()}
    usable = {name: both for name, both in known.items() if both[1] is not None and name in (options.rigs or known)}
    wrongs = [None] if options.wrong is None else options.wrong or list(WRONGS)
    for kind in options.kinds:
        for wrong in wrongs:
            report(kind, wrong, options, usable)


def report(kind: str, wrong: str | None, options: argparse.Namespace, usable: dict[str, Any]) -> None:
    """Print what became of the cases of one kind."""
    names, outcomes, start = list(usable), [], time.perf_counter()
    for number in range(options.first, options.first + options.count):
        seed = 2 * number + options.frozen
        name = names[number % len(names)]
        try:
            one = case(kind, seed, name, usable[name][0], wrong)
        except FringecalError:
            continue
        outcome = judged_case(one, *usable[name])
        outcomes.append(outcome)
        expected = "passed" if wrong is None else "failed"
        if options.all or (not options.quiet and outcome.verdict != expected):
            print(
                f"  {kind} {seed} {name} {wrong or ''}: {one.about}\n      {outcome.verdict}: {outcome.words[:300]}",
                flush=True,
            )
    tally = Counter(outcome.verdict for outcome in outcomes)
    inside = sum(bool(outcome.inside) for outcome in outcomes)
    print(
        f"{kind:12s} {wrong or 'as certified':12s} {len(outcomes)} drawn: {tally['passed']} passed, "
        f"{tally['failed']} failed, {tally['refused']} refused; within U {inside}; {time.perf_counter() - start:.0f} s",
        flush=True,
    )  # fmt: skip


if __name__ == "__main__":
    main()
