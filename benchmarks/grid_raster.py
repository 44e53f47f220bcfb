"""Do crossings, scale and the verdict on distortion hold where lines meet the pixel raster? Cells over what matters.

Run: python benchmarks/grid_raster.py [--sheets 20] [--half judge] [--seed 1] [--fine]. Every sheet is undistorted, seen
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

    cell: Cell
    p_value: float
    alarm: bool
    misfit: float
    limit_px: float
    off_px: float
    scale_z: float
    camera_z: float


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
        cell,
        test.p_value,
        test.verdict != "none",
        test.misfit,
        test.detection_limit_px,
        float(np.sqrt(np.mean((error - error.mean(axis=0)) ** 2))),
        (at_centre.value - SCALE_MM_PER_PX) / at_centre.u,
        camera_z,
    )


def cells() -> list[Cell]:
    """All cells."""
    return list(itertools.starmap(Cell, itertools.product(WIDTHS_PX, BLURS_PX, ROTATIONS, SPACINGS)))


def run(chosen: list[Cell], sheets: int, half: str, seed: int) -> list[Trial]:
    """Sheets of all cells in turn, so that one may stop early; one that the detector refuses is a fault and is told."""
    done, every = [], cells()
    for number in range(sheets):
        for cell in chosen:
            try:
                done.append(trial(cell, (seed, HALVES[half], every.index(cell), number)))
            except FringecalError as error:
                print(f"{cell} {number}: {error}", flush=True)
        print(f"{len(done)} sheets, {sum(t.alarm for t in done)} false alarms", file=sys.stderr, flush=True)
    return done


def summary(name: str, trials: list[Trial]) -> str:
    """One line of a table."""
    alarms = sum(t.alarm for t in trials)
    z = np.abs([(t.scale_z, t.camera_z) for t in trials])
    within = 100 * (z < 1.96).sum(axis=0) / np.maximum(np.isfinite(z).sum(axis=0), 1)
    misfit, off, limit = (np.array([getattr(t, k) for t in trials]) for k in ("misfit", "off_px", "limit_px"))
    low, high = np.quantile(misfit, [0.05, 0.95])
    return (
        f"{name:34s} {len(trials):5d}  false alarms {alarms:3d}, {100 * alarms / len(trials):4.1f} %  misfit "
        f"{np.sqrt(np.mean(misfit**2)):.3f} (90 %: {low:.2f} to {high:.2f}, most {misfit.max():.2f})  "
        f"off {1e3 * np.median(off):4.1f} mpx  scale {within[0]:5.1f} %, of the camera {within[1]:5.1f} %  "
        f"limit {1e3 * np.median(limit):4.1f} mpx (most {1e3 * limit.max():.0f})"
    )


def tables(trials: list[Trial], *, fine: bool) -> None:
    """Print what came out over larger cells, over the fine ones if they hold enough, and over all."""
    groups: dict[str, list[Trial]] = {}
    for each in trials:
        cell = each.cell
        names = [f"{cell.rotation} rotation, {cell.spacing} spacing", f"width {cell.width_px} px"]
        names += [f"blur {cell.blur_px} px"]
        if fine:
            names.append(f"{cell.width_px} / {cell.blur_px} px, {cell.rotation}, {cell.spacing}")
        for name in (*names, "all"):
            groups.setdefault(name, []).append(each)
    for name in sorted(groups):
        print(summary(name, groups[name]))


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--sheets", type=int, default=20)
    parser.add_argument("--half", choices=HALVES, default="tune")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--fine", action="store_true", help="print every cell")
    options = parser.parse_args()
    trials = run(cells(), options.sheets, options.half, options.seed)
    tables(trials, fine=options.fine)


if __name__ == "__main__":
    main()
