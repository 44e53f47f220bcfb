"""What the thesis did to its surfaces besides measuring them: filters before and after, object minus plate."""

from dataclasses import dataclass, replace

import numpy as np

from fringecal.phase import PhaseMap
from fringecal.reconstruct import HeightMap, Reason
from fringecal.verification import filtered
from fringecal.workflows.shared.capture_phase import CapturePhase, frames_of


@dataclass(frozen=True)
class Treatment:
    """Filters of the frames before and of the heights after, one of `verify.filters.FILTERS` each; object minus plate.

    A 3 x 3 filter blurs ridges and leaves neighbours correlated; u(z) stays that of a single unfiltered pixel.
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
    """Demodulate a capture again from filtered frames, rounded back to the camera's integers as the thesis did."""
    if name == "none":
        return phase.map
    frames = frames_of(phase.capture)
    smooth = np.stack([np.rint(filtered(frame, name)).astype(frames.dtype) for frame in frames])
    return phase.again(smooth)


def filtered_heights(surface: HeightMap, name: str) -> HeightMap:
    """Filter the heights of a surface; x, y and u(z) stay as they are."""
    if name == "none":
        return surface
    z = filtered(surface.z, name, valid=surface.mask).astype(surface.z.dtype)
    return replace(surface, z=z)


def minus_plate(surface: HeightMap, plate: HeightMap) -> HeightMap:
    """Subtract the plate's measured heights pixel by pixel: the thesis's `H_Adj = H_Obj - H_Wobj`.

    Takes out what the calibration leaves of the plate's tilt and form; noise of both adds up, and the systematic parts
    stay those of the object alone, which is too much rather than too little. A pixel without plate has no phase.
    """
    both = surface.mask & plate.mask
    reasons = np.where(surface.mask & ~plate.mask, np.uint8(Reason.NO_PHASE), surface.reasons).astype(np.uint8)
    noise = np.hypot(surface.u_random, plate.u_random)
    u_z = np.sqrt(surface.u_z**2 + plate.u_random**2)
    x, y, z, u_z, noise = (np.where(both, m, np.nan) for m in (surface.x, surface.y, surface.z - plate.z, u_z, noise))
    return replace(surface, x=x, y=y, z=z, u_z=u_z, u_random=noise, reasons=reasons)
