"""Artefacts as data: what they are, where their points and surfaces lie in mm, and sheets to print them."""

from fringecal.targets.library import list_targets, load_target, parse_target
from fringecal.targets.models import (
    BallBar,
    Box,
    Charuco,
    Chessboard,
    Dots,
    Flat,
    LineGrid,
    Sphere,
    Steps,
    Strips,
    Target,
    Wedge,
    Zigzag,
)
from fringecal.targets.quantity import Quantity, Scalar

__all__ = [
    "BallBar",
    "Box",
    "Charuco",
    "Chessboard",
    "Dots",
    "Flat",
    "LineGrid",
    "Quantity",
    "Scalar",
    "Sphere",
    "Steps",
    "Strips",
    "Target",
    "Wedge",
    "Zigzag",
    "list_targets",
    "load_target",
    "parse_target",
]
