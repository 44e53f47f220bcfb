"""Do forecast heights hold, and are moved lamps found, over more rigs than the tests draw?

Run: python benchmarks/rig_statements.py [--rigs 200] [--lamps 60]. The rigs are those of `tests/projector`: perturbed
at the level of observations, with everything drawn that a session states. First the spread of heights 28 mm up (bars on
strips of 3 mm, then with a step block of 30 mm) over what one calibration states; then lamps that stand 0, 5, 20 and
50 mm from where they are said to stand.
"""

import argparse
import importlib.util
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np

from fringecal.camera.plate.plate_fit import CameraFit
from fringecal.projector.rig_calibration import calibrate_rig

TESTS = Path(__file__).parents[1] / "tests" / "projection"
DRAWS = 12  # calibrations whose statements are averaged: one draw says little of the scatter of few blocks


def drawn_in(name: str) -> ModuleType:
    """Load a module of tests for the rigs that it draws."""
    spec = importlib.util.spec_from_file_location(name, TESTS / f"{name}.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def spread_over_stated(rigs: ModuleType, camera: CameraFit, *, with_block: bool) -> np.ndarray:
    """Return the spread of heights over the stated u, at five places of the field."""
    spread, (u, v) = rigs.found_spread(camera, with_block)
    true = (0.0, 3.0, 30.0) if with_block else (0.0, 3.0)
    variances = []
    for seed in range(DRAWS):
        observed = rigs.observed(true, np.random.default_rng(seed))
        calibration, _ = calibrate_rig(observed, camera, residual_degree=rigs.DEGREE)
        variances.append(rigs.stated(calibration, 28.0, u, v) ** 2)
    return np.asarray(spread / np.sqrt(np.mean(variances, axis=0)))


def lamps_right(lamps: ModuleType, calibration: Any, size_mm: float, number: int) -> tuple[int, int]:
    """Count moved lamps that are clearly beyond their uncertainty, and those of which the truth is told."""
    rng = np.random.default_rng(int(size_mm) + 100)
    told = [lamps.told(calibration, size_mm, turn, rng) for turn in 2 * np.pi * (np.arange(number) + 0.5) / number]
    return sum(sure for sure, _ in told), sum(right for _, right in told)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rigs", type=int, default=200)
    parser.add_argument("--lamps", type=int, default=60)
    options = parser.parse_args()
    heights, lamps = drawn_in("test_forecast"), drawn_in("test_moved_lamp")
    heights.TRIALS = options.rigs
    camera = heights.grid_camera()
    for with_block in (False, True):
        ratio = spread_over_stated(heights, camera, with_block=with_block)
        print(f"{'with' if with_block else 'without'} a block: spread over stated u of 28 mm {ratio.round(3)}")
    calibration = lamps.calibrated(lamps.grid_camera())
    for size in (0.0, 5.0, 20.0, 50.0):
        sure, right = lamps_right(lamps, calibration, size, options.lamps)
        print(
            f"lamp moved by {size:g} mm: told right {right} of {options.lamps}, {sure} clearly beyond their uncertainty"
        )


if __name__ == "__main__":
    main()
