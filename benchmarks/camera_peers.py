"""fringecal and discorpy on the same pictures in one run: what is found, what is left, seconds and memory.

Run: python benchmarks/camera_peers.py --discorpy PYTHON [--folder FOLDER] [--turns 2] [--large]. PYTHON is an
interpreter of an environment that holds discorpy 1.7 (it asks for another numpy). Drawn pictures of a ruled sheet with
a weak barrel come first, whose spacing and straightness are known; FOLDER may hold pictures of discorpy's repository.
The two take turns on every picture; the least wall and CPU seconds count, detection and fit together, and each
process's largest memory. `--large` adds 12 and 24 megapixels, for fringecal alone (discorpy needs minutes).
"""

import argparse
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from grid_speed import picture

OURS = """
import re, sys, time
import numpy as np
from fringecal.camera.distortion import examine_distortion
from fringecal.camera.spacing import line_spacing_px
from fringecal.camera.straightness import family_rms_px
from fringecal.detect.grid import FAMILIES, find_grid
grey = np.load(sys.argv[1])
examine_distortion(find_grid(grey[:512, :512]))  # kernels are compiled once, then kept on disk
wall, cpu = time.perf_counter(), time.process_time()
grid = find_grid(grey)
test = examine_distortion(grid)
wall, cpu = time.perf_counter() - wall, time.process_time() - cpu
rms = [family_rms_px(table, f) for table in (test.straightness_before, test.straightness_after) for f in FAMILIES]
spacing = [each.value for each in line_spacing_px(grid, test.lens).values()]
memory = int(re.search("VmHWM:\\s+(\\d+)", open("/proc/self/status").read())[1]) / 1024
print(wall, cpu, grid.row.max() + 1, grid.column.max() + 1, len(grid.row), *rms, *spacing, *test.lens.centre_px, memory)
"""
DISCORPY = """
import re, sys, time
import numpy as np
import discorpy.prep.linepattern as lines
import discorpy.prep.preprocessing as prep
import discorpy.proc.processing as proc
import discorpy.post.postprocessing as post
grey = np.load(sys.argv[1]).astype(np.float32)
wall, cpu = time.perf_counter(), time.process_time()
slope_h, dist_h = lines.calc_slope_distance_hor_lines(grey)
slope_v, dist_v = lines.calc_slope_distance_ver_lines(grey)
h = prep.group_dots_hor_lines(lines.get_cross_points_hor_lines(grey, slope_v, dist_v), slope_h, dist_h)
v = prep.group_dots_ver_lines(lines.get_cross_points_ver_lines(grey, slope_h, dist_h), slope_v, dist_v)
centre = proc.find_cod_coarse(h, v)
terms = proc.calc_coef_backward(h, v, *centre, 5)
wall, cpu = time.perf_counter() - wall, time.process_time() - cpu
def rms(x):
    return float(np.sqrt(np.mean(np.asarray(x)[:, 1] ** 2)))
left = [post.unwarp_line_backward(part, *centre, terms) for part in (h, v)]
before = rms(post.calc_residual_hor(h, *centre)), rms(post.calc_residual_ver(v, *centre))
after = rms(post.calc_residual_hor(left[0], *centre)), rms(post.calc_residual_ver(left[1], *centre))
memory = int(re.search("VmHWM:\\s+(\\d+)", open("/proc/self/status").read())[1]) / 1024
points = sum(map(len, h))
print(wall, cpu, len(h), len(v), points, *before, *after, dist_h, dist_v, *centre, memory)
"""


@dataclass(frozen=True)
class Run:
    """One program on one picture."""

    wall_s: float
    cpu_s: float
    lines: tuple[float, float]
    points: float
    before_px: tuple[float, float]
    after_px: tuple[float, float]
    spacing_px: tuple[float, float]
    centre_px: tuple[float, float]
    memory_mb: float

    @classmethod
    def of(cls, words: list[float]) -> "Run":
        """Read a program's line of numbers."""
        w = words
        return cls(w[0], w[1], (w[2], w[3]), w[4], (w[5], w[6]), (w[7], w[8]), (w[9], w[10]), (w[11], w[12]), w[13])


def run(python: str, program: str, path: Path) -> Run | str:
    """Run a program on a stored picture, or its last words."""
    done = subprocess.run([python, "-c", program, str(path)], capture_output=True, text=True)  # noqa: PLW1510
    if done.returncode:
        return (done.stderr.strip().splitlines() or ["no message"])[-1]
    return Run.of([float(word) for word in done.stdout.split()])


def quicker(one: Run | str | None, other: Run | str) -> Run | str:
    """Keep the run with fewer CPU seconds."""
    return one if isinstance(one, Run) and isinstance(other, Run) and one.cpu_s <= other.cpu_s else other


def line(name: str, found: Run | str) -> str:
    """One row of the table."""
    if isinstance(found, str):
        return f"| {name} | fails: {found} |"
    two = [f"{a:.3f} / {b:.3f}" for a, b in (found.before_px, found.after_px, found.spacing_px)]
    return (
        f"| {name} | {found.lines[0]:.0f} + {found.lines[1]:.0f} | {found.points:.0f} | {' | '.join(two)} | "
        f"{found.centre_px[0]:.1f}, {found.centre_px[1]:.1f} | {found.wall_s:.2f} | {found.cpu_s:.2f} | "
        f"{found.memory_mb:.0f} |"
    )


def compare(name: str, grey: np.ndarray, python: str | None, turns: int) -> None:
    """Let both take turns on one picture; print a row of each."""
    best: dict[str, Run | str] = {}
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "grid.npy"
        np.save(path, grey)
        for _ in range(turns):
            for label, interpreter, program in (("fringecal", sys.executable, OURS), ("discorpy", python, DISCORPY)):
                if interpreter is not None:
                    best[label] = quicker(best.get(label), run(interpreter, program, path))
    for label, found in best.items():
        print(line(f"{name}, {label}", found), flush=True)
    ours, theirs = best.get("fringecal"), best.get("discorpy")
    if isinstance(ours, Run) and isinstance(theirs, Run):
        wall, cpu = theirs.wall_s / ours.wall_s, theirs.cpu_s / ours.cpu_s
        print(f"| ratio | | | | | | | {wall:.0f} | {cpu:.0f} | |", flush=True)


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--discorpy", metavar="PYTHON")
    parser.add_argument("--folder", type=Path)
    parser.add_argument("--turns", type=int, default=2)
    parser.add_argument("--large", action="store_true")
    options = parser.parse_args()
    print(
        "| picture | lines | points | before / px | after / px | spacing / px | centre / px | wall / s | CPU / s | MB |"
    )
    print("|---|---|---|---|---|---|---|---|---|---|")
    for size in (1024, 2048):
        compare(f"drawn, {size} x {size}", picture(size), options.discorpy, options.turns)
    for path in sorted(options.folder.glob("*line*.jpg")) if options.folder else ():
        compare(path.stem, cv2.imread(str(path), cv2.IMREAD_GRAYSCALE), options.discorpy, options.turns)
    for size in (3464, 4900) if options.large else ():
        compare(f"drawn, {size} x {size}", picture(size), None, options.turns)


if __name__ == "__main__":
    main()
