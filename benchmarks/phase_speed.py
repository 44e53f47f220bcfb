"""Demodulation and unwrapping against OpenCV, numpy and scikit-image, in one run on one machine.

Run: python benchmarks/phase_speed.py [--small] [--threads N] [--cpu]. Ratios matter, not milliseconds: all jobs take
turns, and of each the median and the least time are shown, so that other work on the machine disturbs all alike.
Ratios are of least times, each beside its bar. Every contestant gives the same: float32 phase (NaN where masked),
modulation in grey levels, and one byte of reasons (saturated, dark, low modulation); OpenCV by its own functions,
once with buffers that are reused throughout and once with fresh ones, as a plain call makes them, and once as it is
mostly written, numpy's arithmetic before cv2.phase and cv2.magnitude. On a machine that
others use, --threads 1 --cpu counts this process's own time alone.
"""

import argparse
import os
import time
from collections.abc import Callable

import cv2
import numba
import numpy as np

from fringecal.phase import Noise, demodulate, scheme, unwrap
from fringecal.phase.demodulation.pixel_kernels import Limits, demodulate_plain

LIMITS = Limits(np.uint8(254), *map(np.float32, (0, 2, 0.25, 5, 0.15)))


def in_turns(jobs: dict[str, Callable[[], object]], turns: int, clock: Callable[[], float]) -> dict[str, list[float]]:
    times: dict[str, list[float]] = {name: [] for name in jobs}
    for job in jobs.values():
        job()
    for _ in range(turns):
        for name, job in jobs.items():
            start = clock()
            job()
            times[name].append(clock() - start)
    return times


class OpenCV:
    """The three-step formula in OpenCV's functions; `fresh` lets OpenCV allocate each result."""

    def __init__(self, shape: tuple[int, int], *, fresh: bool) -> None:
        kinds = 5 * [np.float32] + 3 * [np.uint8]
        buffers = [None if fresh else np.empty(shape, kind) for kind in kinds]
        self.s, self.c, self.a, self.phase, self.modulation, self.peak, self.flag, self.reasons = buffers

    def __call__(self, frames: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        one, two, three = frames
        a = cv2.add(two, three, self.a, dtype=cv2.CV_32F)
        s = cv2.subtract(three, two, self.s, dtype=cv2.CV_32F)
        c = cv2.addWeighted(one, 2 / 3, a, -1 / 3, 0.0, self.c, dtype=cv2.CV_32F)
        a = cv2.addWeighted(one, 1 / 3, a, 1 / 3, 0.0, a, dtype=cv2.CV_32F)
        s = cv2.multiply(s, 3**-0.5, s)
        phase, modulation = cv2.phase(c, s, self.phase), cv2.magnitude(c, s, self.modulation)
        peak = cv2.max(cv2.max(one, two, self.peak), three, self.peak)
        reasons = cv2.bitwise_and(cv2.compare(peak, 255, cv2.CMP_GE, self.reasons), 1, self.reasons)
        for value, map_, least in ((2, a, 0.0), (4, modulation, 2.0)):
            flag = cv2.bitwise_and(cv2.compare(map_, least, cv2.CMP_LT, self.flag), value, self.flag)
            reasons = cv2.bitwise_or(reasons, flag, reasons)
        cv2.copyTo(NOT_A_NUMBER[: phase.shape[0], : phase.shape[1]], reasons, phase)
        return phase, modulation, reasons


NOT_A_NUMBER = np.full((3000, 4096), np.nan, np.float32)


def numpy_then_opencv(frames: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The same as it is mostly written: numpy's arithmetic in float32, then cv2.phase and cv2.magnitude."""
    one, two, three = frames.astype(np.float32)
    s, c = (three - two) * np.float32(3**-0.5), (2 * one - two - three) / 3
    phase, modulation = cv2.phase(c, s), cv2.magnitude(c, s)
    reasons = (frames.max(axis=0) >= 255) + 2 * ((one + two + three) / 3 < 0) + 4 * (modulation < 2)
    phase[reasons > 0] = np.nan
    return phase, modulation, reasons.astype(np.uint8)


def plain_numpy(frames: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    one, two, three = frames.astype(np.float64)
    s, c, a = (three - two) / np.sqrt(3), (2 * one - two - three) / 3, (one + two + three) / 3
    modulation = np.hypot(s, c)
    reasons = (frames.max(axis=0) >= 255) + 2 * (a < 0) + 4 * (modulation < 2)
    return np.where(reasons == 0, np.arctan2(s, c), np.nan), modulation, reasons.astype(np.uint8)


def demodulation(shape: tuple[int, int], turns: int, clock: Callable[[], float]) -> None:
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

    reused, unused = OpenCV(shape, fresh=False), OpenCV(shape, fresh=True)
    jobs = {
        "phase, modulation, mask; buffers reused": lambda: demodulate_plain(
            flat, weights, LIMITS, phase, modulation, reasons
        ),
        "the same, fresh buffers": fresh,
        "and background, u(phi); buffers reused": lambda: demodulate(frames, steps, noise=Noise(1.0), out=full),
        "OpenCV, buffers reused": lambda: reused(frames),
        "OpenCV, fresh buffers": lambda: unused(frames),
        "numpy, then cv2.phase and cv2.magnitude": lambda: numpy_then_opencv(frames),
        "numpy float64": lambda: plain_numpy(frames),
        "copy of 11 bytes a pixel, read and write": lambda: np.copyto(target, half),
    }
    times = in_turns(jobs, turns, clock)
    report(f"demodulation, {shape[1]} x {shape[0]}, three 8-bit frames", times)
    ours, fresh_, full_, cv_reused, cv_fresh, mixed, float64, copied = (min(seconds) for seconds in times.values())
    bars = {
        "OpenCV / reused": (cv_reused / ours, ">= 15"),
        "OpenCV / fresh": (cv_fresh / fresh_, ">= 8"),
        "numpy + OpenCV / reused": (mixed / ours, "none: as mostly written"),
        "numpy float64 / reused": (float64 / ours, ">= 50"),
        "reused / copy": (ours / copied, "<= 1.5"),
        "with u(phi) / without": (full_ / ours, "<= 2"),
    }
    for name, (ratio, bar) in bars.items():
        print(f"  {name:24s} {ratio:7.2f}   (bar {bar})")
    error = np.angle(np.exp(1j * (phase.reshape(shape) - plain_numpy(frames)[0])))
    print(f"  largest error against float64: {np.nanmax(np.abs(error)):.1e} rad")


def unwrapping(side: int, turns: int, clock: Callable[[], float]) -> None:
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
        times = in_turns(jobs, turns, clock)
        report(f"unwrapping, {side} x {side}, noise {sigma} rad", times)
        print(f"  scikit-image / fringecal {min(times['scikit-image']) / min(times['fringecal']):7.2f}   (bar >= 10)")


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
    parser.add_argument("--cpu", action="store_true", help="count this process's own time, on a busy machine")
    arguments = parser.parse_args()
    numba.set_num_threads(arguments.threads)
    cv2.setNumThreads(arguments.threads)
    print(f"{arguments.threads} thread(s); load of the machine {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores")
    part = 4 if arguments.small else 1
    clock = time.process_time if arguments.cpu else time.perf_counter
    demodulation((3000 // part, 4096 // part), 9, clock)
    unwrapping(2048 // part, 3, clock)
