"""What a board in one pose shows: its points in mm, in the camera's picture and in the projector's frame."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fringecal.errors import FitError

Array = NDArray[np.float64]

MIN_POSE_POINTS = 6
"""Points of a pose: twelve coordinates in one picture for the six numbers of its place."""


@dataclass(frozen=True)
class BoardPose:
    """The points of a board in one pose, as both devices have them.

    Parameters
    ----------
    board_mm
        Points on the board (n, 3), mm, in one frame for all poses; z = 0 on a flat board, y down its rows.
    camera_px
        Where the camera sees them (n, 2), px; NaN where it does not.
    projector_px
        Which place of the projector's frame lights them (n, 2), px: column u, row v. NaN where it is not known; a
        projector with fringes along one axis has NaN in the whole of the other column.
    camera_u_px, projector_u_px
        Standard uncertainty of a coordinate, px: one number for all, or (n,), or (n, 2). NaN: not known, found from
        the residuals, alike for all points of the rig.
    read_at_camera
        True where the projector's coordinates were read from the phase at `camera_px`, so that an error of the
        corner in the picture moves both; False where the two lists were found apart.
    name
        What to call the pose in messages.
    """

    board_mm: Array
    camera_px: Array
    projector_px: Array
    camera_u_px: float | Array = math.nan
    projector_u_px: float | Array = math.nan
    read_at_camera: bool = True
    name: str = ""

    def __post_init__(self) -> None:
        n = len(self.board_mm)
        shapes = (self.board_mm.shape, self.camera_px.shape, self.projector_px.shape)
        if shapes != ((n, 3), (n, 2), (n, 2)):
            raise FitError(f"a pose's points have the shapes {shapes}; (n, 3), (n, 2), (n, 2) are needed")

    @property
    def in_camera(self) -> NDArray[np.bool_]:
        """Where the camera sees a point, (n,)."""
        return np.isfinite(self.camera_px).all(axis=1)

    @property
    def in_projector(self) -> NDArray[np.bool_]:
        """Which coordinates of the projector are known, (n, 2)."""
        return np.isfinite(self.projector_px)


@dataclass(frozen=True)
class BoardStatement:
    """What is known of the board beside its points.

    Parameters
    ----------
    pitch_u_rel
        Relative standard uncertainty of all its lengths together (the print's scale): no data tell it.
    stretch_u_rel
        Relative standard uncertainty of its lengths along x over those along y, as of paper or a printer's feed.
    flatness_u_mm
        Standard deviation of its surface about its best plane, of which no more is known; NaN: not stated, a warp of
        second order is then solved for without any expectation.
    """

    pitch_u_rel: float = 0.0
    stretch_u_rel: float = 0.0
    flatness_u_mm: float = math.nan
