"""Do crossings, scale and the verdict on distortion hold where lines meet the pixel raster? Cells over what matters.

Run: python benchmarks/grid_raster.py [--sheets 20] [--half tune|judge] [--seed 1]. Every sheet is undistorted, seen
square-on and drawn by exact integration over the pixels (`exact_sheets`): 600 x 500 px, about 15 x 12 lines. Cells are
width x blur x rotation (within 1 deg of the raster; up to 45 deg) x spacing (free; within 0.05 px of a whole number).
Asked of each: false alarms of the verdict (5 % promised), the crossings' misfit over their u (1), how often the 95 %
interval of the scale holds. The seeds are in two halves: one to work with, one to look at once.
"""

import argparse
import itertools
import math
import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parent))
from exact_sheets import Sheet, picture
from fringecal.camera import examine_distortion, fit_grid_camera
from fringecal.detect import find_grid
from fringecal.errors import FringecalError
from fringecal.uncertainty import Estimate

SHAPE = (500, 600)
WIDTHS_PX = (1.2, 1.5, 2.0, 3.0, 5.0)
BLURS_PX = (0.2, 0.4, 0.7, 1.0)
ROTATIONS = ("along", "free")
SPACINGS = ("free", "whole")
HALVES = {"tune": 0, "judge": 1}
# A camera whose height is stated to 1 %, at 0.2 mm/px.
SCALE_MM_PER_PX, HEIGHT_MM, HEIGHT_U_MM = 0.2, 600.0, 6.0
# The camera on the plate, which takes as long as all else, is fitted to every so many sheets.
CAMERA_EVERY = 4


@dataclass(frozen=True)
class Cell:
    """Width and blur, px, and how rotation and spacing are drawn."""

    width_px: float
    blur_px: float
    rotation: str
    spacing: str

    def draw(self, rng: np.random.Generator) -> Sheet:
        """One sheet of the cell, its phase and rotation free."""
        spacing = rng.uniform(37, 43)
        if self.spacing == "whole":
            spacing = round(spacing) + rng.uniform(-0.05, 0.05)
        rotation = rng.uniform(-1, 1) if self.rotation == "along" else rng.uniform(-45, 45)
        return Sheet(self.width_px, self.blur_px, spacing, rotation, tuple(rng.uniform(0, spacing, 2)))


@dataclass(frozen=True)
class Trial:
    """What came out of one sheet; z are errors over standard uncertainties."""

    sheet: Sheet
    p_value: float
    alarm: bool
    misfit: float
    limit_px: float
    off_px: float
    scale_z: float
    camera_z: float
    profile: tuple[float, float]

    @property
    def line(self) -> str:
        """The trial as a row of numbers."""
        s = self.sheet
        values = (
            s.width_px, s.blur_px, s.spacing_px, s.rotation_deg, self.p_value, self.misfit,
            self.limit_px, self.off_px, self.scale_z, self.camera_z, *self.profile,
        )  # fmt: skip
        return " ".join(f"{value:.5g}" for value in values)


def trial(cell: Cell, seed: tuple[int, ...]) -> Trial:
    """Draw and measure one sheet."""
    rng = np.random.default_rng(seed)
    sheet = cell.draw(rng)
    grid = find_grid(picture(sheet, SHAPE, rng, noise=rng.uniform(0.7, 3.0)))
    test = examine_distortion(grid)
    seen = np.stack([grid.u_px, grid.v_px], axis=1)
    error = seen - sheet.crossings(*sheet.nearest(*seen.T, SHAPE), SHAPE)
    pitch = Estimate(sheet.spacing_px * SCALE_MM_PER_PX, 0.0, "mm")
    at_centre = test.scale_at_centre(pitch)
    camera_z = math.nan
    if seed[-1] % CAMERA_EVERY == 0:
        height = Estimate(HEIGHT_MM + HEIGHT_U_MM * rng.standard_normal(), HEIGHT_U_MM, "mm")
        camera = fit_grid_camera(grid, pitch, height_mm=height).camera.scale("mean")
        camera_z = (camera.value - SCALE_MM_PER_PX) / camera.u
    return Trial(
        sheet,
        test.p_value,
        test.verdict != "none",
        test.misfit,
        test.detection_limit_px,
        float(np.sqrt(np.mean((error - error.mean(axis=0)) ** 2))),
        (at_centre.value - SCALE_MM_PER_PX) / at_centre.u,
        camera_z,
        (grid.profile.width_px, grid.profile.blur_px),
    )


def run(cell: Cell, sheets: int, half: str, seed: int) -> list[Trial]:
    """All sheets of a cell; one that the detector refuses is a fault and raises."""
    place = [WIDTHS_PX, BLURS_PX, ROTATIONS, SPACINGS]
    key = [p.index(x) for p, x in zip(place, (cell.width_px, cell.blur_px, cell.rotation, cell.spacing), strict=True)]
    done = []
    for n in range(sheets):
        try:
            done.append(trial(cell, (seed, HALVES[half], *key, n)))
        except FringecalError as error:
            print(f"{cell} {n}: {error}")
    return done


def summary(name: str, trials: list[Trial]) -> str:
    """One line of a table."""
    alarms = sum(t.alarm for t in trials)
    z = np.abs([(t.scale_z, t.camera_z) for t in trials])
    within = 100 * (z < 1.96).sum(axis=0) / np.isfinite(z).sum(axis=0)
    return (
        f"{name:42s} {len(trials):5d} {alarms:4d} {100 * alarms / len(trials):5.1f} % "
        f"p<1e-3 {sum(t.p_value < 1e-3 for t in trials):3d}  misfit {np.median([t.misfit for t in trials]):5.2f} "
        f"(max {max(t.misfit for t in trials):5.2f})  off {1e3 * np.median([t.off_px for t in trials]):5.2f} mpx "
        f"scale {within[0]:5.1f} {within[1]:5.1f} %  limit {1e3 * np.median([t.limit_px for t in trials]):5.1f} mpx"
    )


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--sheets", type=int, default=20)
    parser.add_argument("--half", choices=HALVES, default="tune")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--rows", help="file to write every sheet to")
    options = parser.parse_args()
    everything: list[Trial] = []
    for cell in itertools.starmap(Cell, itertools.product(WIDTHS_PX, BLURS_PX, ROTATIONS, SPACINGS)):
        trials = run(cell, options.sheets, options.half, options.seed)
        everything += trials
        name = f"{cell.width_px} / {cell.blur_px} px, {cell.rotation}, {cell.spacing}"
        print(summary(name, trials), flush=True)
    print(summary("all", everything))
    if options.rows:
        Path(options.rows).write_text("\n".join(t.line for t in everything) + "\n")


if __name__ == "__main__":
    main()
