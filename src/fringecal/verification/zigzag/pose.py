"""Where the bars stand in the plate frame."""

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from fringecal.verification.zigzag.zigzag_shape import Floats, ZigzagShape, zigzag_height


@dataclass(frozen=True)
class ZigzagPose:
    """Position and direction of a row of bars; there is no scale to fit.

    Parameters
    ----------
    x_mm, y_mm
        Middle of the row of bars on the plate.
    rotation_rad
        Angle of the direction across the ridges against +x, in (-pi/2, pi/2]: 0 for ridges along
        the columns of the picture, pi/2 for ridges along its rows.
    z_mm, tilt_x_rad, tilt_y_rad
        Seating: height and slopes dz/dx, dz/dy under the bars; 0 when they stand on the plate.
    names, covariance
        Fitted numbers ("across_mm", "rotation_rad"[, "z_mm", "tilt_x_rad", "tilt_y_rad"]) and their
        covariance from the scatter of the residuals alone.
    u_along_mm
        Standard uncertainty of the position along the ridges, which only the bars' ends decide.
    residual_sd_mm
        Robust standard deviation of the residuals on the flanks.
    inlier_share
        Share of the valid flank pixels that lie near the target's surface.
    bars_seen
        Number of bars with enough valid pixels to be distinguished from the plate.
    """

    x_mm: float
    y_mm: float
    rotation_rad: float
    z_mm: float = 0.0
    tilt_x_rad: float = 0.0
    tilt_y_rad: float = 0.0
    names: tuple[str, ...] = ()
    covariance: Floats = field(default_factory=lambda: np.zeros((0, 0)))
    u_along_mm: float = math.inf
    residual_sd_mm: float = math.inf
    inlier_share: float = 0.0
    bars_seen: int = 0

    @property
    def rotation_deg(self) -> float:
        """Rotation in degrees."""
        return math.degrees(self.rotation_rad)

    def across_along(self, x: NDArray[np.floating], y: NDArray[np.floating]) -> tuple[Floats, Floats]:
        """Coordinates across and along the ridges, mm, of plate points.

        Examples
        --------
        >>> pose = ZigzagPose(10.0, 0.0, math.pi / 2)
        >>> across, along = pose.across_along(np.array([10.0]), np.array([5.0]))
        >>> across.round(9).tolist(), along.round(9).tolist()
        ([5.0], [0.0])
        """
        c, s = math.cos(self.rotation_rad), math.sin(self.rotation_rad)
        dx, dy = np.asarray(x, float) - self.x_mm, np.asarray(y, float) - self.y_mm
        return c * dx + s * dy, c * dy - s * dx

    def seat_height(self, x: NDArray[np.floating], y: NDArray[np.floating]) -> Floats:
        """Height of the seat under plate points, mm."""
        dx, dy = np.asarray(x, float) - self.x_mm, np.asarray(y, float) - self.y_mm
        return self.z_mm + self.tilt_x_rad * dx + self.tilt_y_rad * dy

    def on_bars(self, x: NDArray[np.floating], y: NDArray[np.floating], shape: ZigzagShape) -> NDArray[np.bool_]:
        """Tell which plate points lie under the bars."""
        across, along = self.across_along(x, y)
        return (np.abs(across) <= shape.count * shape.base_mm / 2) & (np.abs(along) <= shape.length_mm / 2)

    def reference_height(self, x: NDArray[np.floating], y: NDArray[np.floating], shape: ZigzagShape) -> Floats:
        """Height of the target above the plate, mm; NaN beside the bars."""
        height = zigzag_height(self.across_along(x, y)[0], shape) + self.seat_height(x, y)
        return np.where(self.on_bars(x, y, shape), height, np.nan)
