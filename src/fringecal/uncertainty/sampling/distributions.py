"""Distributions of inputs that a Monte Carlo draws from (JCGM 101:2008, 6.4)."""

import math
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

Floats = NDArray[np.float64]


class Distribution(Protocol):
    """Anything that draws values of one input."""

    def draw(self, rng: np.random.Generator, size: int) -> Floats:
        """Draw `size` values."""
        ...


@dataclass(frozen=True)
class Normal:
    """Normal: best estimate and standard uncertainty known (6.4.7)."""

    mean: float
    u: float

    def draw(self, rng: np.random.Generator, size: int) -> Floats:
        """Draw `size` values."""
        return rng.normal(self.mean, self.u, size)


@dataclass(frozen=True)
class StudentT:
    """Scaled and shifted t: a mean and its sd from repeated readings with dof (6.4.9); wider than `scale`."""

    mean: float
    scale: float
    dof: float

    def draw(self, rng: np.random.Generator, size: int) -> Floats:
        """Draw `size` values."""
        return self.mean + self.scale * rng.standard_t(self.dof, size)


@dataclass(frozen=True)
class Rectangular:
    """Rectangular: only bounds known (6.4.2)."""

    mean: float
    half_width: float

    def draw(self, rng: np.random.Generator, size: int) -> Floats:
        """Draw `size` values."""
        return rng.uniform(self.mean - self.half_width, self.mean + self.half_width, size)


@dataclass(frozen=True)
class Arcsine:
    """U-shaped: a sinusoid of unknown phase and known amplitude (6.4.6)."""

    mean: float
    half_width: float

    def draw(self, rng: np.random.Generator, size: int) -> Floats:
        """Draw `size` values."""
        return self.mean + self.half_width * np.sin(2 * math.pi * rng.random(size))


@dataclass(frozen=True)
class CurvedTrapezoid:
    """Rectangular with bounds known to plus or minus `inexactness` (6.4.3)."""

    mean: float
    half_width: float
    inexactness: float

    def draw(self, rng: np.random.Generator, size: int) -> Floats:
        """Draw `size` values."""
        half = self.half_width + self.inexactness * rng.uniform(-1.0, 1.0, size)
        return self.mean + half * rng.uniform(-1.0, 1.0, size)


def draw_normal(mean: ArrayLike, covariance: ArrayLike, rng: np.random.Generator, size: int) -> Floats:
    """Draw from a multivariate normal, (n, size); a covariance of less than full rank is allowed.

    Parameters
    ----------
    mean, covariance
        (n,) and (n, n).
    """
    return rng.multivariate_normal(np.asarray(mean, float), np.asarray(covariance, float), size, method="eigh").T
