"""Unwrapping by counting fringes ("fields") along lines, as the first systems did, and its repair.

The wrapped phase of a line passes four regions in turn: I (0 to pi/2), II, III and IV (3 pi/2 to 2 pi). The
plain rule gives the next fringe a number one higher at every jump, which is right only as long as the phase
rises, as on a flat or gently tilted surface. On a folded surface it turns back. The repair looks at the regions
on both sides of a jump: from IV to I the number rises, from I to IV it falls.
"""

from typing import Literal

import numpy as np
from numba import njit
from numpy.typing import ArrayLike, NDArray

from fringecal.errors import PhaseError
from fringecal.numerics import TURN, over_bands

_QUARTERS = 2 / np.pi  # regions per rad


def count_fields(
    phase: ArrayLike,
    valid: ArrayLike | None = None,
    *,
    rule: Literal["plain", "regions"] = "regions",
    axis: Literal[0, 1] = 0,
) -> NDArray[np.float64]:
    """Unwrap every line of a phase map by itself, counting fringes along it.

    Parameters
    ----------
    phase
        Wrapped phase, rad, (H, W).
    valid
        True where the phase is to be used, (H, W).
    rule
        "plain": at every jump of more than pi the number rises by one, whichever way it goes; "regions": it rises
        from region IV to I and falls from I to IV.
    axis
        0 counts down the columns, 1 along the rows: across the fringes.

    Returns
    -------
    numpy.ndarray
        Phase with its field number, in units of rad, from 0 to 2 pi in field 0; NaN where not valid and, as no
        count can cross a gap, beyond the first gap of a line.

    Notes
    -----
    Kept for comparison with results of that time. An error runs on to the end of its line, where `unwrap` goes
    round it.

    Raises
    ------
    PhaseError
        Not a 2-D map, another mask, or an unknown rule.
    """
    wrapped = np.asarray(phase, np.float64)
    if wrapped.ndim != 2:
        raise PhaseError(f"found a phase map of shape {wrapped.shape}; counting needs (height, width)")
    if rule not in ("plain", "regions") or axis not in (0, 1):
        raise PhaseError(f'found rule {rule!r}, axis {axis!r}; needed: "plain" or "regions", and 0 or 1')
    usable = np.isfinite(wrapped)
    if valid is not None:
        mask = np.asarray(valid, bool)
        if mask.shape != wrapped.shape:
            raise PhaseError(f"valid has shape {mask.shape}, the phase map {wrapped.shape}: give one value per pixel")
        usable &= mask
    lines = np.mod(np.where(usable, wrapped, np.nan), TURN)
    lines = np.ascontiguousarray(np.moveaxis(lines, axis, -1))
    counted = np.full(lines.shape, np.nan)
    over_bands(_count, len(lines), lines, rule == "regions", counted)
    return np.ascontiguousarray(np.moveaxis(counted, -1, axis))


@njit(nogil=True, cache=True)
def _count(first_line, last_line, lines, by_regions, counted):  # type: ignore[no-untyped-def]
    """Count along some lines of phases in [0, 2 pi)."""
    for i in range(first_line, last_line):
        field, last, began = 0, 0.0, False
        for j in range(lines.shape[1]):
            here = lines[i, j]
            if np.isnan(here):
                if began:
                    break
                continue
            if began:
                field += _step(last, here, by_regions)
            began, last = True, here
            counted[i, j] = here + TURN * field


@njit(inline="always")
def _step(last, here, by_regions):  # type: ignore[no-untyped-def]
    """Return by how much the field number changes between two neighbours."""
    if not by_regions:
        return 1 if abs(here - last) > np.pi else 0
    before, after = int(last * _QUARTERS), int(here * _QUARTERS)
    # With noise a step may skip a region: II and III count to the side they lie on.
    if before >= 2 and after <= 1 and last - here > np.pi:
        return 1
    return -1 if before <= 1 and after >= 2 and here - last > np.pi else 0
