"""Height errors of a zig-zag along profiles: tables that a sceptical colleague can check."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike, NDArray

from fringecal.errors import FitError
from fringecal.targets.models import Zigzag
from fringecal.uncertainty.systematic import combined_map, mean_uncertainty
from fringecal.verify.bands import Band, band_errors
from fringecal.verify.diagnosis import ErrorTerm, error_sentence, error_terms
from fringecal.verify.field import ErrorField, default_places, error_field
from fringecal.verify.flanks import FlankAngle, flank_angles
from fringecal.verify.pose import ZigzagPose
from fringecal.verify.shape import (
    Floats,
    Surface,
    ZigzagShape,
    reference_sensitivities,
    zigzag_shape,
)

THESIS_ROWS_PX = (10, 121, 232, 343, 444)  # profiles A..E of the 2008 thesis
_SPREAD = (0.1, 0.3, 0.5, 0.7, 0.9)  # of the bars' visible length, where those rows miss the bars
_MIN_PIXELS = 10  # of a profile
_MAX_TERMS = 50_000  # pixels that the split into causes looks at; more do not change it
_K = 2.0  # En compares expanded uncertainties, k = 2


@dataclass(frozen=True)
class ProfileErrors:
    """Height errors along one picture row (or column); percentages are of the target's full height.

    Parameters
    ----------
    name, row_px
        Letter, and number of the row; of the column where the ridges run along the rows.
    x_mm, y_mm
        Mean place of the profile's pixels on the plate.
    n, mean_mm, sd_mm, rms_mm, max_abs_mm
        Number of valid pixels, and mean, standard deviation, rms and largest absolute error.
    u_mm, en
        Standard uncertainty of the mean error, of target and heights together, and the mean
        error against its expanded uncertainty, ``mean / (2 u)``; None where no uncertainty is known.
    missing_share
        Share of the profile's pixels on the bars that are masked.
    """

    name: str
    row_px: float
    x_mm: float
    y_mm: float
    n: int
    mean_mm: float
    sd_mm: float
    rms_mm: float
    max_abs_mm: float
    mean_percent: float
    max_percent: float
    u_mm: float
    en: float | None
    missing_share: float


@dataclass(frozen=True)
class ProfileCurve:
    """The pixels of one profile, (n,) each: what the plots of actual against reference show."""

    name: str
    across_mm: Floats
    measured_mm: Floats
    reference_mm: Floats
    u_mm: Floats
    edge: NDArray[np.bool_]
    flanks: tuple[FlankAngle, ...]


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
    edge_zone_px: float = 3.0,
    edge_zone_mm: float | None = None,
    sensitivities: ArrayLike | None = None,
    covariance: ArrayLike | None = None,
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

    Raises
    ------
    FitError
        A profile that does not cross the bars, or has too few valid pixels.
    """
    shape = target if isinstance(target, ZigzagShape) else zigzag_shape(target)
    field = error_field(surface, pose, shape)
    zone = edge_zone_px * field.pixel_mm if edge_zone_mm is None else edge_zone_mm
    maps = None if sensitivities is None else np.asarray(sensitivities, float)
    judge = _Judge(field, shape, zone, maps, covariance)
    places = (
        default_places(field, THESIS_ROWS_PX, _SPREAD) if rows_px is None else tuple(int(r) for r in rows_px)
    )
    lines = [judge.line(place) for place in places]
    names = [chr(ord("A") + i) if i < 26 else f"P{i + 1}" for i in range(len(places))]
    with_edges = tuple(judge.stats(n, p, on) for n, p, on in zip(names, places, lines, strict=True))
    without = tuple(
        judge.stats(n, p, on & ~judge.edge) for n, p, on in zip(names, places, lines, strict=True)
    )
    every = np.logical_or.reduce(lines)
    flank_pixels = field.inside & ~judge.edge
    chosen = flank_pixels & field.valid
    some = np.flatnonzero(chosen)[:: 1 + np.count_nonzero(chosen) // _MAX_TERMS]
    terms = error_terms(field.x.flat[some], field.y.flat[some], field.error.flat[some], pose, shape)
    bands = band_errors(field.across[chosen], field.along[chosen], field.error[chosen], shape)
    return ZigzagErrors(
        pose=pose,
        shape=shape,
        axis=field.axis,
        edge_zone_mm=float(zone),
        profiles=without,
        profiles_with_edges=with_edges,
        pooled=judge.stats("pooled", float(np.mean(places)), every & ~judge.edge),
        pooled_with_edges=judge.stats("pooled", float(np.mean(places)), every),
        area=judge.stats("area", float(np.mean(places)), flank_pixels),
        curves=tuple(judge.curve(n, on) for n, on in zip(names, lines, strict=True)),
        bands=bands,
        worst_band_mm=max((abs(band.mean_mm) for band in bands), default=0.0),
        terms=terms,
        sentence=error_sentence(terms, shape.height_mm),
        error_mm=np.where(field.inside & field.valid, field.error, np.nan),
    )


@dataclass(frozen=True)
class _Judge:
    field: ErrorField
    shape: ZigzagShape
    zone_mm: float
    sensitivities: Floats | None
    covariance: ArrayLike | None

    @property
    def edge(self) -> NDArray[np.bool_]:
        return self.field.edge_distance < self.zone_mm

    def line(self, place: int) -> NDArray[np.bool_]:
        """Pixels of the bars on one row (or column)."""
        field = self.field
        along_rows = field.axis == "row"
        if not 0 <= place < field.inside.shape[0 if along_rows else 1]:
            raise FitError(
                f"{field.axis} {place} lies outside the picture of {field.inside.shape} (rows, columns)"
            )
        chosen = np.zeros(field.inside.shape, bool)
        chosen[(place, slice(None)) if along_rows else (slice(None), place)] = True
        return chosen & field.inside

    def stats(self, name: str, place: float, pixels: NDArray[np.bool_]) -> ProfileErrors:
        """Error statistics over the valid ones of some pixels of the bars."""
        field, valid = self.field, pixels & self.field.valid
        total, n = int(np.count_nonzero(pixels)), int(np.count_nonzero(valid))
        if n < _MIN_PIXELS:
            raise FitError(
                f"profile {name} at {field.axis} {place:g} has {n} valid pixels of {total} on the bars, "
                f"{_MIN_PIXELS} are needed; choose {field.axis}s that cross lit parts of the bars"
            )
        error = field.error[valid]
        mean, largest = float(error.mean()), float(np.abs(error).max())
        u = self._mean_u(valid)
        percent = 100 / self.shape.height_mm
        return ProfileErrors(
            name=name,
            row_px=place,
            x_mm=float(field.x[valid].mean()),
            y_mm=float(field.y[valid].mean()),
            n=n,
            mean_mm=mean,
            sd_mm=float(error.std(ddof=1)),
            rms_mm=float(np.sqrt(np.mean(error**2))),
            max_abs_mm=largest,
            mean_percent=mean * percent,
            max_percent=largest * percent,
            u_mm=u,
            en=mean / (_K * u) if u > 0 else None,
            missing_share=1 - n / total,
        )

    def curve(self, name: str, pixels: NDArray[np.bool_]) -> ProfileCurve:
        """Take the pixels of a profile in order, and the angle errors of its flanks."""
        field, valid = self.field, pixels & self.field.valid
        across = field.across[valid]
        order = np.argsort(across, kind="stable")
        across, error, reference = across[order], field.error[valid][order], field.reference[valid][order]
        edge = self.edge[valid][order]
        flanks = flank_angles(across[~edge], error[~edge], self.shape)
        return ProfileCurve(name, across, reference + error, reference, field.u_z[valid][order], edge, flanks)

    def _mean_u(self, valid: NDArray[np.bool_]) -> float:
        """Uncertainty of the mean error: heights, and the target's own leg and apex."""
        u_z = self.field.u_z[valid]
        target = reference_sensitivities(self.field.across[valid], self.shape).mean(axis=1)
        if self.sensitivities is None:
            return float(np.hypot(np.mean(u_z), np.linalg.norm(target)))
        maps = self.sensitivities[:, valid]
        common = combined_map(0.0, maps, self.covariance)
        u_random = np.sqrt(np.maximum(u_z**2 - common**2, 0.0))
        u_mean = mean_uncertainty(u_random, sensitivities=maps, covariance=self.covariance)
        return float(np.hypot(u_mean, np.linalg.norm(target)))
