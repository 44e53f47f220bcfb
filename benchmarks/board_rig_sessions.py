"""Are faults of a board rig's captures named by `commission`, and nothing of clean ones? On whole session folders.

Rigs are drawn wide: a small camera and a small projector at 10 to 40 deg to one another, lenses that bend, a chessboard
in 8 to 11 poses, 3 or 4 phase shifts, one grey level of noise. Their pictures are rendered, a fault is put into the
rig, the pictures or session.toml, the folder is written, and read by the code behind `fringecal commission`.

    python benchmarks/board_rig_sessions.py --cases 10 --seed 2
    python benchmarks/board_rig_sessions.py --cases 50 --seed 2 --faults clean

prints for each fault how often it is named, how often something else is named too, and what is said.
"""

import argparse
import re
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from fringecal.errors import FringecalError
from fringecal.session import load_session, write_session
from fringecal.simulate import RasterRigSpec, load_raster_rig, simulate_raster_session
from fringecal.workflows.commission import board_checks, commission_boards
from fringecal.workflows.commission.by_board import board_run

Rng = np.random.Generator


def drawn_rig(rng: Rng) -> RasterRigSpec:
    """A small rig of camera, projector, board and poses."""
    width, height = [(208, 160), (224, 168), (240, 192)][rng.integers(3)]
    away = float(rng.uniform(400, 800))
    focal = width * rng.uniform(1.6, 2.2)
    columns, rows = [(320, 180), (320, 240), (400, 250)][rng.integers(3)]
    angle, throw = np.radians(rng.uniform(10, 40)) * rng.choice([-1, 1]), away * rng.uniform(0.85, 1.15)
    field = away * width / focal
    place = [throw * np.sin(angle), rng.uniform(-0.1, 0.1) * away, away - throw * np.cos(angle)]
    return load_raster_rig("dlp-small").at(
        camera={
            "width_px": width, "height_px": height, "focal_px": focal,
            "principal_offset_px": tuple(rng.normal(0, 2, 2)), "distortion": terms(rng, 0.3),
            "defocus_px": rng.uniform(0.3, 0.7),
        },
        projector={
            "columns": columns, "rows": rows, "position_mm": tuple(place), "aim_mm": (0.0, 0.0, away),
            "roll_deg": rng.normal(0, 1), "focal_px": columns * throw / field / rng.uniform(1.05, 1.35),
            "centre_px": (columns / 2 + rng.normal(0, 3), rows / 2 + rng.normal(0, 3)), "distortion": terms(rng, 0.3),
            "blur_px": rng.uniform(0.4, 0.8),
        },
        fringes={"fringes": (1.0, float(round(columns / rng.uniform(15, 22)))), "steps_deg": steps(rng)},
        noise={"read_levels": rng.uniform(0.5, 1.2)},
        capture=[*poses(rng, away, field, height / width), plate(away)],
    )  # fmt: skip


def steps(rng: Rng) -> tuple[float, ...]:
    """Phase shifts: three or four."""
    return ((0.0, 120.0, 240.0), (0.0, 90.0, 180.0, 270.0))[rng.integers(2)]


def terms(rng: Rng, corner: float) -> tuple[float, ...]:
    """Brown's terms that move a corner by up to some per cent of its radius."""
    k1, k2 = rng.normal(0, [0.01, 0.003]) / corner ** np.array([2, 4])
    return (k1, k2, *rng.normal(0, 3e-4, 2), 0.0)


def plate(away: float) -> dict[str, Any]:
    """The bare plate, which shows the waveform."""
    return {
        "name": "plate", "kind": "reference", "position_mm": (0.0, 0.0, 1.03 * away), "turn_deg": (4.0, -6.0, 0.0),
    }  # fmt: skip


def poses(rng: Rng, away: float, field: float, aspect: float) -> Iterable[dict[str, Any]]:
    """A chessboard in poses tilted to all sides, near and far."""
    columns, rows = int(rng.integers(7, 10)), int(rng.integers(5, 7))
    square = round(field * rng.uniform(0.5, 0.65) / (columns + 1), 2)
    board = {
        "format": 1, "kind": "chessboard", "name": "board", "certificate": "virtual", "columns": columns, "rows": rows,
        "square_mm": {"value": square, "u": 1e-4 * square},
    }  # fmt: skip
    sheet = ((columns + 2) * square, (rows + 2) * square)
    turned = rng.uniform(0, 2 * np.pi)
    for k in range(int(rng.integers(8, 12))):
        side, size = turned + k * 2.4, rng.uniform(12, 32)  # the golden angle: to all sides
        yield {
            "name": f"pose-{k + 1:02}", "kind": "board", "target": board, "sheet_mm": sheet,
            "position_mm": (*(rng.uniform(-0.1, 0.1, 2) * field * [1, aspect]), away * rng.uniform(0.9, 1.1)),
            "turn_deg": (size * np.cos(side), size * np.sin(side), rng.choice([0.0, 90.0]) + rng.normal(0, 10)),
        }  # fmt: skip


@dataclass
class Made:
    """A session before it is written: the rig it was taken with, its document, its frames by file name."""

    rig: RasterRigSpec
    document: dict[str, Any]
    frames: dict[str, np.ndarray]
    files: dict[str, bytes]
    seed: int

    @property
    def boards(self) -> list[str]:
        return [one.name for one in self.rig.capture if one.kind == "board"]

    def table(self, name: str) -> dict[str, Any]:
        return next(one for one in self.document["capture"] if one["name"] == name)

    def names_of(self, name: str) -> list[str]:
        """File names of a capture: its fringes, white, black."""
        table = self.table(name)
        return [*table["images"], *table["white"], *table["black"]]

    def retaken(self, name: str, rig: RasterRigSpec, only: Iterable[str] | None = None) -> None:
        """Take a capture again with another rig, or some of its frames."""
        taken = simulate_raster_session(rig, [name], seed=self.seed, with_truth=False).frames
        chosen = set(self.names_of(name)) if only is None else set(only)
        self.frames |= {file: frame for file, frame in taken.items() if file in chosen}


def taken(rig: RasterRigSpec, seed: int) -> Made:
    """Take a whole session."""
    session = simulate_raster_session(rig, seed=seed, with_truth=False)
    return Made(rig, session.document, dict(session.frames), dict(session.files), seed)


def with_captures(rig: RasterRigSpec, change: Callable[[Any], Any]) -> RasterRigSpec:
    """The rig with each board's capture changed."""
    return rig.model_copy(update={"capture": tuple(change(c) if c.kind == "board" else c for c in rig.capture)})


def some(rng: Rng, made: Made) -> str:
    """One of the poses."""
    return str(rng.choice(made.boards))


# --- faults of the rig: rendered anew --------------------------------------------------------------------------------


def stretched(rng: Rng, rig: RasterRigSpec) -> RasterRigSpec:
    """A print stretched by 0.4 to 2 %."""
    stretch = rng.choice([-1, 1]) * rng.uniform(0.004, 0.02)
    return with_captures(rig, lambda one: one.model_copy(update={"stretch": stretch}))


def alike(rng: Rng, rig: RasterRigSpec) -> RasterRigSpec:
    """Poses within some degrees of one another at one distance."""

    def near(one: Any) -> Any:
        turn = (*(8 * np.array([1, 0]) + rng.normal(0, 2, 2)), one.turn_deg[2])
        return one.model_copy(update={"turn_deg": turn, "position_mm": (*one.position_mm[:2], rig.projector.aim_mm[2])})

    return with_captures(rig, near)


def few(rng: Rng, rig: RasterRigSpec) -> RasterRigSpec:
    """Three or four poses."""
    count, kept = int(rng.integers(3, 5)), []
    for one in rig.capture:
        if one.kind != "board" or sum(c.kind == "board" for c in kept) < count:
            kept.append(one)
    return rig.model_copy(update={"capture": tuple(kept)})


def scaled(rng: Rng, rig: RasterRigSpec) -> RasterRigSpec:
    """A frame that a scaler stretches along its rows."""
    factor = rng.choice([1.125, 0.9, 1.0667, 0.9375])
    return rig.at(projector={"frame": (1.0, 0, 0, 0, float(factor), 0, 0, 0, 1.0)})


def keystoned(rng: Rng, rig: RasterRigSpec) -> RasterRigSpec:
    """A frame turned into a trapezium whose upper edge is shorter by 10 to 30 %, on one side more than on the other."""
    w, h = rig.projector.columns, rig.projector.rows
    left, right = rng.uniform(0.05, 0.15, 2) * w
    frame = np.array([[0, 0], [w, 0], [w, h], [0, h]], np.float32)
    raster = np.array([[left, 0], [w - right, 0], [w, h], [0, h]], np.float32)
    return rig.at(projector={"frame": tuple(map(float, cv2.getPerspectiveTransform(raster, frame).ravel()))})


def falling(rng: Rng, rig: RasterRigSpec) -> RasterRigSpec:
    """Patterns whose phase falls along an axis, or both: no fault."""
    return rig.at(fringes={"falling": [("u",), ("v",), ("u", "v")][rng.integers(3)]})


# --- faults of pictures and captures ---------------------------------------------------------------------------------


def nothing(_: Rng, __: Made) -> None:
    """A clean session."""


def camera_focus(rng: Rng, made: Made) -> None:
    """The camera focuses anew for each pose: by 0.3 to 1 % of its focal length."""
    size = rng.uniform(0.003, 0.01)
    for name in made.boards:
        focal = made.rig.camera.focal_px * (1 + size * rng.standard_normal())
        made.retaken(name, made.rig.at(camera={"focal_px": focal}))


def projector_focus(rng: Rng, made: Made) -> None:
    """The projector's focus moves from pose to pose by 0.3 to 1 %."""
    size = rng.uniform(0.003, 0.01)
    for name in made.boards:
        focal = made.rig.projector.focal_px * (1 + size * rng.standard_normal())
        made.retaken(name, made.rig.at(projector={"focal_px": focal}))


def turned_pictures(rng: Rng, made: Made) -> None:
    """The pictures of one pose were stored mirrored, or turned by 180 deg: corners are numbered otherwise there."""
    way = [lambda a: a[::-1, ::-1], lambda a: a[:, ::-1], lambda a: a[::-1]][rng.integers(3)]
    for file in made.names_of(some(rng, made)):
        made.frames[file] = np.ascontiguousarray(way(made.frames[file]))


def others_white(rng: Rng, made: Made) -> None:
    """The white picture of a pose is that of another one."""
    one, other = rng.choice(made.boards, 2, replace=False)
    made.frames[made.table(one)["white"][0]] = made.frames[made.table(other)["white"][0]].copy()
    kept = made.frames[made.table(one)["white"][0]].astype(int)  # no two files are one: a bit of noise
    made.frames[made.table(one)["white"][0]] = np.clip(kept + rng.integers(-1, 2, kept.shape), 0, 255).astype(np.uint8)


def moved_board(rng: Rng, made: Made) -> None:
    """The board is pushed by 0.3 to 2 % of the field, or turned, at a random frame of one pose."""
    name = some(rng, made)
    files = made.names_of(name)
    capture = made.rig.capture_named(name)
    push = rng.normal(0, 1, 3)
    push *= rng.uniform(0.003, 0.02) * capture.sheet_mm[0] * 1.6 / np.linalg.norm(push)
    turn = rng.normal(0, 0.5, 3)
    moved = capture.model_copy(
        update={
            "position_mm": tuple(np.add(capture.position_mm, push)),
            "turn_deg": tuple(np.add(capture.turn_deg, turn)),
        }
    )
    rig = made.rig.model_copy(update={"capture": tuple(moved if c.name == name else c for c in made.rig.capture)})
    made.retaken(name, rig, files[int(rng.integers(1, len(files) - 1)) :])


def moved_camera(rng: Rng, made: Made) -> None:
    """The camera is knocked during a pose: it looks 0.2 to 1 deg aside then, and in all later poses."""
    first = int(rng.integers(1, len(made.boards)))
    turn = cv2.Rodrigues(np.radians(rng.uniform(0.2, 1.0)) * unit(rng))[0]
    shift = rng.normal(0, 1.0, 3)
    rig = knocked(made.rig, turn, shift)
    for k, name in enumerate(made.boards[first:]):
        files = made.names_of(name)
        made.retaken(name, rig, files[int(rng.integers(1, len(files) - 1)) :] if k == 0 else files)


def unit(rng: Rng) -> np.ndarray:
    arrow = rng.normal(0, 1, 3)
    return np.asarray(arrow / np.linalg.norm(arrow))


def knocked(rig: RasterRigSpec, turn: np.ndarray, shift: np.ndarray) -> RasterRigSpec:
    """The same things in the frame of a camera that was turned and shifted; the projector keeps its roll but for it."""

    def seen(point: Iterable[float]) -> tuple[float, ...]:
        return tuple(map(float, turn @ np.array(tuple(point)) + shift))

    def turned(capture: Any) -> Any:
        x, y, z = np.radians(capture.turn_deg)
        about = [cv2.Rodrigues(a * e)[0] for a, e in zip((x, y, z), np.eye(3), strict=True)]
        return capture.model_copy(
            update={
                "position_mm": seen(capture.position_mm),
                "turn_deg": angles(turn @ about[2] @ about[1] @ about[0]),
            }
        )

    projector = {"position_mm": seen(rig.projector.position_mm), "aim_mm": seen(rig.projector.aim_mm)}
    changed = rig.at(projector=projector)
    return changed.model_copy(update={"capture": tuple(turned(c) for c in rig.capture)})


def angles(m: np.ndarray) -> tuple[float, float, float]:
    """Turns about x, then y, then z, deg."""
    return (
        float(np.degrees(np.arctan2(m[2, 1], m[2, 2]))),
        float(np.degrees(np.arcsin(-m[2, 0]))),
        float(np.degrees(np.arctan2(m[1, 0], m[0, 0]))),
    )


def glare(rng: Rng, made: Made) -> None:
    """A lamp is mirrored in the board of one pose: a third of its width saturates."""
    name = some(rng, made)
    files = made.names_of(name)
    rows, columns = np.indices(made.frames[files[0]].shape)
    bright = made.frames[files[-2]] > 40
    middle = [np.median(g[bright]) + rng.normal(0, 0.1) * np.ptp(g[bright]) for g in (columns, rows)]
    size = rng.uniform(0.1, 0.2) * np.ptp(columns[bright])
    spot = 400 * np.exp(-((columns - middle[0]) ** 2 + (rows - middle[1]) ** 2) / (2 * size**2))
    for file in files:
        made.frames[file] = np.clip(made.frames[file] + spot, 0, 255).astype(np.uint8)


def partly_lit(rng: Rng, made: Made) -> None:
    """A hand before the projector: 40 to 80 % of the board of one pose is dark."""
    name = some(rng, made)
    files = made.names_of(name)
    white, black = made.frames[files[-2]].astype(float), made.frames[files[-1]].astype(float)
    columns = np.indices(white.shape)[1]
    edge = np.quantile(columns[white > 40], rng.uniform(0.4, 0.8))
    shade = np.clip((columns - edge) / 3 + 0.5, 0, 1)
    for file in files[:-1]:
        lit = made.frames[file] - black
        made.frames[file] = np.clip(np.rint(black + lit * shade), 0, 255).astype(np.uint8)


def half_outside(rng: Rng, made: Made) -> None:
    """The board of one pose lies half outside the picture."""
    name = some(rng, made)
    capture = made.rig.capture_named(name)
    z = capture.position_mm[2]
    x = rng.choice([-1, 1]) * 0.5 * made.rig.camera.width_px / made.rig.camera.focal_px * z
    moved = capture.model_copy(update={"position_mm": (x, capture.position_mm[1], z)})
    rig = made.rig.model_copy(update={"capture": tuple(moved if c.name == name else c for c in made.rig.capture)})
    made.retaken(name, rig)


# --- faults of what is stated ----------------------------------------------------------------------------------------


def wrong_period(rng: Rng, made: Made) -> None:
    """One fringe more or less is stated than was shown, or half a fringe."""
    off = float(rng.choice([-1.0, 1.0, 0.5, 2.0]))
    for table in made.document["capture"]:
        table["fringes"] = [table["fringes"][0], table["fringes"][1] + off]


def swapped_axes(_: Rng, made: Made) -> None:
    """All captures state the axes the other way round."""
    for table in made.document["capture"]:
        table["axes"] = table["axes"][::-1]


def swapped_axes_once(rng: Rng, made: Made) -> None:
    """One pose was captured with the axes the other way round."""
    table = made.table(some(rng, made))
    half = len(table["images"]) // 2
    table["images"] = table["images"][half:] + table["images"][:half]


def other_order(rng: Rng, made: Made) -> None:
    """The frames of one pose stand in another order: two are exchanged, or all are drawn anew."""
    table = made.table(some(rng, made))
    images = list(table["images"])
    if rng.random() < 0.5:
        i, j = rng.choice(len(images), 2, replace=False)
        images[i], images[j] = images[j], images[i]
    else:
        images = [images[i] for i in rng.permutation(len(images))]
    table["images"] = images


def reversed_steps_once(rng: Rng, made: Made) -> None:
    """The phase shifts of one pose ran the other way round: its phase falls where the others' rises."""
    table = made.table(some(rng, made))
    n = len(made.document["phase"]["steps_deg"])
    groups = [table["images"][k : k + n] for k in range(0, len(table["images"]), n)]
    table["images"] = [file for group in groups for file in (group[0], *group[:0:-1])]


MISPLACED = "did the board move|disagree|moved|contradict"
RIG_FAULTS = {
    "stretched print": (stretched, "stretched print"),
    "poses alike": (alike, "too alike|largest angle between boards"),
    "poses few": (few, "too few"),
    "scaler": (scaled, "frame scaled"),
    "keystone": (keystoned, "frame scaled"),
    "falling phase": (falling, ""),
}
CAPTURE_FAULTS = {
    "clean": (nothing, ""),
    "camera focus": (camera_focus, "focus changed"),
    "projector focus": (projector_focus, "focus changed"),
    "turned pictures": (turned_pictures, "numbered otherwise|mirrored|turned"),
    "another's white": (others_white, MISPLACED),
    "moved board": (moved_board, MISPLACED),
    "moved camera": (moved_camera, MISPLACED),
    "glare": (glare, "saturated|glare"),
    "partly lit": (partly_lit, "not lit|lights too little|no board"),
    "half outside": (half_outside, "wholly in the picture"),
    "wrong period": (wrong_period, "period|fringes"),
    "swapped axes": (swapped_axes, "axes"),
    "swapped axes once": (swapped_axes_once, "axes|" + MISPLACED),
    "other order": (other_order, "order of|" + MISPLACED),
    "reversed steps once": (reversed_steps_once, "falls|reversed|" + MISPLACED),
}
FAULTS = {**CAPTURE_FAULTS, **RIG_FAULTS}


def remembering(measure: Callable[..., Any], first: Callable[..., Any]) -> Callable[..., Any]:
    """The same function, which measures nothing twice: a fault leaves most pictures as they are."""
    kept: dict[Any, Any] = {}

    def measured(*given: Any, **options: Any) -> Any:
        key = first(*given, **options)
        if key not in kept:
            if len(kept) > MOST_KEPT:
                kept.clear()
            kept[key] = measure(*given, **options)
        return kept[key]

    return measured


MOST_KEPT = 60  # results, a case's own


def phase_key(capture: Any, axis: str, *, like: Any = None, wave: Any = None, **options: Any) -> Any:
    """What the phase along an axis depends on."""
    paths = (*capture.paths, *capture.white_paths, *capture.black_paths)
    frames = [capture.name.encode(), *(path.read_bytes() for path in paths)]
    stated = [(one.name, one.periods_px, one.zeros_rad, one.falls) for one in capture.axes]
    zeros = None if like is None else (like.zeros_rad, like.falls)
    return hash((b"".join(frames), str(stated), axis, str(zeros), str(wave), str(options)))


def pose_key(name: str, image: np.ndarray, target: Any, raster: Any) -> Any:
    """What a pose's points depend on."""
    return hash((name, image.tobytes(), str(target), raster.px.tobytes(), raster.u_px.tobytes()))


board_run.raster_of_capture = remembering(board_run.raster_of_capture, phase_key)
board_run.posed_board = remembering(board_run.posed_board, pose_key)


def judged(made: Made) -> list[str]:
    """What `commission` says is wrong: a refusal, checks that do not pass, poses that it left aside or in part."""
    with tempfile.TemporaryDirectory() as root:
        folder = write_session(Path(root) / "session", made.document, made.frames, extra_files=made.files)
        try:
            found = commission_boards(load_session(folder))
        except FringecalError as error:
            return [f"refused: {error}"]
    checks = [one for one in board_checks(found) if one.decision not in ("pass", "info")]
    said = [f"{one.name}: {one.rule}" for one in checks]
    aside = [f"{one.name} aside: {one.reason}" for one in found.posed if one.reason]
    return [*said, *aside, *(f"note: {one.name}: {one.unread}" for one in found.used if one.unread)]


def one_case(fault: str, case: int, seed: int) -> list[str]:
    """Draw a rig, put a fault into it, and return what is said."""
    rng = np.random.default_rng([seed, case])
    rig = drawn_rig(rng)
    rng = np.random.default_rng([seed, case, list(FAULTS).index(fault)])
    change = FAULTS[fault][0]
    if fault in RIG_FAULTS:
        return judged(taken(change(rng, rig), case))
    made = cached(rig, seed, case)
    change(rng, made)
    return judged(made)


_KEPT: dict[tuple[int, int], Made] = {}


def cached(rig: RasterRigSpec, seed: int, case: int) -> Made:
    """The clean session of a case, rendered once."""
    if (seed, case) not in _KEPT:
        _KEPT.clear()
        _KEPT[seed, case] = taken(rig, case)
    kept = _KEPT[seed, case]
    tables = [{**one, "images": list(one["images"])} for one in kept.document["capture"]]
    return replace(kept, document={**kept.document, "capture": tables}, frames=dict(kept.frames))


def run(first: int, cases: int, seed: int, faults: Iterable[str], *, verbose: bool) -> None:
    tally = {fault: Counter[str]() for fault in faults}
    for case in range(first, first + cases):
        for fault, counts in tally.items():
            start = time.perf_counter()
            said, wanted = one_case(fault, case, seed), FAULTS[fault][1]
            hits = [one for one in said if wanted and re.search(wanted, one)]
            # A corner at the edge of the light has no coordinate in any session: to say so is no false name.
            others = [one for one in said if one not in hits and not one.startswith("note")]
            counts["named"] += bool(hits)
            counts["others"] += bool(others)
            if verbose:
                shown = " | ".join(text[:230] for text in (*hits, *("OTHER " + text for text in others)))
                print(f"  {case} {fault} ({time.perf_counter() - start:.0f} s): {shown or 'nothing'}", flush=True)
    for fault, counts in tally.items():
        print(f"{fault:20s} named {counts['named']}/{cases}, other names {counts['others']}/{cases}", flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cases", type=int, default=10)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--seed", type=int, default=2)
    parser.add_argument("--faults", nargs="*", default=tuple(FAULTS))
    parser.add_argument("--verbose", action="store_true")
    options = parser.parse_args()
    run(options.first, options.cases, options.seed, options.faults, verbose=options.verbose)


if __name__ == "__main__":
    main()
