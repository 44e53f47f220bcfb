"""What the bare plate alone tells of the rig: five of its seven numbers, and the smooth residual."""

import numpy as np
from numpy.typing import NDArray

from fringecal.errors import FitError
from fringecal.numerics import DRAW_SEED, robust_sd
from fringecal.projector.joint_fit import PhasePoints
from fringecal.projector.rig_model import RESIDUAL_DEGREE, PlateResidual, RigModel, fit_residual
from fringecal.projector.sampling import OUTLIER_SDS

Array = NDArray[np.float64]

_POINTS = 5_000  # of the plate: two hundred for each of the 26 numbers that are fitted
_PLATE_NUMBERS = 5  # of the rig's seven that the plate tells: all but those of z
_ROUNDS = 4  # ratio and residual by turns, from no residual and no outliers; both settle meanwhile
_RANK_TOLERANCE = 1e-12  # of the largest singular value: below it float64 cannot tell a column from the others
_LEAST_RAD = 1e-9  # drawn phase without noise scatters by rounding alone; nothing is an outlier of that
_ROUGH_RAD = 0.5  # from a smooth phase: noise and ripple stay far below it, an object's edge does not
_MOST_ROUGH = 0.1  # share of the plate's points that may be off by more than that: dirt and shadow, but no object


def plate_model(plate: PhasePoints, *, seed: int = DRAW_SEED) -> RigModel:
    """Fit what the plate alone tells: five of the seven numbers, and the smooth residual.

    Parameters
    ----------
    plate
        Points of the bare plate.
    seed
        Of the draw of points that are fitted.

    Raises
    ------
    FitError
        The plate's points do not span the field, or are not those of a bare plate.
    """
    good = np.flatnonzero(np.isfinite(plate.phase_rad))
    good = np.random.default_rng(seed).permutation(good)[:_POINTS]
    x, y, phi = plate.rays.ax[good], plate.rays.ay[good], plate.phase_rad[good]
    unit = max(float(np.ptp(x)), float(np.ptp(y)), 1e-9) / 2
    parameters = np.zeros(7)
    keep = np.ones(phi.size, bool)
    residual = PlateResidual()
    below = np.ones(phi.size)
    for _ in range(_ROUNDS):
        s, t, p = x / unit, y / unit, phi - residual(x, y)
        design = np.column_stack([s, t, np.ones_like(s), -p * s, -p * t]) / below[:, None]
        solution, _, rank, _ = np.linalg.lstsq(design[keep], (p / below)[keep], rcond=_RANK_TOLERANCE)
        if rank < _PLATE_NUMBERS:
            raise FitError("The phase of the plate does not span the field: it cannot be described by a projector.")
        parameters[[0, 1, 3, 4, 5]] = solution / [unit, unit, 1.0, unit, unit]
        below = 1 + (parameters[4] * x + parameters[5] * y)
        model = RigModel(parameters.copy(), np.full(3, np.inf))
        left = phi - model.ratio(x, y, 0.0)
        residual = fit_residual(x[keep], y[keep], left[keep], RESIDUAL_DEGREE)
        left -= residual(x, y)
        keep = np.abs(left) < OUTLIER_SDS * robust_sd(left, about=0) + _LEAST_RAD
    rough = float(np.mean(np.abs(left) > _ROUGH_RAD))
    if rough > _MOST_ROUGH:
        raise FitError(
            f"The reference is no bare plate: over {100 * rough:.0f} % of it the phase is more than {_ROUGH_RAD} rad "
            "from a smooth one. Something lies on the plate, or the captures of strips and reference are exchanged."
        )
    return RigModel(parameters, np.full(3, np.inf), residual)
