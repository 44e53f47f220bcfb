"""Values that a reader takes off a map with the pointer: sampled on a grid, so that a page stays small."""

import base64
import json
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from fringecal.records import demand_maps, pixels_of_nodes, sample_spacing_mm

_LONGEST_SIDE = 200  # nodes: one layer of 200 x 150 takes 160 kB of a page


@dataclass(frozen=True)
class Layer:
    """One quantity of a `ReadableMap`: values at the nodes (rows, columns), NaN where there is none.

    `digits` are the decimal places that a reader is shown.
    """

    name: str
    unit: str
    values: np.ndarray
    digits: int = 3


@dataclass(frozen=True, eq=False)
class ReadableMap:
    """Quantities at the nodes of a regular grid, the same for all figures that show it.

    Parameters
    ----------
    coordinates
        Names of the horizontal and the vertical coordinate.
    unit
        Of both coordinates.
    start, step
        Coordinates of node [0, 0], and from one column, and from one row, to the next.
    layers
        Quantities; the first one is the height of a surface.
    reasons
        Number per node (rows, columns): 0, or the place in `reason_names`, counted from 1.
    reason_names
        Why a node has no value.
    """

    coordinates: tuple[str, str]
    unit: str
    start: tuple[float, float]
    step: tuple[float, float]
    layers: tuple[Layer, ...]
    reasons: np.ndarray | None = None
    reason_names: tuple[str, ...] = ()

    def text(self) -> str:
        """Write everything as JSON that may stand inside a page; arrays as base64 of little-endian numbers."""
        rows, columns = self.layers[0].values.shape
        content: dict[str, Any] = {
            "coordinates": self.coordinates,
            "unit": self.unit,
            "start": self.start,
            "step": self.step,
            "size": (columns, rows),
            "layers": [
                {"name": one.name, "unit": one.unit, "digits": one.digits, "values": _encoded(_known(one), "<f4")}
                for one in self.layers
            ],
            "reasons": None if self.reasons is None else _encoded(self.reasons, "u1"),
            "reasonNames": self.reason_names,
        }
        # No text may end the element that it stands in.
        return json.dumps(content, ensure_ascii=False, allow_nan=False).replace("<", "\\u003c")


def readable_plate(
    x_mm: np.ndarray,
    y_mm: np.ndarray,
    layers: tuple[Layer, ...],
    *,
    masks: Mapping[str, np.ndarray] | None = None,
    unit: str = "mm",
    longest_side: int = _LONGEST_SIDE,
) -> ReadableMap:
    """Sample maps given per pixel at the nodes of a grid in the plate frame; each node shows its nearest pixel.

    Parameters
    ----------
    x_mm, y_mm
        Coordinates per pixel (H, W), mm, NaN where masked.
    layers
        Quantities per pixel (H, W).
    masks
        Why pixels are masked: true pixels (H, W) by reason; the first one that holds is shown.
    unit
        Of both coordinates.
    longest_side
        Most nodes along a side.

    Raises
    ------
    RecordError
        Shapes disagree, or too few pixels are valid to span a grid.
    """
    demand_maps(x_mm, y_mm, *(one.values for one in layers), *(masks or {}).values())
    spacing = sample_spacing_mm(x_mm, y_mm)
    spans = np.array([np.nanmax(part) - np.nanmin(part) for part in (x_mm, y_mm)])
    step = max(spacing, float(spans.max()) / (longest_side - 1))
    start = (float(np.nanmin(x_mm)), float(np.nanmin(y_mm)))
    nodes = [first + step * np.arange(int(span / step) + 1) for first, span in zip(start, spans, strict=True)]
    rows, columns = pixels_of_nodes(x_mm, y_mm, *nodes)
    unseen = rows < 0
    sampled = tuple(replace(one, values=np.where(unseen, np.nan, one.values[rows, columns])) for one in layers)
    reasons = np.zeros(unseen.shape, np.uint8)
    for number, mask in reversed(list(enumerate((masks or {}).values(), start=1))):
        reasons[~unseen & mask[rows, columns]] = number
    return ReadableMap(("x", "y"), unit, start, (step, step), sampled, reasons, tuple(masks or ()))


def readable_picture(layer: Layer, *, step_px: int = 1, longest_side: int = _LONGEST_SIDE) -> ReadableMap:
    """Thin out one quantity given over the camera's picture, row 0 at the top.

    Parameters
    ----------
    layer
        The quantity, one value per `step_px` pixels of the picture.
    step_px
        Pixels of the picture from one value to the next; a value belongs to the middle of its cell.
    longest_side
        Most nodes along a side.
    """
    thin = -(-max(layer.values.shape) // longest_side)
    middle, step = (step_px - 1) / 2, float(step_px * thin)
    thinned = replace(layer, values=layer.values[::thin, ::thin])
    return ReadableMap(("u", "v"), "px", (middle, middle), (step, step), (thinned,))


def _known(layer: Layer) -> np.ndarray:
    return np.where(np.isfinite(layer.values), layer.values, np.nan)


def _encoded(values: np.ndarray, kind: str) -> str:
    return base64.b64encode(np.ascontiguousarray(values, dtype=kind).tobytes()).decode("ascii")
