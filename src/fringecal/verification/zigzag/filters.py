"""Median and mean filters before and after, and the table that ranks their combinations."""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from fringecal.targets import Zigzag
from fringecal.verification.zigzag.height_errors import ZigzagErrors, zigzag_errors
from fringecal.verification.zigzag.pose import ZigzagPose
from fringecal.verification.zigzag.zigzag_shape import Floats, Surface, ZigzagShape

FILTERS = ("none", "median", "mean", "median+mean")  # 3 x 3 each, in the order named


@dataclass(frozen=True)
class FilterResult:
    """Errors for one combination of filters; rank 1 has the smallest rms."""

    before: str
    after: str
    errors: ZigzagErrors
    rank: int = 0


@dataclass(frozen=True)
class _FilteredSurface:
    x: NDArray[np.floating]
    y: NDArray[np.floating]
    z: NDArray[np.floating]
    u_z: NDArray[np.floating]
    mask: NDArray[np.bool_]


def filtered(image: NDArray[np.generic], name: str, *, valid: NDArray[np.bool_] | None = None) -> Floats:
    """Filter an image or a height map by a named 3 x 3 filter; masked pixels take no part and stay.

    Parameters
    ----------
    image
        (H, W) grey values or heights; NaN counts as masked.
    name
        One of `FILTERS`.
    valid
        (H, W) False where masked.

    Examples
    --------
    >>> spike = np.zeros((5, 5)); spike[2, 2] = 9.0
    >>> float(filtered(spike, "median").max()), float(filtered(spike, "mean").max())
    (0.0, 1.0)
    """
    if name not in FILTERS:
        raise ValueError(f"filter {name!r} is not one of {FILTERS}")
    values = np.asarray(image, float)
    keep = np.isfinite(values) if valid is None else np.isfinite(values) & valid
    result = np.where(keep, values, np.nan)
    for step in name.split("+") if name != "none" else ():
        result = np.where(keep, (_median if step == "median" else _mean)(_neighbours(result)), np.nan)
    return np.where(keep, result, values)


def filter_study(
    surfaces: Mapping[str, Surface], target: Zigzag | ZigzagShape, pose: ZigzagPose
) -> tuple[FilterResult, ...]:
    """Judge every combination of a filter before and a filter after, best first.

    Parameters
    ----------
    surfaces
        Surface by the name of the filter that its frames went through, for example
        ``{"none": surface}`` or one for each of `FILTERS`.
    target, pose
        The target and its pose, the same for all: a filter must not move the bars.
    """
    results = [
        FilterResult(before, after, zigzag_errors(_after(surface, after), target, pose))
        for before, surface in surfaces.items()
        for after in FILTERS
    ]
    results.sort(key=lambda result: result.errors.pooled.rms_mm)
    return tuple(replace(result, rank=rank) for rank, result in enumerate(results, start=1))


def ranking_table(results: tuple[FilterResult, ...]) -> pd.DataFrame:
    """Tabulate combinations of filters, best first: pooled errors, with edge zones as `_edges`."""
    rows = [
        {"rank": r.rank, "before": r.before, "after": r.after}
        | _columns(r.errors, edges=False)
        | {f"{key}_edges": value for key, value in _columns(r.errors, edges=True).items()}
        for r in results
    ]
    return pd.DataFrame(rows)


def models_table(models: Mapping[str, ZigzagErrors]) -> pd.DataFrame:
    """Height models side by side: pooled errors, worst band, and the mean of the profiles' largest errors."""
    rows = [
        {"model": name}
        | _columns(errors, edges=False)
        | {
            "worst_band_percent": errors.worst_band_percent,
            "mean_of_max_percent": float(np.mean([p.max_percent for p in errors.profiles])),
        }
        for name, errors in models.items()
    ]
    return pd.DataFrame(rows)


def _columns(errors: ZigzagErrors, *, edges: bool) -> dict[str, float]:
    pooled = errors.pooled_with_edges if edges else errors.pooled
    keys = ("mean_mm", "sd_mm", "rms_mm", "max_abs_mm", "mean_percent", "max_percent")
    return {key: getattr(pooled, key) for key in keys}


def _after(surface: Surface, name: str) -> _FilteredSurface:
    mask = np.asarray(surface.mask, bool)
    return _FilteredSurface(surface.x, surface.y, filtered(surface.z, name, valid=mask), surface.u_z, mask)


def _neighbours(values: Floats) -> Floats:
    """Stack the nine neighbours of every pixel, (9, H, W); outside the picture is NaN."""
    padded = np.pad(values, 1, constant_values=np.nan)
    height, width = values.shape
    return np.stack([padded[i : i + height, j : j + width] for i in range(3) for j in range(3)])


def _mean(stack: Floats) -> Floats:
    known = np.isfinite(stack)
    return np.where(known, stack, 0.0).sum(axis=0) / np.maximum(known.sum(axis=0), 1)


def _median(stack: Floats) -> Floats:
    """Median of the known neighbours; sorting puts NaN last, so the middle of the known is an index."""
    ordered = np.sort(stack, axis=0)
    known = np.isfinite(stack).sum(axis=0)
    low = np.take_along_axis(ordered, np.maximum(known - 1, 0)[None] // 2, axis=0)[0]
    high = np.take_along_axis(ordered, (known // 2 * (known > 0))[None] % 9, axis=0)[0]
    return (low + high) / 2
