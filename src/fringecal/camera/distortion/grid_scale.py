"""The scaling factor the thesis's way: distances between grid lines, their mean, and what it costs."""

import math
from dataclasses import dataclass, replace

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy import special

from fringecal.detect import Family, GridDetection
from fringecal.errors import DetectionError
from fringecal.uncertainty import Estimate, effective_dof

Array = NDArray[np.float64]

#: Distances are taken over these numbers of pitches, as far as the grid reaches.
SPANS = (1, 2, 5, 10)
#: The factor comes from this middle part of the lines, as in the thesis; the rest serves as check points.
MIDDLE_PART = 1 / 3


@dataclass(frozen=True)
class ThesisScale:
    """Scaling factors with the tables they come from.

    Parameters
    ----------
    horizontal, vertical, mean
        Factors in mm/px: from distances between vertical lines, between horizontal lines, and their mean.
    vertical_lines, horizontal_lines
        Distances between the lines of a family at the middle of the picture (the thesis's tables 3.1, 3.2).
    horizontal_errors, vertical_errors
        Distances at points that gave no factor, by the mean one, and their errors (tables 3.3, 3.4).
    largest_error_percent
        The largest of those errors, signed.
    """

    horizontal: Estimate
    vertical: Estimate
    mean: Estimate
    vertical_lines: pd.DataFrame
    horizontal_lines: pd.DataFrame
    horizontal_errors: pd.DataFrame
    vertical_errors: pd.DataFrame
    largest_error_percent: float

    def beside(self, at_centre: Estimate) -> "ThesisScale":
        """Widen the mean factor's u by its distance from the scale at the image centre, a rectangular half width.

        Distances between lines know of no tilt: their scatter alone would deny what it does to the mean.
        """
        shift = abs(self.mean.value - at_centre.value) / math.sqrt(3)
        return replace(self, mean=replace(self.mean, u=math.hypot(self.mean.u, shift)))

    @property
    def anisotropy(self) -> Estimate:
        """Vertical over horizontal factor; the pitch, common to both, drops out."""
        value = self.vertical.value / self.horizontal.value
        own = [self._scatter(factor) / factor.value for factor in (self.horizontal, self.vertical)]
        dof = min(len(self.vertical_lines), len(self.horizontal_lines)) - 1
        return Estimate(value, value * math.hypot(*own), "", "anisotropy", dof)

    @property
    def anisotropy_p(self) -> float:
        """Probability of so large an anisotropy by the scatter of the distances alone."""
        found = self.anisotropy
        return float(2 * special.stdtr(found.dof, -abs(found.value - 1) / found.u)) if found.u > 0 else 1.0

    def _scatter(self, factor: Estimate) -> float:
        table = self.vertical_lines if factor is self.horizontal else self.horizontal_lines
        factors = table.loc[table["span"] == 1, "factor_mm_per_px"]
        return float(factors.std(ddof=1) / math.sqrt(len(factors)))


def thesis_scale(detection: GridDetection, pitch_mm: Estimate) -> ThesisScale:
    """Scaling factor from the distances between grid lines, and the errors of using it.

    Parameters
    ----------
    detection
        The grid found in the picture.
    pitch_mm
        Distance of neighbouring lines on the paper, mm; its u counts in every factor.

    Raises
    ------
    DetectionError
        If no two neighbouring lines are seen at the middle of the grid.

    Notes
    -----
    A factor is pitch times span over the mean distance, px, of two lines along the middle third of
    their length. The mean of a direction is over neighbouring lines; its u combines their scatter over
    sqrt(n) with the pitch's own. One factor for a picture is exact only without tilt and distortion: the
    error tables, from the outer two thirds, say what it costs.
    """
    table_u = _distances(detection, "vertical", pitch_mm.value, middle=True)
    table_v = _distances(detection, "horizontal", pitch_mm.value, middle=True)
    horizontal = _factor(table_u, pitch_mm, "horizontal scale")
    vertical = _factor(table_v, pitch_mm, "vertical scale")
    mean = _mean(horizontal, vertical, pitch_mm)
    errors_u = _errors(_distances(detection, "vertical", pitch_mm.value, middle=False), mean.value)
    errors_v = _errors(_distances(detection, "horizontal", pitch_mm.value, middle=False), mean.value)
    percent = np.concatenate([errors_u["error_percent"], errors_v["error_percent"]])
    largest = float(percent[np.argmax(np.abs(percent))]) if percent.size else 0.0
    return ThesisScale(horizontal, vertical, mean, table_u, table_v, errors_u, errors_v, largest)


def _crossings(detection: GridDetection) -> Array:
    """Crossings (rows, columns, 2), px, NaN where there is none."""
    nodes = np.full((detection.row.max() + 1, detection.column.max() + 1, 2), np.nan)
    nodes[detection.row, detection.column] = np.stack([detection.u_px, detection.v_px], axis=1)
    return nodes


def _distances(detection: GridDetection, family: Family, pitch_mm: float, *, middle: bool) -> pd.DataFrame:
    """Distances between the lines of a family, at their middle third or in their two outer thirds."""
    nodes = _crossings(detection)
    if family == "vertical":
        nodes = nodes.transpose(1, 0, 2)
    rows = []
    for name, part in _parts(nodes.shape[1], middle=middle):
        for span in (s for s in SPANS if s < nodes.shape[0]):
            step = nodes[span:, part] - nodes[:-span, part]
            for first, lengths in enumerate(np.hypot(step[..., 0], step[..., 1])):
                seen = lengths[np.isfinite(lengths)]
                if seen.size:
                    distance = float(seen.mean())
                    rows.append((name, first, first + span, span, seen.size, distance, span * pitch_mm))
    columns = ["part", "first_line", "last_line", "span", "places", "distance_px", "distance_mm"]
    table = pd.DataFrame(rows, columns=columns)
    table["factor_mm_per_px"] = table["distance_mm"] / table["distance_px"]
    return table


def _parts(count: int, *, middle: bool) -> list[tuple[str, slice]]:
    """Choose the middle third of `count` places along the lines, or the two thirds before and behind it."""
    outer = int(count * (1 - MIDDLE_PART) / 2)
    if middle:
        return [("middle", slice(outer, count - outer))]
    return [("first third", slice(0, outer)), ("last third", slice(count - outer, count))] if outer else []


def _factor(table: pd.DataFrame, pitch_mm: Estimate, label: str) -> Estimate:
    """Mean factor of neighbouring lines; u from their scatter and from the pitch."""
    factors = table.loc[table["span"] == 1, "factor_mm_per_px"].to_numpy()
    if factors.size < 2:
        raise DetectionError(f"{label}: {factors.size} distances between neighbouring lines mid-grid; 2 are needed")
    value = float(factors.mean())
    scatter = float(factors.std(ddof=1)) / math.sqrt(factors.size)
    stated = value * pitch_mm.u / pitch_mm.value
    return _combined(value, (scatter, factors.size - 1), (stated, pitch_mm.dof), label)


def _mean(horizontal: Estimate, vertical: Estimate, pitch_mm: Estimate) -> Estimate:
    """Mean of both directions; their scatters are independent, the pitch is common."""
    value = 0.5 * (horizontal.value + vertical.value)
    stated = pitch_mm.u / pitch_mm.value
    own = [max(0.0, e.u**2 - (e.value * stated) ** 2) for e in (horizontal, vertical)]
    dof = min(horizontal.dof, vertical.dof)
    return _combined(value, (0.5 * math.sqrt(sum(own)), dof), (value * stated, pitch_mm.dof), "mean scale")


def _combined(value: float, first: tuple[float, float], second: tuple[float, float], label: str) -> Estimate:
    """Combine two contributions (u, dof) by root sum of squares."""
    contributions, dof = zip(first, second, strict=True)
    return Estimate(value, math.hypot(*contributions), "mm/px", label, effective_dof(contributions, dof))


def _errors(table: pd.DataFrame, factor_mm_per_px: float) -> pd.DataFrame:
    """Distances computed with one factor and their errors, in mm and in percent of the distance."""
    table = table.drop(columns="factor_mm_per_px")
    table["computed_mm"] = table["distance_px"] * factor_mm_per_px
    table["error_mm"] = table["computed_mm"] - table["distance_mm"]
    table["error_percent"] = 100 * table["error_mm"] / table["distance_mm"]
    return table
