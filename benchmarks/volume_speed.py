"""Twelve frames of 12 megapixels to x, y, z and their u, by a rig with an inverse camera.

    python benchmarks/volume_speed.py [--small] [--cpu]

Three steps of four periods (912, 228, 57 and 14.25 px of 912) are drawn of a plane with one grey level of noise.
Compilation is left out: each stage runs once before the clock starts. On a machine that others use, --cpu counts this
process's own time and divides it by the threads, which is what they would need in parallel.
"""

import argparse
import sys
import time
from dataclasses import replace
from pathlib import Path

import numba
import numpy as np

sys.path.insert(0, str(Path(__file__).parent))
from board_rig_coverage import capture, draw_board, draw_rig
from fringecal.phase import raster_of_frames
from fringecal.projector import fit_board_rig
from fringecal.reconstruct import volume_points

STEPS = np.deg2rad([0.0, 120.0, 240.0])
PERIODS = (912.0, 228.0, 57.0, 14.25)
BAR_S = 1.5


def drawn(size: tuple[int, int]):
    """A fitted rig whose camera has a size, and the projector's columns over its picture, of a plane."""
    rng = np.random.default_rng([2, 4])
    rig = replace(draw_rig(rng), axes=2)
    scale = np.array(size) / np.array(rig.camera.size)
    matrix = np.diag([*scale, 1.0]) @ rig.camera.matrix
    rig = replace(rig, camera=replace(rig.camera, size=size, matrix=matrix))
    board = draw_board(rng, rig.field)
    fit = fit_board_rig([capture(rng, rig, board, k) for k in range(15)], size, rig.projector.size).rig
    columns = np.empty(size[::-1])
    for v in range(size[1]):
        rays = fit.camera.unproject(np.column_stack([np.arange(size[0]), np.full(size[0], v)]).astype(float))
        columns[v] = fit.project(rig.distance * rays)[:, 0]
    low, high = columns.min(), columns.max()
    return fit, columns, low, high


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--small", action="store_true", help="1 Mpx")
    parser.add_argument("--cpu", action="store_true")
    options = parser.parse_args()
    size = (1280, 820) if options.small else (4096, 3000)
    fit, columns, low, high = drawn(size)
    extent = float(fit.projector.width_px)
    periods = tuple(p * extent / 912 * max(1.0, 1.05 * (high - low) / extent) for p in PERIODS)
    rng, frames = np.random.default_rng(1), []
    for period in periods:
        one = np.empty((3, *columns.shape), np.uint8)
        for n, step in enumerate(STEPS):
            noise = rng.standard_normal(columns.shape, np.float32)
            one[n] = np.clip(np.rint(120 + 80 * np.cos(2 * np.pi * columns / period + step) + noise), 0, 255)
        frames.append(one)
    clock = time.process_time if options.cpu else time.perf_counter
    share = numba.get_num_threads() if options.cpu else 1
    raster_of_frames([f[:, :64] for f in frames], STEPS, periods, extent)
    volume_points(fit, np.full(columns.shape, 400.0), u_px=0.02)
    for _ in range(3):
        start = clock()
        place = raster_of_frames(frames, STEPS, periods, extent)
        middle = clock()
        points = volume_points(fit, place.px, u_px=float(np.nanmedian(place.u_px[::50, ::50])))
        end = clock()
        total = (end - start) / share
        print(
            f"{columns.size / 1e6:.1f} Mpx: frames to columns {(middle - start) / share:.2f} s, columns to points "
            f"{(end - middle) / share:.2f} s, together {total:.2f} s (bar {BAR_S} s); {points.mask.mean():.1%} of all"
        )


if __name__ == "__main__":
    main()
