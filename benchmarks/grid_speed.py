"""Grid detection with the distortion test against picture size, and against discorpy where it is installed.

Run: python benchmarks/grid_speed.py [--large] [--discorpy PYTHON]. PYTHON is an interpreter of an environment
that holds discorpy 1.7 (it asks for other numpy). Wall and CPU seconds, the best of three alternating turns.
"""

import argparse
import subprocess
import tempfile
import time
from pathlib import Path

import numpy as np

from fringecal.camera.distortion.distortion_test import examine_distortion
from fringecal.detect.grid.grid_search import find_grid

TURNS = 3
DISCORPY = """
import sys, time
import numpy as np
import discorpy.prep.linepattern as lines
import discorpy.prep.preprocessing as prep
import discorpy.proc.processing as proc
picture = np.load(sys.argv[1]).astype(np.float32)
wall, cpu = time.perf_counter(), time.process_time()
slope_h, dist_h = lines.calc_slope_distance_hor_lines(picture)
slope_v, dist_v = lines.calc_slope_distance_ver_lines(picture)
across_h = lines.get_cross_points_hor_lines(picture, slope_v, dist_v)
across_v = lines.get_cross_points_ver_lines(picture, slope_h, dist_h)
group_h = prep.group_dots_hor_lines(across_h, slope_h, dist_h)
group_v = prep.group_dots_ver_lines(across_v, slope_v, dist_v)
centre = proc.find_cod_coarse(group_h, group_v)
proc.calc_coef_backward(group_h, group_v, *centre, 5)
print(time.perf_counter() - wall, time.process_time() - cpu, len(group_h), len(group_v), dist_h, dist_v)
"""


def picture(size: int, pitch_px: float = 50.0) -> np.ndarray:
    """Ruled lines 4 px wide, turned by 3 deg, weak barrel, noise of 1.5 levels; uint8."""
    v, u = np.mgrid[:size, :size].astype(np.float32) - np.float32((size - 1) / 2)
    bent = 1 + 0.004 * (u * u + v * v) / (0.5 * size**2)
    c, s = np.cos(np.radians(3)), np.sin(np.radians(3))
    ink = np.zeros((size, size), np.float32)
    for across in ((c * u + s * v) * bent, (c * v - s * u) * bent):
        distance = np.abs((across / pitch_px + 0.5) % 1 - 0.5) * pitch_px
        ink = np.maximum(ink, np.clip(2.5 - distance, 0, 1))
    noise = np.random.default_rng(1).normal(0, 1.5, ink.shape)
    return np.clip(np.round(200 - 140 * ink + noise), 0, 255).astype(np.uint8)


def ours(grey: np.ndarray) -> tuple[float, float]:
    wall, cpu = time.perf_counter(), time.process_time()
    examine_distortion(find_grid(grey))
    return time.perf_counter() - wall, time.process_time() - cpu


def theirs(python: str, grey: np.ndarray) -> list[float]:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "grid.npy"
        np.save(path, grey)
        done = subprocess.run([python, "-c", DISCORPY, str(path)], capture_output=True, text=True, check=True)
    return [float(word) for word in done.stdout.split()]


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--large", action="store_true", help="up to 24 megapixels")
    parser.add_argument("--discorpy", metavar="PYTHON")
    options = parser.parse_args()
    ours(picture(512))
    for size in (512, 1024, 2048, *((4900,) if options.large else ())):
        grey, best, other = picture(size), (np.inf, np.inf), None
        for _ in range(TURNS):
            best = min(best, ours(grey))
            if options.discorpy and size == 2048:
                found = theirs(options.discorpy, grey)
                other = found if other is None else min(other, found)
        line = f"{size:5d} x {size:<5d} wall {best[0]:6.2f} s  cpu {best[1]:6.2f} s"
        if other is not None:
            line += f"   discorpy wall {other[0]:6.2f} s  cpu {other[1]:6.2f} s: {other[1] / best[1]:.0f} times (cpu)"
        print(line)


if __name__ == "__main__":
    main()
