"""Frames of a capture that lie apart from one another, told by what the model of phase shifting leaves of them."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fringecal.numerics import robust_sd
from fringecal.phase import PhaseMap
from fringecal.reconstruct.against_plate.plate_sample import PlateSample

Array = NDArray[np.float64]

APART_SIGMAS = 8.0
"""Standard uncertainties from which frames lie apart: 2.2 is the most that 30 sound captures showed."""

_STEEP_LEVELS = 25.0  # per pixel: at steeper edges a displacement of a pixel is no slope times its size
_KEPT_SIGMAS = 5.0
_ROUNDS = 3
_RANK = 1e-9  # of the normal matrix: all frames moved together are no motion of one against another
_LEAST_PIXELS, _MOST_PIXELS = 2000, 20_000  # of which displacements are known to 0.002 to 0.02 px


@dataclass(frozen=True)
class FrameMotion:
    """How far frames lie from one another.

    Parameters
    ----------
    frame
        Number of the frame that lies furthest from the others' mean, from 0.
    px, u_px
        How far, and its standard uncertainty, px.
    sigmas
        Largest displacement of any frame along either axis over its standard uncertainty.
    """

    frame: int
    px: float
    u_px: float
    sigmas: float

    @property
    def apart(self) -> bool:
        """Whether chance does not explain it."""
        return self.sigmas > APART_SIGMAS

    @property
    def least_px(self) -> float:
        """Smallest displacement that would have been noticed, px."""
        return APART_SIGMAS * self.u_px


def frame_motion(
    frames: NDArray[np.generic], phase_map: PhaseMap, weights: Array, sample: PlateSample
) -> FrameMotion | None:
    """Find how far frames lie from one another by their residuals; None of three frames, which leave none.

    Parameters
    ----------
    frames
        Grey levels, (N, H, W).
    phase_map
        What they were demodulated to.
    weights
        Weights of the scheme, (3, N).
    sample
        Which pixels are looked at; plate and object alike.

    Notes
    -----
    A frame displaced by d shows `I - d grad(I)`. What the model of phase shifting leaves of the frames, `R I` with
    `R = 1 - D W`, is fitted by the displacements of all frames over the gradients of the texture, beside a brightness,
    a contrast and a phase shift of each frame. Where all frames moved alike nothing is left, and none is found.
    """
    kept_out = _left_out(weights)
    if kept_out.shape[1] == 0:
        return None
    v, u = (at[1:-1] for at in (sample.v_px, sample.u_px))
    place = np.ix_(v, u)
    slopes = np.stack([
        (phase_map.background[np.ix_(v, u + 1)] - phase_map.background[np.ix_(v, u - 1)]) / 2,
        (phase_map.background[np.ix_(v + 1, u)] - phase_map.background[np.ix_(v - 1, u)]) / 2,
    ])  # fmt: skip
    use = np.isfinite(phase_map.phase[place]) & (np.abs(slopes) < _STEEP_LEVELS).all(axis=0)
    if np.count_nonzero(use) < _LEAST_PIXELS:
        return None
    use = _thinned(use)
    light = phase_map.background[place][use].astype(float), phase_map.modulation[place][use].astype(float)
    waves = _waves(phase_map.phase[place][use].astype(float), weights)
    left = kept_out.T @ np.stack([frame[place][use] for frame in frames]).astype(float)
    design = _design(kept_out, slopes[:, use].astype(float), light, waves)
    return _furthest(design, left.ravel(), len(frames))


def _thinned(use: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Leave so many pixels, evenly over the sample."""
    some = np.flatnonzero(use)
    few = np.zeros_like(use)
    few.flat[some[:: max(1, -(-some.size // _MOST_PIXELS))]] = True
    return few


def _left_out(weights: Array) -> Array:
    """Return an orthonormal basis of what no background, modulation and phase explain, (N, N - 3)."""
    number = weights.shape[1]
    vectors, singular, _ = np.linalg.svd(np.eye(number) - np.linalg.pinv(weights) @ weights)
    return np.asarray(vectors[:, singular > 0.5])


def _waves(phase: Array, weights: Array) -> tuple[Array, Array]:
    """Return cosine and sine of phase and phase shift of every frame, (N, n) each."""
    model = np.linalg.pinv(weights)
    across, along = model[:, 1, None], model[:, 2, None]
    cosine, sine = np.cos(phase), np.sin(phase)
    return across * cosine + along * sine, across * sine - along * cosine


def _design(kept_out: Array, slopes: Array, light: tuple[Array, Array], waves: tuple[Array, Array]) -> Array:
    """Return what one unit of each unknown leaves: displacements along u and v, phase shifts, contrasts, brightness."""
    background, modulation = light
    cosine, sine = waves
    seen = 1 + modulation / np.maximum(background, 1.0) * cosine
    columns = []
    for terms in (-slopes[0] * seen, -slopes[1] * seen, -modulation * sine, modulation * cosine, np.ones_like(sine)):
        columns += [np.outer(part, term).ravel() for part, term in zip(kept_out, terms, strict=True)]
    return np.stack(columns, axis=1)


def _furthest(design: Array, left: Array, number: int) -> FrameMotion:
    """Fit all unknowns and return the frame that lies furthest away."""
    kept = np.ones(left.size, bool)
    for _ in range(_ROUNDS):
        chosen = design[kept]
        inverse = np.linalg.pinv(chosen.T @ chosen, rcond=_RANK, hermitian=True)
        values = inverse @ (chosen.T @ left[kept])
        rest = left - design @ values
        noise = robust_sd(rest[kept], about=0)
        kept = np.abs(rest) <= _KEPT_SIGMAS * noise
    away = values[: 2 * number].reshape(2, number)
    away = away - away.mean(axis=1, keepdims=True)
    u = noise * np.sqrt(np.maximum(np.diag(inverse)[: 2 * number], 0)).reshape(2, number)
    size = np.hypot(*away)
    frame = int(np.argmax(size))
    sigmas = float(np.max(np.abs(away) / np.maximum(u, 1e-9)))
    return FrameMotion(frame, float(size[frame]), float(np.hypot(*u[:, frame])), sigmas)
