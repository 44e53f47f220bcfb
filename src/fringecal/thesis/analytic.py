"""The thesis's simulation by formula (its section 4.2): three cosine images of a rectangle and of a zig-zag, read back.

Collimated fringes on an ideal picture: what the phase shift alone does to a height, before any rig, lens or light.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fringecal.numerics import TURN, wrap
from fringecal.phase import PhaseMap, demodulate, unwrap_regions
from fringecal.simulate import THIRDS_RAD, analytic_images, rectangle_px, zigzag_px

ANGLES_DEG = (45.0, 50.7)  # projection angles: the one at which height is shift, and that of the thesis's rig
_SHAPE = (240, 320)  # rows and columns of the pictures, px
_WHITE = 256.0  # grey levels; the images reach 255 by design: nothing is cut off
_WIDE_PX, _FINE_PX = 120.0, 20.0  # periods: a step of the rectangle must stay below half of one, a slope need not
_SECTIONS = (0.3, 0.5, 0.9)  # of the picture's height: through the object twice, and beside it


@dataclass(frozen=True)
class AnalyticCase:
    """One object at one projection angle, drawn and read back; all lengths in px.

    Parameters
    ----------
    name
        The object.
    angle_deg, pitch_px
        Projection angle from the normal and fringe period.
    frames
        The images as 8-bit grey values, (3, H, W).
    phase
        What `fringecal.phase.demodulation.demodulate` gives for them.
    true_px, height_px
        Height drawn and height read, (H, W).
    """

    name: str
    angle_deg: float
    pitch_px: float
    frames: NDArray[np.uint8]
    phase: PhaseMap
    true_px: NDArray[np.float64]
    height_px: NDArray[np.float64]

    @property
    def rows(self) -> tuple[int, ...]:
        """The three rows of the sections."""
        return tuple(round(share * (self.true_px.shape[0] - 1)) for share in _SECTIONS)

    @property
    def largest_error_px(self) -> float:
        """Largest error of the height over the whole picture."""
        return float(np.max(np.abs(self.height_px - self.true_px)))

    @property
    def rms_error_px(self) -> float:
        """Root mean square error of the height over the whole picture."""
        return float(np.sqrt(np.mean((self.height_px - self.true_px) ** 2)))


def analytic_cases() -> Iterator[AnalyticCase]:
    """Draw and read the rectangle and the zig-zag at both angles of the thesis."""
    for angle_deg in ANGLES_DEG:
        yield _case("rectangle", rectangle_px(_SHAPE), angle_deg, _WIDE_PX)
        yield _case("zig-zag", zigzag_px(_SHAPE), angle_deg, _FINE_PX)


def _case(name: str, true_px: NDArray[np.float64], angle_deg: float, pitch_px: float) -> AnalyticCase:
    frames, bare = (_pictures(z, angle_deg, pitch_px) for z in (true_px, np.zeros(_SHAPE)))
    phase, plate = (demodulate(f, THIRDS_RAD, white_level=_WHITE) for f in (frames, bare))
    step = wrap(phase.phase.astype(float) - plate.phase)
    if pitch_px < _WIDE_PX:
        step = unwrap_regions(step, phase.valid & plate.valid).phase
        step -= TURN * np.rint(np.nanmedian(step[0]) / TURN)  # the first row is bare background
    height = -step * pitch_px / (TURN * np.tan(np.radians(angle_deg)))
    return AnalyticCase(name, angle_deg, pitch_px, frames, phase, true_px, height)


def _pictures(z_px: NDArray[np.float64], angle_deg: float, pitch_px: float) -> NDArray[np.uint8]:
    return np.rint(analytic_images(z_px, angle_deg=angle_deg, pitch_px=pitch_px).frames).astype(np.uint8)
