"""Frames that do not show what the others of their set do: fringes of another period, or another scene."""

from collections.abc import Iterator
from itertools import combinations

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import ndimage

from fringecal.phase.diagnostics.evidence import Evidence, Finding
from fringecal.phase.diagnostics.finding_kinds import FindingKind
from fringecal.phase.diagnostics.frame_spectra import FrameSpectra

_MOST_ALONG = 512  # px along each axis of the pictures compared: more is thinned, alike in all frames
_LEAST_PX = 32  # along either axis, for a spectrum to have places
_NOISE = 4.0  # medians of a spectrum's power that are taken for noise
_LEAST_CYCLES = 2.0  # below which uneven light lies
_NO_POWER = 1e-12  # instead of a division by 0
_NEAR_PEAK = 0.2  # of a peak's place, within which its power lies
_A_PEAK = 0.4  # of a frame's power near its peak, from which it shows fringes of one period
_AS_STRONG = 0.3  # of the frames' median amplitude that fringes have


def frame_spectra(frames: ArrayLike) -> FrameSpectra | None:
    """Compare what frames show by their spectra, which do not depend on the phase shift.

    Parameters
    ----------
    frames
        Grey levels, (N, H, W).

    Returns
    -------
    FrameSpectra or None
        None where the pictures are too small or hold values that are not finite.
    """
    grey = np.asarray(frames)
    step = max(1, -(-max(grey.shape[1:]) // _MOST_ALONG))
    some = grey[:, ::step, ::step].astype(np.float64)
    if min(some.shape[1:]) < _LEAST_PX or not np.isfinite(some).all():
        return None
    window = np.hanning(some.shape[1])[:, None] * np.hanning(some.shape[2])
    some -= (some * window).sum(axis=(1, 2), keepdims=True) / window.sum()
    power = np.abs(np.fft.rfft2(some * window)) ** 2
    cycles = np.hypot(*np.meshgrid(*_cycles(some.shape[1:]), indexing="ij"))
    power = np.array([ndimage.uniform_filter(one, 3, mode="wrap") for one in power])
    power = np.maximum(power - _NOISE * np.median(power, axis=(1, 2), keepdims=True), 0) * (cycles >= _LEAST_CYCLES)
    root, size = np.sqrt(power), np.sqrt(power.sum(axis=(1, 2)))
    alike = np.einsum("iab,jab->ij", root, root) / np.maximum(np.outer(size, size), _NO_POWER)
    peaks = [_peak(one, cycles, some.shape[1:]) for one in power]
    place, share, count = zip(*peaks, strict=True)
    fringed = (np.array(share) >= _A_PEAK) & (size >= _AS_STRONG * np.median(size))
    return FrameSpectra(1 - alike, np.array(place) * step, fringed, np.array(count))


def _cycles(shape: tuple[int, ...]) -> tuple[NDArray, NDArray]:
    """Return the cycles along a picture's rows and columns that the places of its spectrum stand for."""
    return np.fft.fftfreq(shape[0]) * shape[0], np.arange(shape[1] // 2 + 1)


def _peak(power: NDArray, cycles: NDArray, shape: tuple[int, ...]) -> tuple[float, float, float]:
    """Return the period of the highest peak in px, the share of the power near it, and its cycles in the picture."""
    row, column = np.unravel_index(int(power.argmax()), power.shape)
    along, across = (float(axis[k]) for axis, k in zip(_cycles(shape), (row, column), strict=True))
    rate = float(np.hypot(along / shape[0], across / shape[1]))
    rows, columns = (axis - at for axis, at in zip(_cycles(shape), (along, across), strict=True))
    near = np.hypot(rows[:, None], columns) <= 1 + _NEAR_PEAK * cycles[row, column]
    share = float(power[near].sum() / max(power.sum(), _NO_POWER))
    return 1 / max(rate, _NO_POWER), share, float(cycles[row, column])


def other_scene(evidence: Evidence) -> Iterator[Finding]:
    """Find frames whose fringes are of another period, or that show none or another scene."""
    spectra = evidence.spectra
    if spectra is None or evidence.fringes < evidence.limits.scene_cycles:
        return
    group = _alike(spectra.apart, evidence.limits.scene_apart)
    others = [k for k in range(len(spectra.apart)) if k not in group]
    if not others:
        return
    within = max((spectra.apart[i, j] for i, j in combinations(group, 2)), default=0.0)
    apart = {k: min(spectra.apart[k, i] for i in group) for k in others}
    least = max(evidence.limits.scene_apart, evidence.limits.scene_over_others * within)
    odd = [k for k in others if apart[k] > least]
    if odd:
        yield _named(spectra, odd, group, max(apart[k] for k in odd))


def _alike(apart: NDArray, limit: float) -> list[int]:
    """Return the largest group of frames that show the same; the first of equal ones."""
    groups = [_around(k, apart, limit) for k in range(len(apart))]
    return max(groups, key=lambda group: (len(group), -float(apart[np.ix_(group, group)].sum())))


def _around(first: int, apart: NDArray, limit: float) -> list[int]:
    """Return a frame and those that show the same as it and as one another, the most alike first."""
    group = [first]
    for k in np.argsort(apart[first], kind="stable"):
        if k != first and max(apart[k, group]) < limit:
            group.append(int(k))
    return sorted(group)


def _named(spectra: FrameSpectra, odd: list[int], group: list[int], apart: float) -> Finding:
    """Say what the frames show that do not belong to the set."""
    one = len(odd) == 1
    which = f"frame{'' if one else 's'} {', '.join(str(k + 1) for k in odd)}"
    fringed = bool(spectra.fringed[odd].all())
    others = float(np.median(spectra.period_px[group]))
    periods = spectra.period_px[odd]
    other_period = fringed and bool((np.abs(periods - others) * spectra.cycles > others).all())
    if len(group) == 1:
        what = "no two frames show the same fringes"
    elif other_period:
        found = ", ".join(f"{period:.1f}" for period in periods)
        what = f"{which} show{'s' if one else ''} fringes of {found} px, the others of {others:.1f} px"
    else:
        what = f"{which} show{'s' if one else ''} another scene, or other fringes, than the others"
    return Finding(
        FindingKind.ANOTHER_PERIOD if other_period and len(group) > 1 else FindingKind.FOREIGN_FRAME,
        what,
        f"{apart:.0%} of the spectrum is another",
        float(np.pi / np.sqrt(3)),
        "check the list of files: all frames of a set show one scene under fringes of one period",
    )
