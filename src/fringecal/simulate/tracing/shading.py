"""From surfaces to light: what each pixel collects from plate, projector and room."""

from typing import NamedTuple

import numpy as np

from fringecal.simulate.rig.drawn_camera import Camera, ray
from fringecal.simulate.rig.drawn_projector import Projector, phase_at
from fringecal.simulate.rig.raster_device import RasterProjector
from fringecal.simulate.scene.printed_patterns import PatternTable, edge_distance, ink_share
from fringecal.simulate.tracing.compiled import compiled
from fringecal.simulate.tracing.ray_kernels import PLATE, Triple, World, bilinear, see, shadowed

type Pair = tuple[float, float]

# Offsets in mm between the textures of different surfaces: no whole multiple of common cell sizes.
TEXTURE_SHIFT = (17.31, 5.73)


class Light(NamedTuple):
    """Light and exposure, ready for tracing.

    Parameters
    ----------
    harmonics
        Cosine series of the projected light, mean 1.
    steps
        Shape (N, 4): per frame the step at the image centre in rad, its change per px along u and v,
        and the lamp's relative brightness.
    ambient
        Relative to projected light, which is 1 at the plate's origin in the middle of a fringe.
    irradiance
        Cosine over squared distance there, 1/mm^2; without `shading` every lit point receives 1.
    scale
        Grey levels for light 1 on a linear sensor.
    gradient
        Relative change of room light per px along u and v.
    vignetting
        Loss per squared px from the image centre.
    """

    harmonics: np.ndarray
    steps: np.ndarray
    ambient: float
    shading: bool
    irradiance: float
    scale: float
    gradient: Pair
    vignetting: float
    centre_px: Pair


class Samples(NamedTuple):
    """Where pixels are sampled.

    Parameters
    ----------
    edges
        Shape (H, W): pixels that an edge may pass.
    inner, outer
        Offsets in px, shape (m, 2), for pixels inside a surface and for those at an edge.
    soft_mm
        Width of the spot over which ink is mixed with paper, mm.
    """

    edges: np.ndarray
    inner: np.ndarray
    outer: np.ndarray
    soft_mm: float


class Texture(NamedTuple):
    """Two periodic tables of relative albedo deviations, shape (2, n + 1, n + 1), and their cells in mm."""

    tables: np.ndarray
    smooth_mm: float
    speckle_mm: float


@compiled
def trace_pixel(
    camera: Camera, projector: Projector | RasterProjector, world: World, u: float, v: float
) -> tuple[Triple, float, int, float, float]:
    """Follow one line of sight: point, cosine to the projector (0 in shadow), surface, albedo, squared range."""
    sight = ray(camera, u, v)
    z, surface, normal, albedo = see(world, sight)
    x, y = sight[0] + sight[2] * z, sight[1] + sight[3] * z
    source = projector.position
    dx, dy, dz = source[0] - x, source[1] - y, source[2] - z
    r2 = dx * dx + dy * dy + dz * dz
    cosine = (normal[0] * dx + normal[1] * dy + normal[2] * dz) / np.sqrt(r2)
    if cosine <= 0 or shadowed(world, surface, (x, y, z), source):
        cosine = 0.0
    return (x, y, z), cosine, surface, albedo, r2


@compiled
def trace_centres(
    first: int,
    last: int,
    camera: Camera,
    projector: Projector,
    world: World,
    table: PatternTable,
    maps: np.ndarray,
    keys: np.ndarray,
) -> None:
    """Fill truth at pixel centres of some rows: x, y, z, phase, cosine, distance to the next printed edge.

    `maps` has shape (6, H, W); `keys` (H, W) gets twice the surface number, plus one where lit.
    """
    for v in range(first, last):
        for u in range(keys.shape[1]):
            (x, y, z), cosine, surface, _, _ = trace_pixel(camera, projector, world, float(u), float(v))
            maps[0, v, u], maps[1, v, u], maps[2, v, u] = x, y, z
            maps[3, v, u] = phase_at(projector, x, y, z)
            maps[4, v, u] = cosine
            maps[5, v, u] = edge_distance(table, x, y) if surface == PLATE else np.inf
            keys[v, u] = 2 * surface + (1 if cosine > 0 else 0)


@compiled
def _texture_at(tables: np.ndarray, k: int, x: float, y: float) -> float:
    n = tables.shape[1] - 1
    return bilinear(tables, k, x - n * np.floor(x / n), y - n * np.floor(y / n))


@compiled
def _series(harmonics: np.ndarray, angle: float) -> float:
    """Sum a_k cos(k angle), by the recurrence cos((k + 1) a) = 2 cos a cos(k a) - cos((k - 1) a)."""
    twice = 2 * np.cos(angle)
    before, now = 1.0, 0.5 * twice
    total = harmonics[0] + harmonics[1] * now
    for k in range(2, harmonics.size):
        before, now = now, twice * now - before
        total += harmonics[k] * now
    return total


@compiled
def reflectance(table: PatternTable, texture: Texture, surface: int, point: Triple, soft_mm: float) -> float:
    """Albedo of a spot relative to its surface: print on the flat, and uneven paint everywhere."""
    x, y = point[0] + TEXTURE_SHIFT[0] * surface, point[1] + TEXTURE_SHIFT[1] * surface
    smooth = _texture_at(texture.tables, 0, x / texture.smooth_mm, y / texture.smooth_mm)
    speckle = _texture_at(texture.tables, 1, x / texture.speckle_mm, y / texture.speckle_mm)
    printed = ink_share(table, point[0], point[1], soft_mm) if surface == PLATE else 1.0
    return printed * (1 + smooth + speckle)


@compiled
def _add_fringes(
    harmonics: np.ndarray, steps: np.ndarray, offset_px: Pair, phase: float, light: Pair, sums: np.ndarray
) -> None:
    """Add one sample to every frame; `light` is what the sample reflects of the projector's and of ambient light."""
    for n in range(sums.size):
        value = light[1]
        if light[0] > 0:
            step = steps[n, 0] + steps[n, 1] * offset_px[0] + steps[n, 2] * offset_px[1]
            value += light[0] * steps[n, 3] * _series(harmonics, phase + step)
        sums[n] += value


@compiled
def collect_fringes(
    first: int,
    last: int,
    camera: Camera,
    projector: Projector,
    world: World,
    table: PatternTable,
    texture: Texture,
    light: Light,
    samples: Samples,
    frames: np.ndarray,
) -> None:
    """Integrate fringe light over every pixel of some rows; `frames` is (N, H, W), grey levels."""
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
                albedo *= light.scale * (1 - light.vignetting * (du * du + dv * dv))
                lit = cosine / (r2 * light.irradiance)
                if not light.shading:
                    lit = np.ceil(cosine)
                phase = phase_at(projector, point[0], point[1], point[2])
                shares = (albedo * lit, albedo * light.ambient)
                _add_fringes(light.harmonics, light.steps, (du, dv), phase, shares, sums)
            for n in range(sums.size):
                frames[n, v, u] = sums[n] / points.shape[0]


@compiled
def collect_room(
    first: int,
    last: int,
    camera: Camera,
    world: World,
    table: PatternTable,
    texture: Texture,
    light: Light,
    samples: Samples,
    picture: np.ndarray,
) -> None:
    """Integrate room light, which comes from everywhere and throws no shadow; `picture` is (H, W)."""
    for v in range(first, last):
        for u in range(picture.shape[1]):
            points = samples.outer if samples.edges[v, u] else samples.inner
            total = 0.0
            for k in range(points.shape[0]):
                su, sv = u + points[k, 0], v + points[k, 1]
                sight = ray(camera, su, sv)
                z, surface, _, albedo = see(world, sight)
                point = (sight[0] + sight[2] * z, sight[1] + sight[3] * z, z)
                du, dv = su - light.centre_px[0], sv - light.centre_px[1]
                albedo *= 1 + light.gradient[0] * du + light.gradient[1] * dv
                albedo *= 1 - light.vignetting * (du * du + dv * dv)
                total += albedo * reflectance(table, texture, surface, point, samples.soft_mm)
            picture[v, u] = light.scale * total / points.shape[0]
