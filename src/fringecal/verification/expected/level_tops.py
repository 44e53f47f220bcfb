"""A level top says which fringe it has: with another order it would not be parallel to the plate.

The height of a fringe changes over the picture, since light and sight diverge. A top that reads level with one order is
tilted by milliradians with the next, and the tilt of a top of some hundred pixels is known to a tenth of that. So a
block that is whole fringes higher or lower than its certificate says does not pass as what it is not.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fringecal.errors import FitError
from fringecal.numerics import TURN
from fringecal.verification.expected.known_rig import Floats, KnownRig


@dataclass(frozen=True)
class LevelRules:
    """When a top contradicts its order.

    Parameters
    ----------
    most_orders
        Fringes up and down that are tried: something else than the artefact may stand there.
    pixels
        Of a top that its tilt is taken from.
    deviations
        Standard uncertainties of the tilt beyond which it counts.
    least_rad
        Tilt below which a top counts as level: 0.1 mm over 50 mm, as tops and calibrations go.
    share
        Of the tilt, below which another order's must lie.
    """

    most_orders: int = 12
    pixels: int = 4000
    deviations: float = 6.0
    least_rad: float = 2e-3
    share: float = 0.4


LEVEL = LevelRules()


def demand_level(
    phase_rad: Floats, pixels: tuple[NDArray[np.intp], NDArray[np.intp]], rig: KnownRig, *, rules: LevelRules = LEVEL
) -> None:
    """Refuse a level top that would be level with another fringe order and is not with its own.

    Parameters
    ----------
    phase_rad
        Absolute phase of the top's pixels, (n,).
    pixels
        Their columns and rows, (n,) each.
    rig
        The calibrated rig.

    Raises
    ------
    FitError
        Another order makes it level.
    """
    step = max(1, phase_rad.size // rules.pixels)
    phase, u, v = phase_rad[::step], pixels[0][::step], pixels[1][::step]
    own, u_own, height = _tilt(phase, u, v, rig)
    if own < max(rules.least_rad, rules.deviations * u_own):
        return
    orders = (k for k in range(-rules.most_orders, rules.most_orders + 1) if k)
    others = {order: _tilt(phase + TURN * order, u, v, rig) for order in orders}
    order = min(others, key=lambda k: others[k][0])
    tilt, _, other_height = others[order]
    if tilt < rules.share * own:
        raise FitError(
            f"the artefact's top reads {height:.3g} mm with the fringe order that its certificate demands, but is "
            f"tilted by {1e3 * own:.1f} mrad then; {abs(order)} fringe{'s' if abs(order) > 1 else ''} away it reads "
            f"{other_height:.3g} mm and is level. Check that the certificate belongs to this artefact and that it lies "
            "flat; a second period would decide"
        )


def _tilt(phase: Floats, u: NDArray[np.intp], v: NDArray[np.intp], rig: KnownRig) -> tuple[float, float, float]:
    """Return a surface's tilt against the plate, its standard uncertainty by scatter, rad, and its mean height, mm."""
    rays = rig.camera.rays(u.astype(float), v.astype(float))
    z = rig.model.height(phase, rays)
    x, y = rays.at(z)
    design = np.column_stack([np.ones(z.size), x - x.mean(), y - y.mean()])
    plane, *_ = np.linalg.lstsq(design, z, rcond=None)
    scatter = float(np.std(z - design @ plane))
    covariance = np.linalg.pinv(design.T @ design)
    return (
        float(np.hypot(plane[1], plane[2])),
        scatter * float(np.sqrt(covariance[1, 1] + covariance[2, 2])),
        float(plane[0]),
    )
