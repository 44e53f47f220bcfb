"""A board seen by a known lens: its own few lines of projection, for the tests of the lens."""

from dataclasses import dataclass

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from fringecal.camera.lens.brown_lens import Lens
from fringecal.camera.lens.lens_solve import BoardView

POSES = (
    (30, 0, 5, 420), (-30, 5, 0, 450), (0, 30, 10, 430), (5, -30, 0, 460), (25, 25, 90, 480),
    (-25, 20, 45, 440), (20, -25, 15, 430), (-20, -25, -60, 470), (10, 0, 0, 330), (0, 12, 30, 340),
)  # fmt: skip


@dataclass(frozen=True)
class Boards:
    """A 9 x 6 board of 25 mm before a camera of 640 x 480 px."""

    shape: tuple[int, int] = (480, 640)
    truth: tuple[float, ...] = (810.0, 812.0, 325.0, 236.0, -0.2, 0.08, 0.001, -0.0005, 0.0)
    poses: tuple[tuple[float, ...], ...] = POSES
    spread_mm: float = 40.0

    @property
    def lens(self):
        return Lens(np.array(self.truth), np.zeros((9, 9)), self.shape[1], self.shape[0])

    def seen(self, poses=None, *, noise_px=0.0, seed=0, bow_mm=0.0, project=None):
        """Views of the board posed by (turn about x, about y, about z in deg, distance in mm)."""
        rng = np.random.default_rng(seed)
        row, column = np.mgrid[:6, :9]
        x, y = 25.0 * (column - 4.0), 25.0 * (row - 2.5)
        board = np.stack([x, y, bow_mm * (1 - (x / 100.0) ** 2)], axis=-1).reshape(-1, 3)
        views = []
        for k, (a, b, c, distance) in enumerate(self.poses if poses is None else poses):
            turned = Rotation.from_euler("xyz", (a, b, c), degrees=True).apply(board)
            aside = self.spread_mm * np.array([np.cos(2.4 * k), 0.75 * np.sin(2.4 * k)])
            points = (project or self.lens.project)(turned + [*aside, distance])
            views.append(BoardView((points + rng.normal(0, noise_px, points.shape)).reshape(6, 9, 2), 25.0))
        return views


@pytest.fixture(scope="session")
def boards():
    return Boards()
