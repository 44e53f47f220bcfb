"""A measured surface: coordinates, uncertainty by cause, and why a pixel has none."""

import enum
import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fringecal.reconstruct.sensitivity import Sensitivities
from fringecal.uncertainty import uncertainty_with_bias

Map = NDArray[Any]


class Reason(enum.IntFlag):
    """Why a pixel has no height; 0 is a valid one.

    `EDGE`: beside the edge of an object or of a shadow, where a pixel may see two surfaces at once. `SHADOW`: no
    fringes arrive, behind an object or on a surface too dark to show them; other pixels without phase have `NO_PHASE`.
    """

    NO_PHASE = 1
    ORDER_UNDECIDED = 2
    NO_RAY = 4
    OUT_OF_RANGE = 8
    EDGE = 16
    SHADOW = 32


@dataclass(frozen=True)
class HeightMap:
    """A measured surface: one value per pixel, mm in the plate frame, NaN where masked.

    Parameters
    ----------
    x, y, z
        Coordinates in mm, shape (H, W).
    u_z
        Combined standard uncertainty of z in mm; with a bias, that whose 95 % interval holds it.
    u_random
        Its random part: independent from pixel to pixel.
    systematic
        Its systematic parts: the change of z by one standard uncertainty of each cause; what has the same sign
        everywhere counts fully in a mean.
    reasons
        `Reason` bits, 0 where valid.
    bias
        Known error that z keeps, mm, by a height model that is not the calibrated one, or by filters; None where there
        is none.
    """

    x: Map
    y: Map
    z: Map
    u_z: Map
    u_random: Map
    systematic: Sensitivities
    reasons: NDArray[np.uint8]
    bias: Map | None = None

    @property
    def sensitivities(self) -> NDArray[np.float32]:
        """Maps of the systematic parts, shape (K, H, W), 0 where masked."""
        return np.nan_to_num(self.systematic.maps(self.z))

    @property
    def mask(self) -> NDArray[np.bool_]:
        """True where the height is valid."""
        return self.reasons == 0

    def mean_uncertainty(self, weights: NDArray[np.floating]) -> float:
        """Return u of a weighted mean of z: systematic parts add up, random ones average out.

        `u^2 = w^T Cov w` with `Cov = diag(u_r^2) + sum_k c_k c_k^T`, the propagation of
        JCGM 102:2011 with independent random parts and K components that all pixels share; weights sum to 1. A known
        bias counts by its weighted mean (`fringecal.uncertainty.uncertainty_with_bias`).
        """
        w = np.where(self.mask, weights, 0.0)
        w = w / w.sum()
        random = float(np.sum((w * np.where(self.mask, self.u_random, 0.0)) ** 2))
        common = np.array(
            [float(np.nansum(w * self.systematic.map(k, self.z))) for k in range(len(self.systematic.sources))]
        )
        bias = 0.0 if self.bias is None else float(np.nansum(w * self.bias))
        return float(uncertainty_with_bias(math.sqrt(random + float(common @ common)), bias))
