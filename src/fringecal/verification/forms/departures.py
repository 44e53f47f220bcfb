"""Departures of an artefact's pixels from its form, beside what noise and uncertainty allow.

Means hide what cancels in them: a frame that moved leaves ripples on every surface, and their mean is right.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import ndtri


@dataclass(frozen=True)
class Departures:
    """Departures of an artefact's pixels from its form.

    Parameters
    ----------
    points
        Number of pixels.
    rms_mm, largest_mm
        Of the departures.
    ratio
        Root mean square of each departure over its own standard uncertainty: about 1 at most.
    largest_ratio
        The largest of them.
    allowed_ratio
        What the largest of so many normal departures stays below in 99 of 100 cases.
    """

    points: int
    rms_mm: float
    largest_mm: float
    ratio: float
    largest_ratio: float
    allowed_ratio: float


def departures_of(departure_mm: ArrayLike, u_mm: ArrayLike) -> Departures:
    """Compare departures with their standard uncertainties.

    Parameters
    ----------
    departure_mm, u_mm
        (n,) departures from the form, and the standard uncertainty of each, mm.

    Examples
    --------
    >>> found = departures_of([0.02, -0.01, 0.01], 0.01)
    >>> round(found.ratio, 3), found.largest_ratio
    (1.414, 2.0)
    """
    off = np.asarray(departure_mm, float)
    scaled = np.abs(off) / np.broadcast_to(np.asarray(u_mm, float), off.shape)
    return Departures(
        points=off.size,
        rms_mm=float(np.sqrt(np.mean(off**2))),
        largest_mm=float(np.max(np.abs(off))),
        ratio=float(np.sqrt(np.mean(scaled**2))),
        largest_ratio=float(np.max(scaled)),
        allowed_ratio=largest_of_normal(off.size),
    )


def largest_of_normal(number: int, probability: float = 0.99) -> float:
    """Return what the largest of so many independent standard normal values stays below with a probability.

    Examples
    --------
    >>> round(largest_of_normal(1, 0.95), 2)
    1.96
    """
    return float(ndtri((1 + probability ** (1 / max(number, 1))) / 2))
