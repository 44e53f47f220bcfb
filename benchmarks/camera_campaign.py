"""Do verdict, detection limit and scale hold over many virtual cameras? Counts, against what is promised.

Run: python benchmarks/camera_campaign.py [--cameras 200] [--seed 1]. Every camera draws its own distortion
(k1 from -0.3 to 0.3, or 0), tilt to 3 deg, sheet turned to 45 deg, noise of 0.5 to 3 levels, and 1 to 10 % of
the sheet hidden; the sheet's pitch errs by its own standard uncertainty. The rays are the simulator's.
"""

import argparse
import math
from dataclasses import dataclass

import numpy as np
from scipy import special

from fringecal.camera.distortion.distortion_test import DistortionTest, examine_distortion
from fringecal.camera.plate.grid_camera import fit_grid_camera
from fringecal.detect.grid.grid_search import GridDetection, find_grid
from fringecal.errors import FringecalError
from fringecal.simulate import RigSpec, plate_points
from fringecal.uncertainty.estimates import Estimate

PITCH_REL_U = 5e-6
HEIGHT_U_MM = 5.0


@dataclass(frozen=True)
class Trial:
    """One virtual camera: what was true, and what came out."""

    displacement_px: float
    test: DistortionTest
    scale: Estimate
    true_scale: float
    slips: int

    @property
    def right(self) -> bool:
        """Whether the verdict names the direction in which the lens bends."""
        return self.test.verdict == ("barrel" if self.displacement_px < 0 else "pincushion")

    @property
    def scale_z(self) -> float:
        """Error of the scale over its standard uncertainty."""
        return (self.scale.value - self.true_scale) / self.scale.u

    @property
    def covered(self) -> bool:
        """Whether the 95 % interval of the scale holds the truth."""
        low, high = self.scale.interval_95
        return low <= self.true_scale <= high


def draw_rig(rng: np.random.Generator) -> RigSpec:
    """One camera of 480 x 400 px; half of them without distortion."""
    k1 = float(rng.uniform(-0.3, 0.3)) if rng.random() < 0.5 else 0.0
    height = float(rng.uniform(500, 2000))
    focal_px = float(rng.uniform(600, 1500))
    camera = {
        "width_px": 480,
        "height_px": 400,
        "scale_mm_per_px": height / focal_px,
        "height_mm": height,
        "tilt_deg": tuple(rng.uniform(-3, 3, 2) / math.sqrt(2)),
        "distortion": (k1, 0.0, 0.0, 0.0, 0.0),
    }
    return RigSpec(name="trial", camera=camera, projector={"position_mm": (0.0, 900.0, 900.0), "pitch_mm": 8.0})


def picture(rig: RigSpec, pitch_px: float, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The sheet as the camera sees it (uint8), and every pixel's place on the sheet in pitches."""
    x, y = plate_points(rig)
    turn = np.radians(rng.uniform(-45, 45))
    pitch_mm = pitch_px * rig.camera.scale_mm_per_px
    shift = rng.uniform(0, 1, 2)
    p = (np.cos(turn) * x + np.sin(turn) * y) / pitch_mm + shift[0]
    q = (np.sin(turn) * x - np.cos(turn) * y) / pitch_mm + shift[1]
    width, blur = rng.uniform(2, 4), rng.uniform(0.5, 1.0)
    paper = (1 - ink(p, width, blur)) * (1 - ink(q, width, blur))
    light = 190 + 30 * rng.uniform(-1, 1) * np.linspace(-1, 1, x.shape[1])
    grey = light * (0.3 + 0.7 * paper)
    hide(grey, rng.uniform(0.01, 0.10), rng)
    noisy = grey + rng.normal(0, rng.uniform(0.5, 3.0), grey.shape)
    return np.clip(np.round(noisy), 0, 255).astype(np.uint8), p, q


def ink(place: np.ndarray, width_px: float, blur_px: float) -> np.ndarray:
    """Share of ink across lines at whole numbers of `place`; the line's sides are straight over a pixel."""
    slope = np.hypot(*np.gradient(place))
    distance = (place - np.round(place)) / slope
    half = width_px / 2
    return special.ndtr((distance + half) / blur_px) - special.ndtr((distance - half) / blur_px)


def hide(grey: np.ndarray, share: float, rng: np.random.Generator) -> None:
    """Lay a grey patch over a share of the picture, in place."""
    height, width = grey.shape
    stretch = math.exp(rng.uniform(-0.5, 0.5))
    h, w = (round(side * math.sqrt(share) * s) for side, s in ((height, stretch), (width, 1 / stretch)))
    top, left = rng.integers(0, height - h), rng.integers(0, width - w)
    grey[top : top + h, left : left + w] = rng.uniform(40, 220)


def slipped(found: GridDetection, p: np.ndarray, q: np.ndarray) -> int:
    """Crossings whose index differs from the truth's by more than the common offset."""
    height, width = p.shape
    at = np.round(found.v_px).astype(int).clip(0, height - 1), np.round(found.u_px).astype(int).clip(0, width - 1)
    best = len(found.row)
    for column, row in ((p, q), (q, -p), (-q, p), (-p, -q)):
        off = np.stack([np.round(column[at]) - found.column, np.round(row[at]) - found.row])
        best = min(best, int(np.any(off != np.median(off, axis=1)[:, None], axis=0).sum()))
    return best


def trial(seed: int, number: int) -> Trial:
    """Draw one camera and its picture, and measure it as `fringecal commission` does."""
    rng = np.random.default_rng([seed, number])
    rig = draw_rig(rng)
    pitch_px = float(rng.uniform(18, 40))
    grey, p, q = picture(rig, pitch_px * (1 + PITCH_REL_U * rng.standard_normal()), rng)
    grid = find_grid(grey)
    stated = pitch_px * rig.camera.scale_mm_per_px
    height = Estimate(rig.camera.height_mm + HEIGHT_U_MM * rng.standard_normal(), HEIGHT_U_MM, "mm")
    fit = fit_grid_camera(grid, Estimate(stated, stated * PITCH_REL_U, "mm"), height_mm=height)
    k1, focal = rig.camera.distortion[0], rig.camera.height_mm / rig.camera.scale_mm_per_px
    test = examine_distortion(grid)
    radius = float(np.hypot(grid.u_px - (grey.shape[1] - 1) / 2, grid.v_px - (grey.shape[0] - 1) / 2).max()) / focal
    scale = fit.camera.scale("mean")
    return Trial(k1 * radius**3 * focal, test, scale, rig.camera.scale_mm_per_px, slipped(grid, p, q))


def run(seed: int, cameras: int) -> list[Trial]:
    """All trials that the detector did not refuse."""
    done = []
    for number in range(cameras):
        try:
            done.append(trial(seed, number))
        except FringecalError as error:
            print(f"camera {number}: {error}")
    return done


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--cameras", type=int, default=200)
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    trials = run(options.seed, options.cameras)
    above = [t for t in trials if abs(t.displacement_px) > t.test.detection_limit_px]
    straight = [t for t in trials if t.displacement_px == 0]
    alarms = [t for t in straight if t.test.verdict != "none"]
    errors = np.array([t.scale.value / t.true_scale - 1 for t in trials])
    z = np.array([t.scale_z for t in trials])
    print(f"measured: {len(trials)} of {options.cameras}; slipped crossings: {sum(t.slips for t in trials)}")
    print(f"verdict right above the limit: {sum(t.right for t in above)} of {len(above)} (bar 99 %)")
    print(f"false alarms: {len(alarms)} of {len(straight)}, {100 * len(alarms) / len(straight):.1f} % (bar 5 +- 2 %)")
    print(f"detection limit: median {np.median([t.test.detection_limit_px for t in trials]):.4f} px")
    print(f"scale error: median {np.median(np.abs(errors)):.1e}, 95 % {np.quantile(np.abs(errors), 0.95):.1e}")
    print(f"scale interval holds the truth: {100 * np.mean([t.covered for t in trials]):.1f} % (bar 93..97 %)")
    print(f"scale error over u: mean {z.mean():+.2f}, sd {z.std(ddof=1):.2f}")


if __name__ == "__main__":
    main()
