"""What can be wrong with the captures of a board rig, by name."""

import enum
import math
from dataclasses import dataclass


class RigFaultKind(enum.Enum):
    """What can be wrong with the captures of a board rig; the value names it in files."""

    STRETCHED_PRINT = "stretched print"
    FRAME_SCALED = "frame scaled or keystoned"
    PICTURE_SCALED = "picture scaled"
    FOCUS_CHANGED = "focus changed between poses"
    RIG_MOVED = "camera or projector moved"
    AXES_EXCHANGED = "axes exchanged"
    NUMBERED_OTHERWISE = "points numbered otherwise"
    POSE_DISAGREES = "pose disagrees"
    POSE_SCATTERS = "pose scatters"
    POSES_TOO_FEW = "poses too few"
    POSES_ALIKE = "poses too alike"


@dataclass(frozen=True)
class RigFault:
    """One fault.

    Parameters
    ----------
    kind
        Which.
    message
        What was found, and what to do.
    poses
        Names of the poses concerned; empty where all are.
    size
        Stretch or aspect (relative), skew (rad), change of focus (relative), or relative u of a focal length.
    """

    kind: RigFaultKind
    message: str
    poses: tuple[str, ...] = ()
    size: float = math.nan
