"""How the pictures of a series are phase-shifted: how many steps, sets one after the other, white and black."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from fringecal.numerics import TURN, robust_sd, wrap
from fringecal.phase import unwrap

Array = NDArray[np.float64]

_LEAST_STEPS, _MOST_STEPS = 3, 32
_EVEN_SHARE = 0.25  # of the set's own modulation by which the means of sets one after the other may differ
_LEFT_SHARE = 0.1  # of the frames' variance that no sine of even shifts explains: a response of gamma 2.2 leaves 0.05
_MODULATED = 0.02  # least modulation over background, at the tenth of the pixels that are modulated most
_AS_BRIGHT = 0.95  # of the range of all pictures, from which a pixel is as bright as the brightest
_FAR = 0.4  # of the modulation above or below the background, from which a pixel is bright or dark
_ALL_OVER = 0.9  # share of bright or dark pixels of a white or black picture
_BINARY_SHARE = 0.9  # share of bright and dark ones together in a picture of Gray code; a sine has 0.74
_LEAST_CYCLES = 0.25  # fringes across the picture: the longest of a set may be as long as the projector's picture
_LIT_SHARE = 0.3  # of the modulation of bright parts, that pixels have which are looked at: unlit ones show noise
_MOST_BEND_RAD, _EVEN_PIXELS = 1.2, 0.75  # change of the phase gradient, and the share of pixels that stay below it
_SAMPLE = 40_000  # pixels that are looked at


@dataclass(frozen=True)
class FringeSet:
    """A series that is phase-shifted.

    Parameters
    ----------
    steps_deg
        Phase shifts of one set: even ones where the pictures agree, else as found.
    blocks
        Complex modulation of every set one after the other, grey levels, (K, H, W).
    background
        Mean of the frames, grey levels, (H, W).
    gradients_rad_px
        Median phase gradient of every set along u and v, rad per pixel of the reduced picture.
    white, black, gray
        Places in the series of pictures that are lit evenly, not at all, or by Gray code.
    frames
        Places of the phase-shifted ones.
    """

    steps_deg: tuple[float, ...]
    blocks: NDArray[np.complex64]
    background: NDArray[np.float32]
    gradients_rad_px: tuple[tuple[float, float], ...]
    white: tuple[int, ...]
    black: tuple[int, ...]
    gray: tuple[int, ...]
    frames: tuple[int, ...]

    @property
    def axes(self) -> tuple[str, ...]:
        """The projector's axis of every set, u where fringes run up and down in the picture: as seen."""
        return tuple("u" if abs(along_u) >= abs(along_v) else "v" for along_u, along_v in self.gradients_rad_px)


Light = Literal["white", "black", "gray"]
LIGHTS: tuple[Light, ...] = ("white", "black", "gray")


def fringe_set(images: NDArray[np.float32], named: Mapping[int, Light] | None = None) -> FringeSet | None:
    """Find how pictures of one scene are phase-shifted; None where they are not.

    Sets of N phase-shifted pictures have one mean, set by set, for every N that is right, and the smallest such N is
    the number of steps; what is not modulated like them at either end of the series is white, black or Gray code.

    Parameters
    ----------
    images
        Grey levels, in their order, (M, H, W).
    named
        Places of pictures whose names say that they are lit evenly, not at all, or by a code; without it they are told
        by their looks.
    """
    for places in _places(images, named or {}):
        steps = _steps(images[list(places)])
        if steps is not None:
            found = _described(images, places, steps, named or {})
            if all(_fringed(block) for block in found.blocks):
                return found
    return None


def _places(images: NDArray[np.float32], named: Mapping[int, Light]) -> list[tuple[int, ...]]:
    """Return which pictures may be phase-shifted: all; all but white and black; without a code before or after too."""
    number = len(images)
    if named:
        return [tuple(k for k in range(number) if k not in named)]
    every = max(1, images[0].size // _SAMPLE)
    flat = images.reshape(number, -1)[:, ::every]
    inner = tuple(k for k in range(number) if not _extreme(flat, k))
    choices = [tuple(range(number)), inner]
    choices += [inner[:end] for end in range(len(inner) - 1, _LEAST_STEPS - 1, -1)]
    choices += [inner[begin:] for begin in range(1, len(inner) - _LEAST_STEPS + 1)]
    long = [each for each in dict.fromkeys(choices) if len(each) >= _LEAST_STEPS]
    return sorted(long, key=len, reverse=True)


def _extreme(flat: NDArray[np.float32], place: int) -> bool:
    """Whether one picture is nearly everywhere the brightest of all, or the darkest: none of a set of fringes is."""
    range_ = np.ptp(flat, axis=0)
    lit = _lit(range_)
    others, here = np.delete(flat[:, lit], place, axis=0), flat[place, lit]
    room = (1 - _AS_BRIGHT) * range_[lit]
    brightest, darkest = np.mean(here >= others.max(axis=0) - room), np.mean(here <= others.min(axis=0) + room)
    return bool(max(brightest, darkest) > _ALL_OVER)


def _steps(images: NDArray[np.float32]) -> int | None:
    """Return the least number of steps for which all sets have one mean and are modulated."""
    number = len(images)
    every = max(1, images[0].size // _SAMPLE)
    flat = images.reshape(number, -1)[:, ::every].astype(np.float64)
    for steps in range(_LEAST_STEPS, min(number, _MOST_STEPS) + 1):
        if number % steps == 0 and _is_set(flat.reshape(number // steps, steps, -1)):
            return steps
    return None


def _is_set(blocks: Array) -> bool:
    """Whether blocks of frames, (K, N, P), share one mean, and each is a sine of its shifts and no more."""
    mean, steps = blocks.mean(axis=1), blocks.shape[1]
    shifts = TURN * np.arange(steps) / steps
    modulation = 2 / steps * np.abs(np.einsum("kns,n->ks", blocks, np.exp(1j * shifts)))
    strong = np.percentile(modulation, 90, axis=1)
    if (strong < _MODULATED * np.maximum(np.median(mean, axis=1), 1)).any():
        return False
    if len(mean) > 1 and np.median(np.std(mean, axis=0)) > _EVEN_SHARE * np.median(strong) / np.sqrt(2):
        return False
    return _one_sine(blocks, shifts)


def _lit(light: NDArray[np.floating]) -> NDArray[np.bool_]:
    """Where fringes have some of the modulation that the tenth of the pixels with most of it has."""
    return np.asarray(light > _LIT_SHARE * np.percentile(light, 90))


def _fringed(block: NDArray[np.complex64]) -> bool:
    """Whether a modulation has fringes: its phase runs on evenly nearly everywhere, by half a turn at least."""
    along_u, along_v = _gradient(block)
    light = np.abs(block)
    lit = _lit(light)
    bends = (
        np.abs(np.angle(block[:, 2:] * np.conj(block[:, 1:-1]) ** 2 * block[:, :-2]))[lit[:, 1:-1]],
        np.abs(np.angle(block[2:] * np.conj(block[1:-1]) ** 2 * block[:-2]))[lit[1:-1]],
    )
    cycles = max(abs(along_u) * block.shape[1], abs(along_v) * block.shape[0]) / TURN
    return cycles > _LEAST_CYCLES and all(np.mean(each < _MOST_BEND_RAD) > _EVEN_PIXELS for each in bends)


def _one_sine(blocks: Array, shifts: Array) -> bool:
    """Whether little is left of the frames' variation after a mean and the first harmonic of stated shifts."""
    design = np.column_stack([np.ones(shifts.size), np.cos(shifts), np.sin(shifts)])
    hat = design @ np.linalg.pinv(design)
    left = blocks - np.einsum("nm,kms->kns", hat, blocks)
    varying = blocks - blocks.mean(axis=1, keepdims=True)
    return bool(np.mean(left**2) < _LEFT_SHARE * np.mean(varying**2))


def _described(
    images: NDArray[np.float32], places: tuple[int, ...], steps: int, named: Mapping[int, Light]
) -> FringeSet:
    """Put together what is known of a series in which sets were found."""
    rest = [k for k in range(len(images)) if k not in places]
    shifted = images[list(places)]
    frames = shifted.reshape(-1, steps, *images.shape[1:])
    shifts = TURN * np.arange(steps) / steps
    blocks = np.einsum("knhw,n->khw", frames, np.exp(-1j * shifts).astype(np.complex64)) * np.complex64(2 / steps)
    background = shifted.mean(axis=0)
    white, black, gray = (tuple(k for k in rest if named.get(k) == light) for light in LIGHTS)
    if not named:
        white, black, gray = _others(images, rest, background, np.abs(blocks[0]))
    gradients = tuple(_gradient(block) for block in blocks)
    even = tuple(360.0 * k / steps for k in range(steps))
    return FringeSet(even, blocks, background, gradients, white, black, gray, places)


def _others(
    images: NDArray[np.float32], rest: list[int], background: NDArray[np.float32], modulation: NDArray[np.float32]
) -> tuple[tuple[int, ...], tuple[int, ...], tuple[int, ...]]:
    """Tell pictures that are not phase-shifted: white is bright all over, black dark, a Gray code either in parts."""
    lit = _lit(modulation)
    white, black, gray = [], [], []
    for k in rest:
        relative = (images[k][lit] - background[lit]) / modulation[lit]
        bright, dark = float(np.mean(relative > _FAR)), float(np.mean(relative < -_FAR))
        if bright > _ALL_OVER:
            white.append(k)
        elif dark > _ALL_OVER:
            black.append(k)
        elif bright + dark > _BINARY_SHARE:
            gray.append(k)
    return tuple(white[-1:]), tuple(black[-1:]), _coarse_first(images, gray + white[:-1] + black[:-1], lit)


def _coarse_first(images: NDArray[np.float32], gray: list[int], lit: NDArray[np.bool_]) -> tuple[int, ...]:
    """Return pictures of a Gray code in the order of their files, or turned if the finest comes first."""
    order = sorted(gray)
    rough = [float(np.mean(np.abs(np.diff(images[k], axis=1))[lit[:, 1:]])) for k in order]
    return tuple(order if len(order) < 2 or rough[0] <= rough[-1] else order[::-1])


def _gradient(block: NDArray[np.complex64]) -> tuple[float, float]:
    """Return the median phase differences of neighbours along u and v where the modulation is more than half usual."""
    light = np.abs(block)
    lit = _lit(light)
    along_u = np.angle(block[:, 1:] * np.conj(block[:, :-1]))[lit[:, 1:] & lit[:, :-1]]
    along_v = np.angle(block[1:] * np.conj(block[:-1]))[lit[1:] & lit[:-1]]
    return float(np.median(along_u)), float(np.median(along_v))


def period_ratios(found: FringeSet) -> tuple[float, ...]:
    """Return the period of every set over the shortest one along its own axis, from the phase gradients."""
    slopes = [max(abs(u), abs(v)) for u, v in found.gradients_rad_px]
    axes = found.axes
    steepest = {axis: max(s for s, a in zip(slopes, axes, strict=True) if a == axis) for axis in axes}
    return tuple(steepest[axis] / max(slope, 1e-9) for axis, slope in zip(axes, slopes, strict=True))


def off_a_plane(found: FringeSet) -> float:
    """Return the share of modulated pixels whose phase is off a smooth surface of third order by 0.3 rad and more.

    The finest fringes are taken. Bare plates are smooth; what stands on one is not.
    """
    block = found.blocks[int(np.argmax([np.hypot(*each) for each in found.gradients_rad_px]))]
    light = np.abs(block)
    lit = _lit(light)
    unwrapped = unwrap(np.angle(block), lit)
    main = unwrapped.pieces == np.argmax(np.bincount(unwrapped.pieces[unwrapped.pieces > 0]))
    v, u = np.nonzero(lit)
    few = slice(None, None, max(1, u.size // _SAMPLE))
    v, u = v[few], u[few]
    design = _terms(u / block.shape[1] - 0.5, v / block.shape[0] - 0.5)
    inside = main[v, u]
    fit = _robust_fit(design[inside], unwrapped.phase[v, u][inside])
    return float(np.mean(np.abs(wrap(np.angle(block[v, u]) - design @ fit)) > _OFF_RAD))


_OFF_RAD = 0.3  # from a smooth surface: a twentieth of a fringe
_ROUNDS = 15  # of the robust fit


def _terms(x: Array, y: Array) -> Array:
    return np.column_stack([x**i * y**j for i in range(4) for j in range(4 - i)])


def _robust_fit(design: Array, phase: Array) -> Array:
    """Fit a surface to most of the pixels: those off it by three times the usual scatter are left aside, in turn."""
    inside = np.ones(phase.size, np.bool_)
    for _ in range(_ROUNDS):
        fit = np.linalg.lstsq(design[inside], phase[inside], rcond=None)[0]
        left = np.asarray(phase - design @ fit)
        centre = float(np.median(left[inside]))
        inside = np.abs(left - centre) < max(3 * robust_sd(left[inside]), _OFF_RAD / 3)
    return np.asarray(fit)
