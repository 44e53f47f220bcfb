"""Does the grid detector hold on hard pictures? Refusals, slipped indices, crossings found and how far off they are.

Run: python benchmarks/grid_pictures.py [--pictures 300] [--seed 1]. Every picture draws its own camera
(k1 from -0.3 to 0.3, tilt to 25 deg, rotation to 45 deg), sheet (lines 9 to 60 px apart, of one or two weights, dark
or light, filling the picture or not), light (gradient, glare, cast shadow with a hard edge), dirt, noise to 3 levels
and covers over 0 to 10 % of it. The place of every crossing is known in closed form.
"""

import argparse
import math
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from scipy import special

from fringecal.detect.grid.grid_search import GridDetection, find_grid
from fringecal.errors import FringecalError

SHAPE = (700, 900)
# A crossing nearer than this to a cover, a shadow's edge or the border is not asked for, px.
CLEAR_PX = 8
NEAR_PX = 0.25


@dataclass(frozen=True)
class Camera:
    """Pinhole with one radial term before a sheet: rotation and tilt of the sheet, pitch at the centre."""

    focal_px: float
    k1: float
    turn: np.ndarray
    pitch_px: float
    shift: np.ndarray

    def to_sheet(self, u: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Pixels to pitches on the sheet."""
        seen = (np.stack([u, v]) - self._middle(u)) / self.focal_px
        flat = seen
        for _ in range(60):
            flat = seen / (1 + self.k1 * (flat**2).sum(axis=0))
        ray = np.stack([flat[0], flat[1], np.ones_like(flat[0])])
        # The plane through (0, 0, 1) spanned by the first two columns of `turn`.
        scale = self.turn[2, 2] / np.einsum("i,i...->...", self.turn[:, 2], ray)
        at = scale * ray - np.array([0.0, 0.0, 1.0]).reshape(3, *[1] * (ray.ndim - 1))
        p, q = (np.einsum("i,i...->...", self.turn[:, k], at) for k in (0, 1))
        return p * self.focal_px / self.pitch_px + self.shift[0], q * self.focal_px / self.pitch_px + self.shift[1]

    def to_pixel(self, p: np.ndarray, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Pitches on the sheet to pixels."""
        x, y = ((place - s) * self.pitch_px / self.focal_px for place, s in zip((p, q), self.shift, strict=True))
        point = self.turn[:, :1] * x.ravel() + self.turn[:, 1:2] * y.ravel() + np.array([[0.0], [0.0], [1.0]])
        flat = (point[:2] / point[2]).reshape(2, *x.shape)
        bent = flat * (1 + self.k1 * (flat**2).sum(axis=0)) * self.focal_px + self._middle(x)
        return bent[0], bent[1]

    @staticmethod
    def _middle(like: np.ndarray) -> np.ndarray:
        return (np.array(SHAPE[::-1]) - 1.0).reshape(2, *[1] * like.ndim) / 2


@dataclass(frozen=True)
class Picture:
    """A picture, the camera that took it, and where its lines are in plain view."""

    grey: np.ndarray
    camera: Camera
    lines: int
    plain: np.ndarray


@dataclass(frozen=True)
class Outcome:
    """Crossings in plain view and those of them found; slipped ones, far ones, error over uncertainty."""

    visible: int
    found: int
    slipped: int
    far: int
    worst_px: float
    z: np.ndarray


def draw_camera(rng: np.random.Generator) -> Camera:
    """One camera whose picture is not folded by its lens."""
    focal = float(rng.uniform(900, 2500))
    k1 = float(rng.uniform(-0.3, 0.3)) if rng.random() < 0.7 else 0.0
    turn = _rotation(2, rng.uniform(-45, 45)) @ _rotation(0, rng.uniform(-25, 25)) @ _rotation(1, rng.uniform(-25, 25))
    return Camera(focal, k1, turn, float(np.exp(rng.uniform(np.log(9), np.log(60)))), rng.uniform(0, 1, 2))


def _rotation(axis: int, angle_deg: float) -> np.ndarray:
    c, s = math.cos(math.radians(angle_deg)), math.sin(math.radians(angle_deg))
    a, b = (k for k in range(3) if k != axis)
    matrix = np.eye(3)
    matrix[a, a], matrix[a, b], matrix[b, a], matrix[b, b] = c, -s, s, c
    return matrix


def draw_picture(rng: np.random.Generator) -> Picture:
    """One picture of a ruled sheet under bad light."""
    camera = draw_camera(rng)
    v, u = np.mgrid[: SHAPE[0], : SHAPE[1]].astype(float)
    p, q = camera.to_sheet(u, v)
    lines = int(rng.integers(4, 12)) if rng.random() < 0.3 else 10_000
    width, blur = rng.uniform(1.2, max(1.3, min(6, camera.pitch_px / 5))), rng.uniform(0.5, 1.1)
    heavy = (int(rng.choice([5, 10])), rng.uniform(1.5, 2.5)) if rng.random() < 0.3 else (1, 1.0)
    ink = _ruled(p, q, (width, blur), heavy, lines)
    grey = rng.uniform(150, 230) * (1 - rng.uniform(0.3, 0.85) * ink)
    plain = np.maximum(np.abs(p), np.abs(q)) < lines + 0.5
    grey, plain = _light(grey, plain, rng)
    plain = _cover(grey, plain, rng)
    if rng.random() < 0.2:
        grey = 255 - grey
    grey = grey + rng.normal(0, rng.uniform(0.5, 3.0), SHAPE)
    return Picture(np.clip(np.round(grey), 0, 255).astype(np.uint8), camera, lines, plain)


def _ruled(p: np.ndarray, q: np.ndarray, line: tuple[float, float], heavy: tuple[int, float], lines: int) -> np.ndarray:
    """Share of ink: lines of a width and blur, px, every n-th of them wider, on a sheet of so many lines each way."""
    paper = np.ones_like(p)
    for across, along in ((p, q), (q, p)):
        slope = np.hypot(*np.gradient(across))
        nearest = np.clip(np.round(across), -lines, lines)
        distance = np.abs(across - nearest) / slope
        half = 0.5 * line[0] * np.where(nearest % heavy[0] == 0, heavy[1], 1.0)
        ink = special.ndtr((half - distance) / line[1]) - special.ndtr((-half - distance) / line[1])
        paper *= 1 - ink * (np.abs(along) <= lines)
    return 1 - paper


def _light(grey: np.ndarray, plain: np.ndarray, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Gradient, vignetting, a patch of glare and a cast shadow; glare and shadow's edge are not in plain view."""
    v, u = np.mgrid[: SHAPE[0], : SHAPE[1]] / max(SHAPE) - 0.4
    grey = grey * (1 + rng.uniform(-0.4, 0.4) * u + rng.uniform(-0.4, 0.4) * v - rng.uniform(0, 0.8) * (u * u + v * v))
    if rng.random() < 0.4:
        at, size = rng.uniform(-0.35, 0.35, 2), rng.uniform(0.03, 0.1)
        glare = np.exp(-((u - at[0]) ** 2 + (v - at[1]) ** 2) / (2 * size**2))
        grey = grey + 180 * glare
        plain = plain & (grey < 250) & (glare < 0.5)
    if rng.random() < 0.4:
        angle, offset = rng.uniform(0, 2 * np.pi), rng.uniform(-0.2, 0.2)
        side = np.cos(angle) * u + np.sin(angle) * v - offset
        grey = grey * np.where(side > 0, rng.uniform(0.4, 0.8), 1.0)
        plain = plain & (np.abs(side) * max(SHAPE) > CLEAR_PX)
    return grey, plain


def _cover(grey: np.ndarray, plain: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Lay rectangles, discs and a ruler over up to 10 % of the picture, in place, and scatter dirt."""
    covers = np.zeros(SHAPE, np.uint8)
    share = rng.uniform(0, 0.1)
    while covers.mean() < share:
        at = rng.integers((0, 0), SHAPE[::-1])
        size = rng.uniform(15, 110, 2)
        if rng.random() < 0.5:
            cv2.fillPoly(covers, [cv2.boxPoints((at.tolist(), size.tolist(), rng.uniform(0, 90))).astype(int)], 1)
        else:
            cv2.circle(covers, at.tolist(), int(size.mean() / 2), 1, -1)
        new = covers == 1
        grey[new] = rng.uniform(10, 240)
    for _ in range(rng.integers(0, 60)):
        u, v = (int(rng.integers(0, size)) for size in SHAPE[::-1])
        dirt = np.zeros(SHAPE, np.uint8)
        cv2.circle(dirt, (u, v), int(rng.integers(1, 4)), 1, -1)
        grey[dirt == 1] *= rng.uniform(0.3, 1.2)
        covers |= dirt
    hidden = cv2.dilate(covers, np.ones((2 * CLEAR_PX + 1, 2 * CLEAR_PX + 1), np.uint8))
    return plain & (hidden == 0)


def judge(picture: Picture, grid: GridDetection) -> Outcome:
    """Compare a detection with the truth."""
    p, q = picture.camera.to_sheet(grid.u_px, grid.v_px)
    whole = np.round(np.stack([p, q])).astype(int)
    ways = ((whole[0], whole[1]), (whole[1], -whole[0]), (-whole[0], -whole[1]), (-whole[1], whole[0]))
    off = [np.stack([column - grid.column, row - grid.row]) for column, row in ways]
    slipped = min(int(np.any(each != np.median(each, axis=1)[:, None], axis=0).sum()) for each in off)
    u, v = picture.camera.to_pixel(*whole.astype(float))
    error = np.stack([grid.u_px - u, grid.v_px - v])
    worst = np.abs(error).max(axis=0)
    far = (worst > 0.05) & (worst > 8 * grid.sigma_px)
    wanted = _crossings_in_view(picture)
    seen = {tuple(each) for each in whole[:, np.hypot(*error) < NEAR_PX].T.tolist()}
    return Outcome(
        len(wanted), len(seen & wanted), slipped, int(far.sum()), float(worst.max()), (error / grid.sigma_px).ravel()
    )


def _crossings_in_view(picture: Picture) -> set[tuple[int, int]]:
    """Crossings whose surroundings are inside the picture and in plain view."""
    v, u = np.nonzero(picture.plain)
    p, q = picture.camera.to_sheet(u.astype(float), v.astype(float))
    some = np.unique(np.round(np.stack([p, q])).astype(int), axis=1)
    some = some[:, np.abs(some).max(axis=0) <= picture.lines]
    at_u, at_v = picture.camera.to_pixel(*some.astype(float))
    margin = 0.6 * picture.camera.pitch_px
    height, width = SHAPE
    inside = (at_u > margin) & (at_u < width - margin) & (at_v > margin) & (at_v < height - margin)
    row, column = (np.clip(np.round(x), 0, n - 1).astype(int) for x, n in ((at_v, height), (at_u, width)))
    return {tuple(each) for each in some[:, inside & picture.plain[row, column]].T.tolist()}


def draw_over(picture: Picture, grid: GridDetection | None, path: Path) -> None:
    """Write the picture at twice its size with the crossings and their indices."""
    canvas = cv2.cvtColor(cv2.resize(picture.grey, None, fx=2, fy=2), cv2.COLOR_GRAY2BGR)
    if grid is not None:
        for row, column, u, v in zip(grid.row, grid.column, grid.u_px, grid.v_px, strict=True):
            at = round(2 * u + 0.5), round(2 * v + 0.5)
            cv2.circle(canvas, at, 3, (0, 0, 255), -1)
            cv2.putText(canvas, f"{row},{column}", at, cv2.FONT_HERSHEY_SIMPLEX, 0.3, (255, 0, 0), 1)
    cv2.imwrite(str(path), canvas)


def run(seed: int, numbers: list[int], folder: Path | None) -> list[Outcome]:
    """Outcomes of the pictures that were not refused; says which were, and which slipped."""
    outcomes = []
    for number in numbers:
        picture = draw_picture(np.random.default_rng([seed, number]))
        grid, outcome = None, None
        try:
            grid = find_grid(picture.grey)
        except FringecalError as error:
            print(f"picture {number}: {len(_crossings_in_view(picture))} crossings in view: {error}", flush=True)
        if grid is not None:
            outcome = judge(picture, grid)
            outcomes.append(outcome)
            if outcome.slipped or outcome.found < 0.9 * outcome.visible:
                print(
                    f"picture {number}: {outcome.slipped} slipped; {outcome.found} of {outcome.visible} found",
                    flush=True,
                )
        if folder is not None:
            draw_over(picture, grid, folder / f"picture-{seed}-{number}.png")
    return outcomes


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--pictures", type=int, default=300)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--only", type=int, nargs="*", help="only these pictures, drawn into --out")
    parser.add_argument("--out", type=Path)
    options = parser.parse_args()
    done = run(options.seed, options.only or list(range(options.pictures)), options.out)
    total = {name: sum(getattr(each, name) for each in done) for name in ("visible", "found", "slipped", "far")}
    crossings = sum(each.z.size // 2 for each in done)
    z = np.concatenate([each.z for each in done])
    print(f"measured {len(done)} of {len(options.only or range(options.pictures))}; slipped: {total['slipped']}")
    print(
        f"found {total['found']} of {total['visible']} in plain view, {100 * total['found'] / total['visible']:.2f} %"
    )
    print(f"far off (8 u and 0.05 px): {total['far']} of {crossings}; worst {max(e.worst_px for e in done):.2f} px")
    print(
        f"error over u: median |z| {np.median(np.abs(z)):.2f} (0.67), {100 * np.mean(np.abs(z) < 2):.1f} % within 2 u"
    )


if __name__ == "__main__":
    main()
