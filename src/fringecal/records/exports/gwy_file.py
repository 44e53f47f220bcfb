"""Height maps for Gwyddion: regular grids of z and u(z) in metres, masked where nothing was measured."""

from pathlib import Path
from typing import Any

import numpy as np

from fringecal import __version__
from fringecal.records.exports.cloud_files import demand_package
from fringecal.records.exports.regular_grid import RegularGrid, regular_grid
from fringecal.records.exports.triangles import Surface
from fringecal.records.files import replacing

_MM = 1e-3


def write_gwy(
    path: str | Path, surface: Surface, *, spacing_mm: float | None = None, max_jump_mm: float | None = None
) -> Path:
    """Write a height map as Gwyddion's native file, whole or not at all.

    Channel 0 is the height, channel 1 its standard uncertainty, in metres on one grid of the plate frame; the top row
    is that of the greatest y. What was not measured is masked, and holds the mean.

    Parameters
    ----------
    path, surface
        File to write, and the height map.
    spacing_mm, max_jump_mm
        As for `fringecal.records.exports.regular_grid.regular_grid`.

    Raises
    ------
    RecordError
        `gwyfile` is not installed, or too few pixels are valid to span a grid.
    """
    demand_package("gwyfile", "gwy")
    from gwyfile.objects import GwyContainer

    x, y, z, u_z = (np.where(surface.mask, part, np.nan) for part in (surface.x, surface.y, surface.z, surface.u_z))
    heights = regular_grid(x, y, z, spacing_mm=spacing_mm, max_jump_mm=max_jump_mm)
    # Where a cell jumps in height, its uncertainty is no more between its pixels than its height is.
    doubts = regular_grid(x, y, u_z, spacing_mm=heights.spacing_mm, max_jump_mm=np.inf)
    masked = ~(np.isfinite(heights.z_mm) & np.isfinite(doubts.z_mm))
    container = GwyContainer()
    for number, (title, grid) in enumerate((("height above the plate", heights), ("u of the height", doubts))):
        container[f"/{number}/data"] = _field(grid, masked, filled=True)
        container[f"/{number}/data/title"] = title
        container[f"/{number}/data/visible"] = True
        container[f"/{number}/mask"] = _field(grid, masked, filled=False)
        container[f"/{number}/meta"] = GwyContainer({"software": f"fringecal {__version__}", "frame": "plate"})
    with replacing(path) as sibling:
        container.tofile(str(sibling))
    return Path(path)


def _field(grid: RegularGrid, masked: np.ndarray, *, filled: bool) -> Any:
    """Return one field: heights with the mean where masked, or the mask itself (1 there)."""
    from gwyfile.objects import GwyDataField, GwySIUnit

    values = np.where(masked, np.nanmean(grid.z_mm), grid.z_mm) * _MM if filled else masked.astype(float)
    step = grid.spacing_mm * _MM
    rows, columns = values.shape
    return GwyDataField(
        np.ascontiguousarray(values[::-1]),
        xreal=columns * step,
        yreal=rows * step,
        xoff=(grid.x_mm[0] - grid.spacing_mm / 2) * _MM,
        yoff=-(grid.y_mm[-1] + grid.spacing_mm / 2) * _MM,
        si_unit_xy=GwySIUnit(unitstr="m"),
        si_unit_z=GwySIUnit(unitstr="m" if filled else ""),
    )
