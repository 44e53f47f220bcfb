"""A renderer of ruled grids of its own: Brown camera, tilt, rotation; box pixels by supersampling."""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import pytest
from scipy import special


@dataclass(frozen=True)
class VirtualGrid:
    """A square-on or tilted grid: `pitch_px` at the centre, lines `width_px` wide, Brown k1 at `focal_px`."""

    shape: tuple[int, int] = (400, 480)
    pitch_px: float = 24.0
    width_px: float = 3.0
    blur_px: float = 0.7
    rotation_deg: float = 0.0
    tilt: tuple[float, float] = (0.0, 0.0)
    k1: float = 0.0
    focal_px: float = 800.0
    shift_px: tuple[float, float] = (0.0, 0.0)
    lines: tuple[int, int] | None = None
    dark: float = 60.0
    light: float = 200.0
    supersampling: int = 5

    def to_plate(self, u, v):
        """Pixel -> grid coordinates in pitches; the Brown polynomial is inverted by fixed point."""
        height, width = self.shape
        x_seen = (u - (width - 1) / 2) / self.focal_px
        y_seen = (v - (height - 1) / 2) / self.focal_px
        x, y = x_seen, y_seen
        for _ in range(16 if self.k1 else 0):
            scale = 1 + self.k1 * (x * x + y * y)
            x, y = x_seen / scale, y_seen / scale
        w = 1 + self.tilt[0] * x + self.tilt[1] * y
        x, y = x / w * self.focal_px - self.shift_px[0], y / w * self.focal_px - self.shift_px[1]
        c, s = np.cos(np.radians(self.rotation_deg)), np.sin(np.radians(self.rotation_deg))
        return (c * x + s * y) / self.pitch_px, (-s * x + c * y) / self.pitch_px

    def to_pixel(self, p, q):
        """Grid coordinates in pitches -> pixel, closed form."""
        c, s = np.cos(np.radians(self.rotation_deg)), np.sin(np.radians(self.rotation_deg))
        a = ((c * p - s * q) * self.pitch_px + self.shift_px[0]) / self.focal_px
        b = ((s * p + c * q) * self.pitch_px + self.shift_px[1]) / self.focal_px
        w = 1 - self.tilt[0] * a - self.tilt[1] * b
        x, y = a / w, b / w
        scale = 1 + self.k1 * (x * x + y * y)
        height, width = self.shape
        return x * scale * self.focal_px + (width - 1) / 2, y * scale * self.focal_px + (height - 1) / 2

    def coverage(self):
        """Part of every pixel that is line, (H, W); drawn once for all tests of the same scene."""
        return _coverage(self).copy()

    def drawn(self):
        """Draw the coverage, by supersampling."""
        n = self.supersampling
        part = (np.arange(n) + 0.5) / n - 0.5
        total = np.zeros(self.shape)
        v, u = np.mgrid[: self.shape[0], : self.shape[1]].astype(float)
        for dv in part:
            for du in part:
                total += self._ink(*self.to_plate(u + du, v + dv))
        return total / n**2

    def _ink(self, p, q):
        paper = 1.0
        for value, across, count in ((p, q, 0), (q, p, 1)):
            nearest = np.round(value)
            if self.lines is not None:
                half = self.lines[count] // 2
                nearest = np.clip(nearest, -half, half)
            distance = np.abs(value - nearest) * self.pitch_px
            if self.blur_px:
                near = distance < self.width_px / 2 + 6 * self.blur_px  # beyond, less than 1e-9 of the ink
                ink, close = np.zeros_like(distance), distance[near]
                ink[near] = special.ndtr((self.width_px / 2 - close) / self.blur_px) - special.ndtr(
                    (-self.width_px / 2 - close) / self.blur_px
                )
            else:
                ink = (distance < self.width_px / 2).astype(float)
            if self.lines is not None:
                half = self.lines[1 - count] // 2
                ink = ink * (np.abs(across) * self.pitch_px <= half * self.pitch_px + self.width_px / 2)
            paper = paper * (1 - ink)
        return 1 - paper

    def picture(self, *, noise=0.0, seed=0, quantise=False):
        """Grey picture, float; with noise of that standard deviation; rounded to 8 bit on request."""
        grey = self.light + (self.dark - self.light) * self.coverage()
        if noise:
            grey = grey + np.random.default_rng(seed).normal(0, noise, grey.shape)
        return np.clip(np.round(grey), 0, 255).astype(np.uint8) if quantise else grey

    def index_errors(self, grid):
        """Offset of every detected index from the true one, and position errors (n, 2) in px."""
        p, q = self.to_plate(grid.u_px, grid.v_px)
        # A grid turned by more than 45 degrees has its columns along q.
        turn = np.round(self.rotation_deg / 90)
        column, row = {0: (p, q), 1: (-q, p), -1: (q, -p)}[int(turn)]
        slips = np.stack([np.round(column) - grid.column, np.round(row) - grid.row])
        u, v = self.to_pixel(np.round(p), np.round(q))
        return slips, np.stack([grid.u_px - u, grid.v_px - v], axis=1)


@lru_cache(maxsize=16)
def _coverage(scene):
    return scene.drawn()


@pytest.fixture
def virtual_grid():
    return VirtualGrid
