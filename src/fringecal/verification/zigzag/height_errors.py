"""Height errors of a zig-zag along profiles: tables that a sceptical colleague can check."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike

from fringecal.targets import Zigzag
from fringecal.verification.forms.departures import Departures
from fringecal.verification.zigzag.bands import Band, band_errors
from fringecal.verification.zigzag.error_field import default_places, error_field
from fringecal.verification.zigzag.error_terms import ErrorTerm, error_sentence, error_terms
from fringecal.verification.zigzag.pose import ZigzagPose
from fringecal.verification.zigzag.profiles import (
    NOTHING_IN_COMMON,
    InCommon,
    Judge,
    Pixels,
    ProfileCurve,
    ProfileErrors,
)
from fringecal.verification.zigzag.zigzag_shape import Floats, Surface, ZigzagShape, zigzag_shape

THESIS_ROWS_PX = (10, 121, 232, 343, 444)  # profiles A..E of the 2008 thesis
EDGE_ZONE_PX = 3.0
"""Half-width of the zones about ridges, valleys and ends, px: blur and a 3 x 3 filter mix what lies on both sides of an
edge over as much."""
_SPREAD = (0.1, 0.3, 0.5, 0.7, 0.9)  # of the bars' visible length, where those rows miss the bars
_MAX_TERMS = 20_000  # pixels that the split into causes looks at; more do not change it


@dataclass(frozen=True)
class ZigzagErrors:
    """Error tables of a zig-zag, with edge zones left out and with them.

    Parameters
    ----------
    axis
        "row" or "column": the direction of the profiles in the picture.
    edge_zone_mm
        Left out on each side of every ridge and valley, and at the ends; measured on the plate.
    profiles, pooled; profiles_with_edges, pooled_with_edges
        The profiles and all their pixels together, without and with the edge zones.
    area
        All flank pixels of the picture together, edge zones out.
    bands, worst_band_mm
        Means over bands of the flanks (tenths of the length, and each flank); the largest |mean|.
    terms, sentence
        What the error is made of, largest first, and the plain sentence naming it.
    error_mm
        (H, W) measured minus reference height on the bars, NaN elsewhere.
    departures
        The errors of all flank pixels, edge zones out, beside the uncertainty of each; None where none is known.
    """

    pose: ZigzagPose
    shape: ZigzagShape
    axis: str
    edge_zone_mm: float
    profiles: tuple[ProfileErrors, ...]
    profiles_with_edges: tuple[ProfileErrors, ...]
    pooled: ProfileErrors
    pooled_with_edges: ProfileErrors
    area: ProfileErrors
    curves: tuple[ProfileCurve, ...]
    bands: tuple[Band, ...]
    worst_band_mm: float
    terms: tuple[ErrorTerm, ...]
    sentence: str
    error_mm: Floats
    departures: Departures | None

    @property
    def full_height_mm(self) -> float:
        """Full height of the target, to which percentages refer."""
        return self.shape.height_mm

    @property
    def worst_band_percent(self) -> float:
        """Largest band mean in percent of full height."""
        return 100 * self.worst_band_mm / self.full_height_mm

    def table(self, *, edges: bool = False) -> pd.DataFrame:
        """Profiles and the pooled row as a table; with the edge zones when `edges`."""
        rows = self.profiles_with_edges if edges else self.profiles
        pooled = self.pooled_with_edges if edges else self.pooled
        return pd.DataFrame([vars(row) for row in (*rows, pooled)])

    def flank_table(self) -> pd.DataFrame:
        """Flank angle errors of every profile, degrees, as a table."""
        return pd.DataFrame([{"profile": c.name, **vars(f)} for c in self.curves for f in c.flanks])


def zigzag_errors(
    surface: Surface,
    target: Zigzag | ZigzagShape,
    pose: ZigzagPose,
    *,
    rows_px: Sequence[int] | None = None,
    edge_zone_px: float = EDGE_ZONE_PX,
    edge_zone_mm: float | None = None,
    sensitivities: ArrayLike | None = None,
    covariance: ArrayLike | None = None,
    dof: ArrayLike = math.inf,
    common: InCommon = NOTHING_IN_COMMON,
) -> ZigzagErrors:
    """Compare a measured surface with a registered zig-zag along profiles.

    Parameters
    ----------
    surface
        Height map; `u_z` is the combined standard uncertainty of each height.
    target, pose
        The target, and its pose from `register_zigzag`.
    rows_px
        Rows (columns where ridges run along the rows). By default the thesis's A..E where all
        five cross the bars, else five spread over the visible length.
    edge_zone_px, edge_zone_mm
        Half-width of the zones about ridges, valleys and ends; mm wins when both are given.
    sensitivities, covariance
        (K, H, W) change of height per unit of K influences common to all pixels, and their (K, K)
        covariance. Without them the whole of u_z is taken as common, so that the mean of a
        profile is stated no better than a single pixel.
    dof
        (K,) or scalar, degrees of freedom of the influences.
    common
        Which of these influences move the reference as well: the calibration of one instrument, one temperature.

    Raises
    ------
    FitError
        A profile that does not cross the bars, or has too few valid pixels.
    """
    shape = target if isinstance(target, ZigzagShape) else zigzag_shape(target)
    field = error_field(surface, pose, shape)
    zone = edge_zone_px * field.pixel_mm if edge_zone_mm is None else edge_zone_mm
    maps = None if sensitivities is None else np.asarray(sensitivities)
    judge = Judge(field, shape, zone, maps, covariance, dof, common)
    places = default_places(field, THESIS_ROWS_PX, _SPREAD) if rows_px is None else tuple(int(r) for r in rows_px)
    lines = {_name(i): (place, judge.line(place)) for i, place in enumerate(places)}
    every = np.concatenate([line for _, line in lines.values()])
    flanks = judge.off_edges(np.flatnonzero(field.inside))
    profiles = tuple(judge.stats(n, p, judge.off_edges(line)) for n, (p, line) in lines.items())
    bands = _bands(judge, flanks)
    terms = _terms(judge, flanks, pose)
    middle = float(np.mean(places))
    return ZigzagErrors(
        pose=pose,
        shape=shape,
        axis=field.axis,
        edge_zone_mm=float(zone),
        profiles=profiles,
        profiles_with_edges=tuple(judge.stats(n, p, line) for n, (p, line) in lines.items()),
        pooled=judge.stats("pooled", middle, judge.off_edges(every)),
        pooled_with_edges=judge.stats("pooled", middle, every),
        area=judge.stats("area", middle, flanks),
        curves=tuple(judge.curve(name, line) for name, (_, line) in lines.items()),
        bands=bands,
        worst_band_mm=max((abs(band.mean_mm) for band in bands), default=0.0),
        terms=terms,
        sentence=error_sentence(terms, shape.height_mm),
        error_mm=np.where(field.inside & field.valid, field.error, np.nan),
        departures=judge.departures(flanks),
    )


def _name(number: int) -> str:
    return chr(ord("A") + number) if number < 26 else f"P{number + 1}"


def _bands(judge: Judge, flanks: Pixels) -> tuple[Band, ...]:
    valid, field = judge.valid(flanks), judge.field
    across, along, error = (m.ravel()[valid] for m in (field.across, field.along, field.error))
    return band_errors(across, along, error, judge.shape)


def _terms(judge: Judge, flanks: Pixels, pose: ZigzagPose) -> tuple[ErrorTerm, ...]:
    valid, field = judge.valid(flanks), judge.field
    some = valid[:: 1 + valid.size // _MAX_TERMS]
    x, y, error = (m.ravel()[some] for m in (field.x, field.y, field.error))
    return error_terms(x, y, error, pose, judge.shape)
