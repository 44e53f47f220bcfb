"""Does an audit see what it says it sees, and name what moved? Counts over virtual rigs, against what is promised.

Run: python benchmarks/audit_campaign.py [--rigs 5] [--seed 1] [--csv FILE]. Every rig draws its own lamp, pitch,
camera tilt, noise and true strip height, and is commissioned once; then each of seven things happens to it, and it is
audited with grid, plate and strips laid anew. Then one of the things, by turns, happens just above the detection limit
that its audit has stated. The pictures and what happens in them are the simulator's. With --csv a row is written after
every audit, and what stands in the file is not done again.
"""

import argparse
import csv
import math
import tempfile
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy import stats

from fringecal.errors import FringecalError
from fringecal.projector.move_kinds import Move
from fringecal.projector.moves import moved
from fringecal.projector.rig_calibration import RigCalibration
from fringecal.records.calibration_record import CalibrationRecord
from fringecal.session import Session, load_session, write_session
from fringecal.simulate import RigSpec, load_rig, simulate_session
from fringecal.simulate.rig.drawn_projector import build_projector, phase_gradient
from fringecal.targets import load_target
from fringecal.workflows.audit.checks import least_seen
from fringecal.workflows.audit.observed import base_state
from fringecal.workflows.audit.run import CHANCE, Audit, audit
from fringecal.workflows.commission.record import calibration_record
from fringecal.workflows.commission.run import commission
from fringecal.workflows.shared.stored_calibration import calibration_of

CAPTURES = ("grid", "reference", "strips")
STRIPS_U_MM = 0.005
REFUSED = "commissioning refused"  # such a rig has no audits
AT_THE_LIMIT = "at the limit: "
ABOVE = 1.05  # times the detection limit: limits are stated from one audit's scatter and judged by another's
POWER = 0.95  # chance of being seen, at which the detection limit stands
COLUMNS = ("rig", "event", "detected", "power", "limit", "cause", "runner_up", "chi2", "dof", "error")

Happened = tuple[RigSpec, float, dict[str, float]]
"""The rig afterwards, the true height of its strips, and the moves by the audit's own names."""
InForce = tuple[RigCalibration, CalibrationRecord]


def draw_rig(rng: np.random.Generator) -> RigSpec:
    """One rig of 320 x 240 px, like the thesis's but for where its parts stand."""
    lamp = (rng.uniform(-60, 60), rng.uniform(1050, 1350), rng.uniform(900, 1100))
    return load_rig("thesis").at(
        camera={
            "width_px": 320,
            "height_px": 240,
            "scale_mm_per_px": 0.9,
            "tilt_deg": tuple(rng.normal(0, 0.5, 2).tolist()),
        },
        projector={"position_mm": lamp, "pitch_mm": rng.uniform(7, 9)},
        noise={"read_levels": rng.uniform(0.5, 1.5)},
        surface={"seed": int(rng.integers(1 << 31))},
    )


# ---- what happens to a rig ------------------------------------------------------------------------
# Each takes the rig, the true height of its strips, a source of chance, and which part of it happens.
def nothing(rig: RigSpec, height_mm: float, _: np.random.Generator, __: float) -> Happened:
    return rig, height_mm, {}


def camera_lowered(rig: RigSpec, height_mm: float, _: np.random.Generator, part: float) -> Happened:
    camera = rig.camera
    height = camera.height_mm - 5 * part
    lower = rig.at(camera={"height_mm": height, "scale_mm_per_px": camera.scale_mm_per_px * height / camera.height_mm})
    return lower, height_mm, {"camera height": -5.0 * part}


def lamp_moved(rig: RigSpec, height_mm: float, rng: np.random.Generator, part: float) -> Happened:
    """5 mm in any direction, by turns as it is, or aimed and its fringes set anew."""
    step = rng.standard_normal(3)
    step *= 5 * part / np.linalg.norm(step)
    position = np.array(rig.projector.position_mm) + step
    changes: dict[str, Any] = {"position_mm": tuple(position.tolist())}
    aimed = bool(rng.random() < 0.5)
    if not aimed:
        slope = phase_gradient(build_projector(rig.projector), -step)
        aim = np.array(rig.projector.aim_mm) + step[:2] - step[2] * (position - step)[:2] / (position - step)[2]
        changes |= {"aim_mm": tuple(aim.tolist())} | _fringes(slope)
    kind = "aimed lamp" if aimed else "lamp"
    amounts = {f"{kind} along {axis}": float(s) for axis, s in zip("xyz", step, strict=True)}
    return rig.at(projector=changes), height_mm, amounts


def _fringes(slope: np.ndarray) -> dict[str, float]:
    across = math.degrees(math.atan2(slope[1], slope[0]))
    return {"pitch_mm": 2 * math.pi / math.hypot(slope[0], slope[1]), "across_deg": across}


def lens_refocused(rig: RigSpec, height_mm: float, rng: np.random.Generator, part: float) -> Happened:
    """Focused 200 to 500 mm short: an aperture of 4 mm blurs by a quarter of its circle, and the lens grows longer.

    With f = 16 mm and pixels of 5 um, an image distance longer by the share s is a blur of 200 s px.
    """
    share = part * (16.0 / (1500.0 - rng.uniform(200, 500)) - 16.0 / 1500.0)
    blur = math.hypot(rig.camera.defocus_px, 4.0 * share * 1000 / 5 / 4)
    scale = rig.camera.scale_mm_per_px / (1 + share)
    amounts = {"lens blur": blur**2 - rig.camera.defocus_px**2, "focal length": share}
    return rig.at(camera={"defocus_px": blur, "scale_mm_per_px": scale}), height_mm, amounts


def slide_changed(rig: RigSpec, height_mm: float, rng: np.random.Generator, part: float) -> Happened:
    change = 0.005 * part * rng.choice([-1, 1])
    return rig.at(projector={"pitch_mm": rig.projector.pitch_mm * (1 + change)}), height_mm, {"slide pitch": change}


def plate_tilted(rig: RigSpec, height_mm: float, rng: np.random.Generator, part: float) -> Happened:
    """0.2 deg in any direction: in the plate's frame camera and lamp turn as one about its origin."""
    tilt, direction = math.radians(0.2) * part, rng.uniform(0, 2 * math.pi)
    rise = tilt * np.array([math.cos(direction), math.sin(direction)])
    cross = np.array([[0, 0, -rise[0]], [0, 0, -rise[1]], [rise[0], rise[1], 0]]) / tilt
    turn = np.eye(3) + math.sin(tilt) * cross + (1 - math.cos(tilt)) * cross @ cross
    lean = turn.T @ np.array([*np.tan(np.radians(rig.camera.tilt_deg)), 1.0])
    projector = {
        "position_mm": tuple((turn.T @ np.array(rig.projector.position_mm)).tolist()),
        **_fringes(turn.T @ phase_gradient(build_projector(rig.projector), np.zeros(3))),
    }
    camera = {
        "tilt_deg": tuple(np.degrees(np.arctan(lean[:2] / lean[2])).tolist()),
        "height_mm": rig.camera.height_mm * lean[2],
    }
    amounts = {"plate tilt toward x": float(rise[0]), "plate tilt toward y": float(rise[1])}
    return rig.at(camera=camera, projector=projector), height_mm, amounts


def strips_swapped(rig: RigSpec, height_mm: float, rng: np.random.Generator, part: float) -> Happened:
    other = height_mm + part * (3.1 + STRIPS_U_MM * rng.standard_normal() - height_mm)
    return rig, other, {"strip height": other / height_mm - 1}


EVENTS: Mapping[str, tuple[Callable[[RigSpec, float, np.random.Generator, float], Happened], str]] = {
    "nothing": (nothing, ""),
    "camera lowered 5 mm": (camera_lowered, "camera height changed"),
    "lamp moved 5 mm": (lamp_moved, "lamp moved"),
    "lens refocused": (lens_refocused, "camera lens refocused"),
    "slide pitch 0.5 %": (slide_changed, "slide pitch changed"),
    "plate tilted 0.2 deg": (plate_tilted, "plate tilted"),
    "strips of 3.1 mm": (strips_swapped, "strips not as high as stated"),
}


# ---- audits ---------------------------------------------------------------------------------------
def taken(rig: RigSpec, height_mm: float, folder: Path, seed: int, rng: np.random.Generator) -> Session:
    """Lay grid and strips anew, not quite where they lay, and take the pictures."""
    captures = [
        capture.model_dump()
        | {"position_mm": tuple(rng.uniform(-4, 4, 2).tolist()), "rotation_deg": float(rng.uniform(-0.5, 0.5))}
        for capture in rig.capture
        if capture.name in CAPTURES
    ]
    stated = load_target("glass-strips")
    true = type(stated).model_validate(stated.model_dump() | {"height_mm": {"value": height_mm, "u": STRIPS_U_MM}})
    shot = simulate_session(rig.at(capture=captures), seed=seed, targets={"strips": true}, with_truth=False)
    write_session(folder, shot.document, shot.frames, extra_files=shot.files)
    return load_session(folder)


def stated(found: Audit, calibration: RigCalibration, amounts: Mapping[str, float]) -> tuple[float, float]:
    """Chance with which the audit says that it sees these moves, and which part of them it would see with 95 %.

    Its own signatures against its own covariance; nothing at all is seen with the chance of a false alarm.
    """
    base, size = base_state(calibration), found.change.size
    signature = found.layout.predict(
        moved(base, {Move(name): amount for name, amount in amounts.items()})
    ) - found.layout.predict(base)
    square = float(signature @ np.linalg.solve(found.covariance, signature))
    if not square:
        return CHANCE, math.inf
    threshold = stats.chi2.isf(CHANCE, size)
    return float(stats.ncx2.sf(threshold, size, square)), math.sqrt(least_seen(size) / square)


@dataclass(frozen=True)
class Rig:
    """A rig, the true height of its strips, its calibration, and the seed of what happens to it."""

    spec: RigSpec
    height_mm: float
    in_force: InForce
    seed: tuple[int, int]


def audited(event: str, rig: Rig, part: float = 1.0) -> dict[str, Any]:
    """Let one thing, or a part of it, happen to a rig and audit it: one row of the table."""
    number = 1 + list(EVENTS).index(event)
    after, height, amounts = EVENTS[event][0](rig.spec, rig.height_mm, np.random.default_rng([*rig.seed, number]), part)
    rng = np.random.default_rng([*rig.seed, number, 1 + int(part != 1.0)])  # of the pictures
    row: dict[str, Any] = {"rig": rig.seed[1], "event": event if part == 1.0 else AT_THE_LIMIT + event}
    with tempfile.TemporaryDirectory() as folder:
        session = taken(after, height, Path(folder) / "s", int(rng.integers(1 << 31)), rng)
        try:
            found = audit(session, *rig.in_force)
        except FringecalError as error:
            return row | {"detected": 1, "error": str(error)}
    power, limit = stated(found, rig.in_force[0], amounts)
    causes = [fit.cause.value for fit in found.causes] + ["", ""]
    return row | {
        "detected": int(found.changed),
        "power": round(power, 4),
        "limit": round(limit, 4),
        "cause": causes[0],
        "runner_up": causes[1],
        "chi2": round(found.chi2, 1),
        "dof": found.change.size,
        "error": "",
    }


def rows_of_rig(seed: int, number: int, done: set[str]) -> Iterator[dict[str, Any]]:
    """Commission one rig, and audit it after each event that is not done."""
    rng = np.random.default_rng([seed, number])
    rig, height_mm = draw_rig(rng), 3.0 + STRIPS_U_MM * rng.standard_normal()
    with tempfile.TemporaryDirectory() as folder:
        session = taken(rig, height_mm, Path(folder) / "s", int(rng.integers(1 << 31)), rng)
        try:
            record = calibration_record(commission(session))
        except FringecalError as error:
            yield {"rig": number, "event": REFUSED, "detected": 0, "error": str(error)}
            return
    whole = Rig(rig, height_mm, (calibration_of(record), record), (seed, number))
    turn = list(EVENTS)[1 + number % (len(EVENTS) - 1)]
    for event in EVENTS:
        if event in done and not (event == turn and AT_THE_LIMIT + turn not in done):
            continue
        row = audited(event, whole)
        if event not in done:
            yield row
        if event == turn and math.isfinite(float(row.get("limit", math.inf))):
            yield audited(event, whole, ABOVE * float(row["limit"]))


def run(seed: int, rigs: int, file: Path | None) -> list[dict[str, Any]]:
    """All rows, those that stand in the file already among them."""
    rows: list[dict[str, Any]] = []
    if file is not None and file.exists():
        with file.open(newline="") as stream:
            rows += list(csv.DictReader(stream))
    for number in range(rigs):
        done = {row["event"] for row in rows if int(row["rig"]) == number}
        if len(done) == len(EVENTS) + 1 or REFUSED in done:
            continue
        for row in rows_of_rig(seed, number, done):
            rows.append(row)
            if file is not None:
                append(file, row)
    return rows


def append(file: Path, row: Mapping[str, Any]) -> None:
    """Add a row to the table at once, so that an interrupted campaign still says something."""
    new = not file.exists()
    with file.open("a", newline="") as stream:
        writer = csv.DictWriter(stream, COLUMNS)
        if new:
            writer.writeheader()
        writer.writerow(row)


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--rigs", type=int, default=5)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--csv", type=Path)
    options = parser.parse_args()
    rows = run(options.seed, options.rigs, options.csv)
    for event, (_, cause) in EVENTS.items():
        tell(event, cause, [row for row in rows if row["event"] == event])
    near = [row for row in rows if row["event"].startswith(AT_THE_LIMIT) and float(row["power"]) >= POWER]
    print(
        f"just above the detection limit: seen {share(sum(int(row['detected']) for row in near), len(near))} (bar 95 %)"
    )
    print(f"{REFUSED}: {sum(row['event'] == REFUSED for row in rows)}")


def share(part: int, whole: int) -> str:
    return f"{part} of {whole}, {100 * part / whole:.1f} %" if whole else "none"


def tell(event: str, cause: str, rows: list[dict[str, Any]]) -> None:
    """Print the counts of one event beside the bars."""
    detected = sum(int(row["detected"]) for row in rows)
    if not cause:
        print(f"{event}: alarms in {share(detected, len(rows))} (bar 5 %)")
        return
    above = [row for row in rows if float(row.get("power") or 1) >= POWER]
    seen, right = sum(int(row["detected"]) for row in above), sum(row["cause"] == cause for row in rows)
    limits = [float(row["limit"]) for row in rows if row.get("limit")] or [math.nan]
    low, middle, high = np.quantile(limits, [0.05, 0.5, 0.95])
    print(f"{event}: above the detection limit {len(above)} of {len(rows)}, of these seen {share(seen, len(above))}")
    print(f"    (bar 95 %); cause named first: {share(right, len(rows))} (bar 80 %)")
    print(f"    stated detection limit: {middle:.3f} of it, {low:.3f} to {high:.3f} on nine rigs of ten")
    for other in sorted({row["cause"] for row in rows} - {cause}):
        print(f"    instead: {other or 'refused or not seen'}, {sum(row['cause'] == other for row in rows)}")


if __name__ == "__main__":
    main()
