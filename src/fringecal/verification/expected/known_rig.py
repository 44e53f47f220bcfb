"""What is asked of a calibrated rig here: lines of sight, and the phase of points in space."""

from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


class Sight(Protocol):
    """Lines of sight `x = ax + bx z`, `y = ay + by z`, mm; `fringecal.camera.Rays` are some."""

    @property
    def ax(self) -> Floats: ...  # noqa: D102
    @property
    def ay(self) -> Floats: ...  # noqa: D102
    @property
    def bx(self) -> Floats: ...  # noqa: D102
    @property
    def by(self) -> Floats: ...  # noqa: D102


class KnownRig(Protocol):
    """A calibrated rig; `fringecal.projector.RigCalibration` is one.

    `camera` has `rays`, `project` and the picture's size, `model` has `phase` of points in mm.
    """

    @property
    def camera(self) -> Any: ...  # noqa: ANN401, D102
    @property
    def model(self) -> Any: ...  # noqa: ANN401, D102
