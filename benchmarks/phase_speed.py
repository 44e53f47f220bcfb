"""Demodulation and unwrapping against OpenCV, numpy and scikit-image, in one run on one machine.

Run: python benchmarks/phase_speed.py [--small] [--threads N]. Ratios matter, not milliseconds: all jobs take
turns, and of each the median and the least time are shown, so that other work on the machine disturbs all alike.
"""

import argparse
import os
import time
from collections.abc import Callable

import cv2
import numba
import numpy as np

from fringecal.phase import Noise, demodulate, scheme, unwrap
from fringecal.phase.kernels import Limits, demodulate_plain

LIMITS = Limits(*map(np.float32, (255, 0, 2, 0.25, 5, 0.15)))


def in_turns(jobs: dict[str, Callable[[], object]], turns: int) -> dict[str, list[float]]:
    times: dict[str, list[float]] = {name: [] for name in jobs}
    for job in jobs.values():
        job()
    for _ in range(turns):
        for name, job in jobs.items():
            start = time.perf_counter()
            job()
            times[name].append(time.perf_counter() - start)
    return times


def opencv(frames: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    one, two, three = frames
    s = cv2.subtract(three, two, dtype=cv2.CV_32F) * np.float32(np.sqrt(3))
    c = cv2.addWeighted(one, 2.0, cv2.add(two, three, dtype=cv2.CV_32F), -1.0, 0.0, dtype=cv2.CV_32F)
    return cv2.phase(c, s), cv2.magnitude(c, s)


def plain_numpy(frames: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    one, two, three = frames.astype(np.float64)
    s, c = np.sqrt(3) * (three - two), 2 * one - two - three
    return np.arctan2(s, c), np.hypot(s, c) / 3


def demodulation(shape: tuple[int, int], turns: int) -> None:
    rng = np.random.default_rng(1)
    v, u = np.mgrid[: shape[0], : shape[1]]
    steps = np.deg2rad([0, 120, 240])
    clean = 120 + 80 * np.cos(2 * np.pi * (u + 0.3 * v) / 17 + steps[:, None, None])
    frames = np.clip(np.rint(clean + rng.standard_normal(clean.shape)), 0, 255).astype(np.uint8)
    flat, pixels = frames.reshape(3, -1), frames[0].size
    weights = np.column_stack([scheme("three-120").weights, np.zeros(3)]).astype(np.float32)
    phase, modulation = np.empty(pixels, np.float32), np.empty(pixels, np.float32)
    reasons = np.empty(pixels, np.uint8)
    half = np.empty(11 * pixels // 2, np.uint8)
    target = np.empty_like(half)
    full = demodulate(frames, steps, noise=Noise(1.0))

    def fresh() -> None:
        outputs = np.empty(pixels, np.float32), np.empty(pixels, np.float32), np.empty(pixels, np.uint8)
        demodulate_plain(flat, weights, LIMITS, *outputs)

    jobs = {
        "phase, modulation, mask; buffers reused": lambda: demodulate_plain(
            flat, weights, LIMITS, phase, modulation, reasons
        ),
        "the same, fresh buffers": fresh,
        "and background, u(phi); buffers reused": lambda: demodulate(frames, steps, noise=Noise(1.0), out=full),
        "OpenCV phase and magnitude": lambda: opencv(frames),
        "numpy float64": lambda: plain_numpy(frames),
        "copy of 11 bytes a pixel, read and write": lambda: np.copyto(target, half),
    }
    report(f"demodulation, {shape[1]} x {shape[0]}, three 8-bit frames", in_turns(jobs, turns))
    error = np.angle(np.exp(1j * (phase.reshape(shape) - plain_numpy(frames)[0])))
    print(f"  largest error against float64: {np.nanmax(np.abs(error)):.1e} rad")


def unwrapping(side: int, turns: int) -> None:
    from skimage.restoration import unwrap_phase

    v, u = np.mgrid[:side, :side] / side
    smooth = 60 * np.exp(-((u - 0.5) ** 2 + (v - 0.4) ** 2) / 0.08) + 40 * u * v
    for sigma in (0.0, 0.3):
        truth = smooth + sigma * np.random.default_rng(2).standard_normal(smooth.shape)
        wrapped = np.angle(np.exp(1j * truth))
        single = wrapped.astype(np.float32)
        jobs = {
            "fringecal": lambda w=wrapped: unwrap(w),
            "fringecal, float32 in": lambda w=single: unwrap(w),
            "scikit-image": lambda w=wrapped: unwrap_phase(w),
        }
        report(f"unwrapping, {side} x {side}, noise {sigma} rad", in_turns(jobs, turns))


def report(title: str, times: dict[str, list[float]]) -> None:
    print(title)
    first = np.array(next(iter(times.values())))
    for name, seconds in times.items():
        median, least = np.median(seconds), np.min(seconds)
        ratio = f"{median / np.median(first):7.2f} x {least / first.min():7.2f} x"
        print(f"  {name:42s} median {1e3 * median:8.1f} ms, least {1e3 * least:8.1f} ms  {ratio}")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--small", action="store_true", help="a quarter of the size along each side")
    parser.add_argument("--threads", type=int, default=numba.get_num_threads())
    arguments = parser.parse_args()
    numba.set_num_threads(arguments.threads)
    cv2.setNumThreads(arguments.threads)
    print(f"{arguments.threads} thread(s); load of the machine {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores")
    part = 4 if arguments.small else 1
    demodulation((3000 // part, 4096 // part), turns=9)
    unwrapping(2048 // part, turns=3)
