"""Displacement of a picture against the calibration's, told by the plate's texture."""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy import fft

from fringecal.phase import TILE_PX, PhaseMap, PlateLook, texture_of

Array = NDArray[np.float64]

REACH_PX = 12
"""Largest displacement that is looked for, px: a knock moves a picture by less, and what moved further is named so."""

CLEAR = 6.5
"""Standard deviations of chance from which texture is found again: of 625 displacements one reaches it by chance once
in a million pictures."""

EXPECTED = 10.0
"""Standard deviations that texture must be able to reach for its absence to say anything."""

_SURELY_NOISE = 1.02  # times the noise as estimated, which is known to 1 or 2 %: what is beyond is texture
_LEAST_OVERLAP = 0.25  # of a piece, below which a displacement of it is not looked at


@dataclass(frozen=True)
class PartsApart:
    """Two parts of a picture that were displaced differently: px, its standard uncertainty, and where they meet."""

    px: float
    u_px: float
    along: str
    at_px: int


@dataclass(frozen=True)
class TextureShift:
    """Where the texture of the calibration's plate is found in a capture.

    Parameters
    ----------
    du_px, dv_px, u_px
        Displacement along rows and columns and the standard uncertainty of each, px.
    clearness
        Correlation at the best displacement in standard deviations of chance.
    at_rest
        The same at no displacement.
    shown_clearness
        Correlation at the best displacement of the pieces that should show plate alone.
    expected
        What it would be if this plate were seen unmoved where the capture looks like plate.
    sharpness, u_sharpness
        Amplitude of the texture over that of the calibration, the lamp's brightness taken out, and its standard
        uncertainty; 1 if neither blur nor another plate.
    by_piece
        Places (u, v) and displacements (du, dv) of single pieces that are clear by themselves, px, (n, 4).
    torn
        How far two parts of the picture lie from one another, both found by themselves; None where no two are.
    """

    du_px: float
    dv_px: float
    u_px: float
    clearness: float
    at_rest: float
    shown_clearness: float
    expected: float
    sharpness: float
    u_sharpness: float
    by_piece: Array
    torn: "PartsApart | None" = None

    @property
    def found(self) -> bool:
        """Whether the texture was found again."""
        return self.clearness >= CLEAR


def texture_shift(phase_map: PhaseMap, look: PlateLook, plate: NDArray[np.bool_] | None = None) -> TextureShift | None:
    """Look for the texture of the calibration's plate in a capture; None where the calibration kept none.

    Parameters
    ----------
    phase_map
        The capture.
    look
        The plate at its calibration.
    plate
        Pieces of `look` that should show plate, (T,); all by default.

    Notes
    -----
    With T the texture kept and w that of the capture, `z(d) = sum T(x) w(x + d) / s^2 / sqrt(sum T^2 / s^2)` over all
    pieces is normal with unit variance where w holds nothing of T. Its square falls off the peak as chi-squared does,
    which gives the uncertainty of the place.
    """
    if not len(look.texture):
        return None
    shows = np.ones(len(look.texture), bool) if plate is None else plate
    pieces = [_correlated(phase_map, look, k) for k in range(len(look.texture))]
    cross, power = (np.array([piece[k] for piece in pieces]) for k in (0, 1))
    total, weight = cross.sum(axis=0), power.sum(axis=0)
    z = total / np.sqrt(np.maximum(weight, 1e-30))
    row, column = (int(k) for k in np.unravel_index(int(np.argmax(z)), z.shape))
    du, dv, u = summit(z, row, column)
    middle = REACH_PX
    brightness = _brightness(phase_map, look)
    held = float(power[shows, middle, middle].sum())
    noise = look.noise_levels**2 * sum(piece[2] for piece, one in zip(pieces, shows, strict=True) if one)
    expected = brightness * max(held - _SURELY_NOISE * noise, 0.0) / max(held, 1e-30) ** 0.5
    of = shows if shows.any() else np.ones_like(shows)
    found, known = (float(maps[of, row, column].sum()) for maps in (cross, power))
    amplitude = found / max(known, 1e-30) / brightness
    shown = found / max(known, 1e-30) ** 0.5 if shows.any() else 0.0
    sharpness = _sharpness(amplitude, shown, look)
    at_rest, pieces_found = float(z[middle, middle]), _by_piece(cross, power, look)
    torn = _parts_apart(cross, power, look)
    return TextureShift(du, dv, u, float(z[row, column]), at_rest, shown, expected, *sharpness, pieces_found, torn)


def _parts_apart(cross: Array, power: Array, look: PlateLook) -> PartsApart | None:
    """Return which two parts of the picture, one beside or above the other, lie furthest apart by their uncertainty."""
    found = []
    for axis, along in ((1, "row"), (0, "column")):
        at = look.corners_px[:, axis]
        for first, second in pairwise(np.unique(at)):
            parts = [_peak(cross[part].sum(axis=0), power[part].sum(axis=0)) for part in (at <= first, at >= second)]
            if all(part is not None for part in parts):
                (du, dv, u), (du2, dv2, u2) = (part for part in parts if part is not None)
                seam = int(first + second + TILE_PX) // 2
                found.append(PartsApart(float(np.hypot(du - du2, dv - dv2)), float(np.hypot(u, u2)), along, seam))
    return max(found, key=lambda one: one.px / one.u_px) if found else None


def _peak(total: Array, weight: Array) -> tuple[float, float, float] | None:
    """Return displacement and uncertainty of a clear peak."""
    z = total / np.sqrt(np.maximum(weight, 1e-30))
    row, column = (int(k) for k in np.unravel_index(int(np.argmax(z)), z.shape))
    return summit(z, row, column) if z[row, column] >= CLEAR else None


def _correlated(phase_map: PhaseMap, look: PlateLook, number: int) -> tuple[Array, Array, float]:
    """Return correlation and power of one piece over all displacements (dv, du), and its pixels, all over variance."""
    place = piece_window(look, number, phase_map.phase.shape)
    return correlated(texture_of(phase_map.background[place], phase_map.phase[place]), look, number)


def piece_window(look: PlateLook, number: int, shape: tuple[int, ...]) -> tuple[slice, slice]:
    """Return the part of the picture in which one piece is looked for."""
    u, v = look.corners_px[number]
    top, left = max(v - REACH_PX, 0), max(u - REACH_PX, 0)
    return slice(top, min(v + TILE_PX + REACH_PX, shape[0])), slice(left, min(u + TILE_PX + REACH_PX, shape[1]))


def correlated(seen: NDArray[np.float32], look: PlateLook, number: int) -> tuple[Array, Array, float]:
    """Correlate the texture of one piece with a window of a picture.

    Parameters
    ----------
    seen
        Texture of the window, NaN where it is not seen.
    look, number
        The plate at its calibration, and which of its pieces.

    Returns
    -------
    tuple
        Correlation and power over all displacements (dv, du), and the piece's pixels, all over the variance.
    """
    side, reach = TILE_PX + 2 * REACH_PX, REACH_PX
    known = np.isfinite(seen)
    none = np.zeros((2 * reach + 1,) * 2)
    if known.mean() < _LEAST_OVERLAP:
        return none, none, 0.0
    window, mask = np.zeros((side, side), np.float32), np.zeros((side, side), np.float32)
    down, across = (max(reach - int(k), 0) for k in look.corners_px[number][::-1])
    inside = (slice(down, down + seen.shape[0]), slice(across, across + seen.shape[1]))
    window[inside], mask[inside] = np.where(known, seen, 0.0), known
    variance = float(np.mean(seen[known] ** 2)) or 1.0
    piece = np.nan_to_num(look.texture[number])
    area = (side, side)
    pattern, squares = (np.conj(fft.rfft2(p, area)) for p in (piece, piece * piece))
    few = np.s_[: 2 * reach + 1, : 2 * reach + 1]
    cross = fft.irfft2(fft.rfft2(window) * pattern, area)[few] / variance
    power = fft.irfft2(fft.rfft2(mask) * squares, area)[few] / variance
    covered = mask[reach:-reach, reach:-reach] @ np.ones(TILE_PX)
    return np.asarray(cross, float), np.maximum(np.asarray(power, float), 0.0), float(covered.sum()) / variance


def summit(z: Array, row: int, column: int) -> tuple[float, float, float]:
    """Return the displacement of the peak near a sample along u and v, and the standard uncertainty of each, px."""
    half = z * np.abs(z) / 2
    (du, bend_u), (dv, bend_v) = _vertex(half[row, :], column), _vertex(half[:, column], row)
    bend = min(bend_u, bend_v)
    return du, dv, bend**-0.5 if bend > 0 else float(REACH_PX)


def _vertex(values: Array, k: int) -> tuple[float, float]:
    """Return the place of a parabola's vertex about sample k, less the reach, and how strongly it bends."""
    if not 0 < k < len(values) - 1:
        return float(k - REACH_PX), 0.0
    before, here, after = values[k - 1 : k + 2]
    bend = float(2 * here - before - after)
    return (k - REACH_PX + (after - before) / (2 * bend), bend) if bend > 0 else (float(k - REACH_PX), 0.0)


def _brightness(phase_map: PhaseMap, look: PlateLook) -> float:
    """Return the median brightness of a capture over that of the plate."""
    few = np.s_[:: max(1, look.shape[0] // 100), :: max(1, look.shape[1] // 100)]
    valid = phase_map.reasons[few] == 0
    return float(np.median(phase_map.background[few][valid]) / np.nanmedian(look.background)) if valid.any() else 1.0


def _sharpness(amplitude: float, shown: float, look: PlateLook) -> tuple[float, float]:
    """Return the texture's amplitude without what noise in the texture kept takes of it, and its uncertainty."""
    whole = float(np.nanmean(look.texture**2))
    texture = max(whole - look.noise_levels**2, 0.01 * whole)
    doubt = np.hypot(1 / max(shown, 1.0), (_SURELY_NOISE - 1) * look.noise_levels**2 / texture)
    return amplitude * whole / texture, float(doubt)


def _by_piece(cross: Array, power: Array, look: PlateLook) -> Array:
    """Return places and displacements of pieces that are clear by themselves, (n, 4)."""
    rows = []
    for c, p, (u, v) in zip(cross, power, look.corners_px, strict=True):
        z = c / np.sqrt(np.maximum(p, 1e-30))
        row, column = np.unravel_index(int(np.argmax(z)), z.shape)
        if z[row, column] >= CLEAR:
            du, dv, _ = summit(z, int(row), int(column))
            rows.append((u + TILE_PX / 2, v + TILE_PX / 2, du, dv))
    return np.array(rows).reshape(-1, 4)
