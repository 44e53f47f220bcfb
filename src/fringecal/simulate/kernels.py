"""Rays against surfaces: the innermost loops of the tracer, float64, the same on any number of threads.

A camera ray is parametrised by height: its point at height z is (ax + bx z, ay + by z, z), and what the
camera sees is the surface with the largest z on it.
"""

from typing import Any, NamedTuple

import numpy as np

from fringecal.simulate.compiled import compiled
from fringecal.simulate.scene import Scene

PLATE = 0
TOUCH_MM = 1e-7
MARCH_STEPS = 4000
MARCH_MIN_MM = 0.02


class World(NamedTuple):
    """A scene ready for tracing; lengths in mm.

    Solids: `planes[first[s]:first[s + 1]]`, bounding boxes (x0, x1, y0, y1, z1) and albedos. Height
    field: heights, slopes and albedo at its nodes; `frame` is (centre x, centre y, cos, sin, step,
    largest height, largest slope).
    """

    base: tuple[float, float, float]
    planes: np.ndarray
    first: np.ndarray
    boxes: np.ndarray
    albedos: np.ndarray
    spheres: np.ndarray
    heights: np.ndarray
    slopes_x: np.ndarray
    slopes_y: np.ndarray
    height_albedo: np.ndarray
    frame: tuple[float, float, float, float, float, float, float]


def build_world(scene: Scene) -> World:
    """Tabulate a scene for the kernels."""
    solids = scene.solids
    planes = np.vstack([np.zeros((0, 4)), *(s.planes for s in solids)])
    first = np.cumsum([0, *(len(s.planes) for s in solids)])
    boxes = np.array([_bounds(s.corners) for s in solids]).reshape(-1, 5)
    spheres = np.array(scene.spheres, float).reshape(-1, 5)
    albedos = np.array([s.albedo for s in solids], float)
    return World(scene.base, planes, first, boxes, albedos, spheres, *_field_tables(scene))


def _bounds(corners: np.ndarray) -> tuple[float, ...]:
    low, high = corners.min(axis=0), corners.max(axis=0)
    return low[0], high[0], low[1], high[1], high[2]


def _field_tables(scene: Scene) -> tuple[Any, ...]:
    field = scene.height_field
    if field is None:
        return *(np.zeros((0, 0)),) * 4, (0.0,) * 7
    z = np.ascontiguousarray(field.z_mm, float)
    slopes_y, slopes_x = (np.ascontiguousarray(slope) for slope in np.gradient(z, field.step_mm))
    # Of the bilinear surface itself: no straight step between nodes is steeper than these.
    steepest = np.hypot(np.abs(np.diff(z, axis=0)).max(), np.abs(np.diff(z, axis=1)).max()) / field.step_mm
    c, s = np.cos(field.angle_rad), np.sin(field.angle_rad)
    frame = (*field.centre_mm, float(c), float(s), field.step_mm, float(z.max()), float(steepest))
    return z, slopes_x, slopes_y, np.ascontiguousarray(field.albedo, float), frame


@compiled
def see(
    world: World, ray: tuple[float, float, float, float]
) -> tuple[float, int, float, float, float, float]:
    """First surface on a camera ray: height, surface number, outward normal and relative albedo.

    Surfaces are numbered: 0 the flat, then every face of every solid, every sphere, the height field.
    """
    ax, ay, bx, by = ray
    c0, cx, cy = world.base[0], world.base[1], world.base[2]
    z = (c0 + cx * ax + cy * ay) / (1 - cx * bx - cy * by)
    length = np.sqrt(1 + cx * cx + cy * cy)
    surface, albedo = PLATE, 1.0
    nx, ny, nz = -cx / length, -cy / length, 1 / length
    for s in range(world.boxes.shape[0]):
        z_hit, face = _see_solid(world, s, ray)
        if z_hit > z:
            z, surface, albedo = z_hit, 1 + face, world.albedos[s]
            nx, ny, nz = world.planes[face, 0], world.planes[face, 1], world.planes[face, 2]
    n_faces = world.planes.shape[0]
    for k in range(world.spheres.shape[0]):
        z_hit = _see_sphere(world, k, ray)
        if z_hit > z:
            z, surface, r = z_hit, 1 + n_faces + k, world.spheres[k, 3]
            nx, ny = (ax + bx * z - world.spheres[k, 0]) / r, (ay + by * z - world.spheres[k, 1]) / r
            nz, albedo = (z - world.spheres[k, 2]) / r, world.spheres[k, 4]
    if world.heights.shape[0] > 0:
        z_hit = _see_field(world, ray, z)
        if z_hit > z + TOUCH_MM:
            z, surface = z_hit, 1 + n_faces + world.spheres.shape[0]
            albedo, nx, ny, nz = _field_surface(world, ax + bx * z, ay + by * z)
    return z, surface, nx, ny, nz, albedo


@compiled
def _see_solid(world: World, s: int, ray: tuple[float, float, float, float]) -> tuple[float, int]:
    ax, ay, bx, by = ray
    x1, y1 = ax + bx * world.boxes[s, 4], ay + by * world.boxes[s, 4]
    if max(ax, x1) < world.boxes[s, 0] or min(ax, x1) > world.boxes[s, 1]:
        return -np.inf, -1
    if max(ay, y1) < world.boxes[s, 2] or min(ay, y1) > world.boxes[s, 3]:
        return -np.inf, -1
    low, high, face = -np.inf, np.inf, -1
    for i in range(world.first[s], world.first[s + 1]):
        nx, ny, nz = world.planes[i, 0], world.planes[i, 1], world.planes[i, 2]
        room = world.planes[i, 3] - nx * ax - ny * ay
        rate = nx * bx + ny * by + nz
        if rate > 0:
            if room / rate < high:
                high, face = room / rate, i
        elif rate < 0:
            low = max(low, room / rate)
        elif room < 0:
            return -np.inf, -1
    return (high, face) if high > low else (-np.inf, -1)


@compiled
def _see_sphere(world: World, k: int, ray: tuple[float, float, float, float]) -> float:
    ax, ay, bx, by = ray
    dx, dy, dz = ax - world.spheres[k, 0], ay - world.spheres[k, 1], -world.spheres[k, 2]
    r = world.spheres[k, 3]
    a = 1 + bx * bx + by * by
    half = bx * dx + by * dy + dz
    inside = half * half - a * (dx * dx + dy * dy + dz * dz - r * r)
    return (-half + np.sqrt(inside)) / a if inside > 0 else -np.inf


@compiled
def _see_field(world: World, ray: tuple[float, float, float, float], floor: float) -> float:
    """March down the ray by steps that the steepest slope allows, so that no surface is stepped over."""
    ax, ay, bx, by = ray
    top, steepest = world.frame[5], world.frame[6]
    rate = 1 + steepest * np.hypot(bx, by)
    z = top
    for _ in range(MARCH_STEPS):
        clear = z - field_height(world, ax + bx * z, ay + by * z)
        if clear < TOUCH_MM or z < floor:
            break
        z -= clear / rate
    return z if z >= floor else -np.inf


@compiled
def _node(world: World, x: float, y: float) -> tuple[float, float]:
    """Position on the height field in node units (column, row)."""
    f = world.frame
    dx, dy = x - f[0], y - f[1]
    column = (f[2] * dx + f[3] * dy) / f[4] + 0.5 * (world.heights.shape[1] - 1)
    row = (-f[3] * dx + f[2] * dy) / f[4] + 0.5 * (world.heights.shape[0] - 1)
    return column, row


@compiled
def bilinear(table: np.ndarray, column: float, row: float) -> float:
    """Interpolate a table between its four nearest nodes; the position must lie on the table."""
    i = min(max(int(np.floor(row)), 0), table.shape[0] - 2)
    j = min(max(int(np.floor(column)), 0), table.shape[1] - 2)
    s, t = column - j, row - i
    upper = (1 - s) * table[i, j] + s * table[i, j + 1]
    lower = (1 - s) * table[i + 1, j] + s * table[i + 1, j + 1]
    return (1 - t) * upper + t * lower


@compiled
def field_height(world: World, x: float, y: float) -> float:
    """Height of the height field over a point of the plate, 0 beside it."""
    column, row = _node(world, x, y)
    ny, nx = world.heights.shape
    if column < 0 or row < 0 or column > nx - 1 or row > ny - 1:
        return 0.0
    return bilinear(world.heights, column, row)


@compiled
def _field_surface(world: World, x: float, y: float) -> tuple[float, float, float, float]:
    column, row = _node(world, x, y)
    column = min(max(column, 0.0), world.heights.shape[1] - 1.0)
    row = min(max(row, 0.0), world.heights.shape[0] - 1.0)
    gx = bilinear(world.slopes_x, column, row)
    gy = bilinear(world.slopes_y, column, row)
    c, s = world.frame[2], world.frame[3]
    length = np.sqrt(1 + gx * gx + gy * gy)
    albedo = bilinear(world.height_albedo, column, row)
    return albedo, -(c * gx - s * gy) / length, -(s * gx + c * gy) / length, 1 / length


@compiled
def shadowed(
    world: World, surface: int, point: tuple[float, float, float], lamp: tuple[float, float, float]
) -> bool:
    """Whether anything stands between a surface point and the lamp."""
    for s in range(world.boxes.shape[0]):
        # A convex solid cannot shade a face of its own that is turned to the lamp.
        own = world.first[s] < surface <= world.first[s + 1]
        if not own and _solid_between(world, s, point, lamp):
            return True
    first_sphere = 1 + world.planes.shape[0]
    for k in range(world.spheres.shape[0]):
        if surface != first_sphere + k and _sphere_between(world, k, point, lamp):
            return True
    return world.heights.shape[0] > 0 and _field_between(world, point, lamp)


@compiled
def _solid_between(
    world: World, s: int, point: tuple[float, float, float], lamp: tuple[float, float, float]
) -> bool:
    x, y, z = point
    dx, dy, dz = lamp[0] - x, lamp[1] - y, lamp[2] - z
    # Above its top a solid shades nothing: look only at the part of the path below it.
    below = min(1.0, (world.boxes[s, 4] - z) / dz)
    if max(x, x + below * dx) < world.boxes[s, 0] or min(x, x + below * dx) > world.boxes[s, 1]:
        return False
    if max(y, y + below * dy) < world.boxes[s, 2] or min(y, y + below * dy) > world.boxes[s, 3]:
        return False
    enter, leave = 0.0, 1.0
    for i in range(world.first[s], world.first[s + 1]):
        nx, ny, nz = world.planes[i, 0], world.planes[i, 1], world.planes[i, 2]
        room = world.planes[i, 3] - nx * x - ny * y - nz * z
        rate = nx * dx + ny * dy + nz * dz
        if rate > 0:
            leave = min(leave, room / rate)
        elif rate < 0:
            enter = max(enter, room / rate)
        elif room < 0:
            return False
        # Solids that touch meet the ray over a length of rounding errors only.
        if leave - enter < 1e-12:
            return False
    return True


@compiled
def _sphere_between(
    world: World, k: int, point: tuple[float, float, float], lamp: tuple[float, float, float]
) -> bool:
    ox, oy = point[0] - world.spheres[k, 0], point[1] - world.spheres[k, 1]
    oz, r = point[2] - world.spheres[k, 2], world.spheres[k, 3]
    dx, dy, dz = lamp[0] - point[0], lamp[1] - point[1], lamp[2] - point[2]
    a = dx * dx + dy * dy + dz * dz
    half = ox * dx + oy * dy + oz * dz
    outside = ox * ox + oy * oy + oz * oz - r * r
    return half < 0 and half * half > a * outside


@compiled
def _field_between(world: World, point: tuple[float, float, float], lamp: tuple[float, float, float]) -> bool:
    dx, dy, dz = lamp[0] - point[0], lamp[1] - point[1], lamp[2] - point[2]
    length = np.sqrt(dx * dx + dy * dy + dz * dz)
    dx, dy, dz = dx / length, dy / length, dz / length
    rate = abs(dz) + world.frame[6] * np.hypot(dx, dy)
    t = MARCH_MIN_MM
    for _ in range(MARCH_STEPS):
        z = point[2] + t * dz
        if z > world.frame[5] or t > length:
            return False
        clear = z - field_height(world, point[0] + t * dx, point[1] + t * dy)
        if clear < -TOUCH_MM:
            return True
        t += max(clear / rate, MARCH_MIN_MM)
    return False
