"""What an error is made of: terms with a cause each, the largest first, and a sentence that names it."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fringecal.numerics import robust_sd
from fringecal.verification.zigzag.pose import ZigzagPose
from fringecal.verification.zigzag.zigzag_shape import Floats, ZigzagShape, ridge_offset, zigzag_height

_LEVER_MM = 100.0  # length over which a change of the height scale is stated
_OUTLIER_SDS = 5.0  # robust standard deviations beyond which a pixel is an outlier: of normal noise one in two million
_LEAST_MM = 1e-12  # drawn heights without noise scatter by rounding alone; none is an outlier of that
_ROUNDS = 4  # of leaving outliers out and fitting anew: the set settles after two or three


@dataclass(frozen=True)
class ErrorTerm:
    """One part of the height error: its size in its own unit, and the rms error it makes, mm."""

    name: str
    size: float
    unit: str
    rms_mm: float


_UNSIGNED = ("noise", "outliers")  # scatter and shares have no direction
_WORDS = {
    "offset": "the same height error everywhere (seat of the bars, or the reference plane)",
    "scale": "heights scaled by one factor (projection angle, or the strips' height)",
    "tilt_x": "a tilt along x (bars not seated, or the reference plane tilted)",
    "tilt_y": "a tilt along y (bars not seated, or the reference plane tilted)",
    "scale_over_x": "a height scale that changes along x (projection angle not constant over the field)",
    "scale_over_y": "a height scale that changes along y (projection angle not constant over the field)",
    "asymmetry": "flanks of opposite sides at different angles (lateral scale, or the camera's perspective)",
    "noise": "scatter of single pixels and fine structure that no smooth term describes",
    "outliers": "single pixels with large errors (wrong fringe order, or steep edges)",
}


def error_terms(
    x: NDArray[np.floating],
    y: NDArray[np.floating],
    error: NDArray[np.floating],
    pose: ZigzagPose,
    shape: ZigzagShape,
) -> tuple[ErrorTerm, ...]:
    """Split height errors on the flanks into named terms by one regression, largest rms first.

    ``e = e0 + s z + tx x + ty y + sx z x + sy z y + a side (z - H/2) + noise`` with z the target's
    height and x, y from the bars' middle; pixels beyond five robust standard deviations of the
    fit count as outliers.

    Parameters
    ----------
    x, y, error
        (n,) plate coordinates and height errors of flank pixels, mm.
    """
    across, _ = pose.across_along(x, y)
    height = zigzag_height(across, shape)
    side = np.sign(ridge_offset(across, shape))
    dx, dy = (x - pose.x_mm) / _LEVER_MM, (y - pose.y_mm) / _LEVER_MM
    columns = {
        "offset": np.ones_like(height),
        "scale": height,
        "tilt_x": dx,
        "tilt_y": dy,
        "scale_over_x": height * dx,
        "scale_over_y": height * dy,
        "asymmetry": side * (height - shape.height_mm / 2),
    }
    design = np.stack(list(columns.values()), axis=1)
    coefficients, kept = _clipped_fit(design, error)
    parts = design * coefficients
    rms = np.sqrt(np.mean(parts[kept] ** 2, axis=0))
    terms = [_term(n, c, r) for n, c, r in zip(columns, coefficients, rms, strict=True)]
    residual = error - parts.sum(axis=1)
    noise = float(np.sqrt(np.mean(residual[kept] ** 2)))
    lost = float(np.sqrt(np.sum(error[~kept] ** 2) / error.size))
    terms += [
        ErrorTerm("noise", noise, "mm", noise),
        ErrorTerm("outliers", 100 * float(np.mean(~kept)), "%", lost),
    ]
    return tuple(sorted(terms, key=lambda term: -term.rms_mm))


def error_sentence(terms: tuple[ErrorTerm, ...], full_height_mm: float) -> str:
    """Say in plain words which term dominates.

    Examples
    --------
    >>> error_sentence((ErrorTerm("scale", 1.0, "%", 0.16),), 28.0).split(":")[0]
    'Dominant error'
    """
    first = terms[0]
    total = math.sqrt(sum(term.rms_mm**2 for term in terms))
    share = 100 * first.rms_mm**2 / total**2 if total > 0 else 0.0
    size = f"{first.size:.3g}" if first.name in _UNSIGNED else f"{first.size:+.3g}"
    return (
        f"Dominant error: {_WORDS[first.name]}, {size} {first.unit}; rms {first.rms_mm:.3f} mm "
        f"({100 * first.rms_mm / full_height_mm:.2f} % of full height), "
        f"{share:.0f} % of the sum of squares of all terms."
    )


def _term(name: str, coefficient: float, rms_mm: float) -> ErrorTerm:
    if name == "offset":
        return ErrorTerm(name, float(coefficient), "mm", float(rms_mm))
    if name.startswith("tilt"):
        return ErrorTerm(name, float(coefficient) / _LEVER_MM * 1e3, "mrad", float(rms_mm))
    unit = "% per 100 mm" if name.startswith("scale_over") else "%"
    return ErrorTerm(name, 100 * float(coefficient), unit, float(rms_mm))


def _clipped_fit(design: Floats, error: NDArray[np.floating]) -> tuple[Floats, NDArray[np.bool_]]:
    middle = float(np.median(error))
    kept = np.abs(error - middle) <= _OUTLIER_SDS * robust_sd(error) + _LEAST_MM
    coefficients = np.zeros(design.shape[1])
    for _ in range(_ROUNDS):
        coefficients = np.linalg.lstsq(design[kept], error[kept], rcond=None)[0]
        residual = np.abs(error - design @ coefficients)
        kept = residual <= _OUTLIER_SDS * robust_sd(residual, about=0) + _LEAST_MM
    return coefficients, kept
