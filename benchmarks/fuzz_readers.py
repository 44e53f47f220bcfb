"""Damaged files of every format, and senseless command lines: each is refused with one sentence that says where.

    python benchmarks/fuzz_readers.py [cases] [first seed]

Each case is drawn from its seed: a format (session, target, rig, limits, laboratory, record, camera model, its solve,
calibrations of other programs, lists of places, table) whose good file is damaged in bytes, in numbers or in structure,
or a command line of real verbs and options with values that make no sense. A case is wrong where the command ends in a
traceback, with another exit code than 0, 1, 2 or 3, by a signal, after more than SLOWEST_S, or without naming the file.
Blocks of cases run in processes of their own, so that a crash of the interpreter costs one block and is counted. It
prints counts by kind and every wrong case with its seed.
"""

import base64
import contextlib
import importlib
import io
import json
import os
import random
import re
import signal
import subprocess
import sys
import tempfile
import time
import traceback
import warnings
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

ROOT = Path(__file__).parents[1]
RIGS = ROOT / "src" / "fringecal" / "simulate" / "rigs"
ARCHIVE = ROOT / "tests" / "records" / "archive" / "0.1.0"
SLOWEST_S = 20  # of one case, on a machine that others use too: 4 MiB of TOML take 4 s
LONGEST = 4000  # characters of a refusal: a session's faults, one a line
BLOCK = 500  # cases in one process

NUMBERS = ("0", "-1", "-0.0", "1e999", "-1e308", "nan", "inf", "1e-320", "9" * 30, "9" * 5000, str(2**63), "0x10", "01")
TEXTS = (
    "",
    " ",
    "a" * 300,
    "../../x",
    "/etc/passwd",
    "x\\u0000y",
    "\\ud800",
    "*",
    "**",
    "[",
    "%s{0}",
    "\\n",
    ".",
    "..",
)
DEEP = ("[" * 5000, "{" * 5000, "[" * 40 + "]" * 40, '{"a":' * 2000, "(" * 300)
VALUES = (None, True, [], {}, [[]], [1, [2]], 10**30, -(10**17), -1, 0, 1e308, 1e-308, "", "a" * 300, "\0", [1e308] * 3)

SESSION = """format = 1
rig = "bench-1"
captured = 2026-11-22T10:00:00Z
temperature_degC = 21.5

[camera]
model = "lens.cameramodel"
bits = 8

[projector]
position_mm = { value = [0.7, 1216.13, 996.92], u = [3.0, 3.0, 3.0] }

[phase]
steps_deg = [0.0, 120.0, 240.0]

[[capture]]
name = "grid"
kind = "grid"
target = "grid.toml"
images = ["grid.png"]

[[capture]]
name = "plate"
kind = "reference"
images = ["plate-*.png"]
"""
LENS = """{
    'lensmodel':  'LENSMODEL_OPENCV5',
    'intrinsics': [ 800, 801, 321, 238, -0.1, 0.02, 0.001, -0.002, 0.01 ],
    'extrinsics': [ 0, 0, 0, 0, 0, 0 ],
    'lens_covariance': [
COVARIANCE    ],
    'imagersize': [ 640, 480 ]
}
""".replace("COVARIANCE", "".join(f"        {[float(i == j) * 1e-6 for j in range(9)]},\n" for i in range(9)))
YAML = """%YAML:1.0
---
image_width: 640
image_height: 480
camera_matrix: !!opencv-matrix
   rows: 3
   cols: 3
   dt: d
   data: [ 800, 0, 321, 0, 801, 238, 0, 0, 1 ]
distortion_coefficients: !!opencv-matrix
   rows: 5
   cols: 1
   dt: d
   data: [ -0.1, 0.02, 0.001, -0.002, 0.01 ]
"""


def solved_model() -> tuple[str, dict[str, object]] | None:
    """Return a camera model that keeps its solve, as mrcal writes it, and that solve; None where mrcal is missing."""
    try:
        import mrcal
    except ImportError:
        return None
    rng = np.random.default_rng(0)
    board = np.full((4, 5, 6, 3), 1.0)
    board[..., :2] = rng.uniform(50, 400, (4, 5, 6, 2))
    numbers = np.arange(4, dtype=np.int32)
    inputs = {
        "lensmodel": "LENSMODEL_OPENCV5",
        "intrinsics": np.array([[800.0, 801, 321, 238, -0.1, 0.02, 0.001, -0.002, 0.01]]),
        "imagersizes": np.array([[640, 480]], dtype=np.int32),
        "rt_cam_ref": np.zeros((0, 6)),
        "rt_ref_frame": rng.uniform(-0.3, 0.3, (4, 6)) + [0, 0, 0, 0, 0, 1],
        "points": None,
        "observations_board": board,
        "indices_frame_camintrinsics_camextrinsics": np.stack([numbers, 0 * numbers, 0 * numbers - 1], axis=1),
        "observations_point": None,
        "indices_point_camintrinsics_camextrinsics": None,
        "calibration_object_spacing": 0.02,
        "calobject_warp": np.zeros(2),
        **dict.fromkeys(("do_optimize_intrinsics_core", "do_optimize_intrinsics_distortions"), True),
        **dict.fromkeys(("do_optimize_extrinsics", "do_apply_outlier_rejection", "do_apply_regularization"), False),
        **dict.fromkeys(("do_optimize_frames", "do_optimize_calobject_warp"), True),
    }
    with tempfile.TemporaryDirectory() as folder:
        mrcal.cameramodel(optimization_inputs=dict(inputs), icam_intrinsics=0).write(f"{folder}/l.cameramodel")
        return Path(f"{folder}/l.cameramodel").read_text(encoding="utf-8"), inputs


def stated_pairs() -> dict[str, bytes]:
    """Return a camera and a projector in every format that is written."""
    from fringecal.camera import Lens
    from fringecal.projector import StatedPair
    from fringecal.records import write_pair

    values = np.array([800.0, 801, 321, 238, -0.1, 0.02, 0.001, -0.002, 0.01])
    lens = Lens(values, np.eye(9) * 1e-6, 640, 480)
    with tempfile.TemporaryDirectory() as folder:
        files = write_pair(folder, StatedPair(lens, lens, np.eye(3), np.array([-100.0, 1.0, 2.0])))
        return {file.name: file.read_bytes() for file in files}


def damaged_solve(text: str, inputs: dict[str, object], rng: random.Random) -> bytes:
    """Damage the arrays of a camera model's solve: away, of another shape or kind, or with senseless numbers."""
    changed = dict(inputs)
    for name in rng.sample(sorted(changed), rng.choice((1, 1, 2, 4))):
        value = np.asarray("" if changed[name] is None else changed[name])
        match rng.randrange(5):
            case 0:
                del changed[name]
                continue
            case 1 if value.ndim:
                value = value[rng.randint(0, len(value)) :]
            case 2 if value.size > 1 and value.dtype.kind in "if":
                value = value.copy()
                value.flat[rng.randrange(value.size)] = rng.choice((-1, 10**9, -(10**9), 7))
            case 3 if value.dtype.kind in "ifb":
                value = value.astype(rng.choice(("<f4", "<i8", "<U5", "|b1")))
            case _:
                value = np.full(
                    rng.choice(((), (0,), (3,), (2, 6), (1, 2, 3, 3))), rng.choice((1.5, np.nan, np.inf, -1))
                )
        changed[name] = value
    packed = io.BytesIO()
    np.savez_compressed(packed, **{name: "" if value is None else value for name, value in changed.items()})
    encoded = base64.b85encode(packed.getvalue()).decode()
    return re.sub(r"b'[^']*'", lambda _: f"b'{encoded}'", text).encode()


LIMITS = "format = 1\nlevel = 0.9\n[commission]\nangle_u_deg = 0.4\n[audit]\nscale_percent = 0.2\n"
PLACES = "pose,camera_u_px,camera_v_px,projector_u_px,projector_v_px,x_mm,y_mm\n" + "".join(
    f"{k // 4},{10 * k},{20 * k},{30 * k},{40 * k},{5 * k},0\n" for k in range(12)
)
TABLE = "rig,captured,quantity,value,u,unit\nbench,2026-11-22T10:00:00Z,scale,0.7340,0.0004,mm/px\n" * 1 + "".join(
    f"bench,2026-11-{day}T10:00:00Z,scale,0.734{day},0.0004,mm/px\n" for day in range(10, 20)
)


@dataclass(frozen=True)
class Outcome:
    """What one case came to: its kind, and what was wrong (empty if nothing)."""

    kind: str
    wrong: str = ""
    refused: bool = False


class TooSlow(BaseException):
    """A case took longer than it may; no handler of the toolkit catches it."""


def damaged(text: bytes, rng: random.Random) -> bytes:
    """Damage a text in one to four places: its bytes, its numbers and texts, or its lines."""
    for _ in range(rng.choice((1, 1, 2, 4))):
        text = rng.choice((_flipped, _cut, _filled, _number, _quoted, _line, _nested, _twice))(text, rng)
    return text


def _flipped(text: bytes, rng: random.Random) -> bytes:
    changed = bytearray(text or b"x")
    for _ in range(rng.randint(1, 8)):
        changed[rng.randrange(len(changed))] = rng.randrange(256)
    return bytes(changed)


def _cut(text: bytes, rng: random.Random) -> bytes:
    a, b = sorted((rng.randrange(len(text) + 1), rng.randrange(len(text) + 1)))
    return text[:a] if rng.random() < 0.5 else text[:a] + text[b:]


def _filled(text: bytes, rng: random.Random) -> bytes:
    place = rng.randrange(len(text) + 1)
    more = rng.choice(
        (b"\0", b"\xff\xfe", b"\xef\xbb\xbf", "µ".encode(), b"'", b'"""', b"#", b"\\", b"\r", b",", b"\n")
    )
    return text[:place] + more * rng.choice((1, 1, 3, 1000)) + text[place:]


def _number(text: bytes, rng: random.Random) -> bytes:
    return _replaced(text, rb"-?\d+(?:\.\d+)?(?:[eE][-+]?\d+)?", rng.choice(NUMBERS).encode(), rng)


def _quoted(text: bytes, rng: random.Random) -> bytes:
    return _replaced(text, rb"(?<=[\"'])[^\"'\n]*(?=[\"'])", rng.choice(TEXTS).encode(), rng)


def _replaced(text: bytes, pattern: bytes, value: bytes, rng: random.Random) -> bytes:
    places = list(re.finditer(pattern, text[:200_000]))
    if not places:
        return text + value
    found = rng.choice(places)
    return text[: found.start()] + value + text[found.end() :]


def _line(text: bytes, rng: random.Random) -> bytes:
    lines = text.split(b"\n")
    rng.shuffle(lines) if rng.random() < 0.3 else lines.pop(rng.randrange(len(lines)))
    return b"\n".join(lines)


def _twice(text: bytes, rng: random.Random) -> bytes:
    lines = text.split(b"\n")
    one = rng.randrange(len(lines))
    return b"\n".join([*lines[:one], *lines[one : one + 3], *lines[one:]])


def _nested(text: bytes, rng: random.Random) -> bytes:
    return _replaced(text, rb"\d+(?:\.\d+)?", rng.choice(DEEP).encode(), rng)


def damaged_document(text: str, rng: random.Random) -> bytes:
    """Damage a JSON document in its structure: values of another kind, ragged lists, keys away or renamed."""
    document = json.loads(text)
    for _ in range(rng.choice((1, 1, 2, 5))):
        place = document
        for _ in range(rng.randint(0, 6)):
            inside = [
                v for v in (place.values() if isinstance(place, dict) else place) if isinstance(v, dict | list) and v
            ]
            if not inside:
                break
            place = rng.choice(inside)
        key = rng.choice(list(place)) if isinstance(place, dict) else rng.randrange(len(place))
        match rng.randrange(5):
            case 0 if isinstance(place, dict):
                place[f"{key}x" * rng.choice((1, 200))] = place.pop(key)
            case 1:
                del place[key]
            case 2 if isinstance(place[key], int | float) and not isinstance(place[key], bool):
                place[key] = -place[key] * rng.choice((1, 1e10, 1e300))
            case _:
                place[key] = rng.choice(VALUES)
        if not place:
            break
    return json.dumps(document).encode()


class Bench:
    """A folder with one good file of each format, and one reader for each kind of case."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.session = folder / "session"
        self.session.mkdir()
        rng = np.random.default_rng(0)
        for name in ("grid", "plate-0", "plate-1", "plate-2"):
            cv2.imwrite(str(self.session / f"{name}.png"), rng.integers(20, 200, (12, 16), np.uint8))
        self.grid = (ROOT / "targets" / "grid-10mm.toml").read_bytes()
        self.record = (ARCHIVE / "calibration.json").read_text(encoding="utf-8")
        self.targets = [file.read_bytes() for file in sorted((ROOT / "targets").glob("*.toml"))]
        self.rigs = [file.read_bytes() for file in sorted(RIGS.glob("*.toml"))]
        self.solve = solved_model()
        self.pairs = stated_pairs()
        (folder / "stereo.yml").write_bytes(self.pairs["stereo.yml"])
        self._restore()
        self.kinds: dict[str, Callable[[random.Random], None]] = {
            "session": self._session,
            "session's target": self._target_of_session,
            "session's camera model": self._model_of_session,
            "target": self._target,
            "rig": self._rig,
            "limits": self._limits,
            "laboratory": self._laboratory,
            "record": self._record,
            "record again": self._again,
            "camera model": self._lens,
            "camera model's solve": self._solve,
            "stated pair": self._pair,
            "given places": self._places,
            "table": self._table,
            "command line": self._line,
        }

    def _restore(self) -> None:
        for name, content in (("session.toml", SESSION), ("lens.cameramodel", LENS), ("grid.toml", self.grid.decode())):
            (self.session / name).write_text(content, encoding="utf-8")

    def run(self, seed: int) -> Outcome:
        """Run one case."""
        rng = random.Random(seed)
        kind = rng.choice(tuple(self.kinds))
        try:
            with within(SLOWEST_S), warnings.catch_warnings():
                warnings.simplefilter("ignore")
                self.kinds[kind](rng)
        except Refused:
            return Outcome(kind, refused=True)
        except TooSlow:
            return Outcome(kind, f"more than {SLOWEST_S} s")
        except Wrong as error:
            return Outcome(kind, str(error))
        except Exception:  # what a user would see as a traceback
            return Outcome(kind, traceback.format_exc(limit=-4).strip())
        return Outcome(kind)

    def _session(self, rng: random.Random) -> None:
        (self.session / "session.toml").write_bytes(damaged(SESSION.encode(), rng))
        self._check()

    def _target_of_session(self, rng: random.Random) -> None:
        (self.session / "grid.toml").write_bytes(damaged(self.grid, rng))
        self._check()

    def _model_of_session(self, rng: random.Random) -> None:
        (self.session / "lens.cameramodel").write_bytes(damaged(rng.choice((LENS, YAML)).encode(), rng))
        self._check()

    def _check(self) -> None:
        try:
            command(["check", str(self.session)], "session")
        finally:
            self._restore()

    def _target(self, rng: random.Random) -> None:
        command(["targets", "show", self._written("t.toml", damaged(rng.choice(self.targets), rng))], "t.toml")

    def _rig(self, rng: random.Random) -> None:
        from fringecal.simulate import load_rig

        reader(load_rig, self._written("rig.toml", damaged(rng.choice(self.rigs), rng)), "rig.toml")

    def _limits(self, rng: random.Random) -> None:
        from fringecal.records import limits_for

        content = damaged(LIMITS.encode(), rng)
        reader(lambda path: limits_for(".", path), self._written("limits.toml", content), "limits.toml")

    def _laboratory(self, rng: random.Random) -> None:
        from fringecal.records import lab_template, read_laboratory

        content = re.sub(rb'= ""', b'= "x"', lab_template().encode())
        reader(read_laboratory, self._written("lab.toml", damaged(content, rng)), "lab.toml")

    def _damaged_record(self, rng: random.Random) -> str:
        structure = rng.random() < 0.7
        content = damaged_document(self.record, rng) if structure else damaged(self.record.encode(), rng)
        return self._written("calibration.json", content)

    def _record(self, rng: random.Random) -> None:
        from fringecal.records import read_calibration
        from fringecal.workflows.shared import calibration_of

        reader(lambda path: calibration_of(read_calibration(path)), self._damaged_record(rng), "")

    def _again(self, rng: random.Random) -> None:
        command(["rerun", self._damaged_record(rng), "--session", str(self.folder / "nowhere")], "")

    def _lens(self, rng: random.Random) -> None:
        from fringecal.records import read_lens

        content, name = rng.choice(((LENS, "l.cameramodel"), (YAML, "l.yml")))
        reader(read_lens, self._written(name, damaged(content.encode(), rng)), name)

    def _solve(self, rng: random.Random) -> None:
        from fringecal.records import read_lens

        if self.solve is None:
            raise Refused
        text, inputs = self.solve
        content = damaged_solve(text, inputs, rng) if rng.random() < 0.7 else damaged(text.encode(), rng)
        reader(read_lens, self._written("s.cameramodel", content), "s.cameramodel")

    def _pair(self, rng: random.Random) -> None:
        from fringecal.records import read_stated

        name = rng.choice(sorted(self.pairs))
        both = {"camera.cameramodel": "projector.cameramodel", "camera.yaml": "projector.yaml"}
        self._written(name, damaged(self.pairs[name], rng))
        names = [name]
        if name in both:
            self._written(both[name], self.pairs[both[name]])
            names.append(both[name])
        size = (1920, 1080)
        reader(
            lambda _: read_stated([self.folder / each for each in names], camera_size=size, projector_size=size),
            "",
            name,
        )

    def _places(self, rng: random.Random) -> None:
        from fringecal.records import read_point_pairs

        if rng.random() < 0.5:
            content, name = damaged(PLACES.encode(), rng), "places.csv"
        else:
            packed = io.BytesIO()
            places = np.zeros(rng.choice(((2, 5, 2), (5, 2), (2, 5, 3), (0, 5, 2), (2,))))
            np.savez_compressed(packed, camera_px=places, projector_px=places, board_mm=np.zeros((5, 3)))
            content, name = packed.getvalue(), "places.npz"
            content = damaged(content, rng) if rng.random() < 0.7 else content
        reader(read_point_pairs, self._written(name, content), name)

    def _table(self, rng: random.Random) -> None:
        file = self._written("t.csv", damaged(TABLE.encode(), rng))
        with tempfile.TemporaryDirectory(dir=self.folder) as folder:
            command(["history", "import", file, "--db", f"{folder}/h.db"], "")

    def _line(self, rng: random.Random) -> None:
        command(senseless(self.folder, rng), "", codes=(0, 1, 2, 3))

    def _written(self, name: str, content: bytes) -> str:
        (self.folder / name).write_bytes(content)
        return str(self.folder / name)


class Refused(Exception):
    """The case was refused as it should be."""


class Wrong(Exception):
    """The case ended as none may."""


def reader(read: Callable[[str], object], path: str, name: str) -> None:
    """Call a reader; what it refuses names the file, in so many characters at most."""
    from fringecal.errors import FringecalError

    try:
        read(path)
    except FringecalError as error:
        demand_sentence(str(error), name)
        raise Refused from error


def command(arguments: list[str], name: str, codes: tuple[int, ...] = (0, 1, 3)) -> None:
    """Run the command in this process; it ends with one of the codes, and refuses with a sentence."""
    from fringecal.cli.app import main

    said, printed = io.StringIO(), io.StringIO()
    try:
        with contextlib.redirect_stderr(said), contextlib.redirect_stdout(printed):
            main(arguments)
        code: object = 0
    except SystemExit as stop:
        code = 0 if stop.code is None else stop.code
    if code not in codes:
        raise Wrong(f"exit code {code!r}: {said.getvalue()[-300:]}")
    if code in (1, 2):
        # With --json what is wrong stands in the document.
        words = said.getvalue() or (printed.getvalue()[:LONGEST] if "--json" in arguments else "")
        demand_sentence(words, name if code == 1 else "")
        raise Refused


def demand_sentence(text: str, name: str) -> None:
    """Demand words, not too many, that say where."""
    if not text.strip() or len(text) > LONGEST or name not in text or "Traceback" in text:
        raise Wrong(f"a refusal of {len(text)} characters that names {name!r} was needed: {text[:300]!r}")


def senseless(folder: Path, rng: random.Random) -> list[str]:
    """Draw a command line: a real verb, real options, values that make no sense for them."""
    verb, options, places = rng.choice(VERBS)
    values = ["", "nan", "-1", "inf", "1e999", "9" * 400, "x" * 300, "a\0b", "\udcff", "\x1b[2J", ".", "/", "/dev/null"]
    files = ("nowhere", "session", "t.toml", "calibration.json", "session/grid.png", "stereo.yml")
    values += [str(folder / name) for name in files]
    values += [f"{folder}/{'d' * 300}", f"{folder}/session/session.toml/x", "/proc/self/mem", "/nowhere/\udce4"]
    line = [*verb.split(), *(rng.choice(values) for _ in range(rng.choice((places, places, rng.randint(0, 3)))))]
    for option in rng.sample(options, rng.randint(0, min(3, len(options)))):
        line += [option, rng.choice(values)] if rng.random() < 0.9 else [option]
    return [*line, "--out", str(folder / "out")] if "--out" in options and rng.random() < 0.5 else line


VERBS: tuple[tuple[str, list[str], int], ...] = (
    ("check", ["--json"], 1),
    ("targets show", ["--json"], 1),
    ("targets print", ["--out", "--page", "--margin-mm"], 1),
    ("grid", ["--target", "--pattern", "--centre", "--out", "--channel", "--polarity", "--json"], 1),
    ("phase", ["--steps-deg", "--periods", "--out", "--bits", "--channel", "--capture"], 1),
    ("lens", ["--target", "--out", "--channel", "--solver", "--model"], 1),
    ("lens", ["--camera-size", "--projector-size", "--unit", "--pixel-aspect", "--pairs", "--out", "--json"], 2),
    ("patterns", ["--projector", "--out", "--bits", "--axis", "--period", "--gray", "--response", "--noise-rad"], 0),
    ("angle", ["--out", "--limits"], 1),
    ("commission", ["--out", "--limits", "--db", "--calibration"], 1),
    ("verify", ["--calibration", "--out", "--limits", "--db"], 2),
    ("audit", ["--calibration", "--out", "--limits", "--db"], 1),
    ("reconstruct", ["--calibration", "--out", "--limits", "--lowest-mm", "--highest-mm", "--also"], 2),
    ("rerun", ["--session", "--calibration", "--json"], 1),
    ("certificate", ["--lab", "--out", "--verification"], 1),
    ("history add", ["--db"], 1),
    ("history show", ["--db", "--rig", "--since"], 0),
    ("history chart", ["--db", "--rig", "--quantity", "--out"], 0),
    ("history export", ["--db", "--rig"], 1),
    ("procedure run", ["--session", "--calibration"], 1),
    ("procedure show", [], 1),
    ("nonsense", ["--out"], 1),
)


@contextlib.contextmanager
def within(seconds: int) -> Iterator[None]:
    """Break a case off after so long; only where the system has alarms."""

    def stop(*_: object) -> None:
        raise TooSlow

    before = signal.signal(signal.SIGALRM, stop)
    signal.alarm(seconds)
    try:
        yield
    finally:
        signal.alarm(0)
        signal.signal(signal.SIGALRM, before)


def run_block(seeds: range) -> list[tuple[int, Outcome]]:
    """Run cases in a folder of their own, as the working directory, since senseless names are relative to it."""
    _load_everything()
    here = Path.cwd()
    with tempfile.TemporaryDirectory() as folder:
        bench = Bench(Path(folder))
        os.chdir(bench.session)
        try:
            return [(seed, bench.run(seed)) for seed in seeds]
        finally:
            os.chdir(here)


def _load_everything() -> None:
    """Load what any case needs, so that none is charged for it, and none broken off in it."""
    from fringecal.cli.app import build_app
    from fringecal.workflows import shared

    build_app()
    for name in ("fringecal.history", "fringecal.records", "fringecal.report", "fringecal.workflows.rerun"):
        face = importlib.import_module(name)
        for word in face.__all__:
            getattr(face, word)
    assert shared.calibration_of


def main(cases: int = 10_000, first: int = 0) -> int:
    """Run blocks of cases one after the other, each in a process of its own, and print what came of them."""
    began, counts, refused, wrong = time.monotonic(), Counter[str](), Counter[str](), []
    for start in range(first, first + cases, BLOCK):
        stop = min(start + BLOCK, first + cases)
        done = subprocess.run(
            [sys.executable, __file__, "block", str(start), str(stop)], capture_output=True, text=True
        )
        rows = [json.loads(line) for line in done.stdout.splitlines() if line.startswith("{")]
        if done.returncode:
            wrong.append(f"seeds {start} to {stop}: the process ended with {done.returncode}: {done.stderr[-500:]}")
        for row in rows:
            counts[row["kind"]] += 1
            refused[row["kind"]] += row["refused"]
            if row["wrong"]:
                wrong.append(f"seed {row['seed']}, {row['kind']}: {row['wrong']}")
    for kind, count in sorted(counts.items()):
        print(f"{kind:24s} {count:6d} cases, {refused[kind]:6d} refused")
    print(*wrong, sep="\n")
    print(f"{counts.total()} cases in {time.monotonic() - began:.0f} s, {len(wrong)} wrong")
    return min(1, len(wrong))


def print_block(start: int, stop: int) -> None:
    """Print the outcomes of one block, a line of JSON each."""
    for seed, outcome in run_block(range(start, stop)):
        print(json.dumps({"seed": seed, "kind": outcome.kind, "wrong": outcome.wrong, "refused": outcome.refused}))


if __name__ == "__main__":
    if sys.argv[1:2] == ["block"]:
        print_block(int(sys.argv[2]), int(sys.argv[3]))
    else:
        sys.exit(main(*map(int, sys.argv[1:3])))
