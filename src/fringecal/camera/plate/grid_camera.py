"""The camera on the plate from one picture of a grid: as many terms of distortion as the picture shows."""

import numpy as np
from scipy import special

from fringecal.camera.distortion.distortion_test import CHANCE
from fringecal.camera.lens.brown_lens import Lens
from fringecal.camera.plate.plate_camera import CAMERA_NAMES
from fringecal.camera.plate.plate_fit import CameraFit, fit_plate_camera
from fringecal.detect import GridDetection
from fringecal.errors import FitError
from fringecal.targets import grid_points_mm
from fringecal.uncertainty import Estimate, Influence

_DISTORTION = (("k1",), ("k1", "k2"), ("k1", "k2", "p1", "p2"))
_MUCH_SMALLER = 0.9  # of the residual's rms, where too few crossings are left for an F-test


def fit_grid_camera(
    detection: GridDetection,
    pitch_mm: Estimate,
    *,
    height_mm: Estimate | None = None,
    telecentric: bool = False,
    lens: Lens | None = None,
) -> CameraFit:
    """Fit the camera to a detected grid, with what is stated of it.

    Terms of distortion beyond k1 are let in one set after the other, while each makes the residual smaller
    than chance would (F-test at 0.1 %).

    Parameters
    ----------
    detection
        The grid found in the picture.
    pitch_mm
        Distance of neighbouring lines, mm.
    height_mm, telecentric, lens
        What is known of the camera, as in `fit_plate_camera`.

    Raises
    ------
    FitError
        The grid does not determine the camera.
    """
    points_mm = np.column_stack(grid_points_mm(detection.column, detection.row, pitch_mm.value))

    def solve(distortion: tuple[str, ...]) -> CameraFit:
        return fit_plate_camera(
            np.column_stack([detection.u_px, detection.v_px]),
            points_mm,
            detection.shape,
            pitch_rel_u=pitch_mm.u / pitch_mm.value,
            sigma_px=detection.sigma_px,
            height_mm=height_mm,
            telecentric=telecentric,
            lens=lens,
            distortion=distortion,
            index=(detection.row, detection.column),
            scatter=detection.scatter,
        )

    best = solve(_DISTORTION[0])
    if lens is not None:
        return best
    for terms in _DISTORTION[1:]:
        try:
            richer = solve(terms)
        except FitError:  # a long lens shows the grid too flat for these terms: they are not there to be seen
            break
        if not _explains_more(best, richer):
            break
        best = richer
    return best


def camera_height(fit: CameraFit) -> Estimate:
    """Height of the entrance pupil above the plate, mm, as fitted."""
    place = CAMERA_NAMES.index("height_mm")
    u = float(np.sqrt(fit.camera.covariance[place, place]))
    return Estimate(fit.camera["height_mm"], u, "mm", dof=fit.dof, influence=Influence.CAMERA_HEIGHT)


def _explains_more(plain: CameraFit, richer: CameraFit) -> bool:
    """Return whether the richer fit's residual is smaller than its further terms explain by chance.

    A sheet whose lines bend counts as a residual: what a richer lens explains need not be put on the sheet.
    """
    if richer.dof < 1 or plain.dof <= richer.dof:
        return richer.dof >= 1 and richer.rms_px < _MUCH_SMALLER * plain.rms_px
    variance = richer.rms_px**2 + 1e-300
    squares = [fit.rms_px**2 / variance * fit.dof + fit.strain for fit in (plain, richer)]
    added = plain.dof - richer.dof
    return bool(special.fdtrc(added, richer.dof, max(squares[0] - squares[1], 0.0) / added) < CHANCE)
