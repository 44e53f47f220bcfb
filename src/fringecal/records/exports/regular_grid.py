"""A map given per pixel, resampled onto a regular grid in the plate frame."""

from dataclasses import dataclass

import numpy as np
from scipy import ndimage

from fringecal.errors import RecordError

# Sample spacings. Neighbouring samples steeper than about 76 degrees count as a jump: a wall that a camera above it has
# not seen.
_JUMP_SAMPLES = 4.0
_ITERATIONS = 15  # of the search for pixels; each leaves the share by which the map departs from a plane view
_SETTLED_PX = 1e-3  # change of a pixel's place that ends the search: a thousandth of a sample
_BLOCK_ROWS = 256  # of the grid, searched at a time: memory
_NO_WEIGHT = 1e-6  # of a corner's share in a node, and of an area against its sides: rounding
_FIT_SAMPLES = 20_000  # through which the affine part is drawn; it has six numbers
_ROUNDING = 5e-7  # of a step, over which the last sample is a node in spite of rounding


@dataclass(frozen=True)
class RegularGrid:
    """Values on a regular grid: `z_mm[j, i]` at (`x_mm[i]`, `y_mm[j]`), both ascending."""

    x_mm: np.ndarray
    y_mm: np.ndarray
    z_mm: np.ndarray
    spacing_mm: float


def sample_spacing_mm(x_mm: np.ndarray, y_mm: np.ndarray) -> float:
    """Give the median distance of neighbouring samples of two maps (H, W), in mm.

    Raises
    ------
    RecordError
        No two neighbouring pixels are valid.
    """
    along = np.hypot(np.diff(x_mm, axis=1), np.diff(y_mm, axis=1)).ravel()
    across = np.hypot(np.diff(x_mm, axis=0), np.diff(y_mm, axis=0)).ravel()
    steps = np.concatenate([along, across])
    steps = steps[steps > 0]  # drops NaN too
    if steps.size == 0:
        raise RecordError("no two neighbouring pixels are valid; a surface needs some, check its mask")
    return float(np.median(steps))


def jump_limit_mm(x_mm: np.ndarray, y_mm: np.ndarray) -> float:
    """Give the default limit of a jump between neighbours: four sample spacings, in mm."""
    return _JUMP_SAMPLES * sample_spacing_mm(x_mm, y_mm)


def demand_maps(*maps: np.ndarray) -> None:
    """Refuse maps that are not two-dimensional, not of one shape, or smaller than 2 x 2.

    Raises
    ------
    RecordError
        With the shapes found.
    """
    shapes = {np.shape(values) for values in maps}
    if len(shapes) != 1 or any(len(shape) != 2 or min(shape) < 2 for shape in shapes):
        raise RecordError(f"maps of one shape (H, W), at least 2 x 2, were needed, found {sorted(shapes)}")


def regular_grid(
    x_mm: np.ndarray,
    y_mm: np.ndarray,
    z_mm: np.ndarray,
    *,
    spacing_mm: float | None = None,
    max_jump_mm: float | None = None,
) -> RegularGrid:
    """Resample a map given per pixel onto a regular grid in the plate frame.

    For every node X the pixel position p that sees it is found by fixed-point iteration,
    ``p <- A^-1 (X - r(p))`` with A the affine part of the map from pixels to mm and r the rest;
    the value there is bilinear in its four pixels. A node is NaN where one of the four is, where
    they differ by more than the jump limit, and where no pixel sees it.

    Parameters
    ----------
    x_mm, y_mm, z_mm
        Coordinates and value per pixel (H, W), NaN where masked.
    spacing_mm
        Distance of the nodes; by default the median distance of the samples.
    max_jump_mm
        Largest difference of z within one cell; by default four sample spacings.

    Raises
    ------
    RecordError
        Shapes disagree, or too few pixels are valid to span a grid.
    """
    demand_maps(x_mm, y_mm, z_mm)
    valid = np.isfinite(x_mm) & np.isfinite(y_mm) & np.isfinite(z_mm)
    samples = sample_spacing_mm(np.where(valid, x_mm, np.nan), np.where(valid, y_mm, np.nan))
    spacing = samples if spacing_mm is None else spacing_mm
    limit = _JUMP_SAMPLES * samples if max_jump_mm is None else max_jump_mm
    nodes_x, nodes_y = _nodes(x_mm[valid], spacing), _nodes(y_mm[valid], spacing)
    pixels = _map_pixels(x_mm, y_mm, valid)
    z = np.where(valid, z_mm, np.nan).astype(float)
    blocks = [
        _bilinear(z, *_find_pixels(pixels, nodes_x, nodes_y[start : start + _BLOCK_ROWS]), limit)
        for start in range(0, nodes_y.size, _BLOCK_ROWS)
    ]
    return RegularGrid(nodes_x, nodes_y, np.vstack(blocks), spacing)


def pixels_of_nodes(
    x_mm: np.ndarray, y_mm: np.ndarray, nodes_x_mm: np.ndarray, nodes_y_mm: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Find the pixel that sees each node of a grid in the plate frame, of masked pixels too.

    Parameters
    ----------
    x_mm, y_mm
        Coordinates per pixel (H, W), mm, NaN where masked; there the nearest valid ones are continued.
    nodes_x_mm, nodes_y_mm
        Coordinates of the grid's columns (n,) and rows (m,), mm.

    Returns
    -------
    rows, columns
        Nearest pixel of every node (m, n), -1 where none sees it.

    Raises
    ------
    RecordError
        Shapes disagree, or too few pixels are valid to say where the others look.
    """
    demand_maps(x_mm, y_mm)
    pixels = _map_pixels(x_mm, y_mm, np.isfinite(x_mm) & np.isfinite(y_mm))
    found = _find_pixels(pixels, nodes_x_mm, nodes_y_mm)
    rows, columns = (np.nan_to_num(np.rint(part), nan=-1).astype(int) for part in found)
    return rows, columns


def _nodes(values_mm: np.ndarray, spacing_mm: float) -> np.ndarray:
    low, high = float(values_mm.min()), float(values_mm.max())
    return low + spacing_mm * np.arange(int((high - low) / spacing_mm + _ROUNDING) + 1)


@dataclass(frozen=True)
class _PixelMap:
    """Plate coordinates of the pixels, split into an affine part and the rest."""

    origin_mm: np.ndarray
    to_pixels: np.ndarray
    rest_x_mm: np.ndarray
    rest_y_mm: np.ndarray


def _map_pixels(x_mm: np.ndarray, y_mm: np.ndarray, valid: np.ndarray) -> _PixelMap:
    some = np.flatnonzero(valid)[:: max(1, int(valid.sum()) // _FIT_SAMPLES)]
    rows, columns = np.unravel_index(some, valid.shape)
    design = np.column_stack([np.ones(some.size), rows, columns])
    observed = np.column_stack([x_mm.ravel()[some], y_mm.ravel()[some]])
    solution, _, rank, _ = np.linalg.lstsq(design, observed, rcond=None)
    if rank < 3 or abs(np.linalg.det(solution[1:])) < _NO_WEIGHT:
        raise RecordError("the valid pixels lie on one line; a surface needs an area, check its mask")
    every_row, every_column = np.ogrid[: valid.shape[0], : valid.shape[1]]
    rest_x, rest_y = (
        np.where(valid, values - (a + b * every_row + c * every_column), np.nan)
        for values, (a, b, c) in zip((x_mm, y_mm), solution.T, strict=True)
    )
    if not valid.all():
        nearest = ndimage.distance_transform_edt(~valid, return_distances=False, return_indices=True)
        rest_x, rest_y = rest_x[tuple(nearest)], rest_y[tuple(nearest)]
    return _PixelMap(solution[0], np.linalg.inv(solution[1:].T), rest_x, rest_y)


def _find_pixels(pixels: _PixelMap, x_mm: np.ndarray, y_mm: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Find (rows, columns) of the nodes, NaN where no pixel sees a node or two disagree."""
    wanted = np.stack(np.meshgrid(x_mm - pixels.origin_mm[0], y_mm - pixels.origin_mm[1]))
    found = np.tensordot(pixels.to_pixels, wanted, axes=1)
    change = np.full(found.shape[1:], np.inf)
    for _ in range(_ITERATIONS):
        rest = np.stack(
            [
                ndimage.map_coordinates(part, found, order=1, mode="nearest")
                for part in (pixels.rest_x_mm, pixels.rest_y_mm)
            ]
        )
        moved = np.tensordot(pixels.to_pixels, wanted - rest, axes=1)
        change, found = np.abs(moved - found).max(axis=0), moved
        if change.max() < _SETTLED_PX:
            break
    inside = (found > -_SETTLED_PX).all(axis=0)
    inside &= found[0] < pixels.rest_x_mm.shape[0] - 1 + _SETTLED_PX
    inside &= found[1] < pixels.rest_x_mm.shape[1] - 1 + _SETTLED_PX
    found = np.where(inside & (change < _SETTLED_PX), found, np.nan)
    return found[0], found[1]


def _bilinear(z: np.ndarray, rows: np.ndarray, columns: np.ndarray, limit: float) -> np.ndarray:
    """Interpolate z at (rows, columns); NaN where a pixel that counts is, or where they differ too much."""
    known = np.isfinite(rows)
    rows, columns = rows[known], columns[known]
    top = np.clip(np.floor(rows), 0, z.shape[0] - 2).astype(int)
    left = np.clip(np.floor(columns), 0, z.shape[1] - 2).astype(int)
    down, right = np.clip(rows - top, 0, 1), np.clip(columns - left, 0, 1)
    weights = np.stack([(1 - down) * (1 - right), (1 - down) * right, down * (1 - right), down * right])
    corners = np.stack([z[top, left], z[top, left + 1], z[top + 1, left], z[top + 1, left + 1]])
    counts = weights > _NO_WEIGHT
    mixed = np.where(counts, weights * corners, 0.0).sum(axis=0)
    span = np.where(counts, corners, -np.inf).max(axis=0) - np.where(counts, corners, np.inf).min(axis=0)
    values = np.full(known.shape, np.nan)
    values[known] = np.where(span <= limit, mixed, np.nan)
    return values
