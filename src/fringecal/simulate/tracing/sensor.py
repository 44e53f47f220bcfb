"""What the camera makes of light: response, noise, grey levels; and the lamp's flicker."""

from collections.abc import Sequence

import numpy as np

from fringecal.simulate.rig.raster_spec import RasterRigSpec
from fringecal.simulate.rig.rig_spec import RigSpec

LAMP_STREAM, SENSOR_STREAM = 1, 2


def stream(seed: int | Sequence[int], *keys: int) -> np.random.Generator:
    """Return an independent random stream for a seed and further whole numbers."""
    entropy = [seed] if isinstance(seed, int) else list(seed)
    return np.random.Generator(np.random.Philox(np.random.SeedSequence([*entropy, *keys])))


def lamp_factors(rig: RigSpec, seed: int | Sequence[int], n_frames: int, *, noise: bool = True) -> np.ndarray:
    """Relative brightness of the lamp in each frame, shape (n_frames,)."""
    if not noise or rig.light.flicker == 0:
        return np.ones(n_frames)
    return 1 + rig.light.flicker * stream(seed, LAMP_STREAM).standard_normal(n_frames)


def exposed(
    rig: RigSpec | RasterRigSpec, levels: np.ndarray, seed: int | Sequence[int], *, noise: bool = True
) -> np.ndarray:
    """Turn linear light into grey levels.

    Parameters
    ----------
    levels
        Shape (N, H, W): grey levels on a linear, noise-free, unbounded sensor.
    seed
        Each frame draws from a stream of its own.
    noise
        False leaves out noise and rounding and returns float64.

    Returns
    -------
    frames
        ``white (level / white)^gamma + noise``, noise of variance ``read^2 + gain grey``, rounded and
        clipped to the sensor's range.
    """
    white = rig.camera.white_level
    grey = levels if rig.camera.gamma == 1 else white * np.maximum(levels / white, 0) ** rig.camera.gamma
    if not noise:
        return np.minimum(grey, white)
    # A saturated pixel holds a full well: shot noise is drawn before the clip, as in the sensor.
    dtype = np.uint8 if rig.camera.bits == 8 else np.uint16
    frames = np.empty(grey.shape, dtype)
    for n, frame in enumerate(grey):
        deviation = np.sqrt(rig.noise.read_levels**2 + rig.noise.gain * np.maximum(frame, 0))
        noisy = frame + deviation * stream(seed, SENSOR_STREAM, n).standard_normal(frame.shape)
        frames[n] = np.clip(np.rint(noisy), 0, white).astype(dtype)
    return frames
