"""A calibrated rig's uncertainty by Monte Carlo: all components drawn at once, through any quantity."""

from collections.abc import Callable, Mapping

import numpy as np
from numpy.typing import NDArray

from fringecal.projector.rig_calibration import RigCalibration
from fringecal.uncertainty import COVERAGE, FirstOrderCheck, check_first_order, draw_deviates

Array = NDArray[np.float64]
Quantities = Mapping[str, Callable[[RigCalibration], float]]

TRIALS = 10_000
"""Rigs drawn: the ends of a 95 % interval are then known to 5 % of u, which one digit of u asks for at least."""


def draw_quantities(
    calibration: RigCalibration, quantities: Quantities, rng: np.random.Generator, trials: int = TRIALS
) -> Array:
    """Return quantities of rigs drawn from a calibration's uncertainty, shape (trials, quantities).

    Each rig has all parameters off at once, by the sum of its components' effects times deviates.

    Parameters
    ----------
    calibration
        The rig with its uncertainty components.
    quantities
        Functions of a calibrated rig, by name.
    rng
        Seeded by the caller.
    trials
        Number of rigs.
    """
    effects = np.stack([component.effect for component in calibration.components])
    offs = draw_deviates(calibration.components, rng, trials) @ effects
    rigs = (calibration.replaced(calibration.vector + off) for off in offs)
    return np.array([[float(quantity(rig)) for quantity in quantities.values()] for rig in rigs])


def check_by_monte_carlo(  # noqa: PLR0913 -- a rig and its quantities; how many draws, to what digit
    calibration: RigCalibration,
    quantities: Quantities,
    rng: np.random.Generator,
    *,
    trials: int = TRIALS,
    coverage: float = COVERAGE,
    digits: int = 1,
) -> dict[str, FirstOrderCheck]:
    """Check the first-order uncertainty of quantities of a rig by drawing rigs (JCGM 101:2008, clause 8).

    First order takes every quantity as linear in the components, and a combined uncertainty as Student's t of the
    effective degrees of freedom. The draws take neither for granted: they show what curvature of camera and rig model,
    and few degrees of freedom, do.

    Parameters
    ----------
    calibration
        The rig with its uncertainty components.
    quantities
        Functions of a calibrated rig, by name with unit, such as ``"angle / deg"``.
    rng
        Seeded by the caller.
    trials
        Number of rigs drawn; each takes about a millisecond.
    coverage
        Coverage probability of the intervals that are compared.
    digits
        Significant digits of u that both must agree in.

    Raises
    ------
    FitError
        A quantity that is not finite for some of the rigs.

    Examples
    --------
    >>> from fringecal.camera import CAMERA_NAMES, PlateCamera
    >>> from fringecal.projector.rig_model import RIG_NAMES, RigModel
    >>> from fringecal.uncertainty import Influence, UncertaintyComponent
    >>> camera = PlateCamera.from_values({"scale_mm_per_px": 0.5, "height_mm": 1000.0}, (480, 640))
    >>> model = RigModel(np.array([0, 0.8, -0.9, 0, 0, 5e-4, -4e-4]), np.array([0, 1000.0, 1000.0]))
    >>> effect = np.zeros(len(CAMERA_NAMES) + len(RIG_NAMES) + 1)
    >>> effect[CAMERA_NAMES.index("scale_mm_per_px")] = 0.5e-3  # mm/px; a sheet that errs by 0.1 %
    >>> rig = RigCalibration(camera, model, (UncertaintyComponent(Influence.GRID_PITCH, effect),))
    >>> scale = {"scale / (mm/px)": lambda rig: rig.camera["scale_mm_per_px"]}
    >>> found = check_by_monte_carlo(rig, scale, np.random.default_rng(1), trials=4000)["scale / (mm/px)"]
    >>> found.validation.valid, round(found.u_ratio, 1)
    (True, 1.0)
    """
    drawn = draw_quantities(calibration, quantities, rng, trials)
    return {
        name: check_first_order(
            calibration.budget(quantity, unit="", label=name), values, coverage=coverage, digits=digits
        )
        for (name, quantity), values in zip(quantities.items(), drawn.T, strict=True)
    }
