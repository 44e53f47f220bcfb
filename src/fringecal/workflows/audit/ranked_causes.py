"""Probable causes of a change: the signature of every single cause, fitted to the observed change."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import special

from fringecal.projector import STRIP_SETS, Move, RigState, has_projector_position, moved
from fringecal.workflows.audit.cause_kinds import Cause
from fringecal.workflows.audit.layout import Layout

Array = NDArray[np.float64]

_CAMERA_PLACE = (Move.CAMERA_ALONG_X, Move.CAMERA_ALONG_Y)
_CAMERA_TURNS = (Move.CAMERA_TILT_X, Move.CAMERA_TILT_Y, Move.CAMERA_ROLL)
_PROJECTOR = (Move.PROJECTOR_ALONG_X, Move.PROJECTOR_ALONG_Y, Move.PROJECTOR_ALONG_Z)
_AIMED = (Move.AIMED_PROJECTOR_ALONG_X, Move.AIMED_PROJECTOR_ALONG_Y, Move.AIMED_PROJECTOR_ALONG_Z)
_TURNED = (Move.PROJECTOR_TURNED_X, Move.PROJECTOR_TURNED_Y, Move.PROJECTOR_TURNED_Z)
_PLATE = (Move.PLATE_TILT_X, Move.PLATE_TILT_Y)
#: What parallel rays of a camera, and parallel light, cannot show.
_OF_A_PINHOLE = frozenset({Move.CAMERA_TILT_X, Move.CAMERA_TILT_Y, Move.CAMERA_HEIGHT, Move.FOCAL_LENGTH})
_OF_DIVERGING_LIGHT = frozenset({*_PROJECTOR, *_AIMED, *_TURNED, Move.SLIDE_TURN})

#: Every cause with its variants: the moves that are free in each.
CAUSES: Mapping[Cause, tuple[tuple[Move, ...], ...]] = {
    Cause.CAMERA_HEIGHT: ((Move.CAMERA_HEIGHT,),),
    Cause.CAMERA_PLACE: (_CAMERA_PLACE, (*_CAMERA_PLACE, *_CAMERA_TURNS)),
    Cause.CAMERA_LENS: (
        (Move.LENS_BLUR,),
        (Move.LENS_BLUR, Move.FOCAL_LENGTH),
        (Move.LENS_BLUR, Move.FOCAL_LENGTH, Move.LENS_DISTORTION),
    ),
    Cause.PROJECTOR_PLACE: (_PROJECTOR, _AIMED, (*_PROJECTOR, *_TURNED)),
    Cause.PROJECTOR_TURNED: (_TURNED,),
    Cause.SLIDE_PITCH: ((Move.SLIDE_PITCH,),),
    Cause.SLIDE_TURNED: ((Move.SLIDE_TURN,),),
    Cause.PROJECTOR_LENS: ((Move.FRINGE_BLUR,),),
    Cause.PLATE_TILTED: (_PLATE, (*_PLATE, Move.PLATE_HEIGHT)),
    Cause.PLATE_RAISED: ((Move.PLATE_HEIGHT,),),
    Cause.STRIPS: ((Move.STRIP_HEIGHT,), *((move,) for move in STRIP_SETS)),
}

#: Usual size of each move when it happens, as a standard deviation; sets how much room a cause has. A size that is too
#: small punishes a cause that is right, one that is too large makes it lose against causes with less room.
SIZES: Mapping[Move, float] = {
    # A mount that slips or is knocked: mm, rad.
    Move.CAMERA_HEIGHT: 10.0,
    **dict.fromkeys(_CAMERA_PLACE, 10.0),
    **dict.fromkeys(_CAMERA_TURNS, 0.005),
    **dict.fromkeys((*_PROJECTOR, *_AIMED), 10.0),
    **dict.fromkeys(_TURNED, 0.005),
    # A lens that is focused anew: relative, k1, variance of the blur in px^2 and mm^2.
    Move.FOCAL_LENGTH: 0.01,
    Move.LENS_DISTORTION: 0.02,
    Move.LENS_BLUR: 1.0,
    Move.FRINGE_BLUR: 1.0,
    # Another slide, or one put in again: relative, rad.
    Move.SLIDE_PITCH: 0.01,
    Move.SLIDE_TURN: 0.005,
    # A plate on other feet: rad, mm.
    **dict.fromkeys(_PLATE, 0.005),
    Move.PLATE_HEIGHT: 2.0,
    # Other strips than stated: relative.
    **dict.fromkeys((Move.STRIP_HEIGHT, *STRIP_SETS), 0.05),
}
_ROUNDS = 4  # Gauss-Newton steps: moves act nearly linearly
_STEP = 1e-3  # of a move's usual size, over which derivatives are taken


@dataclass(frozen=True)
class CauseFit:
    """How well one cause explains the observed change.

    Parameters
    ----------
    cause
        The cause.
    amounts, u_amounts
        By how much each thing would have moved, and its standard uncertainty; mm, rad or relative.
    chi2, dof
        Chi-squared of the residuals, and the number of compared quantities.
    log_evidence
        Logarithm of the probability density of the change under this cause, up to a common constant: the residuals, and
        a penalty for every move that is free (Laplace's approximation of the marginal likelihood).
    """

    cause: Cause
    amounts: dict[Move, float]
    u_amounts: dict[Move, float]
    chi2: float
    dof: int
    log_evidence: float

    @property
    def probability(self) -> float:
        """Probability of residuals as large as these if the cause is right."""
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


def _possible(moves: Sequence[Move], base: RigState, sets: int) -> bool:
    """Leave out what a rig cannot do: a telecentric camera has no height, parallel light no projector position.

    One set of strips alone is in question only where there are `sets` of them.
    """
    if any(move in moves for move in (STRIP_SETS if sets < 2 else STRIP_SETS[sets:])):
        return False
    if base.camera.telecentric and not _OF_A_PINHOLE.isdisjoint(moves):
        return False
    return has_projector_position(base.model) or _OF_DIVERGING_LIGHT.isdisjoint(moves)


def _fit(
    cause: Cause, moves: Sequence[Move], layout: Layout, base: RigState, change: Array, whitening: Array
) -> CauseFit:
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
