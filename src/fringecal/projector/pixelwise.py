"""Phase to height pixel by pixel, fitted to flats of known height: the laws of the literature beside the rig model.

For pinhole camera and pinhole projector the inverse-linear law `1/z = b + a/dphi` is exact at every pixel, whatever
their tilt (Guo, He, Chen, Opt. Eng. 44 (2005) 013603); a third term, `+ c dphi`, takes up most of a projector's
distortion. The cubic polynomial `z = c1 dphi + c2 dphi^2 + c3 dphi^3` is what is used most and explains least.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.polynomial import chebyshev
from numpy.typing import ArrayLike, NDArray

from fringecal.errors import FitError
from fringecal.numerics import products_up_to

Array = NDArray[np.float64]

#: Laws by name, with the number of their coefficients.
LAWS = {"inverse-linear": 2, "three-term": 3, "cubic": 3}
_WORST_CONDITION = 1e12  # of a pixel's scaled normal matrix: beyond it four digits are left of float64's sixteen


@dataclass(frozen=True)
class PixelwiseModel:
    """One law with its own coefficients at every pixel, shape (terms, ...)."""

    law: str
    coefficients: Array

    def height(self, difference_rad: ArrayLike) -> Array:
        """Return heights in mm from the phase over the plate's, rad, in the coefficients' shape."""
        step = np.asarray(difference_rad, float)
        if self.law == "cubic":
            c1, c2, c3 = self.coefficients
            return np.asarray(step * (c1 + step * (c2 + step * c3)))
        # dphi = z (a + b dphi + c dphi^2) is the law without its poles at dphi = 0.
        below = sum(c * step**power for power, c in enumerate(self.coefficients))
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.asarray(step / below)

    def smoothed(self, degree: int) -> "PixelwiseModel":
        """Return the same law with coefficients that are smooth over the field: polynomials of a total degree.

        Noise of the flats averages out over the field; what is rough in the rig is lost with it.
        """
        rows, columns = self.coefficients.shape[1:]
        down, across = np.meshgrid(np.linspace(-1, 1, rows), np.linspace(-1, 1, columns), indexing="ij")
        terms = products_up_to(chebyshev.chebvander(down, degree), chebyshev.chebvander(across, degree))
        design = terms.reshape(rows * columns, -1)
        maps = [_smooth(values.ravel(), design).reshape(rows, columns) for values in self.coefficients]
        return replace(self, coefficients=np.stack(maps))


def _smooth(values: Array, design: NDArray[np.floating]) -> Array:
    good = np.isfinite(values)
    fitted, *_ = np.linalg.lstsq(design[good], values[good], rcond=None)
    return np.asarray(design @ fitted)


def fit_pixelwise(difference_rad: ArrayLike, heights_mm: ArrayLike, *, law: str = "inverse-linear") -> PixelwiseModel:
    """Fit a law at every pixel to flats of known height, by least squares in the phase (cubic: in the height).

    Parameters
    ----------
    difference_rad
        Phase of each flat over the plate's, unwrapped, shape (K, ...).
    heights_mm
        Their heights above the plate, shape (K,), none of them 0.
    law
        "inverse-linear", "three-term" or "cubic".

    Returns
    -------
    model
        NaN at pixels whose flats do not determine the law.

    Raises
    ------
    FitError
        Fewer flats of different height than the law has coefficients.

    Examples
    --------
    >>> z = np.array([10.0, 20.0, 30.0])
    >>> flats = (2.0 * z / (1 - 0.01 * z))[:, None]
    >>> fit_pixelwise(flats, z).coefficients.round(12).ravel().tolist()
    [2.0, 0.01]
    """
    steps, heights = np.asarray(difference_rad, float), np.asarray(heights_mm, float)
    terms = LAWS[law]
    different = np.unique(heights[heights != 0]).size
    if different < terms:
        raise FitError(
            f"{different} flats of different height were given, the law {law!r} has {terms} coefficients at every "
            f"pixel; take {terms} flats or more, the plate itself not counted."
        )
    z = heights.reshape(-1, *(1,) * (steps.ndim - 1))
    if law == "cubic":
        columns, right = [steps ** (n + 1) for n in range(terms)], np.broadcast_to(z, steps.shape)
    else:
        columns, right = [z * steps**n for n in range(terms)], steps
    return PixelwiseModel(law, _solved(np.stack(columns, axis=-1), right))


def _solved(design: Array, right: Array) -> Array:
    """Least squares at every pixel: design (K, ..., terms), right (K, ...)."""
    size = np.sqrt(np.nanmean(design**2, axis=tuple(range(design.ndim - 1))))
    scaled = design / np.where(size > 0, size, 1.0)
    normal = np.einsum("k...i,k...j->...ij", scaled, scaled)
    side = np.einsum("k...i,k...->...i", scaled, right)
    usable = np.isfinite(normal).all(axis=(-2, -1)) & np.isfinite(side).all(axis=-1)
    normal[~usable] = np.eye(design.shape[-1])
    size_along = np.abs(np.linalg.eigvalsh(normal))
    usable &= size_along.max(axis=-1) < _WORST_CONDITION * size_along.min(axis=-1)
    normal[~usable] = np.eye(design.shape[-1])
    found = np.linalg.solve(normal, side[..., None])[..., 0] / np.where(size > 0, size, 1.0)
    return np.moveaxis(np.where(usable[..., None], found, np.nan), -1, 0)
