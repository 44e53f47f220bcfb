"""The thesis's own simulation: three cosine images of a rectangle and of a zig-zag, by formula alone.

Section 4.2 of the thesis drew fringes as a collimated projector and a camera straight above would see
them: a height z shifts the fringe across by z tan(angle). No lens, no shadow, no noise.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from fringecal.errors import FringecalError

# Amplitude of the thesis's images: fringes span all of 8 bits.
AMPLITUDE = 127.5
BACKGROUND_SHARE = 0.25  # of the columns beside the zig-zag, both sides together
THIRDS_RAD = (0.0, 2 * np.pi / 3, 4 * np.pi / 3)


@dataclass(frozen=True)
class AnalyticImages:
    """Three (or more) cosine images and the surface that they show.

    Parameters
    ----------
    frames
        Shape (N, H, W), float64, 0 to 255 grey levels.
    z_px
        Shape (H, W): height in px.
    phase
        Shape (H, W): unwrapped phase in rad.
    """

    frames: np.ndarray
    z_px: np.ndarray
    phase: np.ndarray


def rectangle_px(shape: tuple[int, int], *, height_px: float = 40.0) -> np.ndarray:
    """Heights of a rectangle in the middle half of the picture, on a background of 0."""
    rows, columns = (np.abs(np.arange(n) - (n - 1) / 2) <= n / 4 for n in shape)
    return height_px * np.outer(rows, columns)


def zigzag_px(shape: tuple[int, int], *, period_px: float = 80.0, apex_deg: float = 90.0) -> np.ndarray:
    """Heights of a zig-zag whose ridges run along the columns, on a background of 0.

    It fills the middle half of the rows and as many whole periods as fit three quarters of the columns.
    """
    n_rows, n_columns = shape
    x = np.arange(n_columns) - (n_columns - 1) / 2
    n_bars = int((1 - BACKGROUND_SHARE) * n_columns / period_px)
    if n_bars < 1:
        raise FringecalError(f"a zig-zag of period {period_px:g} px does not fit a picture {n_columns} px wide")
    slope = 1 / np.tan(np.radians(apex_deg) / 2)
    from_foot = (x + n_bars * period_px / 2) % period_px
    profile = slope * np.minimum(from_foot, period_px - from_foot)
    profile[np.abs(x) > n_bars * period_px / 2] = 0.0
    rows = np.abs(np.arange(n_rows) - (n_rows - 1) / 2) <= n_rows / 4
    return np.outer(rows, profile)


def analytic_images(
    z_px: np.ndarray,
    *,
    angle_deg: float,
    pitch_px: float = 20.0,
    phase_shifts_rad: Sequence[float] = THIRDS_RAD,
) -> AnalyticImages:
    """Draw the cosine images of a surface under collimated fringes that run along the rows.

    Parameters
    ----------
    z_px
        Shape (H, W): heights in px.
    angle_deg
        Projection angle from the plate's normal; the thesis drew 45 and 50.7 deg.
    pitch_px
        Period of the fringes on the background, along the columns.
    phase_shifts_rad
        Phase shifts.

    Returns
    -------
    AnalyticImages
        ``I_n = 127.5 (1 + cos(phi + delta_n))`` with ``phi = 2 pi (y - z tan(angle)) / pitch``, y
        upward in the picture: the light comes from above, phase rises toward it.

    Examples
    --------
    >>> images = analytic_images(rectangle_px((200, 200)), angle_deg=45.0)
    >>> shift = images.phase[100, 0] - images.phase[100, 100]
    >>> round(float(shift * 20.0 / (2 * np.pi)), 6)
    40.0
    """
    if not 0 <= angle_deg < 90:
        raise FringecalError(f"angle {angle_deg:g} deg: needs 0 <= angle < 90, from the plate's normal")
    z = np.asarray(z_px, float)
    y = (z.shape[0] - 1) / 2 - np.arange(z.shape[0])[:, None]
    phase = 2 * np.pi / pitch_px * (y - z * np.tan(np.radians(angle_deg)))
    steps = np.asarray(phase_shifts_rad, float)[:, None, None]
    return AnalyticImages(AMPLITUDE * (1 + np.cos(phase + steps)), z, phase)
