"""A rig of camera and inverse camera: both lenses, how the projector stands to the camera, and how well it is known."""

import math
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from fringecal.camera import LENS_NAMES, Lens
from fringecal.uncertainty import Estimate

Array = NDArray[np.float64]

_LENS = len(LENS_NAMES)
#: Parameters of a `BoardRig` in the order of its vector and covariance.
BOARD_RIG_NAMES = (
    *(f"camera.{name}" for name in LENS_NAMES),
    *(f"projector.{name}" for name in LENS_NAMES),
    *(f"projector.turn_{axis}_rad" for axis in "xyz"),
    *(f"projector.shift_{axis}_mm" for axis in "xyz"),
)


@dataclass(frozen=True)
class BoardRig:
    """Camera and projector as pinholes with Brown's distortion, calibrated by a board in poses.

    A point X, mm, in the camera's frame (x right, y down, z forward from its centre) is lit by the projector's place
    `projector.project(rotation X + shift_mm)`. Pixels are (column, row), 0 at the centre of the first.

    Parameters
    ----------
    camera, projector
        The devices; of the projector `width_px` and `height_px` count its raster, and its two focal lengths differ
        where its pixels are not square.
    rotation
        (3, 3), from the camera's frame to the projector's.
    shift_mm
        (3,), place of the camera's centre in the projector's frame.
    covariance
        (24, 24) of `BOARD_RIG_NAMES`; a turn is a small turn of the projector's frame after `rotation`. A print's
        scale stands in it as what it is: one error of all lengths.
    dof
        Effective degrees of freedom of the covariance.
    camera_rms_px, projector_rms_px
        Root mean square length of the residuals in either picture; of a projector with one axis that of the
        coordinate.
    camera_s_px, projector_s_px
        Standard deviation of one coordinate, from the residuals by their degrees of freedom: median of the poses,
        geometric mean of both axes.
    axes
        Which of the projector's coordinates the data hold: ("u", "v"), ("u",) or ("v",).
    undetermined
        Names of the parameters of which the data tell nothing; their u is what was assumed of them.
    board_names, board_values, board_covariance
        Scale, stretch and warp of the board, as solved for.
    volume_mm
        Points (m, 3) in the camera's frame where boards were.
    """

    camera: Lens
    projector: Lens
    rotation: Array
    shift_mm: Array
    covariance: Array
    dof: float = math.inf
    camera_rms_px: float = 0.0
    projector_rms_px: float = 0.0
    camera_s_px: float = 0.0
    projector_s_px: float = 0.0
    axes: tuple[str, ...] = ("u", "v")
    undetermined: tuple[str, ...] = ()
    board_names: tuple[str, ...] = ()
    board_values: Array = field(default_factory=lambda: np.zeros(0))
    board_covariance: Array = field(default_factory=lambda: np.zeros((0, 0)))
    volume_mm: Array = field(default_factory=lambda: np.zeros((0, 3)))

    @property
    def values(self) -> Array:
        """Values in the order of `BOARD_RIG_NAMES`; the turns are 0, they count from `rotation`."""
        return np.concatenate([self.camera.values, self.projector.values, np.zeros(3), self.shift_mm])

    @property
    def centre_mm(self) -> Array:
        """Place of the projector's centre in the camera's frame, (3,)."""
        return np.asarray(-self.rotation.T @ self.shift_mm)

    @property
    def baseline_mm(self) -> float:
        """Distance of the two centres."""
        return float(np.linalg.norm(self.shift_mm))

    def estimate(self, name: str) -> Estimate:
        """Return one parameter with its standard uncertainty; a turn's value is 0.

        Raises
        ------
        ValueError
            No parameter is called so.
        """
        i = BOARD_RIG_NAMES.index(name)
        unit = next((u for u in ("px", "mm", "rad") if name.endswith(f"_{u}")), "")
        return Estimate(float(self.values[i]), math.sqrt(max(self.covariance[i, i], 0.0)), unit, name, self.dof)

    def moved(self, change: Array) -> "BoardRig":
        """Return the rig with its parameters changed by a vector in the order of `BOARD_RIG_NAMES`."""
        return replace(
            self,
            camera=replace(self.camera, values=self.camera.values + change[:_LENS]),
            projector=replace(self.projector, values=self.projector.values + change[_LENS : 2 * _LENS]),
            rotation=turn_matrix(change[2 * _LENS : 2 * _LENS + 3]) @ self.rotation,
            shift_mm=self.shift_mm + change[2 * _LENS + 3 :],
        )

    def in_projector(self, points_mm: Array) -> Array:
        """Points (n, 3) of the camera's frame in the projector's."""
        return np.asarray(points_mm @ self.rotation.T + self.shift_mm)

    def project(self, points_mm: Array) -> Array:
        """Places of the projector's frame (n, 2), px, that light points (n, 3) of the camera's frame."""
        return self.projector.project(self.in_projector(points_mm))


def turn_matrix(turn_rad: Array) -> Array:
    """Rotation matrices (..., 3, 3) of turns (..., 3) about their own axes (Rodrigues).

    Examples
    --------
    >>> (turn_matrix(np.array([0.0, 0.0, np.pi / 2])) @ [1.0, 0.0, 0.0]).round(6).tolist()
    [0.0, 1.0, 0.0]
    """
    angle = np.linalg.norm(turn_rad, axis=-1)[..., None, None]
    cross = cross_matrix(turn_rad)
    sine, versine = np.sinc(angle / np.pi), np.sinc(angle / (2 * np.pi)) ** 2 / 2
    return np.asarray(np.eye(3) + sine * cross + versine * (cross @ cross))


def cross_matrix(vectors: Array) -> Array:
    """Matrices (..., 3, 3) that multiply as the cross product by vectors (..., 3) does."""
    found = np.zeros((*vectors.shape, 3))
    x, y, z = np.moveaxis(vectors, -1, 0)
    found[..., 0, 1], found[..., 0, 2], found[..., 1, 2] = -z, y, -x
    return found - np.swapaxes(found, -1, -2)
