"""Which estimator finds the centre of distortion? Points of a grid with a known centre, tilt and lens.

Run: python benchmarks/distortion_centre.py [--discorpy PYTHON] [--repeats 20]. The cases have the picture size, lens
and tilt of line_pattern_01 (weak, 2560 x 2160) and of its GoPro grid (strong barrel, 2000 x 1500),
with and without the tilt. Points are straight lines, projected, bent about the centre, with normal noise. PYTHON
is an interpreter of an environment that holds discorpy 1.7; it is given the same points.
"""

import argparse
import json
import subprocess
import tempfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from fringecal.camera.distortion.distortion_test import examine_distortion
from fringecal.camera.lens.radial_lens import RadialLens
from fringecal.detect.grid.grid_search import FAMILIES, GridDetection, GridLine
from fringecal.detect.grid.line_profile import LineProfile
from fringecal.errors import FringecalError

DISCORPY = """
import json, sys
import numpy as np
import discorpy.proc.processing as proc
for case in json.load(open(sys.argv[1])):
    lines = [[np.array(line)[:, ::-1] for line in family] for family in case["lines"]]
    found = {"coarse": proc.find_cod_coarse(*lines), "vanishing points": proc.find_cod_bailey(*lines)}
    for reach in (5.0, 20.0):
        found[f"fine within {reach:.0f} px"] = proc.find_cod_fine(*lines, *found["coarse"], reach)
    print(json.dumps({name: [float(x) for x in centre[:2]] for name, centre in found.items()}), flush=True)
"""


@dataclass(frozen=True)
class Case:
    """A grid before a camera: picture size, lines, pitch, tilt per half-size, lens and its centre, noise."""

    name: str
    shape: tuple[int, int]
    lines: tuple[int, int]
    pitch_px: float
    tilt: tuple[float, float]
    centre_px: tuple[float, float]
    radial: tuple[float, ...]
    inverse: bool
    noise_px: float


WEAK = ((2160, 2560), (34, 40), 62.3), (1133.7, 1273.8), (0.00612, 0.00028, 0.0), False, 0.05
STRONG = ((1500, 2000), (27, 37), 54.7), (994.8, 738.0), (0.588, 0.219, 0.603), True, 0.1
CASES = tuple(
    Case(f"{name}, {'tilted' if any(tilt) else 'square-on'}", *sheet, tilt, *lens)
    for name, (sheet, *lens), tilts in (
        ("weak", WEAK, ((0.0, 0.0), (-0.0004, -0.0016))),
        ("strong", STRONG, ((0.0, 0.0), (-0.0103, 0.0172))),
    )
    for tilt in tilts
)


def grid(case: Case, rng: np.random.Generator) -> GridDetection:
    """Crossings of the case as a detection; only those inside the picture."""
    height, width = case.shape
    rows, columns = case.lines
    row, column = (axis.ravel() for axis in np.mgrid[:rows, :columns])
    x, y = (column - (columns - 1) / 2) * case.pitch_px, (row - (rows - 1) / 2) * case.pitch_px
    half = case.pitch_px * max(case.lines) / 2
    depth = 1 + case.tilt[0] * x / half + case.tilt[1] * y / half
    ideal = np.stack([x / depth + (width - 1) / 2, y / depth + (height - 1) / 2], axis=1)
    lens = RadialLens(case.centre_px, 0.5 * float(np.hypot(height, width)), case.radial, (0.0, 0.0), case.inverse)
    points = lens.distort(ideal)
    inside = ((points > 0) & (points < (width, height))).all(axis=1)
    points = points[inside] + rng.normal(0, case.noise_px, points[inside].shape)
    row, column = row[inside], column[inside]
    lines = []
    for family, index in zip(FAMILIES, (row, column), strict=True):
        for k in np.unique(index):
            u, v = points[index == k].T
            lines.append(GridLine(family, int(k), u, v, np.full_like(u, case.noise_px), np.zeros(len(u), np.int64)))
    sigma = np.full(len(row), case.noise_px)
    return GridDetection(
        row, column, points[:, 0], points[:, 1], sigma, tuple(lines), case.shape, "dark", LineProfile(4.0, 0.8)
    )


def fringecal_centres(detection: GridDetection) -> dict[str, tuple[float, float]]:
    """Centre with the camera's tilt fitted beside it, and without."""
    found = {}
    for name, perspective in (("fringecal", True), ("fringecal, tilt left out", False)):
        try:
            found[name] = examine_distortion(detection, centre="free", perspective=perspective).lens.centre_px
        except FringecalError as error:
            found[name] = (np.nan, np.nan)
            print(f"  {name}: {error}")
    return found


def discorpy_centres(python: str, grids: list[GridDetection]) -> list[dict[str, tuple[float, float]]]:
    """Centres by discorpy's estimators on the same points."""
    cases = [
        {
            "lines": [
                [np.stack([line.u_px, line.v_px], axis=1).tolist() for line in each.family(family)]
                for family in FAMILIES
            ]
        }
        for each in grids
    ]
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "points.json"
        path.write_text(json.dumps(cases), encoding="utf-8")
        done = subprocess.run([python, "-c", DISCORPY, str(path)], capture_output=True, text=True, check=True)
    return [json.loads(line) for line in done.stdout.splitlines()]


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--discorpy", metavar="PYTHON")
    parser.add_argument("--repeats", type=int, default=20)
    options = parser.parse_args()
    for case in CASES:
        rng = np.random.default_rng(1)
        grids = [grid(case, rng) for _ in range(options.repeats)]
        found = [fringecal_centres(each) for each in grids]
        if options.discorpy:
            few = grids[:2]
            theirs = discorpy_centres(options.discorpy, few)
            found = [ours | their for ours, their in zip(found, theirs, strict=False)] + found[len(few) :]
        print(f"{case.name}: truth {case.centre_px[0]:.1f}, {case.centre_px[1]:.1f}; error u, v / px (mean, sd)")
        for name in found[0]:
            error = np.array([each[name] for each in found if name in each]) - case.centre_px
            mean, sd = error.mean(axis=0), error.std(axis=0, ddof=min(1, len(error) - 1))
            print(f"  {name:26s} {mean[0]:+9.1f} {mean[1]:+9.1f}   {sd[0]:6.1f} {sd[1]:6.1f}", flush=True)


if __name__ == "__main__":
    main()
