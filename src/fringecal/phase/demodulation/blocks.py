"""Blocks of a few fringes in which the phase is smooth: what every frame really shows against its carrier.

Three frames determine three unknowns per pixel, so nothing can be checked in any one pixel. Over a few fringes
of a smooth surface it can: there the true phase is a low polynomial, the carrier, and each frame is a wave on it
whose phase, amplitude, background and harmonics are measured on their own.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fringecal.errors import PhaseError
from fringecal.numerics import TURN
from fringecal.phase.demodulation.demodulate import PhaseMap
from fringecal.phase.demodulation.fringe_period import FringePeriod, fringe_period
from fringecal.phase.unwrapping.spatial import unwrap

BLOCK_FRINGES = 3.0
"""Length of a block in fringe periods: enough to part carrier, harmonics and shading."""

HARMONICS = (2, 3, 4)
"""Orders of the wave's harmonics that are measured."""

RIPPLE_ORDERS = (1, 2, 3, 4, 6)
"""Orders, against the fringes, of the ripple that is distinguished from the carrier."""

_RIDGE = 1e-9  # of the normal equations' diagonal: keeps them regular where a ripple is a multiple of the carrier
_NO_LIGHT = 1e-12  # grey levels squared, for blocks without any


@dataclass(frozen=True)
class BlockRules:
    """How a picture is cut into blocks, and which of them are smooth enough.

    Parameters
    ----------
    limits_px
        Shortest and longest side of a block, px: carrier, ripple, shading and harmonics are fitted over it, which noise
        spoils in smaller ones; larger ones are no small part of a picture.
    enough
        Blocks that a picture should have: fewer say little of their own scatter.
    sizes
        Fringes across a block, and its length along them over that across, in the order in which they are tried until
        there are enough.
    samples_along
        Most samples along each side of a block: 20 to a fringe resolve the sixth order of ripple.
    valid_share
        Least share of a block's pixels in its largest connected piece.
    cycles
        Fringes that a block must show: over less than two, harmonics and shading cannot be distinguished.
    roughness_rad
        Most that the phase may scatter about its smooth course, rms, rad: an edge within the block leaves more, noise
        of the worst pixels that are kept (`MAX_SIGMA_RAD`) less.
    """

    limits_px: tuple[int, int] = (24, 1500)
    enough: int = 16
    sizes: tuple[tuple[float, float], ...] = (
        (BLOCK_FRINGES, 1 / 3), (BLOCK_FRINGES, 1 / 6), (2.3, 1 / 6), (2.3, 1 / 12),
    )  # fmt: skip
    samples_along: int = 64
    valid_share: float = 0.7
    cycles: float = 1.8
    roughness_rad: float = 0.35


BLOCK_RULES = BlockRules()


@dataclass(frozen=True)
class Block:
    """What the frames show in one block.

    Parameters
    ----------
    u_px, v_px
        Centre in the picture.
    signal
        Complex modulation of each frame on the carrier, `c_n + i s_n` of
        `a_n + c_n cos f - s_n sin f`, grey levels, (N,).
    background
        a_n, grey levels, (N,).
    harmonics
        The same as `signal` at the orders of `HARMONICS`, (3, N).
    ripple
        Complex amplitudes of the phase error at `RIPPLE_ORDERS`, rad: the error is
        `Re(r exp(-i k phase))`, (5,).
    rms
        Residual of the frames, rms, grey levels.
    noise
        The same without what all frames of a pixel share in proportion to their light, as texture is: noise, and
        whatever else differs from frame to frame, grey levels.
    """

    u_px: float
    v_px: float
    signal: NDArray[np.complex128]
    background: NDArray[np.float64]
    harmonics: NDArray[np.complex128]
    ripple: NDArray[np.complex128]
    rms: float
    noise: float


def measure_blocks(
    grey: NDArray, map_: PhaseMap, mask: ArrayLike | None = None, *, rules: BlockRules = BLOCK_RULES
) -> list[Block]:
    """Cut the picture into blocks and measure those in which the surface is smooth.

    Parameters
    ----------
    grey
        Frames, grey levels, (N, H, W).
    map_
        The same, demodulated.
    mask
        True where the surface is to be used, (H, W); by default wherever there is a phase.
    rules
        Size of the blocks, and how smooth they must be.

    Raises
    ------
    PhaseError
        No pixel carries a phase.
    """
    valid = map_.valid if mask is None else map_.valid & np.asarray(mask, bool)
    if not valid.any():
        raise PhaseError(
            "no pixel carries a phase, so no phase shift can be measured: check exposure and stated phase shifts"
        )
    unwrapped = unwrap(map_.phase, valid)
    rows, columns = _block_shape(fringe_period(map_.phase, valid), valid.shape, rules)
    tiles = _Tiles(rows, columns, valid.shape[1] // columns, rules.samples_along)
    blocks: list[Block] = []
    for top in range(0, max(valid.shape[0] - rows, 0) + 1, rows):
        row = [tiles.of(part, top) for part in (unwrapped.phase, unwrapped.pieces, *grey)]
        blocks += _measure_row(row[0], row[1], np.stack(row[2:], axis=1), tiles, top, rules)
    return blocks


@dataclass(frozen=True)
class _Tiles:
    """Blocks side by side in a picture: size in px, how many there are in a row of them, most samples along a side."""

    rows: int
    columns: int
    number: int
    samples_along: int

    @property
    def spacing_px(self) -> tuple[int, int]:
        """Thinning along v and u where blocks are large: long fringes need no dense samples."""
        return -(-self.rows // self.samples_along), -(-self.columns // self.samples_along)

    def of(self, picture: NDArray, top: int) -> NDArray:
        """Return the samples of one row of blocks, (number, samples)."""
        step_v, step_u = self.spacing_px
        strip = picture[top : top + self.rows : step_v, : self.number * self.columns]
        parts = strip.reshape(len(strip), self.number, self.columns)[:, :, ::step_u]
        return parts.transpose(1, 0, 2).reshape(self.number, -1)

    @property
    def places(self) -> tuple[NDArray, NDArray]:
        """Column and row of every sample within its block, in samples, (samples,) each."""
        step_v, step_u = self.spacing_px
        columns, rows = np.meshgrid(np.arange(-(-self.columns // step_u)), np.arange(-(-self.rows // step_v)))
        return columns.ravel().astype(float), rows.ravel().astype(float)


def _block_shape(period: FringePeriod, shape: tuple[int, ...], rules: BlockRules) -> tuple[int, int]:
    """Return rows and columns of a block: a few fringes across, less along them, least where blocks would be few."""
    tried = [_shape_of(period, shape, *size, rules.limits_px) for size in rules.sizes]
    numbers = [(shape[0] // rows) * (shape[1] // columns) for rows, columns in tried]
    enough = [size for size, number in zip(tried, numbers, strict=True) if number >= rules.enough]
    return enough[0] if enough else tried[int(np.argmax(numbers))]


def _shape_of(
    period: FringePeriod, shape: tuple[int, ...], fringes: float, aspect: float, limits_px: tuple[int, int]
) -> tuple[int, int]:
    direction = np.deg2rad(period.direction_deg)
    lengths = fringes * period.period_px * np.maximum(np.abs([np.sin(direction), np.cos(direction)]), aspect)
    least, most = limits_px
    rows, columns = (int(np.clip(round(length), least, most)) for length in lengths)
    # Pictures a little shorter than a block are still worth a try.
    return min(rows, max(shape[0], 1)), min(columns, max(shape[1], 1))


def _measure_row(  # noqa: PLR0913, PLR0917 -- private: one row of blocks
    phase: NDArray, pieces: NDArray, grey: NDArray, tiles: _Tiles, top: int, rules: BlockRules
) -> list[Block]:
    """Measure all frames of a row of blocks against their smooth phase; blocks that are not smooth are left out.

    `phase` and `pieces` are (blocks, samples), `grey` (blocks, N, samples).
    """
    use = _largest_piece(pieces)
    some = use.mean(axis=1) >= rules.valid_share
    if not some.any():
        return []
    use, phase, grey = use[some], np.where(use, phase, 0.0)[some], grey[some]
    quadratic, centre = _quadratic(use, tiles)
    carrier, ripple, roughness = _carrier(quadratic, phase, use)
    span = np.ptp(np.where(use, carrier, carrier.min(axis=1, where=use, initial=np.inf)[:, None]), axis=1)
    good = (roughness <= rules.roughness_rad) & (span >= TURN * rules.cycles)
    if not good.any():
        return []
    left = tiles.columns * np.flatnonzero(some)[good]
    u_px, v_px = left + centre[0][good] * tiles.spacing_px[1], top + centre[1][good] * tiles.spacing_px[0]
    signal, background, harmonics, *spread = _fit_frames(grey[good], carrier[good], quadratic[good], use[good])
    spreads = (part.tolist() for part in spread)
    rows = zip(u_px.tolist(), v_px.tolist(), signal, background, harmonics, ripple[good], *spreads, strict=True)
    return [Block(*row) for row in rows]


def _largest_piece(pieces: NDArray) -> NDArray[np.bool_]:
    """Return where each block shows its largest connected piece, (blocks, samples)."""
    use = np.zeros(pieces.shape, bool)
    for found, row in zip(use, pieces, strict=True):
        lit = row[row > 0]
        if lit.size:
            found[:] = row == (lit[0] if (lit == lit[0]).all() else np.bincount(lit).argmax())
    return use


def _quadratic(use: NDArray[np.bool_], tiles: _Tiles) -> tuple[NDArray, tuple[NDArray, NDArray]]:
    """Return 1, x, y, x x, x y, y y about each block's centre, 0 where not used, (blocks, 6, samples); and centres."""
    number = use.sum(axis=1)
    places = tiles.places
    centre = (use @ places[0] / number, use @ places[1] / number)
    x, y = ((p - c[:, None]) / (p.max() + 1) for p, c in zip(places, centre, strict=True))
    # Not by `products_up_to`: the first three terms are the shading's, and the samples stand last.
    return np.stack([np.ones_like(x), x, y, x * x, x * y, y * y], axis=1) * use[:, None], centre


def _waves(phase: NDArray, orders: tuple[int, ...]) -> NDArray:
    """Return cosine and sine of multiples of a phase by turns, (blocks, 2 orders, samples)."""
    turned = np.exp(1j * phase)
    return np.stack([part for k in orders for part in ((turned**k).real, (turned**k).imag)], axis=1)


def _carrier(
    quadratic: NDArray, phase: NDArray, use: NDArray[np.bool_]
) -> tuple[NDArray, NDArray[np.complex128], NDArray]:
    """Fit a quadratic and a ripple together; return the quadratic, the ripple's amplitudes and the rms left."""
    basis = np.concatenate([quadratic, _waves(phase, RIPPLE_ORDERS) * use[:, None]], axis=1)
    # Normal equations: few well-scaled columns, thousands of rows; a trace keeps them regular.
    normal = basis @ basis.mT
    normal *= 1 + _RIDGE * np.eye(normal.shape[-1])
    coefficients = np.linalg.solve(normal, basis @ phase[:, :, None])
    left = phase - (coefficients.mT @ basis)[:, 0]
    pairs = coefficients[:, 6:, 0].reshape(len(phase), -1, 2)
    carrier = (coefficients[:, :6].mT @ quadratic)[:, 0]
    return carrier, pairs @ [1, 1j], np.sqrt(np.sum(left**2, axis=1) / use.sum(axis=1))


def _fit_frames(
    grey: NDArray, carrier: NDArray, quadratic: NDArray, use: NDArray[np.bool_]
) -> tuple[NDArray, NDArray, NDArray, NDArray, NDArray]:
    """Fit every frame by shading, carrier with a slope, and harmonics: signal, background, harmonics, rms, noise."""
    slopes, frames = quadratic[:, :3], grey * use[:, None].astype(float)
    cosine, sine = np.cos(carrier)[:, None], -np.sin(carrier)[:, None]
    waves = _waves(-carrier, HARMONICS) * use[:, None]
    basis = np.concatenate([quadratic, slopes * cosine, slopes * sine, waves], axis=1)
    coefficients = np.linalg.solve(basis @ basis.mT, basis @ frames.mT)
    residual = frames - coefficients.mT @ basis
    signal = coefficients[:, 6] + 1j * coefficients[:, 9]
    harmonics = coefficients[:, 12::2] + 1j * coefficients[:, 13::2]
    number = use.sum(axis=1)
    return signal, coefficients[:, 0], harmonics, _rms(residual, number), _noise(residual, frames, number)


def _rms(residual: NDArray, number: NDArray) -> NDArray:
    """Rms over all frames and the `number` of samples used in each block; residuals are 0 elsewhere."""
    return np.asarray(np.sqrt(np.sum(residual**2, axis=(1, 2)) / (number * residual.shape[1])))


def _noise(residual: NDArray, grey: NDArray, number: NDArray) -> NDArray:
    """Return the rms residual without texture: in each pixel the part in proportion to its light."""
    n = grey.shape[1]
    texture = (residual * grey).sum(axis=1) / np.maximum((grey * grey).sum(axis=1), _NO_LIGHT)
    return _rms(residual - texture[:, None] * grey, number) * np.sqrt(n / (n - 1))
