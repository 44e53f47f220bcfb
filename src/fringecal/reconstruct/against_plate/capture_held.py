"""A capture held against the bare plate of the calibration: picture, light and contrast."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fringecal.numerics import robust_sd, wrap
from fringecal.phase import TILE_PX, PhaseMap, PlateLook, cells_of, neighbour_scatter
from fringecal.projector import RigCalibration
from fringecal.reconstruct.against_plate.frame_faults import FrameFinding, frame_faults
from fringecal.reconstruct.against_plate.frame_motion import FrameMotion, frame_motion
from fringecal.reconstruct.against_plate.frame_textures import motion_by_texture
from fringecal.reconstruct.against_plate.picture_pose import PictureHeld, picture_held
from fringecal.reconstruct.against_plate.plate_sample import PlateSample, plate_sample
from fringecal.reconstruct.against_plate.texture_shift import EXPECTED, TextureShift, texture_shift

Array = NDArray[np.float64]

_PIECE_SHARE = 0.8  # of a piece of texture that must look like plate for its sharpness to be compared
_LEAST_CELLS = 6  # of the maps of light that must show plate
_SAME_SIGMAS = 4.0  # standard uncertainties within which a phase is the plate's
_LEAST_TURNED = 0.1  # of the picture that must fit the plate's phase when turned, beyond chance
_BETTER = 1.5  # times what fits as it is

TURNS = {
    "mirrored left to right": np.s_[:, ::-1],
    "upside down": np.s_[::-1, :],
    "turned by 180 deg": np.s_[::-1, ::-1],
}
"""How a picture may be turned, and the index that turns it back."""


@dataclass(frozen=True)
class LightHeld:
    """Light on the plate against the calibration's: ratios with standard uncertainties, medians over the picture."""

    brightness: float
    contrast: float
    u_contrast: float


@dataclass(frozen=True)
class NoiseHeld:
    """Noise between neighbours on the plate, over what it was at the calibration, and its standard uncertainty."""

    ratio: float
    u_ratio: float


@dataclass(frozen=True)
class CaptureHeld:
    """A capture beside the bare plate of its calibration.

    Parameters
    ----------
    sample
        A sample of its pixels, and which of them show the plate.
    pose
        What the plate's phase says of picture and plate; None where too little plate is seen.
    texture
        Where the plate's texture is found; None where the calibration kept none.
    light
        Brightness and contrast; None where too little plate is seen, or the calibration did not keep it.
    turned
        How the picture must be turned back to show the plate, a key of `TURNS`; empty if it need not.
    frames
        Frames that disagree with the others; empty where none does, or where no frames were given.
    motion
        How far the frames lie from one another; None where neither residuals nor texture show it.
    noise
        Noise between neighbours; None where too little plate is seen, or the calibration did not keep it.
    """

    sample: PlateSample
    pose: PictureHeld | None
    texture: TextureShift | None
    light: LightHeld | None
    turned: str
    frames: tuple[FrameFinding, ...] = ()
    motion: FrameMotion | None = None
    noise: NoiseHeld | None = None

    @property
    def texture_expected(self) -> bool:
        """Whether the plate's texture is strong enough to be found where plate is seen."""
        return self.texture is not None and self.texture.expected >= EXPECTED


def capture_held(
    phase_map: PhaseMap,
    calibration: RigCalibration,
    *,
    frames: NDArray[np.generic] | None = None,
    weights: Array | None = None,
) -> CaptureHeld:
    """Hold a capture against the plate of its calibration, by its phase, its texture and its light.

    Parameters
    ----------
    phase_map
        The capture.
    calibration
        The rig. Texture and light are compared where it knows how the plate looked.
    frames, weights
        Its frames, grey levels, (N, H, W), and the weights of its scheme, (3, N); without them no frame is judged.
    """
    sample, look = plate_sample(phase_map, calibration), calibration.look
    known = look if look is not None and look.shape == phase_map.phase.shape else None
    return CaptureHeld(
        sample,
        picture_held(sample) if sample.seen else None,
        None if known is None else texture_shift(phase_map, known, _shown(known, sample)),
        None if known is None or not sample.seen else _light(phase_map, known, sample),
        _turned(phase_map, sample),
        () if frames is None or weights is None else frame_faults(frames, phase_map, weights, sample),
        None if frames is None or weights is None else _motion(frames, weights, phase_map, calibration, sample),
        None if known is None or not sample.seen else _noise(phase_map, known, sample),
    )


def _motion(
    frames: NDArray[np.generic], weights: Array, phase_map: PhaseMap, calibration: RigCalibration, sample: PlateSample
) -> FrameMotion | None:
    """Find how far frames lie from one another: by residuals, or of three frames by the plate's texture."""
    found, look = frame_motion(frames, phase_map, weights, sample), calibration.look
    if found is not None or look is None or look.shape != phase_map.phase.shape or not sample.seen:
        return found
    return motion_by_texture(frames, phase_map, calibration, look, _shown(look, sample))


def _noise(phase_map: PhaseMap, look: PlateLook, sample: PlateSample) -> NoiseHeld | None:
    """Compare the noise between neighbours on the plate with the calibration's."""
    down, across = np.nonzero(sample.plate)
    scatter, u = neighbour_scatter(phase_map, sample.v_px[down], sample.u_px[across])
    if not (np.isfinite(scatter) and np.isfinite(look.neighbour_scatter) and look.neighbour_scatter > 0):
        return None
    return NoiseHeld(scatter / look.neighbour_scatter, u / look.neighbour_scatter)


def _shown(look: PlateLook, sample: PlateSample) -> NDArray[np.bool_]:
    """Return which pieces of texture lie where the capture shows the plate, (T,)."""
    shown = []
    for u, v in look.corners_px:
        across = (sample.u_px >= u) & (sample.u_px < u + TILE_PX)
        down = (sample.v_px >= v) & (sample.v_px < v + TILE_PX)
        piece = sample.plate[np.ix_(down, across)]
        shown.append(piece.size > 0 and piece.mean() >= _PIECE_SHARE)
    return np.array(shown, bool)


def _light(phase_map: PhaseMap, look: PlateLook, sample: PlateSample) -> LightHeld | None:
    """Compare light and contrast in the cells that show plate."""
    background = cells_of(phase_map.background[sample.place], sample.plate)
    modulation = cells_of(phase_map.modulation[sample.place], sample.plate)
    seen = np.isfinite(background) & np.isfinite(look.background) & (look.modulation > 0)
    if np.count_nonzero(seen) < _LEAST_CELLS:
        return None
    brighter = background[seen] / look.background[seen]
    stronger = modulation[seen] / look.modulation[seen] / brighter
    scatter = robust_sd(stronger) / np.sqrt(stronger.size)
    return LightHeld(float(np.median(brighter)), float(np.median(stronger)), float(scatter))


def _turned(phase_map: PhaseMap, sample: PlateSample) -> str:
    """Say how the picture must be turned to show the plate's phase, where it fits clearly better so."""
    as_it_is = _fitting(sample.step_rad, sample.sigma_rad)
    best, share = "", _BETTER * as_it_is + _LEAST_TURNED
    for name, way in TURNS.items():
        turned = wrap(phase_map.phase[way][sample.place] - sample.plate_rad)
        fits = _fitting(np.asarray(turned), phase_map.sigma[way][sample.place])
        if fits > share:
            best, share = name, fits
    return best


def _fitting(step_rad: NDArray[np.floating], sigma_rad: NDArray[np.floating]) -> float:
    """Return the share of the sample whose phase is the plate's."""
    with np.errstate(invalid="ignore"):
        return float(np.mean(np.abs(step_rad) <= _SAME_SIGMAS * sigma_rad))
