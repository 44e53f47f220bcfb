"""Gray codes as cameras see them: edges blurred by 1 to 6 px, a projector's response, noise, texture and shadows.

    python benchmarks/gray_edges.py [first seed] [last seed]

prints every set below the bar (99.9 % of the decided pixels right, 95 % decided) and the rates over all.
"""

import sys
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from fringecal.errors import PhaseError
from fringecal.phase import summarise
from fringecal.phase.orders.gray_orders import orders_by_gray

SHAPE = (240, 320)
V, U = np.mgrid[: SHAPE[0], : SHAPE[1]].astype(float)
# Samples of the projected pattern for each fringe: a thirtieth of the narrowest blur drawn.
SAMPLES = 200
MIN_RIGHT, MIN_DECIDED = 0.999, 0.95


@dataclass(frozen=True)
class GraySet:
    """Frames of fringes and code, the true phase in rad, and which pixels are lit and within the code."""

    fringes: NDArray
    phase_shifts_rad: NDArray
    codes: NDArray
    truth: NDArray
    seen: NDArray
    blur_px: float


def gray_set(seed: int) -> GraySet:
    """Draw a wall with one to three raised pieces; the blur is a quarter of a fringe at most."""
    rng = np.random.default_rng(seed)
    blur = rng.uniform(1, 6)
    period = max(rng.uniform(12, 40), 4.2 * blur)
    bits = int(np.ceil(np.log2(SHAPE[1] / period + 4))) + int(rng.integers(0, 2))
    raised, lit = _scene(rng, period)
    x = 1.6 + U / period + rng.uniform(-0.2, 0.2) * V / period + raised
    start = rng.uniform(-0.5, 0.5)
    fine = np.linspace(-3, 2**bits + 3, (2**bits + 6) * SAMPLES)
    number = np.clip(np.floor(fine - start), 0, 2**bits - 1).astype(int)
    gray = number ^ (number >> 1)
    gamma = rng.uniform(1, 2.4) if rng.uniform() < 0.6 else 1.0
    texture = ndimage.gaussian_filter(rng.normal(0, 1, SHAPE), rng.uniform(0.6, 3))
    texture = np.clip(0.55 + 0.25 * texture / texture.std() * rng.uniform(0, 0.9), 0.12, 1)
    ambient, noise, mixed = rng.uniform(3, 40), rng.uniform(0.8, 3), rng.uniform(0, 1)
    gain = min(rng.uniform(110, 200), 245 - ambient - 4 * noise)  # exposed without saturation

    def seen(pattern: NDArray) -> NDArray:
        light = np.interp(x, fine, ndimage.gaussian_filter1d(pattern, blur / period * SAMPLES))
        image = ndimage.gaussian_filter(ambient + gain * texture * lit * light, mixed)
        return np.clip(np.rint(image + rng.normal(0, noise, SHAPE)), 0, 255)

    codes = [seen((gray >> (bits - 1 - k) & 1) * rng.uniform(0.9, 1.0)) for k in range(bits)]
    shifts = np.deg2rad([0, 90, 180, 270] if rng.uniform() < 0.5 else [0, 120, 240])
    fringes = [seen((0.5 + 0.5 * np.cos(2 * np.pi * fine + shift)) ** gamma) for shift in shifts]
    within = (x > start) & (x < start + 2**bits - 1) & (lit > 0.5)
    return GraySet(np.array(fringes), shifts, np.array(codes), 2 * np.pi * x, within, blur)


def _scene(rng: np.random.Generator, period: float) -> tuple[NDArray, NDArray]:
    """Raise boxes and discs by 0.3 to 3 fringes, slanting, each with a shadow beside it."""
    raised, lit = np.zeros(SHAPE), np.ones(SHAPE)
    for _ in range(rng.integers(1, 4)):
        u, v = rng.uniform(60, SHAPE[1] - 60), rng.uniform(50, SHAPE[0] - 50)
        a, b = rng.uniform(20, 60, 2)
        box = (np.abs(U - u) < a) & (np.abs(V - v) < b)
        there = box if rng.uniform() < 0.6 else ((U - u) / a) ** 2 + ((V - v) / b) ** 2 < 1
        height = rng.uniform(0.3, 3)
        raised = np.where(there, height + rng.uniform(-0.5, 0.5) * (U - u) / a, raised)
        end = u + a + rng.uniform(0, 0.45) * period * height
        lit = np.where((np.abs(V - v) < b) & (u + a < U) & (end > U) & ~there, 0.03, lit)
    return raised, lit


def rates(drawn: GraySet) -> tuple[float, float]:
    """Return the share of decided pixels that are right, and the share of pixels with a phase that are decided."""
    map_ = summarise(drawn.fringes.astype(np.uint8), drawn.phase_shifts_rad, white_level=255).map  # as the verb does
    orders = orders_by_gray(map_, drawn.codes)
    off = (orders.phase - drawn.truth) / (2 * np.pi)
    decided = np.isfinite(off) & drawn.seen
    whole = np.round(off[decided] - np.median(off[decided]))  # a code's number 0 may lie anywhere
    return float(np.mean(whole == 0)), float(decided.sum() / max((map_.valid & drawn.seen).sum(), 1))


def main(first: int, last: int) -> None:
    """Print what falls below the bar, and the rates."""
    found = []
    for seed in range(first, last):
        drawn = gray_set(seed)
        try:
            found.append(rates(drawn))
        except PhaseError as error:
            found.append((0.0, 0.0))
            print(f"{seed}: refused: {error}")
            continue
        if found[-1][0] < MIN_RIGHT or found[-1][1] < MIN_DECIDED:
            print(f"{seed}: {found[-1][0]:.3%} right, {found[-1][1]:.2%} decided, blur {drawn.blur_px:.1f} px")
    right, decided = np.transpose(found)
    print(f"{len(found)} sets: {right.mean():.3%} of decided pixels right, {decided.mean():.2%} decided")
    print(
        f"sets with {MIN_RIGHT:.1%} right: {np.mean(right >= MIN_RIGHT):.0%}; with {MIN_DECIDED:.0%} decided: ", end=""
    )
    print(f"{np.mean(decided >= MIN_DECIDED):.0%}")


if __name__ == "__main__":
    main(*(int(text) for text in [*sys.argv[1:], "1000", "1100"][:2]))
