"""A measured surface in a report: as a map to be read, and as a view to be turned."""

import numpy as np

from fringecal.reconstruct import HeightMap, Reason
from fringecal.report import FigureItem, Layer, Live, ReadableMap, height_map, readable_plate, surface_view

_RELIEF = 6  # of a surface's longer side: so small a part of it is relief enough
_FACTORS = (1, 2, 5, 10, 20, 50, 100)


def stretch_of(surface: HeightMap) -> float:
    """Choose by how much a view stretches heights, so that a flat object keeps a visible relief.

    A sixth of the longer side is relief enough; factors are 1, 2, 5, 10 and so on.
    """
    sides = [float(np.nanmax(part) - np.nanmin(part)) for part in (surface.x, surface.y)]
    wanted = max(sides) / _RELIEF / max(float(np.nanmax(surface.z) - np.nanmin(surface.z)), 1e-9)
    return float(max([f for f in _FACTORS if f <= wanted], default=1))


def readable_surface(surface: HeightMap, *further: Layer) -> ReadableMap:
    """Sample a surface for the reader of a page: z, u(z) and further quantities, or why there is no height.

    Parameters
    ----------
    surface
        The measured surface.
    further
        Quantities per pixel (H, W) beside them.
    """
    layers = (Layer("z", "mm", surface.z), Layer("u(z)", "mm", surface.u_z, 4), *further)
    masks = {(r.name or "").lower().replace("_", " "): (surface.reasons & r) > 0 for r in Reason}
    return readable_plate(surface.x, surface.y, layers, masks=masks)


def height_item(caption: str, surface: HeightMap, values: ReadableMap, alt: str) -> FigureItem:
    """Draw a surface as a map whose values are read under the pointer."""
    return FigureItem(caption, height_map(surface.x, surface.y, surface.z), alt, "png", Live(values))


def surface_item(caption: str, surface: HeightMap, values: ReadableMap, alt: str) -> FigureItem:
    """Draw a surface obliquely, stretched so that its relief shows; the reader of a page can turn it."""
    stretch = stretch_of(surface)
    view = surface_view(surface.x, surface.y, surface.z, exaggeration=stretch)
    return FigureItem(caption, view, alt, "png", Live(values, stretch))
