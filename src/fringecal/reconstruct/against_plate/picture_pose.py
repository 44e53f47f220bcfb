"""Where the plate of a capture lies beside that of the calibration, told by its phase alone."""

from dataclasses import dataclass
from enum import Enum

import numpy as np
from numpy.typing import NDArray

from fringecal.numerics import robust_sd
from fringecal.reconstruct.against_plate.plate_sample import PlateSample

Array = NDArray[np.float64]

_ROUNDS = 4  # of the fit, each without what lies off the one before
_KEPT_SIGMAS = 4.0  # robust standard deviations beyond which a pixel is the foot of an object: one in 16 000 of plate
_BLOCKS = 8  # along each axis: what is common to a block, such as light from the object, counts as one departure
_PRICE = 15.0  # of chi-squared for each number: a free number gains as much by chance once in 10 000
_ALIKE = 15.0  # of chi-squared, within which two explanations cannot be told apart


class PoseKind(Enum):
    """What may have happened between calibration and capture; the order is that of the sentences."""

    CAMERA = "camera moved or turned"
    PLATE = "plate raised or tilted"
    FRAMES = "fringes shifted as a whole"
    SCALE = "picture rescaled"


@dataclass(frozen=True)
class Pose:
    """One explanation of the plate's phase.

    Parameters
    ----------
    kind
        What moved.
    values, u
        Its numbers by name and their standard uncertainties: `along` and `across` the fringes in px, `turn` in rad,
        `height` in mm, `tilt_u` and `tilt_v` in mm over the picture, `phase` in rad, `scale` as a share.
    chi_squared
        Sum of squared departures over their uncertainty, with the price of its numbers.
    step_rad
        Root mean square of the phase that it adds to the plate's, rad.
    """

    kind: PoseKind
    values: dict[str, float]
    u: dict[str, float]
    chi_squared: float
    step_rad: float


@dataclass(frozen=True)
class PictureHeld:
    """How a capture's plate lies: the explanations that its phase leaves, the best first; none if nothing moved.

    Parameters
    ----------
    poses
        Explanations that cannot be told apart.
    along_px, u_along_px
        Displacement of the picture along the fringes and its standard uncertainty if the picture moved, px: what the
        fringes' own bend and convergence show.
    spread
        Scatter of the plate's phase over its uncertainty: beyond 1.5, what the phase shows is no displacement alone.
    """

    poses: tuple[Pose, ...]
    along_px: float
    u_along_px: float
    spread: float


def picture_held(sample: PlateSample) -> PictureHeld:
    """Explain the plate's phase by a camera or a plate that moved, or by frames of other phase shifts.

    Parameters
    ----------
    sample
        The capture beside the plate's phase; plate must be seen.

    Notes
    -----
    A picture displaced by `(du, dv)` shows `phi(u - du, v - dv)`: its step is `-(phi_u du + phi_v dv)`; a plate
    raised by z shows `phi_z z`. Along the fringes the plate's phase is the same but for their bend and convergence, so
    a displacement along them is known less well than one across. Each explanation is fitted by itself; its chi-squared
    is charged for each number, and those within what chance makes of the best one are returned.
    """
    place = sample.plate & np.isfinite(sample.step_rad)
    terms = _terms(sample, place)
    step, sigma = sample.step_rad[place], sample.sigma_rad[place]
    kept, spread = _kept(terms, step, sigma)
    weights = 1 / (sigma[kept] * spread)
    weighted = step[kept] * weights
    columns = {name: term[kept] * weights for name, term in terms.items()}
    blocks = _blocks(place)[kept]
    fits = (_fitted(kind, columns, weighted, weights, blocks) for kind in _NUMBERS)
    poses = sorted(fits, key=lambda pose: pose.chi_squared)
    none = float(weighted @ weighted)
    alike = tuple(p for p in poses if p.chi_squared < poses[0].chi_squared + _ALIKE)
    moved = next(p for p in poses if p.kind is PoseKind.CAMERA)
    return PictureHeld(alike if poses[0].chi_squared < none else (), moved.values["along"], moved.u["along"], spread)


_NUMBERS: dict[PoseKind, tuple[str, ...]] = {
    PoseKind.CAMERA: ("across", "along", "turn"),
    PoseKind.PLATE: ("height", "tilt_u", "tilt_v"),
    PoseKind.FRAMES: ("phase",),
    PoseKind.SCALE: ("across", "along", "turn", "scale"),
}


def _terms(sample: PlateSample, place: NDArray[np.bool_]) -> dict[str, Array]:
    """Return what one unit of each number adds to the plate's phase."""
    u, v = np.meshgrid(sample.u_px - sample.u_px.mean(), sample.v_px - sample.v_px.mean())
    width = float(np.ptp(sample.u_px)) or 1.0
    u, v, by_u, by_v, by_z = (m[place] for m in (u, v, sample.along_u, sample.along_v, sample.along_z))
    across = np.array([by_u.mean(), by_v.mean()])
    across /= np.hypot(*across)
    along = np.array([-across[1], across[0]])
    return {
        "across": -(by_u * across[0] + by_v * across[1]),
        "along": -(by_u * along[0] + by_v * along[1]),
        "turn": by_u * v - by_v * u,
        "scale": -(by_u * u + by_v * v),
        "phase": np.ones_like(by_u),
        "height": by_z,
        "tilt_u": by_z * u / width,
        "tilt_v": by_z * v / width,
    }


def _kept(terms: dict[str, Array], step: Array, sigma: Array) -> tuple[NDArray[np.bool_], float]:
    """Return which pixels lie on a plane of phase, and by how much they scatter beyond their uncertainty."""
    design = np.column_stack([terms[name] for name in ("phase", "height", "tilt_u", "tilt_v", "across", "along")])
    design /= np.abs(design).max(axis=0)
    kept = np.ones(step.size, bool)
    scores, spread = step / sigma, 1.0
    for _ in range(_ROUNDS):
        few = np.flatnonzero(kept)[:: max(1, np.count_nonzero(kept) // 5000)]
        plane = np.linalg.lstsq(design[few] / sigma[few, None], step[few] / sigma[few], rcond=1e-9)[0]
        scores = (step - design @ plane) / sigma
        spread = max(robust_sd(scores[kept], about=0), 1.0)
        kept = np.abs(scores) <= _KEPT_SIGMAS * spread
    return kept, spread


def _blocks(place: NDArray[np.bool_]) -> NDArray[np.intp]:
    """Return the number of the block of the picture in which every chosen pixel lies."""
    down, across = (np.arange(length) * _BLOCKS // length for length in place.shape)
    return (down[:, None] * _BLOCKS + across[None, :])[place]


def _fitted(
    kind: PoseKind, columns: dict[str, Array], weighted: Array, weights: Array, blocks: NDArray[np.intp]
) -> Pose:
    """Fit the numbers of one explanation; their uncertainty is that by noise, or by the scatter of blocks if larger."""
    names = _NUMBERS[kind]
    design = np.column_stack([columns[name] for name in names])
    normal, right = design.T @ design, design.T @ weighted
    scale = np.sqrt(np.maximum(np.diag(normal), 1e-300))
    inverse = np.linalg.pinv(normal / np.outer(scale, scale), hermitian=True) / np.outer(scale, scale)
    values = inverse @ right
    made = design @ values
    left = weighted - made
    pulls = np.stack([np.bincount(blocks, left * column, _BLOCKS**2) for column in design.T])
    by_blocks = inverse @ (pulls @ pulls.T) @ inverse
    u = np.sqrt(np.maximum(np.diag(inverse), np.diag(by_blocks)))
    return Pose(
        kind,
        {name: float(value) for name, value in zip(names, values, strict=True)},
        {name: float(one) for name, one in zip(names, u, strict=True)},
        float(weighted @ weighted - right @ values) + _PRICE * len(names),
        float(np.sqrt(np.mean((made / weights) ** 2))),
    )
