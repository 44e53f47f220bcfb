"""From surfaces to light: what each pixel collects from plate, lamp and room."""

from typing import NamedTuple

import numpy as np

from fringecal.simulate.camera import Camera, ray
from fringecal.simulate.compiled import compiled
from fringecal.simulate.kernels import PLATE, World, bilinear, see, shadowed
from fringecal.simulate.patterns import PatternTable, edge_distance, ink_share
from fringecal.simulate.projector import Projector, phase_at

# Offsets between the textures of different surfaces, in texture cells; any irrational-looking pair does.
TEXTURE_SHIFT = (17.31, 5.73)


class Light(NamedTuple):
    """Light and exposure, ready for tracing.

    `scale` turns relative light into grey levels on a linear sensor: projected light is 1 at the
    plate's origin in the middle of a fringe. `steps` has per frame the step at the image centre and
    its change per px along u and v, rad; `lamp` the lamp's relative brightness per frame.
    """

    fringes: bool
    harmonics: np.ndarray
    steps: np.ndarray
    lamp: np.ndarray
    ambient: float
    shading: bool
    irradiance: float
    scale: float
    gradient: tuple[float, float]
    vignetting: float
    half_diagonal_px: float
    centre_px: tuple[float, float]


class Texture(NamedTuple):
    """Two periodic tables of relative albedo deviations and their cell sizes in mm."""

    smooth: np.ndarray
    smooth_mm: float
    speckle: np.ndarray
    speckle_mm: float


@compiled
def trace_pixel(
    camera: Camera, projector: Projector, world: World, u: float, v: float
) -> tuple[float, float, float, float, int, float, float]:
    """What one line of sight meets: x, y, z, cosine to the lamp (0 in shadow), surface, albedo, squared range."""
    sight = ray(camera, u, v)
    z, surface, nx, ny, nz, albedo = see(world, sight)
    x, y = sight[0] + sight[2] * z, sight[1] + sight[3] * z
    lamp = projector.position
    dx, dy, dz = lamp[0] - x, lamp[1] - y, lamp[2] - z
    r2 = dx * dx + dy * dy + dz * dz
    cosine = (nx * dx + ny * dy + nz * dz) / np.sqrt(r2)
    if cosine <= 0 or shadowed(world, surface, (x, y, z), lamp):
        cosine = 0.0
    return x, y, z, cosine, surface, albedo, r2


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
    """Fill truth at pixel centres of some rows: maps x, y, z, phase, cosine and the distance to the next printed edge.

    `maps` has shape (6, H, W); `keys` (H, W) gets twice the surface number, plus one where lit.
    """
    for v in range(first, last):
        for u in range(keys.shape[1]):
            x, y, z, cosine, surface, _, _ = trace_pixel(camera, projector, world, u, v)
            maps[0, v, u], maps[1, v, u], maps[2, v, u] = x, y, z
            maps[3, v, u] = phase_at(projector, x, y, z)
            maps[4, v, u] = cosine
            maps[5, v, u] = edge_distance(table, x, y) if surface == PLATE else np.inf
            keys[v, u] = 2 * surface + (1 if cosine > 0 else 0)


@compiled
def _noise_at(table: np.ndarray, x: float, y: float) -> float:
    n = table.shape[0] - 1
    return bilinear(table, x - n * np.floor(x / n), y - n * np.floor(y / n))


@compiled
def _texture_at(texture: Texture, surface: int, x: float, y: float) -> float:
    px, py = x + TEXTURE_SHIFT[0] * surface, y + TEXTURE_SHIFT[1] * surface
    smooth = _noise_at(texture.smooth, px / texture.smooth_mm, py / texture.smooth_mm)
    return 1 + smooth + _noise_at(texture.speckle, px / texture.speckle_mm, py / texture.speckle_mm)


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
def _add_sample(
    camera: Camera,
    projector: Projector,
    world: World,
    table: PatternTable,
    texture: Texture,
    light: Light,
    u: float,
    v: float,
    weight: float,
    soft_mm: float,
    sums: np.ndarray,
) -> None:
    x, y, z, cosine, surface, albedo, r2 = trace_pixel(camera, projector, world, u, v)
    if surface == PLATE:
        albedo *= ink_share(table, x, y, soft_mm)
    du, dv = u - light.centre_px[0], v - light.centre_px[1]
    fall = 1 - light.vignetting * (du * du + dv * dv) / light.half_diagonal_px**2
    weight *= light.scale * albedo * _texture_at(texture, surface, x, y) * fall
    if not light.fringes:
        room = 1 + light.gradient[0] * du + light.gradient[1] * dv
        sums[0] += weight * room * light.lamp[0]
        return
    if light.shading:
        lit = cosine / r2 / light.irradiance
    else:
        lit = 1.0 if cosine > 0 else 0.0
    phase = phase_at(projector, x, y, z) if lit > 0 else 0.0
    for n in range(sums.size):
        value = light.ambient
        if lit > 0:
            step = light.steps[n, 0] + light.steps[n, 1] * du + light.steps[n, 2] * dv
            value += lit * light.lamp[n] * _series(light.harmonics, phase + step)
        sums[n] += weight * value


@compiled
def collect(
    first: int,
    last: int,
    camera: Camera,
    projector: Projector,
    world: World,
    table: PatternTable,
    texture: Texture,
    light: Light,
    edges: np.ndarray,
    inner: np.ndarray,
    outer: np.ndarray,
    soft_mm: float,
    frames: np.ndarray,
) -> None:
    """Integrate every frame over the square of every pixel of some rows; `frames` has shape (N, H, W), grey levels.

    `inner` and `outer` are sample offsets in px, shape (m, 2), for pixels inside a surface and for
    those that an edge passes (`edges`).
    """
    for v in range(first, last):
        sums = np.empty(frames.shape[0])
        for u in range(edges.shape[1]):
            points = outer if edges[v, u] else inner
            sums[:] = 0
            for k in range(points.shape[0]):
                su, sv = u + points[k, 0], v + points[k, 1]
                _add_sample(
                    camera,
                    projector,
                    world,
                    table,
                    texture,
                    light,
                    su,
                    sv,
                    1 / points.shape[0],
                    soft_mm,
                    sums,
                )
            frames[:, v, u] = sums
