"""How often a verification by a rig with a board's calibration is right: En of sound artefacts is below 1.

    python benchmarks/board_verify_coverage.py --cases 40 --seed 1

Rigs and boards are those of `board_rig_coverage.py`, with cameras of 320 px; each measures a ball, a ball bar, a flat
and a block of steps in poses of their own. Lines of sight are OpenCV's, points on the artefacts are in closed form;
shadows and walls are left out. Printed: how many intervals of 95 % hold the certified value, by number, and how many
artefacts pass both checks of their pixels.
"""

import argparse
from dataclasses import replace
from types import SimpleNamespace

import cv2
import numpy as np

from board_rig_coverage import Drawn, capture, draw_board, draw_rig
from fringecal.errors import FitError
from fringecal.projector import BoardRig, fit_board_rig
from fringecal.reconstruct import volume_points
from fringecal.targets import parse_target
from fringecal.workflows.shared import VolumeCapture
from fringecal.workflows.verify import artefact_checks, judged_in_volume

WIDTH = 320
ABOUT = {"format": 1, "name": "drawn", "certificate": "virtual"}


def small_rig(rng: np.random.Generator) -> Drawn:
    """A rig as that benchmark draws it, with a small camera."""
    rig = draw_rig(rng)
    share = WIDTH / rig.camera.size[0]
    size = (WIDTH, round(share * rig.camera.size[1]))
    return replace(rig, camera=replace(rig.camera, size=size, matrix=np.diag([share, share, 1.0]) @ rig.camera.matrix))


def rays_of(rig: Drawn) -> np.ndarray:
    """Lines of sight (H, W, 3) of the true camera, z = 1."""
    width, height = rig.camera.size
    pixels = np.stack(np.meshgrid(np.arange(width), np.arange(height)), axis=-1).reshape(-1, 1, 2).astype(float)
    wanted = cv2.undistortPoints(pixels, rig.camera.matrix, None).reshape(-1, 2)
    ideal, still = wanted.copy(), np.zeros(3)
    for _ in range(40):  # a fixed point: the lens bends by some per cent
        there = np.column_stack([ideal, np.ones(len(ideal))])
        ideal += wanted - cv2.projectPoints(there, still, still, np.eye(3), rig.camera.terms)[0].reshape(-1, 2)
    return np.concatenate([ideal.reshape(-1, 2), np.ones((width * height, 1))], axis=1).reshape(height, width, 3)


def ball(rays: np.ndarray, centre: np.ndarray, radius: float) -> np.ndarray:
    """Depths at which rays meet a ball, NaN where they do not."""
    square, along = (rays**2).sum(axis=-1), rays @ centre
    with np.errstate(invalid="ignore"):
        return (along - np.sqrt(along**2 - square * (centre @ centre - radius**2))) / square


def facing(rng: np.random.Generator, most_deg: float) -> np.ndarray:
    """Rotation whose third column looks toward the camera, tilted by up to an angle to any side."""
    turn, tilt, way = rng.uniform(0, 2 * np.pi), np.radians(rng.uniform(0, most_deg)), rng.uniform(0, 2 * np.pi)
    spin = cv2.Rodrigues(np.array([0, 0, turn]))[0]
    return cv2.Rodrigues(tilt * np.array([np.cos(way), np.sin(way), 0]))[0] @ np.diag([1.0, -1.0, -1.0]) @ spin


def plane(rays: np.ndarray, turn: np.ndarray, at: np.ndarray, height: float = 0.0) -> np.ndarray:
    normal = turn[:, 2]
    return (normal @ at + height) / (rays @ normal)


def steps(rays: np.ndarray, turn: np.ndarray, at: np.ndarray, heights: list[float], size: float) -> np.ndarray:
    """Depths of a block of steps on its ground; walls are as dark as nothing."""
    depth = plane(rays, turn, at)
    edges = (np.arange(len(heights) + 1) - len(heights) / 2) * size
    for k, height in enumerate(heights):
        top = plane(rays, turn, at, height)
        local = (top[..., None] * rays - at) @ turn
        on = (local[..., 0] >= edges[k]) & (local[..., 0] < edges[k + 1]) & (np.abs(local[..., 1]) < size)
        depth = np.where(on & (top < depth), top, depth)
    return depth


def artefacts(rng: np.random.Generator, rig: Drawn, rays: np.ndarray):
    """Each target with the depths at which the camera sees it."""
    field, middle = rig.field, np.array([0.0, 0.0, rig.distance])
    move = lambda share: middle + field * rng.uniform(-share, share, 3) * [1, 0.7, 0.7]  # noqa: E731
    size, tiny = round(0.18 * field, 3), 1e-6 * field
    yield (
        parse_target(ABOUT | {"kind": "sphere", "diameter_mm": {"value": size, "u": tiny}}),
        ball(rays, move(0.12), size / 2),
    )
    arm, at, turn = round(0.45 * field, 3), move(0.05), facing(rng, 25)
    ends = [at + side * arm / 2 * turn[:, 0] * [1, 0.5, 1] for side in (-1, 1)]
    arm = float(np.linalg.norm(ends[1] - ends[0]))
    if arm > 1.5 * size:
        both = np.fmin(*(ball(rays, one, size / 2) for one in ends))
        sizes = {"value": [size, size], "u": tiny}
        yield (
            parse_target(ABOUT | {"kind": "ball-bar", "diameters_mm": sizes, "spacing_mm": {"value": arm, "u": tiny}}),
            both,
        )
    yield (
        parse_target(ABOUT | {"kind": "flat", "flatness_mm": {"value": 0, "u": tiny}}),
        plane(rays, facing(rng, 30), move(0.1)),
    )
    heights = [round(share * field, 3) for share in (0.03, 0.06, 0.09)]
    wide = {"value": [0.1 * field] * 3, "u": tiny}
    target = {"kind": "steps", "heights_mm": {"value": heights, "u": tiny}, "width_mm": wide,
              "length_mm": {"value": 0.2 * field, "u": tiny}}  # fmt: skip
    yield parse_target(ABOUT | target), steps(rays, facing(rng, 20), move(0.05), heights, 0.1 * field)


def seen_by(rng: np.random.Generator, rig: Drawn, fit: BoardRig, rays: np.ndarray, depth: np.ndarray) -> VolumeCapture:
    """The points that a capture of it gives."""
    points = (depth[..., None] * rays).reshape(-1, 3)
    known = np.isfinite(points).all(axis=1)
    place = np.full((len(points), 2), np.nan)
    place[known] = rig.read(points[known], rng)
    lit = ((place > 0) & (place < np.array(rig.projector.size) - 1)) | ~np.isfinite(place)
    place[~lit.all(axis=1)] = np.nan
    maps = place.T.reshape(2, *depth.shape)
    axes = [k for k in (0, 1) if np.isfinite(maps[k]).any()]
    u = tuple(float(rig.u_px * rig.rows[k]) if k in axes else 0.0 for k in (0, 1))
    column, row = (maps[k] if k in axes else None for k in (0, 1))
    u_px = np.stack([np.full(depth.shape, one, np.float32) for one in u])
    return VolumeCapture(maps, u_px, u, volume_points(fit, column, row, u_px=u, dtype=np.float64))


def fitted(rng: np.random.Generator) -> tuple[Drawn, BoardRig]:
    """A drawn rig, and what its board says of it."""
    rig = small_rig(rng)
    board = draw_board(rng, rig.field)
    poses = [capture(rng, rig, board, k) for k in range(int(rng.integers(8, 20)))]
    aspect = 2.0 if rig.projector.size == (912, 1140) else 1.0
    statement = board.statement
    return rig, fit_board_rig(poses, rig.camera.size, rig.projector.size, board=statement, projector_aspect=aspect).rig


def run(cases: int, seed: int, *, verbose: bool = False) -> None:
    held: dict[str, list[bool]] = {}
    refused: list[str] = []
    for case in range(cases):
        rng = np.random.default_rng([seed, case])
        rig, fit = fitted(rng)
        rays = rays_of(rig)
        for target, depth in artefacts(rng, rig, rays):
            try:
                found = judged_in_volume(
                    SimpleNamespace(name="drawn"), target, fit, seen_by(rng, rig, fit, rays, depth)
                )
            except FitError as error:
                refused.append(f"{case} {target.kind}: {error}")
                continue
            for reading in found.readings:
                if reading.en is not None:
                    name = reading.name.split(" ")[0] if "step" in reading.name else reading.name
                    held.setdefault(f"{target.kind} {name}", []).append(abs(reading.en) <= 1)
            for check in artefact_checks(found)[-2:]:
                held.setdefault(f"{target.kind} {check.name}", []).append(check.decision == "pass")
                if verbose and check.decision != "pass":
                    print(case, target.kind, check.name, round(check.value, 2), flush=True)
            if verbose:
                print(
                    case,
                    target.kind,
                    *(f"{r.name} {r.en:+.2f}" for r in found.readings if r.en is not None),
                    flush=True,
                )
    print(f"seed {seed}, {cases} rigs; refused {len(refused)}", *refused[:8], sep="\n  ")
    for name, shares in held.items():
        share = float(np.mean(shares))
        spread = 100 * np.sqrt(share * (1 - share) / len(shares))
        print(f"  {name:45s} {100 * share:5.1f} % of {len(shares)}, +- {spread:.1f}")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cases", type=int, default=40)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--verbose", action="store_true")
    options = parser.parse_args()
    run(options.cases, options.seed, verbose=options.verbose)


if __name__ == "__main__":
    main()
