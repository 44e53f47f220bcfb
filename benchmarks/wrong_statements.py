"""Does a session with a wrong statement ever pass without a condition while heights are wrong by more than the limit?

Run: python benchmarks/wrong_statements.py [--rigs 1] [--seed 1] [--from 0] [--cache FOLDER] [--clean].
Rigs are drawn (small pictures of the thesis's kind), with angle bars beside grid, plate and strips; pictures are drawn
once and kept in FOLDER. Of each rig 40 sessions are judged: the height of the strips, the pitch of the grid, the
camera's height, the focal length of a stated lens, or the certificate of the bars is stated wrongly, by what changes
heights by 0.5, 1.5, 4 and 10 times the limit (by 45 % of the statement at most), with the bars in the session and
without them. The heights' true error is that of the wrong calibration against the right one, the largest over the field
20 mm up. Diagnostics of the frames and the angle's columns, which know no statement, are left out.
`--clean` judges right statements: with bars, without them, with a lens, and with a projector known to 100 mm.
"""

import argparse
import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np

from fringecal.calibration import CameraFindings, CameraKnowledge, KnownLens, camera_from_grid, wrong_statements
from fringecal.camera import Lens
from fringecal.detect import GridDetection
from fringecal.errors import FringecalError
from fringecal.projector import height_changes
from fringecal.records import DEFAULT_LIMITS
from fringecal.session import Session, load_session, write_session
from fringecal.simulate import load_rig, simulate_session
from fringecal.targets import Quantity
from fringecal.uncertainty import Estimate, UncertaintyComponent
from fringecal.uncertainty.influences import Influence
from fringecal.workflows.commission import calibrate_session, calibrated_session
from fringecal.workflows.commission.camera import camera_knowledge, grid_with_pitch
from fringecal.workflows.commission.checks import commissioning_checks
from fringecal.workflows.commission.run import Commissioning
from fringecal.workflows.shared import displaced, phase_of_capture, severest
from fringecal.workflows.verify import verify_session
from fringecal.workflows.verify.session_artefacts import Verified

LIMIT = DEFAULT_LIMITS.commission.height_percent
SIZES = (0.5, 1.5, 4.0, 10.0)  # of the limit
MOST = 0.45  # of a statement: of half of it nobody is asked
FOCAL_U = 0.002  # relative, as board pictures give it
HEIGHT_MM = 20.0
KINDS = ("strips", "pitch", "camera height", "lens", "bars")

_phases: dict[tuple[str, tuple[str, ...]], Any] = {}


def remembered(capture: Any, **asked: Any) -> Any:
    """Return the phase of a capture, worked out once: statements do not change it."""
    key = (capture.name, capture.sha256)
    if key not in _phases:
        _phases[key] = phase_of_capture(capture, **asked)
    return replace(_phases[key], capture=capture)


@dataclass(frozen=True)
class Case:
    """One session to judge: what is stated wrongly, by which share, and whether its lens is stated."""

    kind: str
    off: float
    lens: bool


def drawn(number: int, seed: int, cache: Path) -> tuple[Session, float]:
    """Return a drawn rig's session with bars, and the true focal length in pixels; pictures come from the cache."""
    rng = np.random.default_rng([seed, number])
    angle, up = math.radians(rng.uniform(42, 54)), rng.uniform(850, 1300)
    rig = load_rig("thesis").at(
        camera={
            "width_px": 320,
            "height_px": 240,
            "scale_mm_per_px": rng.uniform(1.2, 1.5),
            "height_mm": rng.uniform(1100, 1800),
            "tilt_deg": rng.uniform(-0.4, 0.4, 2).tolist(),
        },
        projector={
            "position_mm": [rng.uniform(-40, 40), up * math.tan(angle), up],
            "pitch_mm": rng.uniform(15, 22),
            "contrast": rng.uniform(0.7, 0.95),
        },
        noise={"read_levels": rng.uniform(0.5, 1.5)},
    )
    wanted = {"grid", "reference", "strips", "bars"}
    rig = rig.at(capture=[c.model_dump() for c in rig.capture if c.name in wanted])
    folder = cache / f"rig-{seed}-{number}"
    if not folder.exists():
        shot = simulate_session(rig, seed=seed + 1000 * number, with_truth=False)
        write_session(folder, shot.document, shot.frames, extra_files=shot.files)
    return load_session(folder), rig.camera.height_mm / rig.camera.scale_mm_per_px


def lens_of(focal_px: float, shape: tuple[int, int]) -> KnownLens:
    """Return a lens as stated; its principal point and distortion leave the grid free to find them."""
    values = np.array([focal_px, focal_px, (shape[1] - 1) / 2, (shape[0] - 1) / 2, 0, 0, 0, 0, 0])
    u = np.array([FOCAL_U * focal_px] * 2 + [4.0, 4.0, 0.2, 1e-6, 1e-6, 1e-6, 1e-6])
    return KnownLens(Lens(values, np.diag(u**2), shape[1], shape[0]), file="lens.cameramodel")


def scaled(quantity: Quantity, factor: float) -> Quantity:
    """Return a quantity whose values are stated so many times as large, with the same u."""
    values = tuple(v * factor for v in quantity.values)
    return quantity.model_copy(update={"value": values[0] if len(values) == 1 else values})


def with_target(session: Session, name: str, **changed: Any) -> Session:
    """Return the session with one capture's target stated otherwise."""
    capture = session.captures[name]
    assert capture.target is not None
    other = replace(capture, target=capture.target.model_copy(update=changed))
    return replace(session, captures={**session.captures, name: other})


def stated(session: Session, case: Case) -> Session:
    """Return the session as the case states it."""
    factor = 1 + case.off
    if case.kind == "strips":
        return with_target(session, "strips", height_mm=scaled(session.captures["strips"].target.height_mm, factor))
    if case.kind == "pitch":
        return with_target(session, "grid", pitch_mm=scaled(session.captures["grid"].target.pitch_mm, factor))
    if case.kind == "camera height":
        height = scaled(session.camera.height_mm, factor)
        return replace(session, camera=replace(session.camera, height_mm=height))
    if case.kind == "bars":
        return with_target(session, "bars", leg_mm=scaled(session.captures["bars"].target.leg_mm, factor))
    return session


def judged(session: Session, case: Case, focal_px: float) -> Commissioning:
    """Commission a session as the case states it, with its bars, without what no check needs."""
    said = stated(session, case)
    known = camera_knowledge(said)
    capture = said.one("grid")
    assert capture.target is not None
    detection, pitch = seen_grid(session)
    pitch = replace(pitch, value=capture.target.pitch_mm.value)  # type: ignore[union-attr]
    if case.lens:
        wrong = 1 + case.off if case.kind == "lens" else 1.0
        known = replace(known, lens=lens_of(wrong * focal_px, detection.shape))
    camera: CameraFindings = camera_from_grid(detection, pitch, known, thermal_rel_u=capture.target.thermal_rel_u)
    found = calibrate_session(said, camera=camera)
    angles = SimpleNamespace(displacement=displaced(found.result.rig, found.result.stated_projector))
    own = CameraKnowledge(known.height_mm, known.telecentric, found.result.camera.lens)
    wrong_ones = wrong_statements(found.result, own)
    verified = verify_session(said, found.result.rig)
    return Commissioning(found, angles, (), None, verified, None, wrong_ones)  # type: ignore[arg-type]


def without_bars(found: Commissioning) -> Commissioning:
    """Return the same session without its bars."""
    return replace(found, verified=Verified())


_grids: dict[Path, tuple[GridDetection, Estimate]] = {}


def seen_grid(session: Session) -> tuple[GridDetection, Estimate]:
    """Return a session's grid in its picture, found once: its statements do not change it."""
    capture = session.one("grid")
    if capture.paths[0] not in _grids:
        assert capture.target is not None
        _grids[capture.paths[0]] = grid_with_pitch(capture, capture.target)
    return _grids[capture.paths[0]]


def heights_percent(right: Commissioning, wrong: Commissioning) -> float:
    """Largest relative difference of heights over the field, %."""
    rig, other = right.calibrated.result.rig, wrong.calibrated.result.rig
    places = np.meshgrid(*(np.linspace(0.05, 0.95, 7) * (n - 1) for n in (rig.camera.width_px, rig.camera.height_px)))
    off = replace(rig, components=(UncertaintyComponent(Influence.INPUT, other.vector - rig.vector),))
    return 100 * float(np.abs(height_changes(off, HEIGHT_MM, *places)).max()) / HEIGHT_MM


def sensitivity(found: Commissioning, kind: str) -> float:
    """Relative change of heights over that of a statement, from the report's own table."""
    from fringecal.workflows.commission.testability import statements_tested

    names = {"strips": "height of the strips", "pitch": "pitch of the grid", "camera height": "height of the camera",
             "lens": "focal length of the lens", "bars": "certificate of bars"}  # fmt: skip
    (row,) = [one for one in statements_tested(found, DEFAULT_LIMITS) if one.name == names[kind]]
    return row.heights_rel


def cases(right: dict[bool, Commissioning]) -> Iterator[Case]:
    """Yield the twenty wrong statements of a rig; each is judged with bars and without them."""
    for kind in KINDS:
        lens = kind == "lens"
        rel = sensitivity(right[lens], kind)
        for k, size in enumerate(SIZES):
            off = min(size * LIMIT / 100 / max(rel, 1e-9), MOST)
            yield Case(kind, off * (-1) ** k, lens)


def campaign(number: int, seed: int, cache: Path) -> tuple[int, int, int]:
    """Judge the forty sessions of one rig; return those that pass while they must not, those told, and all."""
    session, focal_px = drawn(number, seed, cache)
    right = {lens: judged(session, Case("none", 0.0, lens), focal_px) for lens in (False, True)}
    bad = told = count = 0
    for case in cases(right):
        try:
            found = judged(session, case, focal_px)
            percent = heights_percent(right[case.lens], found)
            both = [
                (name, commissioning_checks(one))
                for name, one in (("with bars", found), ("alone", without_bars(found)))
            ]
        except FringecalError as error:
            bad, told, count = bad, told + 2, count + 2
            print(f"  {case.kind:14} {100 * case.off:+7.2f} %  refused: {str(error)[:70]}", flush=True)
            continue
        for name, checks in both:
            decision = severest(checks)
            why = next((c.name for c in checks if c.decision == decision), "")
            wrong = decision == "pass" and percent > LIMIT
            bad, told, count = bad + wrong, told + (decision in ("fail", "conditionalFail")), count + 1
            mark = "  WRONG" if wrong else ""
            said = f"  {case.kind:14} {name:10} {100 * case.off:+7.2f} %  heights {percent:6.2f} %"
            print(f"{said}  {decision:16} {why if decision != 'pass' else ''}{mark}", flush=True)
    return bad, told, count


def clean(number: int, seed: int, cache: Path) -> None:
    """Print the verdicts of right statements, with the reason of each that is no pass."""
    session, focal_px = drawn(number, seed, cache)
    position = session.projector.position_mm.model_copy(update={"u": (100.0,) * 3})
    vague = replace(session, projector=replace(session.projector, position_mm=position))
    plain, lens = (judged(session, Case("none", 0.0, known), focal_px) for known in (False, True))
    far = judged(vague, Case("none", 0.0, False), focal_px)
    sessions = {
        "with bars": plain,
        "alone": without_bars(plain),
        "with bars and lens": lens,
        "alone, with a lens": without_bars(lens),
        "with bars, projector known to 100 mm": far,
        "alone, projector known to 100 mm": without_bars(far),
    }
    for name, found in sessions.items():
        checks = commissioning_checks(found)
        reasons = [f"{c.name} {c.value:.2g}" for c in checks if c.decision not in ("pass", "info")]
        print(f"  {name:38} {severest(checks):16} {'; '.join(reasons)}", flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rigs", type=int, default=1)
    parser.add_argument("--from", dest="first", type=int, default=0)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--cache", type=Path, default=Path("wrong-statements"))
    parser.add_argument("--clean", action="store_true")
    options = parser.parse_args()
    calibrated_session.phase_of_capture = remembered  # type: ignore[attr-defined]
    total = np.zeros(3, int)
    for number in range(options.first, options.first + options.rigs):
        print(f"rig {number}", flush=True)
        if options.clean:
            clean(number, options.seed, options.cache)
        else:
            total += campaign(number, options.seed, options.cache)
    if not options.clean:
        bad, told, count = total
        print(
            f"{count} wrong statements: {bad} pass with heights wrong by more than {LIMIT:g} %, {told} found or refused"
        )


if __name__ == "__main__":
    main()
