"""Lens distortion on real pictures beside discorpy: what is found, what is left, where the centre lies, seconds.

Run: python benchmarks/grid_distortion.py FOLDER [--discorpy PYTHON]. FOLDER holds pictures of discorpy's
repository (line_pattern_01.jpg, dot_pattern_01.jpg, ...); PYTHON is an interpreter of an environment that holds
discorpy 1.7. Both describe one lens by the same measure: rms distance from straight, horizontal / vertical, px.
"""

import argparse
import subprocess
import tempfile
import time
from pathlib import Path

import cv2
import numpy as np

from fringecal.camera.distortion.distortion_test import examine_distortion
from fringecal.camera.distortion.straightness import family_rms_px
from fringecal.detect.dots import find_dot_grid
from fringecal.detect.grid.grid_search import FAMILIES, GridDetection, find_grid

DISCORPY = """
import sys, time
import numpy as np
import discorpy.prep.linepattern as lines
import discorpy.prep.preprocessing as prep
import discorpy.proc.processing as proc
import discorpy.post.postprocessing as post
picture, kind = np.load(sys.argv[1]).astype(np.float32), sys.argv[2]
start = time.process_time()
if kind == "lines":
    slope_h, dist_h = lines.calc_slope_distance_hor_lines(picture)
    slope_v, dist_v = lines.calc_slope_distance_ver_lines(picture)
    points_h = lines.get_cross_points_hor_lines(picture, slope_v, dist_v)
    points_v = lines.get_cross_points_ver_lines(picture, slope_h, dist_h)
else:
    flat = prep.normalization_fft(picture, 20)
    size, dist_h = prep.calc_size_distance(prep.binarization(flat))
    chosen = prep.select_dots_based_size(prep.binarization(flat), size, 0.5)
    chosen = prep.select_dots_based_ratio(chosen, 0.5)
    slope_h = prep.calc_hor_slope(chosen)
    slope_v, dist_v, points_h, points_v = prep.calc_ver_slope(chosen), dist_h, chosen, chosen
h = prep.group_dots_hor_lines(points_h, slope_h, dist_h)
v = prep.group_dots_ver_lines(points_v, slope_v, dist_v)
centre = proc.find_cod_coarse(h, v)
terms = proc.calc_coef_backward(h, v, *centre, 5)
seconds = time.process_time() - start
flat_h, flat_v = (post.unwarp_line_backward(part, *centre, terms) for part in (h, v))
def rms(x):
    return float(np.sqrt(np.mean(np.asarray(x)[:, 1] ** 2)))
left = rms(post.calc_residual_hor(flat_h, *centre)), rms(post.calc_residual_ver(flat_v, *centre))
before = rms(post.calc_residual_hor(h, *centre)), rms(post.calc_residual_ver(v, *centre))
print(len(h), len(v), dist_h, dist_v, *before, *left, *centre, *proc.find_cod_bailey(h, v), seconds)
"""


def ours(name: str, grey: np.ndarray, kind: str) -> None:
    start = time.process_time()
    grid = find_grid(grey) if kind == "lines" else find_dot_grid(grey)
    test = examine_distortion(grid)
    seconds = time.process_time() - start
    spacing = [middle_distance_px(grid, axis) for axis in (0, 1)]
    before, after = (
        [family_rms_px(table, family) for family in FAMILIES]
        for table in (test.straightness_before, test.straightness_after)
    )
    u_centre = "" if test.centre is None else f" u {test.centre[0].u:.1f} {test.centre[1].u:.1f}"
    print(f"{name}\n  fringecal  {grid.row.max() + 1} + {grid.column.max() + 1}, spacing {_two(spacing)} px")
    shrunk = [d * (n - 1) / n for d, n in zip(spacing, grey.shape, strict=True)]
    print(f"             in discorpy's convention, (N - 1) / N: {_two(shrunk)} px")
    print(f"             straightness {_two(before)} -> {_two(after)} px, {test.verdict}, {seconds:.1f} s CPU")
    print(f"             centre {test.lens.centre_px[0]:.1f}, {test.lens.centre_px[1]:.1f}{u_centre}")


def middle_distance_px(grid: GridDetection, axis: int) -> float:
    """Median distance of neighbouring lines over the middle 30 % of the picture, px."""
    nodes = np.full((grid.row.max() + 1, grid.column.max() + 1, 2), np.nan)
    nodes[grid.row, grid.column] = np.stack([grid.u_px, grid.v_px], axis=1)
    size = np.array(grid.shape[::-1])
    near = (np.abs(nodes - (size - 1) / 2) < 0.15 * size).all(axis=2)
    nodes[~near] = np.nan
    return float(np.nanmedian(np.hypot(*np.moveaxis(np.diff(nodes, axis=axis), 2, 0))))


def theirs(python: str, grey: np.ndarray, kind: str) -> None:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "grid.npy"
        np.save(path, grey)
        done = subprocess.run([python, "-c", DISCORPY, str(path), kind], capture_output=True, text=True)  # noqa: PLW1510
    if done.returncode:
        print(f"  discorpy   fails: {done.stderr.strip().splitlines()[-1]}")
        return
    found = [float(word) for word in done.stdout.split()]
    print(f"  discorpy   {found[0]:.0f} + {found[1]:.0f}, spacing {_two(found[2:4])} px")
    print(f"             straightness {_two(found[4:6])} -> {_two(found[6:8])} px, {found[12]:.1f} s CPU")
    coarse, vanishing = (f"{u:.1f}, {v:.1f}" for u, v in (found[8:10], found[10:12]))
    print(f"             centre, coarse {coarse}; by vanishing points {vanishing}")


def _two(values: list[float]) -> str:
    return " / ".join(f"{value:.3f}" for value in values)


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("folder", type=Path)
    parser.add_argument("--discorpy", metavar="PYTHON")
    options = parser.parse_args()
    for path in sorted(options.folder.glob("*.jpg")):
        kind = "dots" if "dot" in path.name else "lines"
        grey = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
        ours(path.name, grey, kind)
        if options.discorpy:
            theirs(options.discorpy, grey, kind)


if __name__ == "__main__":
    main()
