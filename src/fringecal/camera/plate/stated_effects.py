"""What a fitted camera becomes if pitch, height or focal length are stated otherwise, to first order."""

import numpy as np
from numpy.typing import NDArray

from fringecal.camera.plate.plate_camera import CAMERA_NAMES
from fringecal.camera.plate.plate_fit import CameraFit
from fringecal.uncertainty import Estimate, Influence

Array = NDArray[np.float64]

_SCALE, _HEIGHT = CAMERA_NAMES.index("scale_mm_per_px"), CAMERA_NAMES.index("height_mm")


def effects_of_statements(fit: CameraFit, height_mm: Estimate | None, *, lens: bool) -> dict[Influence, Array]:
    """Return the change of a camera's parameters over the relative error of each statement.

    A longer pitch makes everything larger, the camera's height with it; what is stated of the height pulls it back,
    with all that goes with the height (tilt, distortion), by its share of the height's weight. The other share is the
    lens's: pitch and focal length give the height as well.

    Parameters
    ----------
    fit
        The camera, fitted to a grid.
    height_mm
        Its height as stated or assumed; None where it is not.
    lens
        Whether its lens is stated.

    Returns
    -------
    effects
        By source: pitch of the grid and, for a pinhole, height and focal length, where stated; in the order of
        `CAMERA_NAMES`.
    """
    camera = fit.camera
    larger = np.zeros(len(CAMERA_NAMES))
    larger[_SCALE] = camera.parameters[_SCALE]
    if camera.telecentric:
        return {Influence.GRID_PITCH: larger}
    larger[_HEIGHT] = camera.parameters[_HEIGHT]
    higher = _with_the_height(fit) * camera.parameters[_HEIGHT]
    share = _share(fit, height_mm, lens=lens)
    effects = {Influence.GRID_PITCH: larger - share * higher}
    if height_mm is not None:
        effects[Influence.CAMERA_HEIGHT] = share * higher
    if lens:
        effects[Influence.LENS] = (1 - share) * higher
    return effects


def _with_the_height(fit: CameraFit) -> Array:
    """Change of all parameters as the height changes by 1 mm: their regression on it."""
    covariance = fit.camera.covariance
    if covariance[_HEIGHT, _HEIGHT] > 0:
        return np.asarray(covariance[:, _HEIGHT] / covariance[_HEIGHT, _HEIGHT])
    return np.asarray(np.eye(len(CAMERA_NAMES))[_HEIGHT])


def _share(fit: CameraFit, height_mm: Estimate | None, *, lens: bool) -> float:
    """Share of the height's weight that what is stated of it has; the lens has the rest."""
    if height_mm is None or not lens:
        return float(height_mm is not None)
    if height_mm.u == 0:
        return 1.0
    return float(np.clip(fit.camera.covariance[_HEIGHT, _HEIGHT] / height_mm.u**2, 0.0, 1.0))
