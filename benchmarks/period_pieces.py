"""Absolute phase by periods where the picture is in pieces: board poses, gaps, objects, random lists of periods.

    python benchmarks/period_pieces.py [first seed] [last seed]

prints every set with a pixel of the wrong fringe, and the rates over all: decided, and wrong over decided. Each set is
counted twice: by the periods alone, and with the length of the projected picture stated.
"""

import sys
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from fringecal.errors import PhaseError
from fringecal.phase import absolute_phase, decide_orders

SHAPE = (240, 320)
V, U = np.mgrid[: SHAPE[0], : SHAPE[1]].astype(float)


@dataclass(frozen=True)
class PeriodSet:
    """Wrapped phases of all periods with their noise, periods, fringes projected, and the true phase, rad."""

    phases: NDArray
    sigmas: NDArray
    periods: tuple[float, ...]
    projected: float
    truth: NDArray
    offset_rad: float


def period_set(seed: int) -> PeriodSet:
    """Draw a scene of a plane and objects, seen in pieces, under a list of periods."""
    rng = np.random.default_rng(seed)
    ratios, projected = _list_of_periods(rng)
    width = rng.uniform(0.35, 1.0)  # share of the projected picture that the camera sees on the plane
    left = rng.uniform(0, 1 - width)
    turn = np.deg2rad(rng.uniform(-25, 25))
    along = ((U - 160) * np.cos(turn) + (V - 120) * np.sin(turn)) / 400 + 0.5
    along += rng.uniform(-0.25, 0.25) * (along - 0.5) ** 2  # perspective
    place = left + width * np.clip(along, 0, 1)
    disparity = width * rng.uniform(0.02, 0.6)  # of the highest object: at 30 deg as high as the picture is wide
    seen, plane = np.ones(SHAPE, bool), place
    for _ in range(rng.integers(0, 4)):
        there, beside = _object(rng)
        place = np.where(there, plane + disparity * rng.uniform(0.2, 1) * rng.choice([-1, 1]), place)
        seen &= ~(beside & ~there)
    seen &= _pieces(rng) & (place > 0) & (place < 1) & (along > 0) & (along < 1)
    truth = 2 * np.pi * projected * place
    offset = rng.choice([0.0, -np.pi / 2, np.pi / 2, rng.uniform(-3, 3)], p=[0.55, 0.2, 0.1, 0.15])
    sigma = rng.uniform(0.01, 0.12)
    noise = sigma * rng.standard_normal((len(ratios), *SHAPE))
    falling = rng.choice([1, -1], p=[0.8, 0.2])
    phases = falling * ratios[:, None, None] * truth + offset + noise
    phases[:, ~seen] = np.nan
    wrapped = phases - 2 * np.pi * np.rint(phases / (2 * np.pi))
    periods = tuple((float(rng.uniform(5, 20)) / ratios).tolist())
    return PeriodSet(wrapped, np.full(wrapped.shape, sigma), periods, projected, falling * truth, float(offset))


def _list_of_periods(rng: np.random.Generator) -> tuple[NDArray, float]:
    """Draw shortest over each period, the shortest first, and how many of the shortest are projected."""
    kind = rng.integers(0, 3)
    if kind == 0:  # a longest fringe, and steps of 4 to 10
        steps = rng.integers(4, 11, rng.integers(1, 3))
        ratios = 1 / np.cumprod([1, *steps])
    elif kind == 1:  # two or three close to one another
        base = int(rng.integers(8, 30))
        ratios = base / np.array([base, base + 1, *([base + 3] if rng.uniform() < 0.5 else [])])
    else:  # counts of fringes over the picture, the least below or above one
        counts = rng.uniform(0.6, 1.6) * np.cumprod([1, *rng.uniform(3.5, 7, rng.integers(1, 3))])
        return counts[::-1] / counts[-1], float(counts[-1])
    longest = 1 / ratios[-1] if kind == 0 else float(base)
    return ratios, float(longest * rng.choice([rng.uniform(0.4, 1.0), 1.0, rng.uniform(1.05, 2.5)]))


def _object(rng: np.random.Generator) -> tuple[NDArray, NDArray]:
    """Draw where an object is, and the shadow beside it."""
    u, v = rng.uniform(40, 280), rng.uniform(40, 200)
    a, b = rng.uniform(15, 60, 2)
    there = (np.abs(U - u) < a) & (np.abs(V - v) < b)
    beside = (np.abs(V - v) < b) & (u + a <= U) & (u + a + rng.uniform(0, 30) > U)
    return there, beside


def _pieces(rng: np.random.Generator) -> NDArray:
    """Draw what carries fringes at all: everything, the white squares of a board, stripes, or patches."""
    kind = rng.integers(0, 4)
    size = rng.uniform(14, 50)
    turn = rng.uniform(-0.3, 0.3)
    a, b = U * np.cos(turn) + V * np.sin(turn), V * np.cos(turn) - U * np.sin(turn)
    if kind == 0:
        return np.ones(SHAPE, bool)
    if kind == 1:  # squares whose corners do not touch
        white = (np.floor(a / size) + np.floor(b / size)) % 2 == 0
        return ndimage.binary_erosion(white, iterations=int(rng.integers(1, 4)))
    if kind == 2:
        return a % (2 * size) > rng.uniform(0.2, 1.4) * size
    rough = ndimage.gaussian_filter(rng.normal(size=SHAPE), size / 2)
    return rough > np.quantile(rough, rng.uniform(0.1, 0.6))


def rates(drawn: PeriodSet, stated: bool) -> tuple[float, float, str]:
    """Return the share of the pixels with a phase that is decided, the share of these that is wrong, and the words."""
    orders = decide_orders(drawn.phases, drawn.sigmas, drawn.periods, projected=drawn.projected if stated else None)
    count = absolute_phase(orders, projected=drawn.projected if stated else None)
    off = (count.phase - drawn.truth) / (2 * np.pi)
    decided = np.isfinite(off)
    whole = np.rint(off[decided] - np.median(off[decided]))  # counted from one fringe, whichever
    return float(decided.sum() / np.isfinite(drawn.phases[0]).sum()), float(np.mean(whole != 0)), count.sentence()


def main(first: int, last: int) -> None:
    """Print what is wrong, and the rates."""
    for stated in (False, True):
        found, refused = [], []
        for seed in range(first, last):
            drawn = period_set(seed)
            if np.isfinite(drawn.phases[0]).sum() < 500:
                continue
            try:
                found.append(rates(drawn, stated))
            except PhaseError as error:
                refused.append(str(error))
                print(f"{seed}: refused: {error}")
                continue
            if found[-1][1] > 0:
                print(f"{seed}: {found[-1][1]:.3%} wrong of {found[-1][0]:.1%} decided: {found[-1][2]}")
        decided, wrong = np.transpose([one[:2] for one in found])
        print(
            f"length of the picture {'stated' if stated else 'not stated'}: {len(found)} sets, {len(refused)} refused;"
            f" {decided.mean():.1%} decided, {np.sum(wrong * decided) / decided.sum():.2e} of these wrong,"
            f" {np.mean(wrong > 1e-3):.1%} of the sets with more than 0.1 % wrong"
        )


if __name__ == "__main__":
    main(*(int(text) for text in [*sys.argv[1:], "0", "100"][:2]))
