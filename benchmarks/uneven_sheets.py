"""Lens or sheet? Sheets whose lines stand off their places by 0.02 to 0.5 mm rms, without and with a lens.

    python benchmarks/uneven_sheets.py [first seed] [last seed]

Works on crossings: the verdict is asked, not the detection. Prints how often a lens is found where there is none (5 %
at most), and how often one that is larger than the limit stated beside it is found, with its direction (95 % at least).
"""

import sys

import numpy as np

from fringecal.camera import examine_distortion
from fringecal.detect import GridDetection, grid_of_crossings

WIDTH, HEIGHT = 1600, 1200
LEAST_MM, MOST_MM = 0.02, 0.5


def sheet(seed: int, lens_px: float = 0.0) -> GridDetection:
    """Draw an uneven ruling seen by a slightly tilted camera, and a lens that moves the outermost crossing so far."""
    rng = np.random.default_rng(seed)
    columns, rows = int(rng.integers(9, 36)), int(rng.integers(8, 28))
    pitch_mm = rng.uniform(5, 10)
    scale = min(WIDTH / (columns + 1), HEIGHT / (rows + 1)) / pitch_mm
    rms_mm = np.exp(rng.uniform(np.log(LEAST_MM), np.log(MOST_MM)))
    likeness = rng.uniform(0, 0.95)  # of one line's error with that of the next
    off_x, off_y = (rms_mm * _correlated(rng, count, likeness) for count in (columns, rows))
    row, column = np.mgrid[:rows, :columns]
    x = (column - (columns - 1) / 2) * pitch_mm + off_x[column]
    y = (row - (rows - 1) / 2) * pitch_mm + off_y[row]
    turn = np.radians(rng.uniform(-5, 5))
    x, y = x * np.cos(turn) - y * np.sin(turn), x * np.sin(turn) + y * np.cos(turn)
    depth = 1 + (rng.uniform(-0.05, 0.05) * x + rng.uniform(-0.05, 0.05) * y) / (columns * pitch_mm)
    u, v = scale * x / depth, scale * y / depth
    outermost = np.hypot(u, v).max()
    moved = 1 + lens_px * (u**2 + v**2) / outermost**3
    sigma = rng.uniform(0.01, 0.08)
    u, v = (np.ravel(at * moved + rng.normal(0, sigma, u.shape)) for at in (u, v))
    return grid_of_crossings(
        row.ravel(), column.ravel(), u + WIDTH / 2, v + HEIGHT / 2, shape=(HEIGHT, WIDTH), sigma_px=sigma
    )


def _correlated(rng: np.random.Generator, count: int, likeness: float) -> np.ndarray:
    """Return errors of variance 1, each like the one before."""
    errors = rng.normal(size=count)
    for k in range(1, count):
        errors[k] = likeness * errors[k - 1] + np.sqrt(1 - likeness**2) * errors[k]
    return errors


def main(first: int, last: int) -> None:
    """Print both rates; lenses are drawn from 0.7 to 4 times the limit of the sheet without a lens."""
    false = found = asked = 0
    for seed in range(first, last):
        without = examine_distortion(sheet(seed))
        false += without.verdict != "none"
        rng = np.random.default_rng([seed, 1])
        size = without.detection_limit_px * rng.uniform(0.7, 4) * rng.choice([-1, 1])
        test = examine_distortion(sheet(seed, size))
        if abs(size) >= test.detection_limit_px:
            asked += 1
            found += test.verdict == ("barrel" if size < 0 else "pincushion")
    print(f"{last - first} sheets without a lens: {false / (last - first):.1%} with a verdict of a lens")
    print(f"{asked} with a lens above the stated limit: {found / max(asked, 1):.1%} found")


if __name__ == "__main__":
    main(*(int(text) for text in [*sys.argv[1:], "1000", "1200"][:2]))
