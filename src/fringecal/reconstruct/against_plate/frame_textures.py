"""Where the plate's texture lies in single frames: what tells three frames apart, which leave no residual."""

import numpy as np
from numpy.typing import NDArray

from fringecal.phase import PhaseMap, PlateLook, texture_of
from fringecal.projector import RigCalibration
from fringecal.reconstruct.against_plate.frame_motion import FrameMotion
from fringecal.reconstruct.against_plate.plate_sample import plate_phase
from fringecal.reconstruct.against_plate.texture_shift import CLEAR, REACH_PX, correlated, piece_window, summit

Array = NDArray[np.float64]


def motion_by_texture(
    frames: NDArray[np.generic],
    phase_map: PhaseMap,
    calibration: RigCalibration,
    look: PlateLook,
    shown: NDArray[np.bool_],
) -> FrameMotion | None:
    """Find how far frames lie from one another by the plate's texture in each; None where one does not show it.

    Parameters
    ----------
    frames
        Grey levels, (N, H, W).
    phase_map
        What they were demodulated to; it says which pixels carry fringes.
    calibration
        The rig, whose phase of the bare plate takes the fringes out of a single frame.
    look
        The plate at its calibration.
    shown
        Pieces of its texture that lie where the capture shows the plate, (T,).

    Notes
    -----
    The phase that was measured must not be used for it: with three frames it leaves the same texture in each.
    """
    if not shown.any():
        return None
    flat = plate_phase(calibration)
    cross, power = (np.zeros((len(frames), *2 * (2 * REACH_PX + 1,))) for _ in range(2))
    for number in np.flatnonzero(shown):
        place = piece_window(look, int(number), phase_map.phase.shape)
        phase = flat(np.arange(place[0].start, place[0].stop), np.arange(place[1].start, place[1].stop))
        phase = np.where(phase_map.reasons[place] == 0, phase, np.nan)
        for k, frame in enumerate(frames):
            one = correlated(texture_of(frame[place].astype(float), phase), look, int(number))
            cross[k] += one[0]
            power[k] += one[1]
    scores = cross / np.sqrt(np.maximum(power, 1e-30))
    places = []
    for score in scores:
        row, column = (int(k) for k in np.unravel_index(int(np.argmax(score)), score.shape))
        if score[row, column] < CLEAR:
            return None
        places.append(summit(score, row, column))
    return _furthest(np.array(places))


def _furthest(places: Array) -> FrameMotion:
    """Return the frame that lies furthest from the median of all: displacements (du, dv, u) px, (N, 3)."""
    away = places[:, :2] - np.median(places[:, :2], axis=0)
    size = np.hypot(*away.T)
    frame = int(np.argmax(size))
    u = float(np.hypot(places[frame, 2], np.median(places[:, 2])))
    return FrameMotion(frame, float(size[frame]), u, float(size[frame] / max(u, 1e-9)))
