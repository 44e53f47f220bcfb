"""Demodulation against the kernel of `fringes` 2.1.0, in one run; without it the script says so and stops.

Run: bash benchmarks/peers.sh; .venv-peers/bin/python benchmarks/phase_peers.py [--rows N] [--threads N]. Three 8-bit
frames. Its kernel is called directly (`fringes.decoder_numba.decode`, no unwrapping), so that neither its checks nor
scikit-image count. CPU times, least of five turns, contestants by turns.
"""

import argparse
import sys
import time

import numba
import numpy as np

from fringecal.phase.demodulation.pixel_kernels import Limits, demodulate_plain
from fringecal.phase.demodulation.schemes import scheme

try:
    from fringes.decoder_numba import decode
except ImportError:
    decode = None


def frames_of(rows: int) -> np.ndarray:
    rng = np.random.default_rng(1)
    v, u = np.mgrid[:rows, :4096]
    steps = np.deg2rad([0, 120, 240])[:, None, None]
    clean = 120 + 80 * np.cos(2 * np.pi * (u + 0.3 * v) / 17 + steps)
    return np.clip(np.rint(clean + rng.standard_normal(clean.shape)), 0, 255).astype(np.uint8)


def main(rows: int, threads: int, turns: int = 5) -> None:
    if decode is None:
        sys.exit("fringes is not installed: run benchmarks/peers.sh and use .venv-peers/bin/python")
    numba.set_num_threads(threads)
    frames = frames_of(rows)
    flat, pixels = frames.reshape(3, -1), frames[0].size
    weights = np.column_stack([scheme("three-120").weights, np.zeros(3)]).astype(np.float32)
    limits = Limits(np.uint8(254), *map(np.float32, (0, 2, 0.25, 5, 0.15)))
    out = np.empty(pixels, np.float32), np.empty(pixels, np.float32), np.empty(pixels, np.uint8)
    stack = np.ascontiguousarray(frames[..., None])
    one, length = np.ones((1, 1)), np.array([4096.0])
    counts = np.array([[3]]), 4096 / 17 * one, one, length, np.array([17.0]), one, np.ones(1)
    jobs = {
        "fringecal": lambda: demodulate_plain(flat, weights, limits, *out),
        "fringes": lambda: decode(stack, *counts, unwrap=False),
    }
    times: dict[str, list[float]] = {name: [] for name in jobs}
    results = {name: job() for name, job in jobs.items()}  # compiled and warm
    for _ in range(turns):
        for name, job in jobs.items():
            start = time.process_time()
            job()
            times[name].append(time.process_time() - start)
    for name, seconds in times.items():
        print(f"{name:10s} {1e3 * min(seconds):9.1f} ms for {pixels / 1e6:.1f} Mpx, {threads} thread(s)")
    print(f"ratio {min(times['fringes']) / min(times['fringecal']):.1f} (bar >= 60)")
    # z = sum I exp(i (2 pi n / N + pi)): their phase is pi minus ours.
    theirs = results["fringes"][4].reshape(-1).astype(float)
    off = np.angle(np.exp(1j * (theirs + out[0] - np.pi)))
    print(f"  largest difference of the phases {np.nanmax(np.abs(off)):.1e} rad")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rows", type=int, default=3000)
    parser.add_argument("--threads", type=int, default=numba.get_num_threads())
    chosen = parser.parse_args()
    main(chosen.rows, chosen.threads)
