"""The error at every pixel of the bars, and where each pixel lies on them."""

from dataclasses import dataclass

import numpy as np
from numpy.polynomial import polynomial
from numpy.typing import NDArray

from fringecal.errors import FitError
from fringecal.numerics import products_up_to
from fringecal.verification.zigzag.pose import ZigzagPose
from fringecal.verification.zigzag.zigzag_shape import Floats, Surface, ZigzagShape, edge_distance, zigzag_height

Mask = NDArray[np.bool_]

_CROSSES = 0.5  # of the most pixels that any row has on the bars: a row with fewer only touches them
_MOST_END_U = 0.02  # of the bars' length, left out at each end at most, however badly the ends are seen
_END_U = 2.0  # standard uncertainties of the bars' place along the ridges that are left out at each end: 95 %
_FITTED_PIXELS = 20_000  # through which coordinates of masked pixels are drawn; a quadratic has six terms


@dataclass(frozen=True)
class ErrorField:
    """Maps (H, W) about the registered bars, mm; masked pixels carry interpolated places, so that they count.

    `edge_distance` is that to the nearest ridge, valley or end; `inside` is True on the bars, `valid`
    where the surface was measured; `axis` is the picture direction that crosses the ridges, `pixel_mm`
    a pixel's step in it on the plate.
    """

    x: Floats
    y: Floats
    across: Floats
    along: Floats
    edge_distance: Floats
    reference: Floats
    error: Floats
    u_z: Floats
    inside: Mask
    valid: Mask
    axis: str
    pixel_mm: float


def error_field(surface: Surface, pose: ZigzagPose, shape: ZigzagShape) -> ErrorField:
    """Compare a surface with a registered target pixel by pixel.

    Raises
    ------
    FitError
        No valid pixel lies on the bars.
    """
    z, u_z = np.asarray(surface.z, float), np.asarray(surface.u_z, float)
    valid = np.asarray(surface.mask, bool) & np.isfinite(z) & np.isfinite(u_z)
    valid &= np.isfinite(surface.x) & np.isfinite(surface.y)
    if not np.any(valid & pose.on_bars(surface.x, surface.y, shape)):
        raise FitError("no valid pixel of the surface, with its uncertainty, lies on the bars; check mask and u_z")
    x, y = _filled(surface.x, valid), _filled(surface.y, valid)
    across, along = pose.across_along(x, y)
    reference = zigzag_height(across, shape) + pose.seat_height(x, y)
    axis, pixel_mm = _crossing(across, valid)
    return ErrorField(
        x=x,
        y=y,
        across=across,
        along=along,
        edge_distance=np.minimum(edge_distance(across, shape), _end_distance(along, pose, shape)),
        reference=reference,
        error=z - reference,
        u_z=u_z,
        inside=pose.on_bars(x, y, shape),
        valid=valid,
        axis=axis,
        pixel_mm=pixel_mm,
    )


def default_places(field: ErrorField, preferred: tuple[int, ...], spread: tuple[float, ...]) -> tuple[int, ...]:
    """Rows (or columns) of the profiles: the preferred rows if all cross the bars, else spread over them."""
    crossing = (field.inside & field.valid).sum(axis=1 if field.axis == "row" else 0)
    good = np.flatnonzero(crossing >= _CROSSES * crossing.max())
    if field.axis == "row" and np.isin(preferred, good).all():
        return preferred
    return tuple(int(round(good[0] + share * (good[-1] - good[0]))) for share in spread)


def _end_distance(along: Floats, pose: ZigzagPose, shape: ZigzagShape) -> Floats:
    """Distance to the nearer end of the bars, less the uncertainty of where the ends are."""
    uncertain = min(_END_U * pose.u_along_mm, _MOST_END_U * shape.length_mm)
    return shape.length_mm / 2 - uncertain - np.abs(along)


def _crossing(across: Floats, valid: Mask) -> tuple[str, float]:
    by_row = np.abs(np.diff(across, axis=1))[valid[:, 1:] & valid[:, :-1]]
    by_column = np.abs(np.diff(across, axis=0))[valid[1:] & valid[:-1]]
    steps = [float(np.median(d)) if d.size else 0.0 for d in (by_row, by_column)]
    return ("row", steps[0]) if steps[0] >= steps[1] else ("column", steps[1])


def _filled(coordinate: NDArray[np.floating], valid: Mask) -> Floats:
    """Coordinate map whose masked pixels come from a quadratic in row and column."""
    values = np.asarray(coordinate, float)
    if valid.all():
        return values
    rows, columns = np.indices(valid.shape, dtype=float)
    v, u = rows / valid.shape[0], columns / valid.shape[1]
    terms = products_up_to(polynomial.polyvander(u, 2), polynomial.polyvander(v, 2))
    known = np.flatnonzero(valid)[:: 1 + np.count_nonzero(valid) // _FITTED_PIXELS]
    coefficients = np.linalg.lstsq(terms.reshape(values.size, -1)[known], values.ravel()[known], rcond=None)[0]
    return np.where(valid, values, terms @ coefficients)
