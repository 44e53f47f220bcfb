"""Millimetre paper in perspective: 1, 5 and 10 mm ruling in five ratios of line weights, indexed and scaled or refused.

    python benchmarks/millimetre_paper.py [first seed] [last seed]

prints every picture whose index or pitch is wrong, and how many are right, refused and wrong.
"""

import sys
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from fringecal.camera import ruled_pitch, thesis_scale
from fringecal.detect import find_grid, ruling_of
from fringecal.errors import FringecalError as Refusal
from fringecal.uncertainty import Estimate

RATIOS = (1.0, 1.3, 1.7, 2.4, 3.5)
SHAPE = (640, 860)
FINER = 3  # samples of the picture for each pixel along either side


@dataclass(frozen=True)
class Paper:
    """A picture, what is stated of the paper, and mm for a pixel in its middle along either direction."""

    picture: NDArray[np.uint8]
    pitch_mm: float
    heavy_every: int
    mm_per_px: tuple[float, float]
    ratio: float


def paper(seed: int) -> Paper:
    """Draw paper seen obliquely, with fine lines from hardly resolved to wide apart."""
    rng = np.random.default_rng(seed)
    ratio = float(rng.choice(RATIOS))
    levels = [(1, 1.0), (5, ratio), (10, ratio ** float(rng.choice([1.0, 1.5])))]
    if rng.uniform() < 0.3:
        levels = levels[:2]
    if rng.uniform() < 0.2:
        levels = [levels[0], levels[-1]]
    px_per_mm = float(np.exp(rng.uniform(np.log(4), np.log(32))))
    width = rng.uniform(0.09, 0.2)
    u, v, local = _on_paper(rng, px_per_mm)
    ink, ground = rng.uniform(60, 170), rng.uniform(190, 240)
    fine = rng.uniform(0.4, 1.0) if ratio > 1 else 1.0  # of their ink that fine lines have
    thin = np.maximum(_lines(u, 1, width, px_per_mm), _lines(v, 1, width, px_per_mm))
    strong = np.zeros(u.shape)
    for every, weight in levels[1:]:
        for along in (u, v):
            strong = np.maximum(strong, _lines(along, every, width * weight, px_per_mm))
    cover = np.maximum(strong, fine * thin)
    picture = ground - (ground - ink) * cover
    picture = ndimage.gaussian_filter(picture, FINER * rng.uniform(0.3, 1.0))
    picture = picture.reshape(SHAPE[0], FINER, SHAPE[1], FINER).mean(axis=(1, 3))
    y, x = np.mgrid[: SHAPE[0], : SHAPE[1]]
    picture *= 1 + rng.uniform(-0.15, 0.15) * (x / SHAPE[1] - 0.5) + rng.uniform(-0.15, 0.15) * (y / SHAPE[0] - 0.5)
    picture += rng.normal(0, rng.uniform(0.5, 3), SHAPE)
    return Paper(np.clip(np.rint(picture), 0, 255).astype(np.uint8), 1.0, levels[1][0], local, ratio)


def _on_paper(rng: np.random.Generator, px_per_mm: float) -> tuple[NDArray, NDArray, tuple[float, float]]:
    """Return the place on the paper under every sample, mm, and mm for a pixel in the middle along u and v."""
    y, x = (np.mgrid[: SHAPE[0] * FINER, : SHAPE[1] * FINER] + 0.5) / FINER - 0.5
    x, y = (x - (SHAPE[1] - 1) / 2) / px_per_mm, (y - (SHAPE[0] - 1) / 2) / px_per_mm
    turn = np.deg2rad(rng.uniform(-12, 12))
    tilt = rng.uniform(-0.18, 0.18, 2) * px_per_mm / SHAPE[1]
    scale = 1 + tilt[0] * x + tilt[1] * y
    a, b = x / scale, y / scale
    u = a * np.cos(turn) - b * np.sin(turn) + rng.uniform(0, 10)
    v = a * np.sin(turn) + b * np.cos(turn) + rng.uniform(0, 10)
    return u, v, (1 / px_per_mm, 1 / px_per_mm)


def _lines(place: NDArray, every: int, width_mm: float, px_per_mm: float) -> NDArray:
    """Return how far samples lie within lines, with flanks of a sample, 0 to 1."""
    off = np.abs(place - every * np.rint(place / every))
    return np.clip((width_mm / 2 - off) * px_per_mm * FINER + 0.5, 0, 1)


def judged(drawn: Paper) -> tuple[str, str]:
    """Return `right`, `refused` or `wrong`, and the words."""
    try:
        detection = find_grid(drawn.picture)
        ruling = ruling_of(drawn.picture, detection)
        pitch = ruled_pitch(ruling, Estimate(drawn.pitch_mm, 0.001, "mm"), drawn.heavy_every)
    except Refusal as error:
        return "refused", str(error)
    found = thesis_scale(detection, pitch)
    scales = (found.horizontal.value, found.vertical.value)
    off = max(abs(scale / true - 1) for scale, true in zip(scales, drawn.mm_per_px, strict=True))
    return ("right" if off < 0.1 else "wrong"), f"{off:.1%}; {ruling.sentence()}"


def main(first: int, last: int) -> None:
    """Print what is wrong, and the numbers."""
    found = []
    for seed in range(first, last):
        drawn = paper(seed)
        verdict, words = judged(drawn)
        found.append(verdict)
        if verdict != "right":
            print(f"{seed}: {verdict}, ratio {drawn.ratio}, {1 / drawn.mm_per_px[0]:.1f} px/mm: {words}")
    print(", ".join(f"{found.count(each)} {each}" for each in ("right", "refused", "wrong")))


if __name__ == "__main__":
    main(*(int(text) for text in [*sys.argv[1:], "0", "100"][:2]))
