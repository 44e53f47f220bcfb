"""What the thesis did to its surfaces besides measuring them: filters before and after, object minus plate."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from fringecal.numerics import wrap
from fringecal.phase import PhaseMap
from fringecal.reconstruct import DRAWS, FilterEffect, HeightMap, Reason, effect_of_filter
from fringecal.uncertainty import uncertainty_with_bias
from fringecal.verification import filtered
from fringecal.workflows.shared.capture_phase import CapturePhase, frames_of

NOISE_SEED = 1
"""Of the noise that is drawn to see what a filter leaves of it; an argument wherever it is used."""


@dataclass(frozen=True)
class Treatment:
    """Filters of the frames before and of the heights after, one of `verify.filters.FILTERS` each; object minus plate.

    A 3 x 3 filter blurs ridges and leaves neighbours correlated. u(z) is that of a filtered pixel, with what the filter
    takes away of the form; `u_random` stays that of an unfiltered one, which is what a mean over many pixels holds.
    """

    before: str = "none"
    after: str = "none"
    minus_plate: bool = False

    @property
    def sentence(self) -> str:
        """State which filters were applied; empty if none was."""
        done = [f"frames filtered ({self.before})"] if self.before != "none" else []
        done += ["plate's own heights subtracted"] if self.minus_plate else []
        done += [f"heights filtered ({self.after})"] if self.after != "none" else []
        return ", ".join(done)


UNTREATED = Treatment()


def filtered_phase(phase: CapturePhase, name: str) -> PhaseMap:
    """Demodulate a capture again from filtered frames, rounded back to the camera's integers as the thesis did.

    u(phi) stays that of unfiltered frames; `effect_on_phase` says what the filter leaves of it.
    """
    if name == "none":
        return phase.map
    return replace(phase.again(_filtered_frames(frames_of(phase.capture), name)), sigma=phase.map.sigma)


def _filtered_frames(frames: NDArray[np.generic], name: str) -> NDArray[np.generic]:
    """Filter every frame; keep the type and its integers."""
    smooth = np.stack([filtered(frame, name) for frame in frames])
    return (np.rint(smooth) if frames.dtype.kind in "iu" else smooth).astype(frames.dtype)


def effect_on_phase(phase: CapturePhase, name: str, *, seed: int = NOISE_SEED) -> FilterEffect | None:
    """Find what a filter of the frames does to the phase, rad; None where there is none.

    Parameters
    ----------
    phase
        The capture's phase.
    name
        One of `verification.FILTERS`.
    seed
        Of the noise that is drawn.
    """
    if name == "none":
        return None
    frames = np.asarray(frames_of(phase.capture))
    rng, spread = np.random.default_rng(seed), phase.map.noise.sigma(frames)
    return effect_of_filter(
        frames.astype(float),
        [spread * rng.standard_normal(frames.shape) for _ in range(DRAWS)],
        lambda f: np.rint(np.stack([filtered(frame, name) for frame in f])),
        lambda f: np.stack([filtered(frame, "mean") for frame in f]),
        lambda f: np.where(phase.map.valid, phase.again(f).phase, np.nan),
        lambda a, b: wrap(a - b),
    )


def filtered_heights(
    surface: HeightMap,
    name: str,
    *,
    before: FilterEffect | None = None,
    sigma_rad: NDArray[np.floating] | None = None,
    seed: int = NOISE_SEED,
) -> HeightMap:
    """Filter the heights of a surface, and state u(z) for what all filters leave and take away.

    Parameters
    ----------
    surface
        The surface, of frames that may have been filtered; x, y, and the independent part of u(z) stay as they are.
    name
        One of `verification.FILTERS`.
    before
        What a filter of the frames did to the phase, and `sigma_rad`, the phase's u before it, (H, W).
    seed
        Of the noise that is drawn.
    """
    if name == "none" and before is None:
        return surface
    bias, noises = np.zeros(surface.z.shape), _noises(surface, seed)
    if before is not None and sigma_rad is not None:
        slope = surface.u_random / sigma_rad
        bias, noises = slope * before.bias, [slope * noise for noise in before.noises]
    z, effect = surface.z, FilterEffect(tuple(noises), np.zeros(surface.z.shape))
    if name != "none":
        z = filtered(surface.z, name, valid=surface.mask).astype(surface.z.dtype)
        effect = effect_of_filter(
            surface.z,
            noises,
            lambda heights: filtered(heights, name, valid=surface.mask),
            lambda heights: filtered(heights, "mean", valid=surface.mask),
        )
    combined = np.sqrt(_systematic_variance(surface) + effect.noise_left(surface.u_random) ** 2)
    return _with_bias(replace(surface, z=z), combined, bias + effect.bias)


def _noises(surface: HeightMap, seed: int) -> list[NDArray[np.floating]]:
    """Draw noise of single pixels' heights, mm."""
    rng = np.random.default_rng(seed)
    return [surface.u_random * rng.standard_normal(surface.z.shape) for _ in range(DRAWS)]


def _systematic_variance(surface: HeightMap) -> NDArray[np.floating]:
    """Return what u(z) holds besides noise and known bias, mm^2, (H, W)."""
    if surface.bias is not None:
        return surface.systematic.variance(surface.z)
    return np.maximum(surface.u_z**2 - surface.u_random**2, 0.0)


def _with_bias(surface: HeightMap, combined: NDArray[np.floating], further: NDArray[np.floating]) -> HeightMap:
    """State u(z) with the bias of the surface and a further one, whose signs do not cancel."""
    bias = further if surface.bias is None else np.abs(surface.bias) + further
    u_z = np.where(surface.mask, uncertainty_with_bias(combined, bias), np.nan)
    return replace(surface, u_z=u_z.astype(surface.u_z.dtype), bias=bias)


def minus_plate(surface: HeightMap, plate: HeightMap) -> HeightMap:
    """Subtract the plate's measured heights pixel by pixel: the thesis's `H_Adj = H_Obj - H_Wobj`.

    Takes out what the calibration leaves of the plate's tilt and form; noise of both adds up, and the systematic parts
    stay those of the object alone, which is too much rather than too little. A pixel without plate has no phase.
    """
    both = surface.mask & plate.mask
    reasons = np.where(surface.mask & ~plate.mask, np.uint8(Reason.NO_PHASE), surface.reasons).astype(np.uint8)
    noise = np.hypot(surface.u_random, plate.u_random)
    u_z, bias = np.sqrt(_systematic_variance(surface) + noise**2), None
    if surface.bias is not None and plate.bias is not None:
        bias = surface.bias - plate.bias
        u_z = uncertainty_with_bias(u_z, bias)
    x, y, z, u_z, noise = (np.where(both, m, np.nan) for m in (surface.x, surface.y, surface.z - plate.z, u_z, noise))
    return replace(surface, x=x, y=y, z=z, u_z=u_z, u_random=noise, reasons=reasons, bias=bias)
