"""Type-1 gauge study: one artefact measured again and again, against its certificate and a tolerance."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy import stats

from fringecal.errors import HistoryError

CAPABLE = 1.33
"""Least Cg and Cgk of a gauge that is fit for its tolerance (Quality Management in the Bosch Group 10, Capability of
Measurement and Test Processes, type-1 study)."""

LEAST_READINGS, FINEST_SHARE = 25, 0.05
"""Readings that a verdict needs at least, and the coarsest resolution as a share of the tolerance (as `CAPABLE`)."""

_SHARE_OF_TOLERANCE = 0.2
"""Of the tolerance's width that the gauge's whole scatter is set against; half of it on either side for the bias."""


@dataclass(frozen=True)
class TypeOne:
    """Result of a type-1 study; lengths in the unit of the readings.

    `cg` and `cgk` compare the scatter, and scatter with bias, to the tolerance; `t` and `p` test the bias against the
    scatter alone. A bias may be significant and yet small beside the tolerance. `reasons` says what stands against
    the gauge; `capable` is True when nothing does.
    """

    count: int
    mean: float
    sd: float
    bias: float
    cg: float
    cgk: float
    t: float
    p: float
    reasons: tuple[str, ...]

    @property
    def capable(self) -> bool:
        """Whether both indices reach 1.33 with readings enough and a resolution fine enough."""
        return not self.reasons


def type_one_study(
    readings: ArrayLike, reference: float, tolerance: float, *, resolution: float = 0.0, spread: float = 6.0
) -> TypeOne:
    """Judge a gauge on one artefact.

    ``Cg = 0.2 T / (spread s)``, ``Cgk = (0.1 T - |mean - reference|) / (spread / 2 s)``.

    Parameters
    ----------
    readings
        (n,) repeated readings; 50 are usual, 25 needed for a verdict.
    reference
        Certified value.
    tolerance
        Width T of the tolerance that the gauge is to judge.
    resolution
        Smallest step of the readings, at most 5 % of T.
    spread
        Standard deviations that stand for the whole scatter: 6, or 4 in older VDA practice.

    Raises
    ------
    HistoryError
        Fewer than 2 finite readings, no scatter, or a tolerance that is not positive.

    Examples
    --------
    >>> rng = np.random.default_rng(1)
    >>> type_one_study(rng.normal(10.0, 0.001, 50), 10.0, 0.06).capable
    True
    """
    x = np.asarray(readings, dtype=float)
    if x.ndim != 1 or x.size < 2 or not np.isfinite(x).all() or np.ptp(x) == 0:
        raise HistoryError(f"a type-1 study takes a row of finite readings that differ, found shape {x.shape}")
    if not tolerance > 0:
        raise HistoryError(f"a tolerance is a width above 0, found {tolerance:g}")
    sd, bias = float(x.std(ddof=1)), float(x.mean() - reference)
    t = bias / (sd / np.sqrt(x.size))
    cg = _SHARE_OF_TOLERANCE * tolerance / (spread * sd)
    cgk = (_SHARE_OF_TOLERANCE / 2 * tolerance - abs(bias)) / (spread / 2 * sd)
    reasons = [
        f"{name} = {value:.2f} is below {CAPABLE}" for name, value in (("Cg", cg), ("Cgk", cgk)) if value < CAPABLE
    ]
    if x.size < LEAST_READINGS:
        reasons.append(f"{x.size} readings are fewer than {LEAST_READINGS}")
    if resolution > FINEST_SHARE * tolerance:
        reasons.append(f"the resolution {resolution:g} is coarser than 5 % of the tolerance")
    p = 2 * float(stats.t.sf(abs(t), x.size - 1))
    return TypeOne(x.size, float(x.mean()), sd, bias, cg, cgk, float(t), p, tuple(reasons))
