"""A living leaf with pleats, lying on the plate: outline, folds that fan out, veins."""

from dataclasses import dataclass

import numpy as np

from fringecal.simulate.scene.scene import HeightField, Scene

# Reflectance of a leaf's blade and veins relative to the white plate.
BLADE, VEIN = 0.55, 0.75
RIM = 0.3  # share of the way from the outline to the middle over which the leaf rises
SHARPNESS = (1e-6, 0.999)  # limits: 0 and 1 themselves divide by 0
# Half widths of veins: on the ridges, in pleats; of the midrib, mm; of side veins, in their spacing (mm), with their
# slope and brightness.
RIDGE_VEIN, MIDRIB_MM, SIDE_VEIN, SIDE_SPACING_MM, SIDE_SLOPE, SIDE_SHARE = 0.03, 1.2, 0.04, 14, 0.6, 0.6


@dataclass(frozen=True)
class Leaf:
    """Shape of a pleated leaf; lengths in mm, its midrib along y.

    Parameters
    ----------
    length_mm, width_mm
        Axes of its elliptical outline.
    pleat_mm
        Spacing of the pleats across the middle of the leaf.
    depth_mm
        From the valleys to the ridges of the pleats.
    lift_mm
        Height of the valleys above the plate in the middle of the leaf.
    fan
        Relative narrowing of the pleats from the middle to either tip; 0 keeps them parallel.
    sharpness
        0 for sinusoidal pleats; toward 1 the folds grow sharp and their flanks straight.
    """

    length_mm: float = 320.0
    width_mm: float = 240.0
    pleat_mm: float = 25.0
    depth_mm: float = 8.0
    lift_mm: float = 3.0
    fan: float = 0.35
    sharpness: float = 0.5


def leaf_scene(leaf: Leaf | None = None, *, step_mm: float = 0.25) -> Scene:
    """Lay a leaf on the plate, its edge touching so that phase is continuous all around it.

    Parameters
    ----------
    leaf
        Its shape; the default fits the field of the thesis's rig.
    step_mm
        Distance of the nodes of its height field.
    """
    leaf = leaf or Leaf()
    half = (np.array([leaf.width_mm, leaf.length_mm]) / 2 / step_mm).astype(int) + 2
    x, y = np.meshgrid(*(np.arange(-n, n + 1) * step_mm for n in half))
    envelope = _envelope(leaf, x, y)
    position = _pleat_position(leaf, x, y)
    z = envelope * (leaf.lift_mm + leaf.depth_mm * _fold(position, leaf.sharpness))
    albedo = np.where(envelope > 0, _albedo(position, x, y), 1.0)
    return Scene(height_field=HeightField(z, step_mm, albedo))


def _envelope(leaf: Leaf, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """One inside the leaf, falling to zero at its outline with no slope at either end."""
    rho = np.hypot(2 * x / leaf.width_mm, 2 * y / leaf.length_mm)
    t = np.clip((1 - rho) / RIM, 0, 1)
    return t * t * (3 - 2 * t)


def _pleat_position(leaf: Leaf, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Count pleats from the midrib; lines of whole number are the ridges."""
    narrowing = 1 - leaf.fan * (2 * y / leaf.length_mm) ** 2
    return x / (leaf.pleat_mm * narrowing)


def _fold(position: np.ndarray, sharpness: float) -> np.ndarray:
    """Height of the folds from 0 in the valleys to 1 on the ridges.

    The arc sine of ``s sin`` over that of s is a sine for s -> 0 and a triangle for s = 1.
    """
    s = min(max(sharpness, SHARPNESS[0]), SHARPNESS[1])
    return 0.5 + 0.5 * np.arcsin(s * np.cos(2 * np.pi * position)) / np.arcsin(s)


def _albedo(position: np.ndarray, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    on_ridge = np.exp(-(((position - np.round(position)) / RIDGE_VEIN) ** 2))
    midrib = np.exp(-((x / MIDRIB_MM) ** 2))
    place = (np.abs(x) * SIDE_SLOPE - y) / SIDE_SPACING_MM % 1 - 0.5
    side_veins = np.exp(-((place / SIDE_VEIN) ** 2))
    return BLADE + (VEIN - BLADE) * np.maximum(np.maximum(on_ridge, midrib), SIDE_SHARE * side_veins)
