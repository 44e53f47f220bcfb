"""What would lie below the lowest height that an object can have: orders that evidence gives by chance."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fringecal.numerics import TURN
from fringecal.phase import Regions

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

DEEPEST_RAD = -TURN / 7
"""Step of what counts as lying on the plate still: its form, noise, and what its capture may differ by."""
SUNK_SHARE = 0.2
"""Share of the pixels below the lowest height at which an order cannot be right: fewer are noise and edges."""
_EVERY_PX, _LOOKED_AT = 3, 500  # of the pixels along rows and columns, but no more rows than are needed


def sample_of(shape: tuple[int, ...]) -> tuple[slice, slice]:
    """Return every third pixel along rows and columns of a picture, and fewer of one with more than 1500 rows."""
    every = slice(None, None, max(_EVERY_PX, shape[0] // _LOOKED_AT))
    return every, every


@dataclass(frozen=True)
class Depths:
    """Every region's steps over the plate, counted positive upwards, rad, sorted; pixels `ends[r - 1]` to `ends[r]`."""

    steps_rad: Array
    ends: Ints
    deepest_rad: float

    @classmethod
    def of(cls, regions: Regions, rising: int, deepest_rad: float) -> "Depths":
        """Take a sample of the regions' pixels.

        Parameters
        ----------
        regions
            The regions.
        rising
            Sign of the phase that a raised point gains.
        deepest_rad
            Step of the lowest that an object can be, rad, negative below the plate.
        """
        sample = sample_of(regions.labels.shape)
        labels, values = regions.labels[sample].ravel(), rising * regions.values[sample].ravel()
        # Numbers of 16 bits, which most pictures' regions have, are sorted by radix.
        short = labels.astype(np.uint16) if regions.number <= np.iinfo(np.uint16).max else labels
        steps = values[np.argsort(short, kind="stable")]
        ends = np.cumsum(np.bincount(labels, minlength=regions.number + 1))
        for region in np.split(steps, ends[:-1]):
            region.sort()
        return cls(steps, ends, deepest_rad)

    def impossible(self, orders: dict[int, int]) -> bool:
        """Whether orders, positive upwards, put regions that hang together below the lowest that an object can be.

        Parameters
        ----------
        orders
            Order of every region, from 1.
        """
        sunk, looked_at = 0, 0
        for region, order in orders.items():
            steps = self.steps_rad[self.ends[region - 1] : self.ends[region]]
            sunk += int(np.searchsorted(steps, self.deepest_rad - TURN * order))
            looked_at += steps.size
        return sunk > SUNK_SHARE * looked_at
