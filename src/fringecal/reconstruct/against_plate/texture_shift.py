"""Displacement of a picture against the calibration's, told by the plate's texture."""

from dataclasses import dataclass

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
    du, dv, u = _summit(z, row, column)
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
    return TextureShift(du, dv, u, float(z[row, column]), at_rest, shown, expected, *sharpness, pieces_found)


def _correlated(phase_map: PhaseMap, look: PlateLook, number: int) -> tuple[Array, Array, float]:
    """Return correlation and power of one piece over all displacements (dv, du), and its pixels, all over variance."""
    height, width = phase_map.phase.shape
    u, v = look.corners_px[number]
    side, reach = TILE_PX + 2 * REACH_PX, REACH_PX
    top, left = max(v - reach, 0), max(u - reach, 0)
    place = np.s_[top : min(v + TILE_PX + reach, height), left : min(u + TILE_PX + reach, width)]
    seen = texture_of(phase_map.background[place], phase_map.phase[place])
    known = np.isfinite(seen)
    none = np.zeros((2 * reach + 1,) * 2)
    if known.mean() < _LEAST_OVERLAP:
        return none, none, 0.0
    window, mask = np.zeros((side, side), np.float32), np.zeros((side, side), np.float32)
    at = np.s_[top - v + reach :, left - u + reach :]
    inside = (slice(at[0].start, at[0].start + seen.shape[0]), slice(at[1].start, at[1].start + seen.shape[1]))
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


def _summit(z: Array, row: int, column: int) -> tuple[float, float, float]:
    """Return the place of the peak between the samples along u and v, and its standard uncertainty, px."""
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
            du, dv, _ = _summit(z, int(row), int(column))
            rows.append((u + TILE_PX / 2, v + TILE_PX / 2, du, dv))
    return np.array(rows).reshape(-1, 4)
