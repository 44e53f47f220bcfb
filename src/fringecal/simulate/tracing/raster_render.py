"""Draw a capture under a raster projector: frames as its pixels light them, and the truth behind them."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy import ndimage, special

from fringecal.simulate.rig.drawn_camera import Camera
from fringecal.simulate.rig.raster_device import RasterProjector, flat_pose, raster_point, seen_from
from fringecal.simulate.rig.raster_spec import RasterCaptureSpec, RasterRigSpec
from fringecal.simulate.scene.printed_patterns import PatternTable, edge_distance, pattern_table
from fringecal.simulate.scene.scene import Scene
from fringecal.simulate.tracing.compiled import compiled, over_rows
from fringecal.simulate.tracing.ray_kernels import PLATE, World, build_world
from fringecal.simulate.tracing.ray_tracer import (
    BLUR_REACH,
    EDGE_REACH,
    EDGE_SAMPLES,
    INK_EDGE_PX,
    OPTICAL_BLUR_PX,
    aperture,
    lattice,
    texture_tables,
    two_points,
)
from fringecal.simulate.tracing.sensor import exposed
from fringecal.simulate.tracing.shading import Samples, Texture, reflectance, trace_pixel

PER_PIXEL = 8  # samples of a projector pixel's profile: light changes by a thousandth between two of them
LEVELS = 255  # of a projector pixel
ALONG_U, ALONG_V, EVEN = range(3)
DARK = 0.02  # reflectance beyond a sheet: what lies behind it


@dataclass(frozen=True)
class RasterFrames:
    """Frames of one capture and the truth at every pixel's centre.

    Parameters
    ----------
    frames
        Fringes in the order axis, period, step, then white and black; (N, H, W), uint8 or uint16.
    points_mm
        The surface point seen, (3, H, W), mm in the camera's frame.
    projector_px
        Column and row that light it, (2, H, W), px; 0 at the centre of the first.
    lit
        Whether the projector reaches it, (H, W).
    surface
        Number of the face seen, (H, W); 0 is the flat.
    """

    frames: np.ndarray
    points_mm: np.ndarray
    projector_px: np.ndarray
    lit: np.ndarray
    surface: np.ndarray


class _RasterLight(NamedTuple):
    """Profiles (F, n) of the frames along their axes (F,), extents in px, and exposure; lengths in mm."""

    profiles: np.ndarray
    axes: np.ndarray
    extents: tuple[int, int]
    ambient: float
    shading: bool
    irradiance: float
    scale: float
    vignetting: float
    centre_px: tuple[float, float]
    sheet: tuple[float, float]


def render_raster(
    rig: RasterRigSpec, capture: RasterCaptureSpec, scene: Scene, *, seed: int | Sequence[int] = 0, noise: bool = True
) -> RasterFrames:
    """Render one capture.

    Parameters
    ----------
    rig, capture
        The rig, and where its flat is.
    scene
        What is printed on the flat and stands on it.
    seed
        Seeds sensor noise.
    noise
        False leaves out noise and rounding: frames are then float64 grey levels, clipped at the white level.
    """
    camera, projector = seen_from(rig, capture)
    world, table = build_world(scene), pattern_table(scene.pattern)
    shape = (rig.camera.height_px, rig.camera.width_px)
    maps, keys = np.empty((6, *shape)), np.empty(shape, np.int64)
    over_rows(_trace_raster, shape[0], camera, projector, world, table, maps, keys)
    light = _light(rig, capture)
    levels = np.empty((len(light.axes), *shape))
    samples = _samples(rig, capture, keys, maps[5])
    optics = camera, projector, world, table, texture_tables(rig.surface), light, samples
    over_rows(_collect_raster, shape[0], *optics, levels)
    rotation, shift = flat_pose(capture)
    points = np.einsum("ij,jhw->ihw", rotation, maps[:3]) + shift[:, None, None]
    return RasterFrames(exposed(rig, levels, seed, noise=noise), points, maps[3:5], keys % 2 == 1, keys // 2)


def pattern_profiles(rig: RasterRigSpec) -> tuple[np.ndarray, np.ndarray]:
    """Return the light of each frame along its axis, (F, n), `PER_PIXEL` samples a pixel from its edge, and the axes.

    A fringe is rounded to the projector's levels, emitted by its response, and blurred by pixel and lens.
    """
    spec, fringes = rig.projector, rig.fringes
    longest = PER_PIXEL * max(spec.columns, spec.rows)
    steps = np.radians(fringes.steps_deg) + np.radians(fringes.error_deg or (0.0,) * len(fringes.steps_deg))
    zeros = np.radians(np.broadcast_to(fringes.zeros_deg, len(fringes.fringes)))
    rows, axes = [], []
    for name in fringes.axes:
        extent, axis = (spec.columns, ALONG_U) if name == "u" else (spec.rows, ALONG_V)
        way = -1.0 if name in fringes.falling else 1.0
        for count, zero in zip(fringes.fringes, zeros, strict=True):
            for step in steps:
                phase = way * 2 * np.pi * count / extent * np.arange(extent) + zero + step
                rows.append(_profile(rig, 0.5 + 0.5 * fringes.contrast * np.cos(phase), axis, longest))
                axes.append(axis)
    for level in (1.0, 0.0):
        rows.append(np.full(longest, _emitted(rig, np.array(level))))
        axes.append(EVEN)
    return np.array(rows), np.array(axes)


def _emitted(rig: RasterRigSpec, value: np.ndarray) -> np.ndarray:
    """Light of pixels of a share of white, rounded to the projector's levels."""
    spec = rig.projector
    return np.asarray(spec.black + (1 - spec.black) * (np.rint(value * LEVELS) / LEVELS) ** spec.gamma)


def _profile(rig: RasterRigSpec, value: np.ndarray, axis: int, longest: int) -> np.ndarray:
    """Light along an axis: each pixel's square blurred; columns of a diamond raster half here, half a column on."""
    spec = rig.projector
    light = _emitted(rig, value)
    at = (np.arange(PER_PIXEL * light.size) + 0.5) / PER_PIXEL - 0.5
    found = _blurred_squares(light, at, spec.blur_px)
    if spec.diamond and axis == ALONG_U:
        found = (found + _blurred_squares(light, at - 0.5, spec.blur_px)) / 2
    return np.pad(found, (0, longest - found.size), mode="edge")


def _blurred_squares(light: np.ndarray, at: np.ndarray, blur_px: float) -> np.ndarray:
    """Light at coordinates, px: the sum of pixels, each a square of 1 px convolved with a Gaussian."""
    nearest, reach = np.rint(at).astype(int), math.ceil(0.5 + 5 * blur_px)
    total = np.zeros(at.size)
    for offset in range(-reach, reach + 1):
        pixel = nearest + offset
        away = at - pixel
        if blur_px > 0:
            share = special.ndtr((away + 0.5) / blur_px) - special.ndtr((away - 0.5) / blur_px)
        else:
            share = (np.abs(away) < 0.5) + 0.5 * (np.abs(away) == 0.5)  # noqa: PLR2004 -- half a pixel
        total += share * light[np.clip(pixel, 0, light.size - 1)]
    return total


def _light(rig: RasterRigSpec, capture: RasterCaptureSpec) -> _RasterLight:
    profiles, axes = pattern_profiles(rig)
    camera, light, spec = rig.camera, rig.light, rig.projector
    r2 = float(np.sum(np.subtract(spec.aim_mm, spec.position_mm) ** 2))
    sheet = capture.sheet_mm or (math.inf, math.inf)
    return _RasterLight(
        profiles,
        axes,
        (spec.columns, spec.rows),
        light.ambient,
        light.shading,
        1 / r2,
        camera.white_level * light.white_grey ** (1 / camera.gamma),
        camera.vignetting / (math.hypot(camera.width_px, camera.height_px) / 2) ** 2,
        ((camera.width_px - 1) / 2, (camera.height_px - 1) / 2),
        (sheet[0] / 2, sheet[1] / 2),
    )


def _samples(rig: RasterRigSpec, capture: RasterCaptureSpec, keys: np.ndarray, print_mm: np.ndarray) -> Samples:
    """Sample more where an edge may pass, as `ray_tracer.render` does."""
    blur_px = min(rig.camera.defocus_px, OPTICAL_BLUR_PX)
    scale_mm = float(np.linalg.norm(capture.position_mm)) / rig.camera.focal_px
    reach_px = 0.5 + BLUR_REACH * blur_px
    window = 2 * math.ceil(reach_px) + 1
    same = ndimage.minimum_filter(keys, window) == ndimage.maximum_filter(keys, window)
    edges = ~same | (print_mm < EDGE_REACH * math.sqrt(2) * reach_px * scale_mm)
    outer = lattice(EDGE_SAMPLES)
    return Samples(edges, two_points(blur_px), aperture(outer, blur_px), INK_EDGE_PX * scale_mm)


@compiled
def _trace_raster(
    first: int,
    last: int,
    camera: Camera,
    projector: RasterProjector,
    world: World,
    table: PatternTable,
    maps: np.ndarray,
    keys: np.ndarray,
) -> None:
    """Fill truth at pixel centres: x, y, z in the flat's frame, column and row, distance to the next printed edge."""
    for v in range(first, last):
        for u in range(keys.shape[1]):
            (x, y, z), cosine, surface, _, _ = trace_pixel(camera, projector, world, float(u), float(v))
            maps[0, v, u], maps[1, v, u], maps[2, v, u] = x, y, z
            maps[3, v, u], maps[4, v, u] = raster_point(projector, x, y, z)
            maps[5, v, u] = edge_distance(table, x, y) if surface == PLATE else np.inf
            keys[v, u] = 2 * surface + (1 if cosine > 0 else 0)


@compiled
def _collect_raster(
    first: int,
    last: int,
    camera: Camera,
    projector: RasterProjector,
    world: World,
    table: PatternTable,
    texture: Texture,
    light: _RasterLight,
    samples: Samples,
    frames: np.ndarray,
) -> None:
    """Integrate the projector's light over every pixel of some rows; `frames` is (F, H, W), grey levels."""
    sums = np.empty(frames.shape[0])
    for v in range(first, last):
        for u in range(frames.shape[2]):
            points = samples.outer if samples.edges[v, u] else samples.inner
            sums[:] = 0
            for k in range(points.shape[0]):
                su, sv = u + points[k, 0], v + points[k, 1]
                point, cosine, surface, albedo, r2 = trace_pixel(camera, projector, world, su, sv)
                du, dv = su - light.centre_px[0], sv - light.centre_px[1]
                albedo *= reflectance(table, texture, surface, point, samples.soft_mm)
                if surface == PLATE and (abs(point[0]) > light.sheet[0] or abs(point[1]) > light.sheet[1]):
                    albedo = DARK
                albedo *= light.scale * (1 - light.vignetting * (du * du + dv * dv))
                lit = cosine / (r2 * light.irradiance)
                if not light.shading:
                    lit = np.ceil(cosine)
                column, row = raster_point(projector, point[0], point[1], point[2])
                on = -0.5 <= column < light.extents[0] - 0.5 and -0.5 <= row < light.extents[1] - 0.5
                _add_light(light.profiles, light.axes, (column, row), (albedo * lit * on, albedo * light.ambient), sums)
            for n in range(sums.size):
                frames[n, v, u] = sums[n] / points.shape[0]


@compiled
def _add_light(
    profiles: np.ndarray,
    axes: np.ndarray,
    place: tuple[float, float],
    shares: tuple[float, float],
    sums: np.ndarray,
) -> None:
    """Add one sample to every frame; `shares` is what it reflects of the projector's and of ambient light."""
    for n in range(sums.size):
        value = shares[1]
        if shares[0] > 0:
            at = 0.0
            if axes[n] != EVEN:
                at = (place[axes[n]] + 0.5) * PER_PIXEL - 0.5
            at = min(max(at, 0.0), profiles.shape[1] - 1.001)
            i = int(at)
            value += shares[0] * (profiles[n, i] + (at - i) * (profiles[n, i + 1] - profiles[n, i]))
        sums[n] += value
