"""Share of pixels of right order: fringecal's unwrapping against scikit-image, and kamui and OpenCV if present.

Run: python benchmarks/phase_orders.py [--side N] [--seeds N]; with kamui: bash benchmarks/peers.sh, then with
.venv-peers/bin/python. Truth is written down; the share is that of the most frequent order, so that a shift of the
whole map costs nothing. kamui is looked for and left out, with a word, if it is not installed.
"""

import argparse
import time

import cv2
import numpy as np
from skimage.restoration import unwrap_phase

from fringecal.phase import order_error_rate, unwrap, unwrap_guided, unwrap_temporal

try:
    import kamui
except ImportError:
    kamui = None


def right(found: np.ndarray, truth: np.ndarray) -> float:
    orders = np.rint((found - truth) / (2 * np.pi)).astype(int)
    return np.bincount((orders - orders.min()).ravel()).max() / orders.size


def scenes(side: int, rng: np.random.Generator) -> dict[str, np.ndarray]:
    v, u = np.mgrid[:side, :side] / side
    smooth = 60 * np.exp(-((u - 0.5) ** 2 + (v - 0.4) ** 2) / 0.08) + 40 * u * v
    plate = 2 * np.pi * v * side / 20
    strips = plate + sum(
        np.where((np.abs(u - 0.14 - 0.18 * k) < 0.045) & (np.abs(v - 0.5) < 0.4), 3.9 + 0.5 * v, 0) for k in range(5)
    )
    noise = rng.standard_normal(smooth.shape)
    torn = smooth + np.where((u > 0.5 + 0.1 * (v - 0.5)) & (v > 0.3), 9 * (v - 0.3), 0)
    return {
        "smooth": smooth,
        "noisy, 0.3 rad": smooth + 0.3 * noise,
        "strips": strips + 0.05 * noise,
        "zig-zag": 60 * np.abs((4 * u) % 1 - 0.5) + plate / 2 + 0.1 * noise,
        "torn": torn + 0.1 * noise,
        "torn, 0.3 rad": torn + 0.3 * noise,
    }


def histogram_unwrapper(wrapped: np.ndarray) -> np.ndarray:
    method = cv2.phase_unwrapping.HistogramPhaseUnwrapping
    parameters = method.Params()
    parameters.height, parameters.width = wrapped.shape
    return method.create(parameters).unwrapPhaseMap(wrapped.astype(np.float32))


def spatial(side: int, seeds: int) -> None:
    methods = {"fringecal": lambda w: unwrap(w).phase, "scikit-image": unwrap_phase}
    if hasattr(cv2, "phase_unwrapping"):
        methods["OpenCV histogram"] = histogram_unwrapper
    if kamui is None:
        print("kamui is not installed and left out: see benchmarks/peers.sh")
    else:
        methods["kamui"] = kamui.unwrap_dimensional
    for method in methods.values():
        method(np.zeros((64, 64)))  # compiled and warm
    title = f"right order, {side} x {side}, mean of {seeds}"
    print(f"{title:36s}" + "".join(f"{m:>24s}" for m in methods))
    found: dict[str, dict[str, list[tuple[float, float]]]] = {}
    for seed in range(seeds):
        for name, truth in scenes(side, np.random.default_rng(5 + seed)).items():
            wrapped = np.angle(np.exp(1j * truth))
            for title, method in methods.items():
                if title == "OpenCV histogram" and "0.3 rad" in name and side > 256:
                    continue  # minutes
                start = time.process_time()
                share = right(method(wrapped), truth)
                seconds = time.process_time() - start
                found.setdefault(name, {}).setdefault(title, []).append((share, seconds))
    for name, by_method in found.items():
        cells = [np.mean(by_method[m], axis=0) if m in by_method else None for m in methods]
        shown = ("not run" if c is None else f"{c[0]:.4%} in {1e3 * c[1]:6.0f} ms" for c in cells)
        print(f"{name:36s}" + "".join(f"{cell:>24s}" for cell in shown))


def by_evidence(side: int) -> None:
    rng = np.random.default_rng(8)
    v = np.mgrid[:side, :side][0] / side
    truth, plate = scenes(side, rng)["strips"], 2 * np.pi * v * side / 20
    print("strips by evidence      right order        predicted, two periods of ratio 8")
    for sigma in (0.05, 0.1, 0.3):
        fine = np.angle(np.exp(1j * (truth + sigma * rng.standard_normal(truth.shape))))
        guided, _ = unwrap_guided(fine, plate, -0.7, 5.1)
        two = unwrap_temporal(truth / 8 + sigma * rng.standard_normal(truth.shape), fine, 8.0)
        rate = float(order_error_rate(sigma, sigma, 8.0))
        shares = [(np.abs(found - truth) < np.pi).mean() for found in (guided, two)]
        print(f"noise {sigma:4.2f} rad   known heights {shares[0]:.4%}, two periods {shares[1]:.4%}   {1 - rate:.4%}")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--side", type=int, default=512)
    parser.add_argument("--seeds", type=int, default=4)
    chosen = parser.parse_args()
    spatial(chosen.side, chosen.seeds)
    by_evidence(chosen.side)
