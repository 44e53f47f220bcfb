"""A camera and a projector as inverse camera, as someone states them: both lenses, and how they stand to each other."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from fringecal.camera import LENS_NAMES, Lens
from fringecal.projector.board_rig.rig_value import BOARD_RIG_NAMES, BoardRig

Array = NDArray[np.float64]

_PARALLEL = 1e-12  # of a triangulation's determinant: rays that meet nowhere


@dataclass(frozen=True)
class StatedPair:
    """A calibration that another program made.

    A point X, mm, of the camera's frame (x right, y down, z forward) is lit by the projector's place
    `projector.project(rotation X + shift_mm)`; that is OpenCV's `stereoCalibrate` with the camera first.

    Parameters
    ----------
    camera, projector
        Lenses with their covariance, where the file states one; `width_px`, `height_px` of the projector count its
        raster.
    rotation, shift_mm
        From the camera's frame to the projector's, (3, 3) and (3,).
    kind
        Whose format the file has.
    errors_px
        Reprojection errors that the file states, px, by "camera", "projector" and "pair".
    valid_px
        Closed contours (n, 2), px, inside which the file says that a lens holds, by "camera" and "projector".
    notes
        What a reader should know of how the file was taken.
    """

    camera: Lens
    projector: Lens
    rotation: Array
    shift_mm: Array
    kind: str = ""
    errors_px: Mapping[str, float] = field(default_factory=dict)
    valid_px: Mapping[str, Array] = field(default_factory=dict)
    notes: tuple[str, ...] = ()

    @property
    def baseline_mm(self) -> float:
        """Distance of the two centres."""
        return float(np.linalg.norm(self.shift_mm))

    @property
    def centre_mm(self) -> Array:
        """Centre of the projector in the camera's frame, (3,)."""
        return np.asarray(-self.rotation.T @ self.shift_mm)

    def reversed(self) -> "StatedPair":
        """Return the pair with its pose read the other way round: as leading from the projector to the camera."""
        return StatedPair(self.camera, self.projector, self.rotation.T, self.centre_mm, self.kind)

    def rig(self) -> BoardRig:
        """Return the pair as a rig to measure with; the devices' pose counts as exact."""
        n = len(LENS_NAMES)
        covariance = np.zeros((len(BOARD_RIG_NAMES),) * 2)
        covariance[:n, :n], covariance[n : 2 * n, n : 2 * n] = self.camera.covariance, self.projector.covariance
        return BoardRig(self.camera, self.projector, self.rotation, self.shift_mm, covariance)

    def light(self, points_mm: Array) -> Array:
        """Places of the projector's frame (n, 2), px, that light points (n, 3) of the camera's frame; NaN behind it."""
        there = points_mm @ self.rotation.T + self.shift_mm
        there[there[:, 2] <= 0] = np.nan
        return self.projector.project(there)

    def meet(self, camera_px: Array, projector_px: Array) -> Array:
        """Points (n, 3) of the camera's frame, mm, nearest to both rays of pairs of places (n, 2), px.

        NaN where a lens sees no ray there, or the rays are parallel. For judging; it weighs both rays alike.
        """
        ray = self.camera.unproject(camera_px)
        light = self.projector.unproject(projector_px) @ self.rotation
        aa, bb, ab = ((p * q).sum(axis=1) for p, q in ((ray, ray), (light, light), (ray, light)))
        away_a, away_b = ray @ self.centre_mm, light @ self.centre_mm
        free = aa * bb - ab * ab
        with np.errstate(divide="ignore", invalid="ignore"):
            along = (away_a * bb - away_b * ab) / np.where(free > _PARALLEL * aa * bb, free, np.nan)
            back = (along * ab - away_b) / bb
        return (along[:, None] * ray + self.centre_mm + back[:, None] * light) / 2


def stated_from_rig(rig: BoardRig, kind: str = "fringecal") -> StatedPair:
    """Return a calibrated rig as others are told of it: lenses with their covariance, pose, and its residuals."""
    errors = {"camera": rig.camera_rms_px, "projector": rig.projector_rms_px}
    return StatedPair(rig.camera, rig.projector, rig.rotation, rig.shift_mm, kind, errors)
