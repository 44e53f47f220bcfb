"""What an audit compares, as one vector: camera on the plate, plate phase, phase difference of strips, sharpness."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.polynomial import legendre
from numpy.typing import NDArray

from fringecal.camera import PlateCamera
from fringecal.numerics import products_up_to
from fringecal.projector import RigState, fringe_pitch_mm, pick_points

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

BLOCK_PX = 24  # side of the blocks that are averaged: noise goes, changes longer than two blocks stay
_LEAST_SHARE = 0.1  # of a block's pixels; a mean of fewer is noise
PLATE_DEGREE = 3  # of the plate's change: what moves of camera, projector and plate do to it over the picture
STRIPS_DEGREE = (
    1  # of the strips': they cover too little of the picture to separate a curvature from one strip of another height
)
STRIPS_TERMS = 3  # of degree 1 over the picture
_INNER = 3  # the corner's distortion is counted against the radius that is this part of its own
_PIXELS = 200_000  # of a map that are fitted; noise of 0.02 rad leaves less than 1e-4
CAMERA_QUANTITIES = ("horizontal scale", "vertical scale", "tilt toward x", "tilt toward y", "distortion")


@dataclass(frozen=True)
class Blocks:
    """Means of a map over blocks of a picture: centres of the pixels used (px), values, and how many pixels."""

    u_px: Array
    v_px: Array
    value: Array
    pixels: NDArray[np.intp]
    shape: tuple[int, int]

    def design(self, degree: int) -> Array:
        """Return Legendre terms of total degree `degree` over the picture at the centres, the constant first."""
        return legendre_terms(self.u_px, self.v_px, self.shape, degree)


def legendre_terms(u_px: Array, v_px: Array, shape: tuple[int, int], degree: int) -> Array:
    """Return Legendre terms of total degree `degree` over a picture of a shape at pixels, (n, terms)."""
    s, t = 2 * u_px / max(shape[1] - 1, 1) - 1, 2 * v_px / max(shape[0] - 1, 1) - 1
    return products_up_to(legendre.legvander(s, degree), legendre.legvander(t, degree))


def terms_of_map(values: Array, degree: int) -> Array:
    """Fit the terms to a map, (H, W), NaN where unknown.

    To single pixels, drawn at random, and not to means over blocks: a ripple at the fringes' own period would beat
    with the raster of blocks, and the beat looks like a smooth change.
    """
    u, v, _ = pick_points(np.isfinite(values), _PIXELS)
    design = legendre_terms(u, v, (values.shape[0], values.shape[1]), degree)
    return np.asarray(np.linalg.lstsq(design, values[v.astype(int), u.astype(int)], rcond=None)[0])


def block_means(values: Array, valid: Mask) -> Blocks:
    """Average a map over blocks of the picture, leaving out those that show next to nothing.

    Parameters
    ----------
    values, valid
        Map and mask, (H, W).
    """
    v, u = np.nonzero(valid)
    across = -(-values.shape[1] // BLOCK_PX)
    block = (v // BLOCK_PX) * across + u // BLOCK_PX
    number = np.bincount(block)
    enough = np.flatnonzero(number >= _LEAST_SHARE * BLOCK_PX**2)

    def mean(of: Array) -> Array:
        return np.asarray(np.bincount(block, weights=of)[enough] / number[enough])

    height, width = values.shape
    return Blocks(mean(u.astype(float)), mean(v.astype(float)), mean(values[v, u]), number[enough], (height, width))


@dataclass(frozen=True)
class StripBlocks:
    """Strip tops of one capture: blocks of their phase difference to the plate, and the stated height at each, (n,)."""

    blocks: Blocks
    height_mm: Array


@dataclass(frozen=True)
class Layout:
    """Which quantities an audit has, and how a rig predicts them.

    Parameters
    ----------
    grid
        Whether the camera on the plate was measured anew.
    plate
        Blocks of the bare plate; None where there is none.
    strips
        Strip tops, one capture of strips after the other.
    blur_px
        Blur of the grid's lines at the calibration, None where it is not compared.
    contrast
        Whether the contrast of the fringes is compared.
    """

    grid: bool
    plate: Blocks | None
    strips: tuple[StripBlocks, ...]
    blur_px: float | None
    contrast: bool

    @property
    def parts(self) -> dict[str, slice]:
        """Place of each part in the vector."""
        sizes = {
            "camera": len(CAMERA_QUANTITIES) if self.grid else 0,
            "plate": 0 if self.plate is None else self.plate.design(PLATE_DEGREE).shape[1] - 1,
            "strips": STRIPS_TERMS * len(self.strips),
            "blur": 0 if self.blur_px is None else 1,
            "contrast": int(self.contrast),
        }
        ends = np.cumsum(list(sizes.values()))
        return {name: slice(int(end) - size, int(end)) for (name, size), end in zip(sizes.items(), ends, strict=True)}

    @property
    def strip_parts(self) -> tuple[slice, ...]:
        """Place of each capture of strips in the vector."""
        start = self.parts["strips"].start
        return tuple(slice(start + STRIPS_TERMS * k, start + STRIPS_TERMS * (k + 1)) for k in range(len(self.strips)))

    def predict(self, state: RigState) -> Array:
        """Return the vector that a rig shows: camera, plate (rad), strips (rad), blur (px), log of the contrast."""
        parts = [camera_quantities(state.camera)] if self.grid else []
        if self.plate is not None:
            parts.append(coefficients(self.plate, plate_phase(state, self.plate), PLATE_DEGREE)[1:])
        for number, strips in enumerate(self.strips):
            step = strip_step(state, strips, number)
            parts.append(coefficients(strips.blocks, step, STRIPS_DEGREE))
        if self.blur_px is not None:
            parts.append(np.array([math.sqrt(max(self.blur_px**2 + state.camera_blur_px2, 0.0))]))
        if self.contrast:
            parts.append(np.array([_log_contrast(state)]))
        return np.concatenate(parts)


def coefficients(blocks: Blocks, values: Array, degree: int) -> Array:
    """Fit the terms of `Blocks.design` to values at the blocks."""
    return np.asarray(np.linalg.lstsq(blocks.design(degree), values, rcond=None)[0])


def plate_phase(state: RigState, blocks: Blocks) -> Array:
    """Return the phase that a rig shows on its plate at the blocks, rad."""
    rays = state.camera.rays(blocks.u_px, blocks.v_px)
    return state.model.phase(rays.ax, rays.ay, 0.0)


def strip_step(state: RigState, strips: StripBlocks, number: int = 0) -> Array:
    """Return the phase of the strips of a capture over that of the plate behind them at the blocks, rad."""
    rays = state.camera.rays(strips.blocks.u_px, strips.blocks.v_px)
    z = state.strip_scale * state.set_scales.get(number, 1.0) * strips.height_mm
    return np.asarray(state.model.phase(*rays.at(z), z) - state.model.phase(rays.ax, rays.ay, 0.0))


def camera_quantities(camera: PlateCamera) -> Array:
    """Return log scales, tilts (rad) and what distortion does to the picture's corner (px)."""
    scales = [math.log(camera.scale(name).value) for name in ("horizontal", "vertical")]
    return np.array([*scales, camera["tilt_x_rad"], camera["tilt_y_rad"], corner_displacement_px(camera)])


def corner_displacement_px(camera: PlateCamera) -> float:
    """Return by how many px the radial terms push the picture's corner outward, against its own middle third.

    A change of scale is no distortion: what the terms do at a third of the half diagonal is taken off in proportion.
    """
    radius = math.hypot(camera.width_px, camera.height_px) / 2 / camera.focal_px
    k1, k2, k3 = (camera[name] for name in ("k1", "k2", "k3"))

    def push(r2: float) -> float:
        return r2 * (k1 + r2 * (k2 + r2 * k3))

    return camera.focal_px * radius * (push(radius**2) - push((radius / _INNER) ** 2))


def _log_contrast(state: RigState) -> float:
    """Return what blur does to the logarithm of the contrast: -2 pi^2 s^2 / p^2 for a Gaussian of sd s at pitch p."""
    variance = state.camera_blur_px2 * state.camera["scale_mm_per_px"] ** 2 + state.fringe_blur_mm2
    return -2 * math.pi**2 * variance / float(fringe_pitch_mm(state.model)) ** 2
