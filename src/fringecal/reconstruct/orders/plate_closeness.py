"""How closely regions lie on the plate's phase: what tells plate from tops that are whole fringes high by chance.

Plate lies on its own phase to within noise and what it has changed since its calibration, which the largest part of it
in view shows; of tops of any height one in nine lies within 0.35 rad of whole fringes, but few lie so close.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fringecal.numerics import TURN
from fringecal.phase import Regions
from fringecal.reconstruct.orders.sinking import sample_of

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

_MOST_OFF_RAD = TURN / 4  # beyond which nothing is on the plate's phase


@dataclass(frozen=True)
class PlateCloseness:
    """How far the smooth pixels of each region lie from whole fringes over the plate.

    Parameters
    ----------
    centre_rad, wide_rad
        Median of the step less whole fringes, and what three quarters of its sizes do not exceed, by region, rad;
        infinite where nothing was looked at.
    scatter_rad
        Median size of it among the plate's pixels in the region that starts all, rad.
    """

    centre_rad: Array
    wide_rad: Array
    scatter_rad: float

    @classmethod
    def of(cls, regions: Regions, main: int) -> "PlateCloseness":
        """Look at a sample of the smooth pixels.

        Parameters
        ----------
        regions
            The regions.
        main
            Number of the one that shows most of the plate.
        """
        sample = sample_of(regions.cores.shape)
        labels = regions.cores[sample].ravel()
        off = regions.values[sample].ravel()[labels > 0]
        labels = labels[labels > 0]
        off = off - TURN * np.rint(off / TURN)
        plate = np.abs(off[(labels == main)])
        plate = plate[plate < _MOST_OFF_RAD]
        scatter = float(np.median(plate)) if plate.size else 0.0
        sizes = np.bincount(labels, minlength=regions.number + 1)
        return cls(*_spreads(off, labels, sizes), scatter)

    def within(self, scatters: float, rad: float) -> NDArray[np.bool_]:
        """Whether three quarters of each region lie on the plate's phase, and so does its middle.

        Parameters
        ----------
        scatters, rad
            How far from it three quarters may lie: so many times the scatter, and rad more; the middle a third of it.
        """
        limit = scatters * self.scatter_rad + rad
        return np.asarray((self.wide_rad < limit) & (np.abs(self.centre_rad) < limit / 3))


def _spreads(off: Array, labels: NDArray[np.int32], sizes: Ints) -> tuple[Array, Array]:
    """Return the median of every region, and the third quartile of the sizes."""
    grouped = off[np.argsort(labels, kind="stable")]
    centre, wide = np.full(sizes.size, np.inf), np.full(sizes.size, np.inf)
    for region, values in enumerate(np.split(grouped, np.cumsum(sizes)[:-1])):
        if values.size:
            centre[region], wide[region] = np.median(values), np.percentile(np.abs(values), 75)
    return centre, wide
