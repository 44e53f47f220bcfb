"""Do the 95 % intervals of the projection angle hold over random rigs, for each estimator? Counts, against truth.

Run: python benchmarks/angle_campaign.py [--rigs 300] [--seed 1] [--out angle-campaign.csv] [--centred].
Every rig is drawn (camera 0.6 to 8 m up or telecentric, tilted to 2 deg, 0.1 to 1 mm/px; light from 20 to 65 deg;
pitch 3 to 15 mm; strips 1 to 10 mm high; fringes along rows or columns), its pictures are taken by the simulator,
and `fringecal angle` reads them three times. One row a rig and estimator goes to the file as it is found; the same
command goes on where an interrupted one stood. `--centred` leaves the principal point at the image centre.
"""

import argparse
import csv
import math
from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from fringecal.errors import FringecalError
from fringecal.projector.angle.angle_table import AxisAngle
from fringecal.session import Session, temporary_session
from fringecal.simulate import RigSpec, simulate_session
from fringecal.simulate.rig.truth import projection_angle_deg
from fringecal.simulate.scene.capture_scenes import stated_target
from fringecal.targets import Target
from fringecal.uncertainty.coverage import wilson_interval
from fringecal.uncertainty.influences import Influence, Source
from fringecal.workflows.angle.run import ESTIMATORS, picture_angles
from fringecal.workflows.commission import calibrate_session
from fringecal.workflows.commission.angle_findings import AngleFindings, angles_of
from fringecal.workflows.commission.camera import CameraFindings, measure_camera

SIZE_PX = (560, 420)
GRID_PX = (18.0, 32.0)
PERIODS_PX = (6.0, 60.0)
FIELDS = ("rig", "estimator", "refused", "along", "period_px", "step_turns", "camera_mm", "scale", "angle_deg",
          "error_deg", "expanded_deg", "u_scatter_deg", "column_ratios", "column_expanded_deg", "row_ratios",
          "row_expanded_deg")  # fmt: skip

type Draw = np.random.Generator


def logarithmic(rng: Draw, low: float, high: float) -> float:
    """Draw a size: each octave is as likely as any other."""
    return math.exp(rng.uniform(math.log(low), math.log(high)))


def draw_rig(seed: int, number: int, *, centred: bool) -> tuple[RigSpec, dict[str, Target]]:
    """Draw one rig, and its artefacts as they truly are: off the stated size by a normal error of the stated u."""
    rng = np.random.default_rng([seed, number])
    scale, pitch = logarithmic(rng, 0.1, 1.0), logarithmic(rng, 3.0, 15.0)
    while not PERIODS_PX[0] <= pitch / scale <= PERIODS_PX[1]:
        scale, pitch = logarithmic(rng, 0.1, 1.0), logarithmic(rng, 3.0, 15.0)
    along = str(rng.choice(["rows", "columns"]))
    document = {
        "name": f"rig {number}",
        "camera": draw_camera(rng, scale, centred=centred),
        "projector": draw_projector(rng, scale, pitch, along),
        "steps": {"nominal_deg": (0.0, 120.0, 240.0), "error_deg": rng.normal(0.0, 1.0, 3).tolist()},
        "light": {"ambient": 0.1, "flicker": 0.002},
        "noise": {"read_levels": rng.uniform(0.5, 1.5)},
        "surface": {"seed": number, "smooth": 0.01},
        "capture": draw_captures(rng, scale, along),
    }
    spec = RigSpec.model_validate(document | {"stated": draw_stated(rng, document["camera"]["height_mm"])})
    return spec, {capture.name: true_target(rng, capture) for capture in spec.capture if capture.target is not None}


def draw_camera(rng: Draw, scale: float, *, centred: bool) -> dict[str, Any]:
    tilt = rng.uniform(0.0, 2.0), rng.uniform(0.0, 2 * math.pi)
    off = rng.normal(0.0, 0.01 * math.hypot(*SIZE_PX), 2)
    telecentric = rng.random() < 0.2
    return {
        "kind": "telecentric" if telecentric else "pinhole",
        "width_px": SIZE_PX[0],
        "height_px": SIZE_PX[1],
        "scale_mm_per_px": scale,
        "height_mm": logarithmic(rng, 600.0, 8000.0),
        "tilt_deg": (tilt[0] * math.cos(tilt[1]), tilt[0] * math.sin(tilt[1])),
        "principal_offset_px": (0.0, 0.0) if centred or telecentric else off.tolist(),
        "distortion": [0.0 if telecentric else rng.uniform(-0.1, 0.05), 0.0, 0.0, 0.0, 0.0],
        "defocus_px": 0.5,
    }


def draw_projector(rng: Draw, scale: float, pitch: float, along: str) -> dict[str, Any]:
    """Place the lamp 0.6 to 2 m off, and no nearer than one and a half times the picture's diagonal on the plate."""
    angle = math.radians(rng.uniform(20.0, 65.0))
    field = scale * math.hypot(*SIZE_PX)
    far = logarithmic(rng, max(600.0, 1.5 * field), 2000.0)
    turn = 90.0 if along == "rows" else 0.0
    azimuth = turn + float(rng.choice([0.0, 180.0])) + rng.uniform(-5.0, 5.0)
    out, where = far * math.sin(angle), math.radians(azimuth)
    return {
        "position_mm": (out * math.cos(where), out * math.sin(where), far * math.cos(angle)),
        "across_deg": azimuth + rng.uniform(-3.0, 3.0),
        "pitch_mm": pitch,
        "phase_at_origin_rad": rng.uniform(-math.pi, math.pi),
        "contrast": rng.uniform(0.7, 0.95),
        "gamma": rng.uniform(0.95, 1.1),
        "distortion": (rng.uniform(-0.05, 0.05), 0.0),
        "defocus_mm": 0.1 * pitch,
    }


def draw_captures(rng: Draw, scale: float, along: str) -> list[dict[str, Any]]:
    across_px, along_px = SIZE_PX if along == "rows" else SIZE_PX[::-1]
    count = int(rng.integers(6, 11))
    width = round(0.85 * across_px * scale / (2 * count - 1), 2)
    height = round(logarithmic(rng, 1.0, 10.0), 3)
    pitch = round(rng.uniform(*GRID_PX) * scale, 3)
    grid = {
        "kind": "line-grid",
        "name": "grid",
        "polarity": "dark",
        "pitch_mm": {"value": pitch, "u": pitch * logarithmic(rng, 1e-4, 1e-3)},
        "line_width_mm": {"value": round(3 * scale, 3), "u": 0.01},
    }
    strips = {
        "kind": "strips",
        "name": "strips",
        "count": count,
        "width_mm": {"value": width, "u": 0.05},
        "gap_mm": {"value": width, "u": 0.05},
        "height_mm": {"value": height, "u": rng.uniform(0.002, 0.008)},
        "length_mm": {"value": 3 * along_px * scale, "u": 0.5},
    }
    common = {"format": 1, "certificate": "virtual"}
    place = {"position_mm": (rng.uniform(-2, 2, 2) * scale).tolist(), "rotation_deg": rng.uniform(-1.0, 1.0)}
    direction = "columns" if along == "rows" else "rows"
    return [
        {"name": "grid", "kind": "grid", "target": common | grid} | place,
        {"name": "reference", "kind": "reference"},
        {"name": "strips", "kind": "strips", "target": common | strips, "direction": direction} | place,
    ]


def draw_stated(rng: Draw, camera_mm: float) -> dict[str, float]:
    return {"camera_height_u_mm": camera_mm * logarithmic(rng, 1e-3, 1e-2), "projector_position_u_mm": 3.0}


def true_target(rng: Draw, capture: Any) -> Target:
    stated = stated_target(capture)
    name = "pitch_mm" if stated.kind == "line-grid" else "height_mm"
    size = getattr(stated, name)
    true = size.model_copy(update={"value": size.value + size.u * float(rng.standard_normal())})
    return stated.model_copy(update={name: true})


def examine(seed: int, number: int, *, centred: bool) -> Iterator[dict[str, Any]]:
    """Draw one rig, take its pictures, and measure its angle by every estimator; one row each."""
    spec, targets = draw_rig(seed, number, centred=centred)
    taken = simulate_session(spec, seed=number, targets=targets, with_truth=False)
    true = float(projection_angle_deg(spec, np.zeros((1, 2)))[0])
    height = spec.capture_named("strips").target["height_mm"]["value"]  # type: ignore[index]
    drawn = {
        "rig": number,
        "along": "rows" if spec.capture_named("strips").direction == "columns" else "columns",
        "period_px": round(spec.projector.pitch_mm / spec.camera.scale_mm_per_px, 2),
        "step_turns": round(height * math.tan(math.radians(true)) / spec.projector.pitch_mm, 3),
        "camera_mm": math.inf if spec.camera.kind == "telecentric" else round(spec.camera.height_mm),
        "scale": round(spec.camera.scale_mm_per_px, 4),
        "angle_deg": round(true, 3),
    }
    with temporary_session(taken.document, taken.frames, extra_files=taken.files) as session:
        for estimator, found in findings(session):
            yield drawn | {"estimator": estimator} | compared(found, spec, true)


def findings(session: Session) -> Iterator[tuple[str, AngleFindings | FringecalError]]:
    """Yield what each estimator finds, or why it refuses; the camera is measured once, it is half of a rig's time."""
    camera: CameraFindings | None = None
    try:
        commissioned = calibrate_session(session)
        camera = commissioned.result.camera
        yield "phase", angles_of(commissioned)
    except FringecalError as error:
        yield "phase", error
    for estimator in ("ridge", "skeleton"):
        try:
            camera = camera or measure_camera(session)
            yield estimator, picture_angles(session, camera, estimator=estimator)  # type: ignore[arg-type]
        except FringecalError as error:
            yield estimator, error


def compared(found: AngleFindings | FringecalError, spec: RigSpec, true_deg: float) -> dict[str, Any]:
    """Return errors beside stated uncertainties, or the reason of the refusal."""
    if isinstance(found, FringecalError):
        return {"refused": f"{type(found).__name__}: {found}"}
    row: dict[str, Any] = {
        "error_deg": found.angle.value - true_deg,
        "expanded_deg": found.angle.expanded().U,
        "u_scatter_deg": found.budget.contributions().get(Source(Influence.PHASE_SCATTER), 0.0),
    }
    for name, places in (("column", found.columns), ("row", found.rows)):
        ratios = [(place.angle.value - true_at(spec, place)) / place.angle.expanded().U for place in places]
        row[f"{name}_ratios"] = " ".join(f"{ratio:.3f}" for ratio in ratios)
        row[f"{name}_expanded_deg"] = float(np.median([p.angle.expanded().U for p in places])) if places else ""
    return row


def true_at(spec: RigSpec, place: AxisAngle) -> float:
    point = (place.place_mm, 0.0) if place.axis == "u" else (0.0, place.place_mm)
    return float(projection_angle_deg(spec, np.array([point]))[0])


def run(options: argparse.Namespace) -> list[dict[str, str]]:
    """Examine the rigs that the file does not hold, and return all rows."""
    path = Path(options.out)
    done = Counter(int(row["rig"]) for row in rows_of(path))
    for number in range(options.first, options.first + options.rigs):
        if done[number] < len(ESTIMATORS):
            found = list(examine(options.seed, number, centred=options.centred))
            fresh = not path.exists()
            with path.open("a", newline="") as file:
                writer = csv.DictWriter(file, FIELDS, restval="")
                if fresh:
                    writer.writeheader()
                writer.writerows(found)
    return [r for r in rows_of(path) if options.first <= int(r["rig"]) < options.first + options.rigs]


def rows_of(path: Path) -> list[dict[str, str]]:
    if not path.exists():
        return []
    with path.open(newline="") as file:
        return list(csv.DictReader(file))


def share(held: Sequence[bool] | np.ndarray) -> str:
    if not len(held):
        return "none"
    hits = int(np.count_nonzero(held))
    low, high = wilson_interval(hits, len(held))
    return f"{hits} of {len(held)} = {100 * hits / len(held):.1f} % (band {100 * low:.1f}..{100 * high:.1f})"


def report(rows: Sequence[dict[str, str]], estimator: str) -> None:
    mine = [row for row in rows if row["estimator"] == estimator]
    good = [row for row in mine if not row["refused"]]
    print(f"\n{estimator}: {len(good)} of {len(mine)} rigs measured")
    if not good:
        return
    error, expanded = (np.array([float(row[name]) for row in good]) for name in ("error_deg", "expanded_deg"))
    spread = np.sqrt(np.mean((2 * error / expanded) ** 2))
    print(f"  origin: {share(np.abs(error) <= expanded)}; 2 error / U rms {spread:.2f}")
    print(f"  origin: |error| median {np.median(np.abs(error)):.3f}, U median {np.median(expanded):.3f} deg")
    for name in ("column", "row"):
        ratios = [np.array([float(x) for x in row[f"{name}_ratios"].split()]) for row in good]
        u = np.array([float(row[f"{name}_expanded_deg"]) for row in good if row[f"{name}_expanded_deg"]])
        means = np.array([np.mean(r) for r in ratios if r.size])
        each = np.concatenate(ratios)
        own = np.concatenate([r - r.mean() for r in ratios if r.size])
        print(
            f"  {name}s: {share(np.abs(each) <= 1)}; 2 error / U rms {2 * np.sqrt(np.mean(each**2)):.2f}, "
            f"common to a rig {2 * np.sqrt(np.mean(means**2)):.2f}, own {2 * np.sqrt(np.mean(own**2)):.2f}; "
            f"U median {np.median(u):.3f} deg"
        )
        print(f"  rigs whose mean over {name}s is within U: {share(np.abs(means) <= 1)}")
    for reason, number in Counter(row["refused"][:110] for row in mine if row["refused"]).most_common():
        print(f"  refused {number}: {reason}")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rigs", type=int, default=300)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--out", default="angle-campaign.csv")
    parser.add_argument("--centred", action="store_true")
    rows = run(parser.parse_args())
    for estimator in ESTIMATORS:
        report(rows, estimator)


if __name__ == "__main__":
    main()
