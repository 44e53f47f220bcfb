"""Golden results: the command's verbs on fixed sessions, kept, and compared number by number with today's.

    python benchmarks/golden.py make DIR        run every case, results into DIR
    python benchmarks/golden.py compare A B     hold every number of A's records, tables and maps against B's

The cases use the command line alone, so that they outlive any move of modules. Two numbers agree when they differ by
less than 1e-9 of their size: sums in another order are allowed, another estimate is not. Reports are not read, their
tables are.
"""

import argparse
import csv
import json
import math
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np

ROOT = Path(__file__).parents[1]
DATA = ROOT / "tests" / "data"
RELATIVE = 1e-9
ABSOLUTE = 1e-12  # in the number's unit: below any digit that is printed
SHOWN = 40  # differences printed for each file

# What differs between two runs of one version on the same files.
PASSING = {"created", "software", "command", "versions", "python", "platform"}
OUT_OF_TOLERANCE = 3  # a result as well
MOVED_LAMP = ("[0.0, 1222.0, 1000.0]", "[0.0, 1227.0, 1000.0]")

REAL_FRINGES = {
    "fpp_tools_lens": ["phase", "fpp_tools_lens"],
    "kamino_object1": ["phase", "kamino_object1"],
    "kamino_gamma_plane": ["phase", *(f"kamino_gamma_plane/pat0{n}.png" for n in range(3)), "--steps", "-120,0,120"],
}
REAL_GRIDS = {
    "line_pattern_01": ["grid", "discorpy_grids/line_pattern_01.jpg"],
    "gopro": ["grid", "discorpy_grids/GoPro8_line_grid_halfsize.jpg"],
    "dot_pattern_05": ["grid", "discorpy_grids/dot_pattern_05_crop.png", "--pattern", "dots"],
    "laser_line": ["phase", "tis_laser_line"],
}


def commands() -> Iterator[tuple[str, list[str]]]:
    """Name the result folder and the arguments of every command, in the order in which they need one another."""
    for rig in ("thesis", "harder", "oblique", "tutorial-rig.toml"):
        name = rig.removesuffix("-rig.toml")
        session, calibration = f"{name}-session", f"{name}-calibration"
        yield session, ["simulate", rig]
        yield calibration, ["commission", session]
        yield (
            f"{name}-verification",
            ["verify", session, "--capture", "bars", "--calibration", calibration, "--no-filters"],
        )
    yield "thesis-leaf", ["reconstruct", "thesis-session", "--capture", "leaf", "--calibration", "thesis-calibration"]
    yield "thesis-angle", ["angle", "thesis-session"]
    yield "tutorial-ridge", ["angle", "tutorial-session", "--estimator", "ridge"]
    yield "tutorial-skeleton", ["angle", "tutorial-session", "--estimator", "skeleton"]
    yield (
        "tutorial-leaf",
        ["reconstruct", "tutorial-session", "--capture", "leaf", "--calibration", "tutorial-calibration"],
    )
    yield "tutorial-month", ["simulate", "tutorial-rig.toml", "--seed", "2"]
    yield "tutorial-audit", ["audit", "tutorial-month", "--calibration", "tutorial-calibration"]
    yield "tutorial-moved", ["simulate", "moved-rig.toml", "--seed", "2"]
    yield "tutorial-audit-moved", ["audit", "tutorial-moved", "--calibration", "tutorial-calibration"]
    yield "oblique-data", ["commission", str(DATA / "oblique")]
    yield (
        "oblique-bars",
        [
            "reconstruct",
            str(DATA / "oblique"),
            "--capture",
            "bars",
            "--calibration",
            "oblique-data",
            "--highest-mm",
            "25",
        ],
    )
    for name, arguments in (REAL_FRINGES | REAL_GRIDS).items():
        yield f"real-{name}", [str(DATA / word) if (DATA / word).exists() else word for word in arguments]


def make(out: Path) -> None:
    """Run every case."""
    out.mkdir(parents=True, exist_ok=True)
    rig = (ROOT / "docs" / "tutorial-rig.toml").read_text(encoding="utf-8")
    (out / "tutorial-rig.toml").write_text(rig, encoding="utf-8")
    (out / "moved-rig.toml").write_text(rig.replace(*MOVED_LAMP), encoding="utf-8")
    for name, arguments in commands():
        begun = time.monotonic()
        printed = [] if arguments[0] == "simulate" else ["--json"]
        command = [sys.executable, "-m", "fringecal", *arguments, "--out", name, *printed]
        done = subprocess.run(command, cwd=out, capture_output=True, text=True, check=False)
        if done.returncode not in (0, OUT_OF_TOLERANCE):
            print(f"{name}: exit code {done.returncode}: {done.stderr.strip()[:300]}")
        (out / f"{name}.code").write_text(f"{done.returncode}\n")
        if printed:
            (out / f"{name}.json").write_text(done.stdout, encoding="utf-8")
        print(f"{name}: {time.monotonic() - begun:.1f} s", flush=True)


def compare(before: Path, after: Path) -> int:
    """Print every number that differs; return how many do."""
    differing = 0
    for file in sorted(path.relative_to(before) for path in before.rglob("*") if path.suffix in READERS):
        if "truth" in file.parts or "figures" in file.parts:
            continue
        if not (after / file).exists():
            print(f"{file}: missing")
            differing += 1
            continue
        reader = READERS[file.suffix]
        changes = list(differences(reader(before / file), reader(after / file)))
        for place, old, new in changes[:SHOWN]:
            print(f"{file}: {place}: {old} -> {new}")
        if len(changes) > SHOWN:
            print(f"{file}: and {len(changes) - SHOWN} more")
        differing += len(changes)
    print(f"{differing} differences")
    return differing


def differences(old: object, new: object, place: str = "") -> Iterator[tuple[str, object, object]]:
    """Yield where two documents differ by more than rounding, or in a text."""
    if isinstance(old, dict) and isinstance(new, dict):
        for key in {**old, **new}:
            if key not in PASSING:
                yield from differences(old.get(key, "absent"), new.get(key, "absent"), f"{place}.{key}")
    elif isinstance(old, list) and isinstance(new, list) and len(old) == len(new):
        for number, pair in enumerate(zip(old, new, strict=True)):
            yield from differences(*pair, f"{place}[{number}]")
    elif isinstance(old, np.ndarray) and isinstance(new, np.ndarray):
        yield from _differing_maps(old, new, place)
    elif isinstance(old, int | float) and isinstance(new, int | float):
        same = old == new or (math.isnan(old) and math.isnan(new))
        if not same and not math.isclose(old, new, rel_tol=RELATIVE, abs_tol=ABSOLUTE):
            yield place, old, new
    elif old != new:
        yield place, old, new


def _differing_maps(old: np.ndarray, new: np.ndarray, place: str) -> Iterator[tuple[str, object, object]]:
    if old.shape != new.shape or old.dtype != new.dtype:
        yield place, (old.shape, old.dtype), (new.shape, new.dtype)
    elif old.dtype.kind == "f":
        # Maps of four bytes are rounded to seven digits.
        relative = RELATIVE if old.dtype.itemsize == 8 else 1e-6
        apart = ~np.isclose(old, new, rtol=relative, atol=ABSOLUTE, equal_nan=True)
        if apart.any():
            yield place, f"{np.count_nonzero(apart)} of {apart.size} values", f"most {np.nanmax(np.abs(old - new)):.3g}"
    elif not np.array_equal(old, new):
        yield place, "values", f"{np.count_nonzero(old != new)} of {old.size} differ"


def _json(path: Path) -> object:
    text = path.read_text(encoding="utf-8")
    return json.loads(text) if text.strip() else ""


def _table(path: Path) -> object:
    with path.open(encoding="utf-8", newline="") as lines:
        return [[_number(cell) for cell in row] for row in csv.reader(lines)]


def _number(cell: str) -> float | str:
    try:
        return float(cell)
    except ValueError:
        return cell


def _maps(path: Path) -> object:
    with np.load(path) as maps:
        return {name: maps[name] for name in maps.files}


READERS = {".json": _json, ".csv": _table, ".npz": _maps, ".code": lambda path: path.read_text()}


def main() -> None:
    """Read the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    verbs = parser.add_subparsers(dest="verb", required=True)
    verbs.add_parser("make").add_argument("out", type=Path)
    pair = verbs.add_parser("compare")
    pair.add_argument("before", type=Path)
    pair.add_argument("after", type=Path)
    given = parser.parse_args()
    if given.verb == "make":
        make(given.out)
    else:
        sys.exit(1 if compare(given.before, given.after) else 0)


if __name__ == "__main__":
    main()
