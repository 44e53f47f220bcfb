"""Errors along one row (or column) of the picture: statistics with uncertainty, and the curve itself."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fringecal.errors import FitError
from fringecal.uncertainty import Estimate, combined_map, effective_dof, en_score, mean_uncertainty
from fringecal.verification.forms.departures import Departures, departures_of
from fringecal.verification.zigzag.error_field import ErrorField
from fringecal.verification.zigzag.flanks import FlankAngle, flank_angles
from fringecal.verification.zigzag.zigzag_shape import Floats, ZigzagShape, reference_sensitivities

Pixels = NDArray[np.int64]  # flat indices into the maps

_MIN_PIXELS = 10  # of a profile: fewer are no cut through the bars, and their spread says nothing
_WIDE_ZONES = 0.2  # of a bar's base, on each side of an edge: four such zones leave a fifth of its flanks


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
    u_mm, dof, en
        Standard uncertainty of the mean error, of target and heights together, its effective degrees of
        freedom, and `en_score` of the mean error; None where no uncertainty is known.
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
    dof: float
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
class InCommon:
    """Numbers of the influences of the heights that are the reference's own as well: of the instrument, of temperature.

    Strips measured with the micrometer that measured the bars read high with it, and so do the heights that they fix.
    """

    instrument: tuple[int, ...] = ()
    temperature: tuple[int, ...] = ()


NOTHING_IN_COMMON = InCommon()


@dataclass(frozen=True)
class Judge:
    """The errors of one surface, and the rules by which sets of its pixels are judged.

    Parameters
    ----------
    field, shape
        Errors at every pixel, and the target's shape.
    zone_mm
        Half-width of the edge zones.
    sensitivities, covariance
        (K, H, W) maps of the systematic part and the covariance of its K influences, or None.
    dof
        (K,) or scalar, degrees of freedom of the influences.
    common
        Which of these influences, of unit covariance, move the reference as well.
    """

    field: ErrorField
    shape: ZigzagShape
    zone_mm: float
    sensitivities: NDArray[np.floating] | None = None
    covariance: ArrayLike | None = None
    dof: ArrayLike = math.inf
    common: InCommon = NOTHING_IN_COMMON

    def off_edges(self, pixels: Pixels) -> Pixels:
        """Leave out the pixels in edge zones."""
        return pixels[self.field.edge_distance.ravel()[pixels] >= self.zone_mm]

    def valid(self, pixels: Pixels) -> Pixels:
        """Leave out the masked pixels."""
        return pixels[self.field.valid.ravel()[pixels]]

    def line(self, place: int) -> Pixels:
        """Find the pixels of the bars on one row (or column)."""
        axis, size = self.field.axis, self.field.inside.shape
        if not 0 <= place < size[0 if axis == "row" else 1]:
            raise FitError(f"{axis} {place} lies outside the picture of {size} (rows, columns)")
        numbers = np.arange(self.field.inside.size).reshape(size)
        chosen = numbers[place] if axis == "row" else numbers[:, place]
        return chosen[self.field.inside.ravel()[chosen]]

    def stats(self, name: str, place: float, pixels: Pixels) -> ProfileErrors:
        """Compute error statistics over the valid ones of some pixels of the bars."""
        valid = self.valid(pixels)
        self._check_count(name, place, pixels.size, valid.size)
        error = self.field.error.ravel()[valid]
        mean, largest = float(error.mean()), float(np.abs(error).max())
        u, dof = self._mean_u(valid)
        percent = 100 / self.shape.height_mm
        return ProfileErrors(
            name=name,
            row_px=place,
            x_mm=float(self.field.x.ravel()[valid].mean()),
            y_mm=float(self.field.y.ravel()[valid].mean()),
            n=valid.size,
            mean_mm=mean,
            sd_mm=float(error.std(ddof=1)),
            rms_mm=float(np.sqrt(np.mean(error**2))),
            max_abs_mm=largest,
            mean_percent=mean * percent,
            max_percent=largest * percent,
            u_mm=u,
            dof=dof,
            en=en_score(Estimate(mean, u, "mm", dof=dof)) if u > 0 else None,
            missing_share=1 - valid.size / pixels.size,
        )

    def departures(self, pixels: Pixels) -> Departures | None:
        """Compare the errors of some pixels with the uncertainty of each, the target's own included.

        None where no uncertainty is known.
        """
        valid = self.valid(pixels)
        target = reference_sensitivities(self.field.across.ravel()[valid], self.shape)
        both = 0.0 if self.sensitivities is None else self._covariance(self._maps(valid), target)
        u = np.sqrt(np.maximum(self.field.u_z.ravel()[valid] ** 2 + np.sum(target**2, axis=0) - 2 * both, 0.0))
        return departures_of(self.field.error.ravel()[valid], u) if np.all(u > 0) else None

    def curve(self, name: str, pixels: Pixels) -> ProfileCurve:
        """Put the pixels of a profile in order, and find the angle errors of its flanks."""
        valid = self.valid(pixels)
        valid = valid[np.argsort(self.field.across.ravel()[valid], kind="stable")]
        maps = (self.field.across, self.field.error, self.field.reference, self.field.u_z)
        across, error, reference, u_z = (m.ravel()[valid] for m in maps)
        edge = self.field.edge_distance.ravel()[valid] < self.zone_mm
        flanks = flank_angles(across[~edge], error[~edge], self.shape)
        return ProfileCurve(name, across, reference + error, reference, u_z, edge, flanks)

    def _check_count(self, name: str, place: float, total: int, valid: int) -> None:
        if valid >= _MIN_PIXELS:
            return
        remedy = f"choose {self.field.axis}s that cross lit parts of the bars"
        if self.zone_mm > _WIDE_ZONES * self.shape.base_mm:
            remedy = (
                f"edge zones of {self.zone_mm:.2f} mm on each side leave almost nothing of flanks "
                f"{self.shape.base_mm / 2:.2f} mm wide, choose narrower ones"
            )
        raise FitError(
            f"profile {name} at {self.field.axis} {place:g} has {valid} valid pixels of {total} on the bars, "
            f"{_MIN_PIXELS} are needed; {remedy}"
        )

    def _mean_u(self, valid: Pixels) -> tuple[float, float]:
        """Uncertainty of the mean error, and its degrees of freedom: heights, and the target's own leg and apex."""
        u_z = self.field.u_z.ravel()[valid]
        target = reference_sensitivities(self.field.across.ravel()[valid], self.shape).mean(axis=1)
        if self.sensitivities is None:
            return float(np.hypot(np.mean(u_z), np.linalg.norm(target))), math.inf
        maps = self._maps(valid)
        common = combined_map(0.0, maps, self.covariance)
        u_random = np.sqrt(np.maximum(u_z**2 - common**2, 0.0))
        u_mean = mean_uncertainty(u_random, sensitivities=maps, covariance=self.covariance)
        means = np.asarray(maps, float).mean(axis=1)
        both = float(self._covariance(means, target))
        u = math.sqrt(max(u_mean**2 + float(target @ target) - 2 * both, 0.0))
        return u, self._mean_dof(u, means)

    def _maps(self, valid: Pixels) -> Floats:
        """Changes of the heights of some pixels by each influence, (K, n)."""
        assert self.sensitivities is not None
        return np.asarray(self.sensitivities.reshape(len(self.sensitivities), -1)[:, valid])

    def _covariance(self, heights: Floats, target: Floats) -> Floats:
        """Covariance of heights and reference, mm^2, by their changes, (K, ...) and (4, ...)."""
        shared = ((self.common.instrument, target[2]), (self.common.temperature, target[3]))
        return np.asarray(sum(reference * heights[list(rows)].sum(axis=0) for rows, reference in shared))

    def _mean_dof(self, u: float, means: Floats) -> float:
        """Degrees of freedom of u, the influences' means over the pixels given; noise and target are exactly known."""
        effects, dof = means, np.broadcast_to(np.asarray(self.dof, float), means.shape)
        if self.covariance is not None:
            given = np.asarray(self.covariance, float)
            effects = means * given if given.ndim == 1 else np.sqrt([means @ given @ means])
            dof = dof if given.ndim == 1 else np.min(dof, keepdims=True)  # correlated: no rule, the smallest is taken
        known = math.sqrt(max(u**2 - float(effects @ effects), 0.0))
        return effective_dof([known, *effects], [math.inf, *dof])
