"""Damaged files of every format, and senseless command lines: each is refused with one sentence that says where.

    python benchmarks/fuzz_readers.py [cases] [first seed] [--tally FILE] [--seconds 300]

Each case is drawn from its seed: a format (session, picture, phase map, target, rig, limits, laboratory, record,
camera model, its solve, calibrations of other programs, lists of places, tables as CSV and Parquet, a history's
database) whose good file is damaged in bytes, in numbers or in structure, or a command line of real verbs and options
with values that make no sense. A case is wrong where the command ends in a traceback, with another exit code than 0, 1,
2 or 3, by a signal, after more than SLOWEST_S, with more than MOST_MIB of memory above what the process had, or without
naming the file. Blocks of cases run in processes of their own; where one dies, the case that it died of is counted and
the block goes on behind it. It prints counts by kind and every wrong case with its seed.

With a tally, each block is noted in that file as soon as it is done, a line of JSON; the next call goes on where the
last has stopped, after so many seconds or by a signal, and the tally of all that was ever run is printed.
"""

import argparse
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
import zlib
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np

ROOT = Path(__file__).parents[1]
RIGS = ROOT / "src" / "fringecal" / "simulate" / "rigs"
ARCHIVE = ROOT / "tests" / "records" / "archive" / "0.1.0"
SLOWEST_S = 20  # of one case, on a machine that others use too: 4 MiB of TOML take 4 s
LONGEST = 4000  # characters of a refusal: a session's faults, one a line
BLOCK = 500  # cases in one process
MOST_MIB = 1024  # above what the process had: a small file unpacks to 1100 times its size at most, and is then copied
LONGEST_BLOCK_S = 1500  # after which a process hangs where no alarm of Python reaches it
CLEAR_PEAK = b"5"  # proc(5), clear_refs: the peak of the resident set begins anew

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
MAPS = """
[[capture]]
name = "surface"
kind = "object"
images = []
maps = [{ file = "phase.ENDING", name = "phi", axis = "u", fringes = 12.0, absolute = true }]
"""
TABLE = "rig,captured,quantity,value,u,unit\nbench,2026-11-22T10:00:00Z,scale,0.7340,0.0004,mm/px\n" * 1 + "".join(
    f"bench,2026-11-{day}T10:00:00Z,scale,0.734{day},0.0004,mm/px\n" for day in range(10, 20)
)


@dataclass(frozen=True)
class Outcome:
    """What one case came to: its kind, what was wrong (empty if nothing), its time and its memory."""

    kind: str
    wrong: str = ""
    refused: bool = False
    seconds: float = 0.0
    mib: float = 0.0


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


def _words(content: bytes, rng: random.Random) -> bytes:
    """Write sizes that no file has over one to four bytes: lengths, sides and offsets of a format."""
    place = rng.randrange(min(len(content), rng.choice((64, 512, 10**9))))
    value = rng.choice((0, 1, 0x7F, 0x80, 0xFF, 0xFFFF, 0x7FFFFFFF, 0x80000000, 0xFFFFFFFF, rng.randrange(2**32)))
    size = rng.choice((1, 2, 4))
    word = (value & (256**size - 1)).to_bytes(size, rng.choice(("little", "big")))
    return content[:place] + word + content[place + size :]


def damaged_bytes(content: bytes, rng: random.Random) -> bytes:
    """Damage a file that is no text; a PNG's checksums are made to fit again in half of the cases."""
    for _ in range(rng.choice((1, 1, 2, 4))):
        content = rng.choice((_flipped, _cut, _filled, _words, _words, _words))(content, rng) or b"x"
    return _summed(content) if content.startswith(b"\x89PNG") and rng.random() < 0.5 else content


def _summed(png: bytes) -> bytes:
    """Write the checksum of every chunk anew, as far as chunks can be followed."""
    place, made = 8, png[:8]
    while place + 12 <= len(png):
        end = place + 8 + int.from_bytes(png[place : place + 4], "big")
        made += png[place:end] + zlib.crc32(png[place + 4 : end]).to_bytes(4, "big")
        place = end + 4
    return made + png[place:]


def pictures() -> dict[str, bytes]:
    """Return a picture in every format that is read, grey and colour, 8 and 16 bit."""
    grey = np.random.default_rng(0).integers(20, 200, (12, 16), np.uint8)
    colour, deep = np.stack([grey, grey // 2, 255 - grey], axis=-1), grey.astype(np.uint16) * 200
    made = {f"g{ending}": cv2.imencode(ending, grey)[1].tobytes() for ending in (".png", ".jpg", ".bmp", ".tif")}
    made |= {f"c{ending}": cv2.imencode(ending, colour)[1].tobytes() for ending in (".png", ".jpg", ".bmp", ".tif")}
    made |= {f"d{ending}": cv2.imencode(ending, deep)[1].tobytes() for ending in (".png", ".tif")}
    progressive = cv2.imencode(".jpg", colour, [cv2.IMWRITE_JPEG_PROGRESSIVE, 1])[1].tobytes()
    codes = {"none": 1, "lzw": 5, "deflate": 8, "packed": 32773}
    tiffs = {
        f"{name}.tif": cv2.imencode(".tif", deep, [cv2.IMWRITE_TIFF_COMPRESSION, code])[1].tobytes()
        for name, code in codes.items()
    }
    return made | tiffs | {"p.jpg": progressive}


def arrays() -> dict[str, bytes]:
    """Return a phase map in every format that is read."""
    from scipy.io import savemat

    phase = 2 * np.pi * 12 * np.linspace(20, 160, 16)[None, :] / 192 + np.zeros((12, 1))
    made = {}
    for ending, save in (("npy", np.save), ("npz", lambda file, phi: np.savez_compressed(file, phi=phi))):
        packed = io.BytesIO()
        save(packed, phase)
        made[ending] = packed.getvalue()
    for name, squeezed in (("mat", False), ("Mat", True)):
        packed = io.BytesIO()
        savemat(packed, {"phi": phase}, do_compression=squeezed)
        made[name] = packed.getvalue()
    return made


def tables_of(folder: Path) -> tuple[bytes, bytes]:
    """Return a history as Parquet and as its database."""
    (folder / "good.csv").write_text(TABLE, encoding="utf-8")
    command(["history", "import", str(folder / "good.csv"), "--db", str(folder / "good.db")], "")
    command(["history", "export", str(folder / "good.parquet"), "--db", str(folder / "good.db")], "")
    return (folder / "good.parquet").read_bytes(), (folder / "good.db").read_bytes()


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
        self.pictures, self.arrays = pictures(), arrays()
        self.parquet, self.database = tables_of(folder)
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
            "table as Parquet": self._parquet,
            "history's database": self._database,
            "picture": self._picture,
            "session's picture": self._picture_of_session,
            "session's phase map": self._map_of_session,
            "command line": self._line,
        }

    def _restore(self) -> None:
        for name, content in (("session.toml", SESSION), ("lens.cameramodel", LENS), ("grid.toml", self.grid.decode())):
            (self.session / name).write_text(content, encoding="utf-8")

    def run(self, seed: int) -> Outcome:
        """Run one case, and see what it took."""
        rng = random.Random(seed)
        kind = rng.choice(tuple(self.kinds))
        before, began = _memory_mib(anew=True), time.monotonic()
        outcome = self._outcome(kind, rng)
        taken, mib = time.monotonic() - began, _memory_mib() - before
        if mib > MOST_MIB and not outcome.wrong:
            outcome = replace(outcome, wrong=f"{mib:.0f} MiB of memory")
        return replace(outcome, seconds=taken, mib=mib)

    def _outcome(self, kind: str, rng: random.Random) -> Outcome:
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

    def _parquet(self, rng: random.Random) -> None:
        file = self._written("t.parquet", damaged_bytes(self.parquet, rng))
        with tempfile.TemporaryDirectory(dir=self.folder) as folder:
            command(["history", "import", file, "--db", f"{folder}/h.db"], "t.parquet")

    def _database(self, rng: random.Random) -> None:
        with tempfile.TemporaryDirectory(dir=self.folder) as folder:
            file = Path(folder) / "h.db"
            file.write_bytes(damaged_bytes(self.database, rng))
            verb = rng.choice((["show"], ["export", f"{folder}/t.csv"]))
            command(["history", *verb, "--db", str(file)], "h.db")

    def _picture(self, rng: random.Random) -> None:
        from fringecal.cli.shared.pictures import read_picture

        name = rng.choice(sorted(self.pictures))
        reader(
            lambda path: read_picture(Path(path)), self._written(name, damaged_bytes(self.pictures[name], rng)), name
        )

    def _picture_of_session(self, rng: random.Random) -> None:
        name = rng.choice(sorted(self.pictures))
        good = (self.session / "grid.png").read_bytes()
        try:
            (self.session / "grid.png").write_bytes(damaged_bytes(self.pictures[name], rng))
            self._check()
        finally:
            (self.session / "grid.png").write_bytes(good)

    def _map_of_session(self, rng: random.Random) -> None:
        ending = rng.choice(sorted(self.arrays))
        (self.session / f"phase.{ending}").write_bytes(damaged_bytes(self.arrays[ending], rng))
        text = SESSION.replace("[phase]", "resolution_px = [192, 96]\n\n[phase]") + MAPS.replace("ENDING", ending)
        text = text.replace(', name = "phi"', "") if ending == "npy" else text
        (self.session / "session.toml").write_text(text, encoding="utf-8")
        self._check()

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


def _memory_mib(*, anew: bool = False) -> float:
    """Return the peak of this process's memory; with `anew` it begins at what the process has now. Linux only."""
    try:
        if anew:
            Path("/proc/self/clear_refs").write_bytes(CLEAR_PEAK)
        found = Path("/proc/self/status").read_text(encoding="ascii")
    except OSError:
        return 0.0
    return int(re.search(r"VmHWM:\s+(\d+) kB", found)[1]) / 1024


def run_block(seeds: range) -> list[tuple[int, Outcome]]:
    """Run cases; return their outcomes."""
    return list(outcomes_of(seeds))


def outcomes_of(seeds: range) -> Iterator[tuple[int, Outcome]]:
    """Run cases in a folder of their own, as the working directory, since senseless names are relative to it."""
    _load_everything()
    here = Path.cwd()
    with tempfile.TemporaryDirectory() as folder:
        bench = Bench(Path(folder))
        os.chdir(bench.session)
        try:
            for seed in seeds:
                yield seed, bench.run(seed)
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


type Note = dict[str, Any]


def block_of(start: int, stop: int) -> Iterator[Note]:
    """Run a block in processes of its own; a case that a process dies of is wrong, and the block goes on behind it."""
    while start < stop:
        arguments = [sys.executable, __file__, "block", str(start), str(stop)]
        try:
            done = subprocess.run(arguments, capture_output=True, text=True, timeout=LONGEST_BLOCK_S)
            printed, ended, said = done.stdout, f"ended with {done.returncode}", done.stderr
        except subprocess.TimeoutExpired as slow:
            printed, ended, said = (slow.stdout or b"").decode(), "hangs", (slow.stderr or b"").decode()
        rows = [json.loads(line) for line in printed.splitlines() if line.startswith("{")]
        yield from rows
        start += len(rows)
        if start < stop:
            wrong = f"the process {ended}: {said[-500:]}"
            yield {"seed": start, "kind": "end of a process", "wrong": wrong, "refused": False, "seconds": 0, "mib": 0}
            start += 1


def noted(start: int, stop: int) -> Note:
    """Run a block and return what a tally keeps of it."""
    note: Note = {"start": start, "stop": stop, "kinds": {}, "wrong": [], "seconds": [0.0, -1], "mib": [0.0, -1]}
    for row in block_of(start, stop):
        counts = note["kinds"].setdefault(row["kind"], [0, 0])
        counts[0], counts[1] = counts[0] + 1, counts[1] + row["refused"]
        for size in ("seconds", "mib"):
            note[size] = max(note[size], [round(row[size], 1), row["seed"]])
        if row["wrong"]:
            note["wrong"].append(f"seed {row['seed']}, {row['kind']}: {row['wrong']}")
    return note


def print_tally(notes: list[Note]) -> int:
    """Print counts by kind, every wrong case, and the slowest and largest; return how many were wrong."""
    counts, refused = Counter[str](), Counter[str]()
    wrong = [words for note in notes for words in note["wrong"]]
    for note in notes:
        for kind, (cases, so_many) in note["kinds"].items():
            counts[kind] += cases
            refused[kind] += so_many
    for kind, count in sorted(counts.items()):
        print(f"{kind:24s} {count:6d} cases, {refused[kind]:6d} refused")
    print(*wrong, sep="\n")
    for size, words in (("seconds", "s at most"), ("mib", "MiB at most above what the process had")):
        most, seed = max((note[size] for note in notes), default=[0.0, -1])
        print(f"{most} {words}, seed {seed}")
    print(f"{counts.total()} cases, {len(wrong)} wrong")
    return len(wrong)


def main(cases: int, first: int, tally: Path | None, seconds: float) -> int:
    """Run the blocks that a tally lacks, one after the other, for so long; print what came of all."""
    began = time.monotonic()
    lines = tally.read_text(encoding="utf-8").splitlines() if tally is not None and tally.exists() else []
    notes = [json.loads(line) for line in lines]
    done = {note["start"] for note in notes}
    for start in range(first, first + cases, BLOCK):
        if start in done or time.monotonic() - began > seconds:
            continue
        notes.append(noted(start, min(start + BLOCK, first + cases)))
        if tally is not None:
            with tally.open("a", encoding="utf-8") as file:
                file.write(json.dumps(notes[-1]) + "\n")
    return min(1, print_tally(notes))


def print_block(start: int, stop: int) -> None:
    """Print the outcomes of one block as they come, a line of JSON each."""
    for seed, outcome in outcomes_of(range(start, stop)):
        print(json.dumps({"seed": seed} | asdict(outcome)), flush=True)


if __name__ == "__main__":
    if sys.argv[1:2] == ["block"]:
        print_block(int(sys.argv[2]), int(sys.argv[3]))
    else:
        parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
        parser.add_argument("cases", type=int, nargs="?", default=10_000)
        parser.add_argument("first", type=int, nargs="?", default=0)
        parser.add_argument("--tally", type=Path, default=None)
        parser.add_argument("--seconds", type=float, default=float("inf"))
        chosen = parser.parse_args()
        sys.exit(main(chosen.cases, chosen.first, chosen.tally, chosen.seconds))
