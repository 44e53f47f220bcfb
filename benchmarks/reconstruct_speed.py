"""Three 8-bit frames of 12 megapixels to x, y, z and u(z): time of every stage and memory, beside the bars.

Run: python benchmarks/reconstruct_speed.py [--small] [--scene hill|pleats|noise] [--threads N] [--cpu]. Compilation
is left out: every stage runs once on a smaller picture before the clock starts. On a machine that others use, --cpu
counts this process's own time and divides it by the threads, which is what they would need if all of it ran in
parallel.
"""

import argparse
import os
import resource
import time
from collections.abc import Callable

import cv2
import numba
import numpy as np

from fringecal.camera.plate.plate_camera import PlateCamera
from fringecal.phase import demodulate
from fringecal.projector.rig_calibration import RigCalibration
from fringecal.projector.rig_model import PlateResidual, RigModel, projector_point
from fringecal.reconstruct.object_phase import absolute_phase
from fringecal.reconstruct.phase_to_height import height_of_phase
from fringecal.uncertainty.components import UncertaintyComponent
from fringecal.uncertainty.influences import Influence

STEPS = np.deg2rad([0.0, 120.0, 240.0])
BAR_S, BAR_GB = 1.0, 1.5


def rig_of(shape: tuple[int, int]) -> RigCalibration:
    """A rig like the thesis's seen by a larger camera: lens k1, plate residual, 20 causes of uncertainty."""
    values = {"scale_mm_per_px": 470.0 / shape[1], "height_mm": 1500.0, "tilt_x_rad": 0.02, "k1": -0.1}
    camera = PlateCamera.from_values(values, shape)
    ratio = np.array([0.0, 0.785, -0.9594, 0.0, 0.0, -4e-4, -5.11e-4])
    residual = PlateResidual(5, 0.01 * np.cos(np.arange(21.0)), (-230.0, 230.0, -170.0, 170.0))
    model = RigModel(ratio, projector_point(ratio, near=np.array([0.0, 1222.0, 1000.0])), residual)
    effects = 1e-5 * np.random.default_rng(3).standard_normal((20, 12 + 7 + 21))
    components = tuple(UncertaintyComponent(Influence.INPUT, e, detail=str(k)) for k, e in enumerate(effects))
    return RigCalibration(camera, model, components, 0.004)


def frames_of(rig: RigCalibration, scene: str) -> np.ndarray:
    """Render row by row what the rig's own model sees of a hill or of pleats, with one grey level of noise."""
    height, width = rig.camera.height_px, rig.camera.width_px
    rng, frames = np.random.default_rng(1), np.empty((3, height, width), np.uint8)
    u = np.arange(width)
    for v in range(height):
        rays = rig.camera.rays(u, np.full(width, v))
        z = 25 * np.exp(-(rays.ax**2 + rays.ay**2) / 90**2)
        if scene == "pleats":
            z *= 0.6 + 0.4 * np.abs(rays.ax / 12.5 % 2 - 1)
        phase = rig.model.phase(*rays.at(z), z)
        noise = (8.0 if scene == "noise" else 1.0) * rng.standard_normal((3, width))
        frames[:, v] = np.clip(np.rint(120 + 80 * np.cos(phase + STEPS[:, None]) + noise), 0, 255)
    return frames


def run(frames: np.ndarray, rig: RigCalibration, clock: Callable[[], float]) -> dict[str, float]:
    start = clock()
    phase_map = demodulate(frames, STEPS)
    demodulated = clock()
    absolute = absolute_phase(phase_map, rig)
    unwrapped = clock()
    surface = height_of_phase(absolute, rig, dtype=np.float32)
    end = clock()
    assert surface.mask.mean() > 0.95
    return {
        "demodulation, u(phi)": demodulated - start,
        "step over the plate, regions, orders": unwrapped - demodulated,
        "x, y, z, u(z), reasons": end - unwrapped,
        "total": end - start,
    }


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--small", action="store_true", help="a quarter of the size along each side")
    parser.add_argument("--scene", choices=["hill", "pleats", "noise"], default="pleats")
    parser.add_argument("--threads", type=int, default=numba.get_num_threads())
    parser.add_argument("--cpu", action="store_true", help="count this process's own time, on a busy machine")
    arguments = parser.parse_args()
    numba.set_num_threads(arguments.threads)
    cv2.setNumThreads(arguments.threads)
    part = 4 if arguments.small else 1
    shape = (3000 // part, 4096 // part)
    own, share = (time.process_time, arguments.threads) if arguments.cpu else (time.perf_counter, 1)
    small = rig_of((1200, 1600))  # pleats of fewer pixels are masked
    run(frames_of(small, arguments.scene), small, own)
    compiled = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    rig = rig_of(shape)
    frames = frames_of(rig, arguments.scene)
    times = [run(frames, rig, own) for _ in range(5)]
    print(f"{shape[1]} x {shape[0]}, {arguments.scene}; {arguments.threads} thread(s); load {os.getloadavg()[0]:.1f}")
    for stage in times[0]:
        seconds = [t[stage] / share for t in times]
        print(f"  {stage:40s} least {min(seconds):6.3f} s, median {np.median(seconds):6.3f} s")
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    print(f"  least total {min(t['total'] for t in times) / share:.3f} s (bar {BAR_S} s)")
    print(f"  peak memory {peak / 1e6:.2f} GB (bar {BAR_GB} GB), {compiled / 1e6:.2f} GB before the large picture")
