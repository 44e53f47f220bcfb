"""A measured surface against its target: registration and error tables."""

from fringecal.verify.errors import ZigzagErrors, zigzag_errors
from fringecal.verify.filters import FILTERS, filter_study, filtered, models_table, ranking_table
from fringecal.verify.pose import ZigzagPose
from fringecal.verify.profiles import ProfileCurve, ProfileErrors
from fringecal.verify.registration import register_zigzag
from fringecal.verify.shape import ZigzagShape, zigzag_shape

__all__ = [
    "FILTERS",
    "ProfileCurve",
    "ProfileErrors",
    "ZigzagErrors",
    "ZigzagPose",
    "ZigzagShape",
    "filter_study",
    "filtered",
    "models_table",
    "ranking_table",
    "register_zigzag",
    "zigzag_errors",
    "zigzag_shape",
]
