"""Single frames of a capture that disagree with the others: on the plate, whose phase is known, and row by row."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from enum import Enum
from itertools import combinations, pairwise

import numpy as np
from numpy.typing import NDArray

from fringecal.numerics import robust_sd
from fringecal.phase import PhaseMap
from fringecal.reconstruct.against_plate.moved_rows import moved_rows
from fringecal.reconstruct.against_plate.plate_sample import PlateSample

Array = NDArray[np.float64]

HARMFUL = 2.0
"""Standard uncertainties of one pixel's phase from which a ripple over the plate matters: U of its height."""

_BLOCKS = (12, 9)  # across and down: a reflection or a shadow covers some of them
_LEAST_IN_BLOCK = 80  # pixels: some fringes, and ten times the numbers fitted
_CHI_SQUARED = 40.0  # of up to seven frames: by chance once in 100 000 blocks
_KEPT_SIGMAS = 4.0
_MOST_OF_PLATE = 0.6  # of the plate's blocks, beyond which a frame differs everywhere
_COLUMNS = 120  # of a row, by which frames are compared row by row
_EQUAL = 2.0  # times what noise makes two equal rows differ by
_APART = 4.0  # times noise by which the rest of both frames must differ
_LEAST_ROWS = 4
_EMPTY = 0.1  # of the picture's brightness, below which a row of one frame is missing
_SAVED_ROWS = 60  # sampled for the seams of 8 x 8 blocks
_SEAM = 1.25  # times the differences between other neighbours, from which seams of compression show
_MOVED_SIGMAS = 6.0
_MOVED_PX = 0.3  # of a frame against the others, from which it is named
_CLIP_LEVELS = 12.0  # differences beyond are edges


class FrameFault(Enum):
    """What is wrong with single frames."""

    LIGHT = "light"
    WHOLE = "whole frame"
    STALE_ROWS = "stale rows"
    EMPTY_ROWS = "empty rows"
    COMPRESSED = "compressed"
    MOVED = "moved"
    ROWS_MOVED = "moved rows"


@dataclass(frozen=True)
class FrameFinding:
    """One fault of one frame.

    Parameters
    ----------
    fault
        What it is.
    frame
        Number of the frame, from 0; -1 where all are meant.
    size
        Grey levels of light, pixels of a displacement, or a ratio of seams.
    place
        First and last column and row that it covers, px; rows alone where it runs through the picture.
    """

    fault: FrameFault
    frame: int
    size: float
    place: tuple[int, int, int, int]


def frame_faults(
    frames: NDArray[np.generic], phase_map: PhaseMap, weights: Array, sample: PlateSample
) -> tuple[FrameFinding, ...]:
    """Look for frames that disagree with the others.

    Parameters
    ----------
    frames
        Grey levels, (N, H, W).
    phase_map
        What they were demodulated to.
    weights
        Weights of the scheme, (3, N).
    sample
        The capture beside the plate's phase.

    Notes
    -----
    A frame k that is brighter by e changes the phase by `e (cos(phi) wS_k - sin(phi) wC_k) / B`. The plate's phase is
    known, so that in every block of plate these patterns are fitted beside a quadratic, even with three frames, which
    have no residual of their own. A frame that moved shows the gradient of the plate's texture
    in place of e.
    """
    rows = (*_stale_rows(frames, phase_map), *_empty_rows(frames), *_unsteady_rows(frames))
    light = () if rows or not sample.seen else _light(phase_map, weights, sample)
    moved = () if not sample.seen else _moved(phase_map, weights, sample)
    return (*rows, *light, *moved, *_compressed(frames))


def _patterns(phase_map: PhaseMap, weights: Array, sample: PlateSample, chosen: NDArray[np.bool_]) -> Array:
    """Return the phase that one grey level more in each frame adds at chosen pixels of the sample, rad, (N, n)."""
    phase = phase_map.phase[sample.place][chosen].astype(float)
    modulation = phase_map.modulation[sample.place][chosen].astype(float)
    return np.asarray((weights[2][:, None] * np.cos(phase) - weights[1][:, None] * np.sin(phase)) / modulation)


def _light(phase_map: PhaseMap, weights: Array, sample: PlateSample) -> tuple[FrameFinding, ...]:
    """Find blocks of plate in which one frame is brighter or darker than the others."""
    down, across = (np.arange(n) * parts // n for n, parts in zip(sample.plate.shape, _BLOCKS[::-1], strict=True))
    block = down[:, None] * _BLOCKS[0] + across[None, :]
    chosen = sample.plate & np.isfinite(sample.step_rad)
    patterns = _patterns(phase_map, weights, sample, chosen)
    v, u = np.nonzero(chosen)
    values, sigma, number = sample.step_rad[chosen], sample.sigma_rad[chosen], block[chosen]
    order = np.argsort(number, kind="stable")
    starts = np.flatnonzero(np.diff(number[order], prepend=-1))
    looked, found = 0, []
    for first, last in pairwise([*starts.tolist(), len(order)]):
        of = order[first:last]
        if len(of) >= _LEAST_IN_BLOCK:
            looked += 1
            brighter = _brighter(patterns[:, of], u[of], v[of], values[of], sigma[of])
            if brighter is not None:
                found.append((*brighter, int(number[of[0]])))
    return tuple(_gathered(found, looked, sample))


def _brighter(
    patterns: Array, u: NDArray[np.intp], v: NDArray[np.intp], values: Array, sigma: Array
) -> tuple[int, float] | None:
    """Return which frame of a block is brighter, and by how many grey levels; None where the ripple does not matter."""
    x, y = u - u.mean(), v - v.mean()
    smooth = np.column_stack([np.ones(len(u)), x, y, x * x, x * y, y * y])
    design = np.column_stack([smooth, *patterns[1:]]) / sigma[:, None]
    scores = values / sigma
    kept = np.ones(len(u), bool)
    for _ in range(2):
        fit = np.linalg.lstsq(design[kept], scores[kept], rcond=1e-6)[0]
        left = scores - design @ fit
        spread = max(robust_sd(left[kept], about=0), 1.0)
        kept = np.abs(left) <= _KEPT_SIGMAS * spread
    few = smooth.shape[1]
    if np.sqrt(np.mean((smooth @ fit[:few]) ** 2)) > HARMFUL * float(np.median(sigma)):
        return None  # the foot of an object, or a plate that moved, which light in one frame does not make
    ripple = patterns[1:].T @ fit[few:]
    plain = np.linalg.lstsq(design[kept, :few], scores[kept], rcond=1e-6)[0]
    gained = np.sum((scores[kept] - design[kept, :few] @ plain) ** 2) - np.sum(left[kept] ** 2)
    size = float(np.sqrt(2) * np.std(ripple))
    if gained < _CHI_SQUARED * spread**2 or size < HARMFUL * float(np.median(sigma)):
        return None
    levels = np.concatenate([[0.0], fit[few:]])
    others = (levels.sum() - levels) / (len(levels) - 1)
    frame = int(np.argmax(np.abs(levels - others)))
    return frame, float(levels[frame] - others[frame])


def _gathered(found: Sequence[tuple[int, float, int]], looked: int, sample: PlateSample) -> Iterator[FrameFinding]:
    """Say where each frame differs: in a part of the plate, or all over it."""
    for frame in sorted({frame for frame, _, _ in found}):
        sizes = [size for one, size, _ in found if one == frame]
        blocks = np.array([number for one, _, number in found if one == frame])
        whole = len(found) > _MOST_OF_PLATE * looked
        size = float(max(sizes, key=abs))
        yield FrameFinding(FrameFault.WHOLE if whole else FrameFault.LIGHT, frame, size, _extent(blocks, sample))


def _extent(blocks: NDArray[np.intp], sample: PlateSample) -> tuple[int, int, int, int]:
    """Return first and last column and row of some blocks, px."""
    edges = [
        np.linspace(int(at[0]), int(at[-1]), n + 1) for at, n in zip((sample.u_px, sample.v_px), _BLOCKS, strict=True)
    ]
    across, down = blocks % _BLOCKS[0], blocks // _BLOCKS[0]
    return (
        int(edges[0][across.min()]), int(edges[0][across.max() + 1]),
        int(edges[1][down.min()]), int(edges[1][down.max() + 1]),
    )  # fmt: skip


def _moved(phase_map: PhaseMap, weights: Array, sample: PlateSample) -> Iterator[FrameFinding]:
    """Find frames in which the plate's texture lies elsewhere than in the others."""
    inside = sample.plate & np.isfinite(sample.step_rad)
    inside[[0, -1], :] = inside[:, [0, -1]] = False
    patterns = _patterns(phase_map, weights, sample, inside)
    v, u = (at[place] for at, place in zip((sample.v_px, sample.u_px), np.nonzero(inside), strict=True))
    light = phase_map.background
    along_u = np.nan_to_num((light[v, u + 1] - light[v, u - 1]) / 2)
    along_v = np.nan_to_num((light[v + 1, u] - light[v - 1, u]) / 2)
    even = (np.abs(along_u) < _CLIP_LEVELS) & (np.abs(along_v) < _CLIP_LEVELS)
    terms = [np.ones(len(u)), u - u.mean(), v - v.mean(), *patterns[1:]]
    terms += [-pattern * slope for slope in (along_u, along_v) for pattern in patterns[1:]]
    sigma = sample.sigma_rad[inside]
    design, scores = np.column_stack(terms) / sigma[:, None], sample.step_rad[inside] / sigma
    for _ in range(2):
        normal = design[even].T @ design[even]
        inverse = np.linalg.pinv(normal, rcond=1e-12, hermitian=True)
        fit = inverse @ (design[even].T @ scores[even])
        left = scores - design @ fit
        spread = max(robust_sd(left[even], about=0), 1.0)
        even &= np.abs(left) <= _KEPT_SIGMAS * spread
    number = len(patterns)
    first = 3 + number - 1
    shifts = fit[first:].reshape(2, number - 1)
    u_shifts = spread * np.sqrt(np.abs(np.diag(inverse)[first:])).reshape(2, number - 1)
    yield from _named_shifts(shifts, u_shifts, sample)


def _named_shifts(shifts: Array, u_shifts: Array, sample: PlateSample) -> Iterator[FrameFinding]:
    """Name the frame that lies furthest from the others, if it does by more than chance and the limit."""
    placed = np.concatenate([np.zeros((2, 1)), shifts], axis=1)
    away = np.hypot(*(placed - np.median(placed, axis=1, keepdims=True)))
    frame = int(np.argmax(away))
    if away[frame] > max(_MOVED_PX, _MOVED_SIGMAS * float(u_shifts.max())):
        whole = int(sample.u_px[0]), int(sample.u_px[-1]), int(sample.v_px[0]), int(sample.v_px[-1])
        yield FrameFinding(FrameFault.MOVED, frame, float(away[frame]), whole)


def _few_columns(frames: NDArray[np.generic]) -> NDArray[np.float32]:
    """Return every so many columns of the frames."""
    return frames[:, :, :: max(1, frames.shape[2] // _COLUMNS)].astype(np.float32)


def _stale_rows(frames: NDArray[np.generic], phase_map: PhaseMap) -> Iterator[FrameFinding]:
    """Find rows that two frames show alike, where the rest of both differs."""
    few = _few_columns(frames)
    lit = phase_map.modulation[:, :: max(1, frames.shape[2] // _COLUMNS)]
    seen = float(np.mean(lit, where=np.isfinite(lit))) if np.isfinite(lit).any() else 0.0
    noise = float(phase_map.noise.sigma(np.array(float(few.mean()))))
    for first, second in combinations(range(len(frames)), 2):
        apart = np.mean(np.abs(few[first] - few[second]), axis=1)
        alike = apart < _EQUAL * noise * 2 / np.sqrt(np.pi)
        if np.median(apart) > _APART * noise and seen > _APART * noise:
            for top, bottom in _runs(alike, _LEAST_ROWS):
                if _continued(few, apart, top, bottom, noise):
                    yield FrameFinding(FrameFault.STALE_ROWS, second, first, (0, frames.shape[2] - 1, top, bottom))


def _continued(few: NDArray[np.float32], apart: Array, top: int, bottom: int, noise: float) -> bool:
    """Return whether rows become alike from one to the next, which fringes along the rows do not make them."""
    ends = [apart[at] for at in (top - 2, bottom + 2) if 0 <= at < len(apart)]
    return bool(ends) and min(ends) > _APART * noise and bool(few[:, top : bottom + 1].std() > _APART * noise)


def _empty_rows(frames: NDArray[np.generic]) -> Iterator[FrameFinding]:
    """Find rows that one frame lacks."""
    rows = _few_columns(frames).mean(axis=2)
    usual = np.median(rows, axis=0)
    lit = usual > 0.5 * np.median(usual)
    for frame, values in enumerate(rows):
        for top, bottom in _runs(lit & (values < _EMPTY * usual), 1):
            yield FrameFinding(FrameFault.EMPTY_ROWS, frame, 0.0, (0, frames.shape[2] - 1, top, bottom))


def _unsteady_rows(frames: NDArray[np.generic]) -> Iterator[FrameFinding]:
    """Find frames of which single rows lie aside."""
    for frame, px, rows in moved_rows(frames):
        yield FrameFinding(FrameFault.ROWS_MOVED, frame, px, (0, frames.shape[2] - 1, int(rows[0]), int(rows[-1])))


def _runs(marked: NDArray[np.bool_], least: int) -> Iterator[tuple[int, int]]:
    """Return first and last index of every run of at least so many marks."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], marked.astype(np.int8), [0]])))
    for first, last in edges.reshape(-1, 2):
        if last - first >= least:
            yield int(first), int(last - 1)


def _compressed(frames: NDArray[np.generic]) -> Iterator[FrameFinding]:
    """Find the seams that compression in blocks of 8 x 8 leaves."""
    few = frames[:, :: max(1, frames.shape[1] // _SAVED_ROWS)].astype(np.float32)
    bends = np.abs(np.diff(few, n=3, axis=2))  # centred between pixels k + 1 and k + 2
    at = (np.arange(bends.shape[2]) + 1) % 8
    means = np.array([np.minimum(bends[:, :, at == k], _CLIP_LEVELS).mean() for k in range(8)])
    seam = float(means[7] / max(np.median(means), 1e-6))
    if seam > _SEAM:
        yield FrameFinding(FrameFault.COMPRESSED, -1, seam, (0, frames.shape[2] - 1, 0, frames.shape[1] - 1))
