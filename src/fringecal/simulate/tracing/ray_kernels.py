"""Rays against surfaces: the innermost loops of the tracer, float64.

A camera ray is parametrised by height: its point at height z is (ax + bx z, ay + by z, z), and what the
camera sees is the surface with the largest z on it. Functions take the arrays they need rather than the
whole `World`, and each loops by itself: so the compiler drops all counting of references to arrays.
"""

from typing import Any, NamedTuple

import numpy as np

from fringecal.simulate.scene.scene import FORM_ORDER, Form, HeightField, Scene
from fringecal.simulate.tracing.compiled import compiled

type Triple = tuple[float, float, float]
type Ray = tuple[float, float, float, float]

PLATE = 0
TOUCH_MM = 1e-7  # depth of rounding errors: what is less below a surface is on it
TOUCH_SHARE = 1e-12  # of the way to the lamp: solids that touch a surface meet its light over rounding errors only
# A ray marches over a height field by its clearance over the steepest slope, and by no less than this; so many steps
# reach over 80 mm of the roughest field.
MARCH_STEPS = 4000
MARCH_MIN_MM = 0.02
# Of finding a ray's place on a flat that is not plane: each brings it nearer by the slope, a hundredth at most.
FORM_ROUNDS = 4
# Rows of `World.solids` and `World.field`.
FIRST, LAST, X0, X1, Y0, Y1, TOP, ALBEDO = range(8)
HEIGHT, SLOPE_X, SLOPE_Y, REFLECTANCE = range(4)


class World(NamedTuple):
    """A scene ready for tracing; lengths in mm.

    Parameters
    ----------
    base
        The flat: z = c0 + cx x + cy y.
    form
        What the flat has over that plane: shape (4, 4), mm by powers of x and y over `form_unit_mm`; 0 for a plane.
    n_solids, n_faces, n_spheres, has_field
        What there is.
    planes
        Shape (n_faces, 4): normals and distances of all solids' faces.
    solids
        Shape (n_solids, 8): first and last (exclusive) plane, bounding box x0, x1, y0, y1, z1, albedo.
    spheres
        Shape (n_spheres, 5): centre, radius, albedo.
    field
        Shape (4, ny, nx): height, its slopes along the grid's x and y, albedo.
    frame
        Of the field: centre x, y, cosine and sine of its turn, step, largest height, largest slope.
    """

    base: Triple
    form: np.ndarray
    form_unit_mm: float
    n_solids: int
    n_faces: int
    n_spheres: int
    has_field: bool
    planes: np.ndarray
    solids: np.ndarray
    spheres: np.ndarray
    field: np.ndarray
    frame: tuple[float, float, float, float, float, float, float]


def build_world(scene: Scene) -> World:
    """Tabulate a scene for the kernels."""
    planes = np.vstack([np.zeros((0, 4)), *(solid.planes for solid in scene.solids)])
    first = np.cumsum([0, *(len(solid.planes) for solid in scene.solids)])
    spans = zip(first[:-1], first[1:], scene.solids, strict=True)
    rows = [(start, stop, *_bounds(solid.corners), solid.albedo) for start, stop, solid in spans]
    field, frame = _field_tables(scene.height_field)
    solids, spheres = np.array(rows, float).reshape(-1, 8), np.array(scene.spheres, float).reshape(-1, 5)
    counts = len(solids), len(planes), len(spheres), scene.height_field is not None
    form, unit_mm = _form_table(scene.form)
    return World(scene.base, form, unit_mm, *counts, planes, solids, spheres, field, frame)


def _form_table(form: Form) -> tuple[np.ndarray, float]:
    table = np.zeros((FORM_ORDER, FORM_ORDER))
    for i, j, height_mm in form.terms:
        table[i, j] += height_mm
    return table, form.unit_mm if np.any(table) else 0.0


def _bounds(corners: np.ndarray) -> tuple[float, ...]:
    low, high = corners.min(axis=0), corners.max(axis=0)
    return low[0], high[0], low[1], high[1], high[2]


def _field_tables(field: HeightField | None) -> tuple[np.ndarray, Any]:
    if field is None:
        return np.zeros((4, 2, 2)), (0.0,) * 7
    z = np.asarray(field.z_mm, float)
    slopes_y, slopes_x = np.gradient(z, field.step_mm)
    # Of the bilinear surface itself: no straight step between nodes is steeper than these.
    steepest = np.hypot(np.abs(np.diff(z, axis=0)).max(), np.abs(np.diff(z, axis=1)).max()) / field.step_mm
    turn = float(np.cos(field.angle_rad)), float(np.sin(field.angle_rad))
    frame = (*field.centre_mm, *turn, float(field.step_mm), float(z.max()), float(steepest))
    return np.stack([z, slopes_x, slopes_y, np.asarray(field.albedo, float)]), frame


@compiled
def see(world: World, ray: Ray) -> tuple[float, int, Triple, float]:
    """First surface on a camera ray: height, surface number, outward normal and relative albedo.

    Surfaces are numbered: 0 the flat, then every face of every solid, every sphere, the height field.
    """
    c0, cx, cy = world.base
    z = (c0 + cx * ray[0] + cy * ray[1]) / (1 - cx * ray[2] - cy * ray[3])
    if world.form_unit_mm > 0:
        z, cx, cy = _formed(world.form, world.form_unit_mm, world.base, ray, z)
    length = np.sqrt(1 + cx * cx + cy * cy)
    surface, normal, albedo = PLATE, (-cx / length, -cy / length, 1 / length), 1.0
    if world.n_solids > 0:
        z_hit, face, solid = _highest_face(world.planes, world.solids, ray)
        if z_hit > z:
            z, surface = z_hit, 1 + face
            albedo, normal = _face_surface(world.planes, world.solids, face, solid)
    if world.n_spheres > 0:
        z_hit, k = _highest_sphere(world.spheres, ray)
        if z_hit > z:
            z, surface = z_hit, 1 + world.n_faces + k
            albedo, normal = _sphere_surface(world.spheres, k, ray, z)
    if world.has_field:
        z_hit = _field_hit(world.field, world.frame, ray, z)
        if z_hit > z + TOUCH_MM:
            z, surface = z_hit, 1 + world.n_faces + world.n_spheres
            albedo, normal = _field_surface(world.field, world.frame, ray[0] + ray[2] * z, ray[1] + ray[3] * z)
    return z, surface, normal, albedo


@compiled
def _formed(form: np.ndarray, unit_mm: float, base: Triple, ray: Ray, z: float) -> tuple[float, float, float]:
    """Height at which a ray meets a flat that is not plane, and the slopes there."""
    cx, cy = base[1], base[2]
    for _ in range(FORM_ROUNDS):
        x, y = ray[0] + ray[2] * z, ray[1] + ray[3] * z
        height, rise_x, rise_y = 0.0, 0.0, 0.0
        for i in range(FORM_ORDER):
            for j in range(FORM_ORDER):
                if form[i, j] != 0:
                    height += form[i, j] * (x / unit_mm) ** i * (y / unit_mm) ** j
                    if i > 0:
                        rise_x += form[i, j] * i / unit_mm * (x / unit_mm) ** (i - 1) * (y / unit_mm) ** j
                    if j > 0:
                        rise_y += form[i, j] * j / unit_mm * (x / unit_mm) ** i * (y / unit_mm) ** (j - 1)
        cx, cy = base[1] + rise_x, base[2] + rise_y
        z = base[0] + base[1] * x + base[2] * y + height
    return z, cx, cy


@compiled
def _highest_face(planes: np.ndarray, solids: np.ndarray, ray: Ray) -> tuple[float, int, int]:
    """Height, face and solid of the highest point of a ray inside any convex solid."""
    ax, ay, bx, by = ray
    best, best_face, best_solid = -np.inf, -1, -1
    for s in range(solids.shape[0]):
        x_top, y_top = ax + bx * solids[s, TOP], ay + by * solids[s, TOP]
        beside_x = max(ax, x_top) < solids[s, X0] or min(ax, x_top) > solids[s, X1]
        beside_y = max(ay, y_top) < solids[s, Y0] or min(ay, y_top) > solids[s, Y1]
        if beside_x or beside_y:
            continue
        low, high, face = -np.inf, np.inf, -1
        for i in range(int(solids[s, FIRST]), int(solids[s, LAST])):
            room = planes[i, 3] - planes[i, 0] * ax - planes[i, 1] * ay
            rate = planes[i, 0] * bx + planes[i, 1] * by + planes[i, 2]
            if rate > 0 and room / rate < high:
                high, face = room / rate, i
            elif rate < 0:
                low = max(low, room / rate)
            elif rate == 0 and room < 0:
                low = np.inf
        if high > low and high > best:
            best, best_face, best_solid = high, face, s
    return best, best_face, best_solid


@compiled
def _face_surface(planes: np.ndarray, solids: np.ndarray, face: int, solid: int) -> tuple[float, Triple]:
    return solids[solid, ALBEDO], (planes[face, 0], planes[face, 1], planes[face, 2])


@compiled
def _highest_sphere(spheres: np.ndarray, ray: Ray) -> tuple[float, int]:
    """Height and number of the highest sphere that a ray meets."""
    ax, ay, bx, by = ray
    best, best_k = -np.inf, -1
    for k in range(spheres.shape[0]):
        dx, dy, dz, r = ax - spheres[k, 0], ay - spheres[k, 1], -spheres[k, 2], spheres[k, 3]
        a = 1 + bx * bx + by * by
        half = bx * dx + by * dy + dz
        inside = half * half - a * (dx * dx + dy * dy + dz * dz - r * r)
        if inside > 0 and (-half + np.sqrt(inside)) / a > best:
            best, best_k = (-half + np.sqrt(inside)) / a, k
    return best, best_k


@compiled
def _sphere_surface(spheres: np.ndarray, k: int, ray: Ray, z: float) -> tuple[float, Triple]:
    r = spheres[k, 3]
    x, y = ray[0] + ray[2] * z, ray[1] + ray[3] * z
    return spheres[k, 4], ((x - spheres[k, 0]) / r, (y - spheres[k, 1]) / r, (z - spheres[k, 2]) / r)


@compiled
def _field_hit(field: np.ndarray, frame: Any, ray: Ray, floor: float) -> float:
    """March down a ray by steps that the steepest slope allows, so that no surface is stepped over."""
    rate = 1 + frame[6] * np.hypot(ray[2], ray[3])
    z = frame[5]
    for _ in range(MARCH_STEPS):
        clear = z - field_height(field, frame, ray[0] + ray[2] * z, ray[1] + ray[3] * z)
        if clear < TOUCH_MM or z < floor:
            break
        z -= clear / rate
    return z


@compiled
def bilinear(tables: np.ndarray, k: int, column: float, row: float) -> float:
    """Interpolate table `k` between its four nearest nodes; the position must lie on the table."""
    i = min(max(int(np.floor(row)), 0), tables.shape[1] - 2)
    j = min(max(int(np.floor(column)), 0), tables.shape[2] - 2)
    s, t = column - j, row - i
    upper = (1 - s) * tables[k, i, j] + s * tables[k, i, j + 1]
    lower = (1 - s) * tables[k, i + 1, j] + s * tables[k, i + 1, j + 1]
    return (1 - t) * upper + t * lower


@compiled
def _node(field: np.ndarray, frame: Any, x: float, y: float) -> tuple[float, float]:
    """Position on the height field in node units (column, row)."""
    dx, dy = x - frame[0], y - frame[1]
    column = (frame[2] * dx + frame[3] * dy) / frame[4] + 0.5 * (field.shape[2] - 1)
    row = (-frame[3] * dx + frame[2] * dy) / frame[4] + 0.5 * (field.shape[1] - 1)
    return column, row


@compiled
def field_height(field: np.ndarray, frame: Any, x: float, y: float) -> float:
    """Height of the height field over a point of the plate, 0 beside it."""
    column, row = _node(field, frame, x, y)
    inside = 0 <= column <= field.shape[2] - 1 and 0 <= row <= field.shape[1] - 1
    return bilinear(field, HEIGHT, column, row) if inside else 0.0


@compiled
def _field_surface(field: np.ndarray, frame: Any, x: float, y: float) -> tuple[float, Triple]:
    """Albedo and normal of the height field, slopes interpolated between nodes."""
    column, row = _node(field, frame, x, y)
    column = min(max(column, 0.0), field.shape[2] - 1.0)
    row = min(max(row, 0.0), field.shape[1] - 1.0)
    gx, gy = bilinear(field, SLOPE_X, column, row), bilinear(field, SLOPE_Y, column, row)
    length = np.sqrt(1 + gx * gx + gy * gy)
    nx, ny = -(frame[2] * gx - frame[3] * gy) / length, -(frame[3] * gx + frame[2] * gy) / length
    return bilinear(field, REFLECTANCE, column, row), (nx, ny, 1 / length)


@compiled
def shadowed(world: World, surface: int, point: Triple, source: Triple) -> bool:
    """Whether anything stands between a surface point and the source."""
    if world.n_solids > 0 and _solid_between(world.planes, world.solids, surface, point, source):
        return True
    if world.n_spheres > 0 and _sphere_between(world.spheres, surface - 1 - world.n_faces, point, source):
        return True
    return world.has_field and _field_between(world.field, world.frame, point, source)


@compiled
def _solid_between(planes: np.ndarray, solids: np.ndarray, surface: int, point: Triple, source: Triple) -> bool:
    x, y, z = point
    dx, dy, dz = source[0] - x, source[1] - y, source[2] - z
    hidden = False
    for s in range(solids.shape[0]):
        # Above its top a solid shades nothing: look only at the part of the path below it.
        below = min(1.0, (solids[s, TOP] - z) / dz)
        beside_x = max(x, x + below * dx) < solids[s, X0] or min(x, x + below * dx) > solids[s, X1]
        beside_y = max(y, y + below * dy) < solids[s, Y0] or min(y, y + below * dy) > solids[s, Y1]
        # A convex solid cannot shade a face of its own that is turned to the source.
        own = solids[s, FIRST] < surface <= solids[s, LAST]
        if own or below <= 0 or beside_x or beside_y:
            continue
        enter, leave = 0.0, 1.0
        for i in range(int(solids[s, FIRST]), int(solids[s, LAST])):
            room = planes[i, 3] - planes[i, 0] * x - planes[i, 1] * y - planes[i, 2] * z
            rate = planes[i, 0] * dx + planes[i, 1] * dy + planes[i, 2] * dz
            if rate > 0:
                leave = min(leave, room / rate)
            elif rate < 0:
                enter = max(enter, room / rate)
            elif room < 0:
                leave = -1.0
        hidden = hidden or leave - enter > TOUCH_SHARE
    return hidden


@compiled
def _sphere_between(spheres: np.ndarray, own: int, point: Triple, source: Triple) -> bool:
    dx, dy, dz = source[0] - point[0], source[1] - point[1], source[2] - point[2]
    a = dx * dx + dy * dy + dz * dz
    hidden = False
    for k in range(spheres.shape[0]):
        ox, oy, oz = point[0] - spheres[k, 0], point[1] - spheres[k, 1], point[2] - spheres[k, 2]
        half = ox * dx + oy * dy + oz * dz
        outside = ox * ox + oy * oy + oz * oz - spheres[k, 3] * spheres[k, 3]
        hidden = hidden or (k != own and half < 0 and half * half > a * outside)
    return hidden


@compiled
def _field_between(field: np.ndarray, frame: Any, point: Triple, source: Triple) -> bool:
    dx, dy, dz = source[0] - point[0], source[1] - point[1], source[2] - point[2]
    length = np.sqrt(dx * dx + dy * dy + dz * dz)
    dx, dy, dz = dx / length, dy / length, dz / length
    rate = abs(dz) + frame[6] * np.hypot(dx, dy)
    t, clear = MARCH_MIN_MM, 0.0
    for _ in range(MARCH_STEPS):
        z = point[2] + t * dz
        if z > frame[5] or t > length or clear < -TOUCH_MM:
            break
        clear = z - field_height(field, frame, point[0] + t * dx, point[1] + t * dy)
        t += max(clear / rate, MARCH_MIN_MM)
    return clear < -TOUCH_MM
