"""Which physical thing has moved: the signature of every single cause, fitted to the observed change."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import special

from fringecal.projector import MOST_SETS, RigState, has_lamp, moved
from fringecal.workflows.audit.layout import Layout

Array = NDArray[np.float64]

_AXES = ("x", "y", "z")
_LAMP = tuple(f"lamp along {a}" for a in _AXES)
_AIMED = tuple(f"aimed lamp along {a}" for a in _AXES)
_TURNED = tuple(f"lamp turned about {a}" for a in _AXES)
_SETS = tuple(f"strip height, set {number + 1}" for number in range(MOST_SETS))
_PLATE = ("plate tilt toward x", "plate tilt toward y")

#: Every cause with its variants: the moves that are free in each.
CAUSES: Mapping[str, tuple[tuple[str, ...], ...]] = {
    "camera height changed": (("camera height",),),
    "camera shifted or turned": (
        ("camera along x", "camera along y"),
        ("camera along x", "camera along y", "camera tilt toward x", "camera tilt toward y", "camera roll"),
    ),
    "camera lens refocused": (
        ("lens blur",),
        ("lens blur", "focal length"),
        ("lens blur", "focal length", "lens distortion"),
    ),
    "lamp moved": (_LAMP, _AIMED, (*_LAMP, *_TURNED)),
    "projector or mirror turned": (_TURNED,),
    "slide pitch changed": (("slide pitch",),),
    "slide turned": (("slide turn",),),
    "projector refocused": (("fringe blur",),),
    "plate tilted": (_PLATE, (*_PLATE, "plate height")),
    "plate raised or lowered": (("plate height",),),
    "strips not as high as stated": (("strip height",), *((name,) for name in _SETS)),
}

#: Usual size of each move when it happens, as a standard deviation; sets how much room a cause has. A size that is too
#: small punishes a cause that is right, one that is too large makes it lose against causes with less room.
SIZES: Mapping[str, float] = {
    # A mount that slips or is knocked: mm, rad.
    "camera height": 10.0,
    "camera along x": 10.0,
    "camera along y": 10.0,
    "camera tilt toward x": 0.005,
    "camera tilt toward y": 0.005,
    "camera roll": 0.005,
    **dict.fromkeys((*_LAMP, *_AIMED), 10.0),
    **dict.fromkeys(_TURNED, 0.005),
    # A lens that is focused anew: relative, k1, variance of the blur in px^2 and mm^2.
    "focal length": 0.01,
    "lens distortion": 0.02,
    "lens blur": 1.0,
    "fringe blur": 1.0,
    # Another slide, or one put in again: relative, rad.
    "slide pitch": 0.01,
    "slide turn": 0.005,
    # A plate on other feet: rad, mm.
    **dict.fromkeys(_PLATE, 0.005),
    "plate height": 2.0,
    # Other strips than stated: relative.
    **dict.fromkeys(("strip height", *_SETS), 0.05),
}
_ROUNDS = 4  # Gauss-Newton steps: moves act nearly linearly
_STEP = 1e-3  # of a move's usual size, over which derivatives are taken


@dataclass(frozen=True)
class CauseFit:
    """How well one cause explains the observed change.

    Parameters
    ----------
    cause
        Name of the cause.
    amounts, u_amounts
        By how much each thing would have moved, and its standard uncertainty; mm, rad or relative.
    chi2, dof
        Misfit that is left, over the number of compared quantities.
    log_evidence
        Logarithm of the probability density of the change under this cause, up to a common constant: the misfit, and
        a penalty for every move that is free (Laplace's approximation of the marginal likelihood).
    """

    cause: str
    amounts: dict[str, float]
    u_amounts: dict[str, float]
    chi2: float
    dof: int
    log_evidence: float

    @property
    def probability(self) -> float:
        """Chance of a misfit as large as this if the cause is right."""
        return float(special.chdtrc(self.dof, self.chi2))


def rank_causes(layout: Layout, base: RigState, change: Array, covariance: Array) -> tuple[CauseFit, ...]:
    """Fit every single cause to a change and rank them, the likeliest first.

    Parameters
    ----------
    layout, base
        What is compared, and the rig as calibrated.
    change, covariance
        Observed minus predicted vector of `Layout.predict`, and its covariance.

    Notes
    -----
    The change is taken as `f(q) - f(0) + e`, q normal about 0 with the sizes of `SIZES`, e with the covariance; of a
    cause with several variants the best one counts.
    """
    whitening = np.linalg.cholesky(np.linalg.inv(covariance)).T
    best = []
    for cause, variants in CAUSES.items():
        possible = (moves for moves in variants if _possible(moves, base, len(layout.strips)))
        fits = [_fit(cause, moves, layout, base, change, whitening) for moves in possible]
        if fits:
            best.append(max(fits, key=lambda fit: fit.log_evidence))
    return tuple(sorted(best, key=lambda fit: -fit.log_evidence))


def _possible(moves: Sequence[str], base: RigState, sets: int) -> bool:
    """Leave out what a rig cannot do: a telecentric camera has no height, parallel light no lamp.

    One set of strips alone is in question only where there are `sets` of them.
    """
    if any(name in moves for name in (_SETS if sets < 2 else _SETS[sets:])):
        return False
    if base.camera.telecentric and any(m.startswith(("camera tilt", "camera height", "focal")) for m in moves):
        return False
    return has_lamp(base.model) or not any("lamp" in m or m == "slide turn" for m in moves)


def _fit(cause: str, moves: Sequence[str], layout: Layout, base: RigState, change: Array, whitening: Array) -> CauseFit:
    sizes = np.array([SIZES[m] for m in moves])
    start = layout.predict(base)

    def misfit(q: Array) -> Array:
        return whitening @ (change - (layout.predict(moved(base, dict(zip(moves, q * sizes, strict=True)))) - start))

    q = np.zeros(len(moves))
    for _ in range(_ROUNDS):
        left = misfit(q)
        slopes = np.stack([(left - misfit(q + step)) / _STEP for step in _STEP * np.eye(q.size)], axis=1)
        normal = slopes.T @ slopes + np.eye(q.size)
        q = q + np.linalg.solve(normal, slopes.T @ left - q)
    left = misfit(q)
    chi2 = float(left @ left)
    u = np.sqrt(np.diag(np.linalg.inv(normal)))
    evidence = -0.5 * (chi2 + float(q @ q) + float(np.linalg.slogdet(normal)[1]))
    return CauseFit(
        cause,
        dict(zip(moves, (q * sizes).tolist(), strict=True)),
        dict(zip(moves, (u * sizes).tolist(), strict=True)),
        chi2,
        change.size,
        evidence,
    )
