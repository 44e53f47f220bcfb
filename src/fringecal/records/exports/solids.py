"""What is made of a triangulated surface: fewer triangles, or a closed body that a printer or a CAD program takes."""

import fast_simplification
import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from fringecal.errors import RecordError
from fringecal.records.exports.triangles import Triangles

_SIDES = ((0, 1), (1, 2), (2, 0))
_LEAST_GOAL = 16  # faces of a body; below it there is nothing to thin
_LEAST_CUT = 0.9  # of the body's faces asked for each time: walls and base take their share, so that one goal may miss


def thinned(triangles: Triangles, faces: int) -> Triangles:
    """Return the surface with about so many faces, fewest where it is flat (quadric error, Garland and Heckbert 1997).

    Parameters
    ----------
    triangles
        The surface; returned as it is if it has no more faces than asked for.
    faces
        Number of faces to keep, at least 4. The uncertainty of a new vertex is that of the nearest old one.

    Raises
    ------
    RecordError
        Fewer than 4 faces are asked for.
    """
    if faces < len(_SIDES) + 1:
        raise RecordError(f"{faces} faces make no surface; ask for 4 or more")
    if len(triangles.faces) <= faces:
        return triangles
    low, high = triangles.vertices_mm.min(axis=0), triangles.vertices_mm.max(axis=0)
    depth = float((high - low).max())  # as far down as the surface is wide, so that the base is never mistaken for it
    body = closed_body(triangles, base_mm=low[2] - depth)
    vertices, top, goal = body.vertices_mm, triangles.faces, len(body.faces)
    while len(top) > faces and goal > _LEAST_GOAL:
        goal = int(goal * min(_LEAST_CUT, faces / len(top)))
        vertices, all_faces = fast_simplification.simplify(body.vertices_mm, body.faces, target_count=goal)
        top = _upper(vertices, all_faces, low[2] - depth / 2)
    used, numbers = np.unique(top, return_inverse=True)
    kept = vertices[used]
    _, nearest = cKDTree(triangles.vertices_mm).query(kept)
    return Triangles(kept, numbers.reshape(-1, 3), triangles.u_z_mm[nearest], triangles.max_jump_mm)


def _upper(vertices: np.ndarray, faces: np.ndarray, level_mm: float) -> np.ndarray:
    """Return the faces that lie above a level: those of the surface, without walls and base.

    Thinned as a body, a surface keeps its rim, which the walls hold in place; an open one would shrink.
    """
    return faces[(vertices[faces, 2] > level_mm).all(axis=1)]


def closed_body(triangles: Triangles, *, base_mm: float | None = None) -> Triangles:
    """Close a surface to a watertight body: walls down from every rim, holes included, to a flat base.

    Where two parts of the surface touch in a single point, each gets a vertex of its own, so that every edge of the
    body belongs to just two faces.

    Parameters
    ----------
    triangles
        The surface, counter-clockwise as seen from +z.
    base_mm
        Height of the base; by default 1 mm below the lowest point.

    Raises
    ------
    RecordError
        The base does not lie below the surface.
    """
    lowest = float(triangles.vertices_mm[:, 2].min())
    base = lowest - 1.0 if base_mm is None else base_mm
    if base >= lowest:
        raise RecordError(f"the base, {base:g} mm, must lie below the lowest point of the surface, {lowest:.3f} mm")
    faces, origin = _parted(triangles.faces)
    top = triangles.vertices_mm[origin]
    bottom = np.column_stack([top[:, :2], np.full(len(top), base)])
    rim = _rim(faces)
    start, end, below = rim[:, 0], rim[:, 1], len(top)
    walls = np.concatenate(
        [np.column_stack([start, end + below, end]), np.column_stack([start, start + below, end + below])]
    )
    return Triangles(
        np.concatenate([top, bottom]),
        np.concatenate([faces, faces[:, ::-1] + below, walls]),
        np.concatenate([triangles.u_z_mm[origin], np.zeros(len(top))]),
        triangles.max_jump_mm,
    )


def _sides(faces: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the directed edges of all faces (3 m, 2) and, alongside, the corners at their ends (face * 3 + place)."""
    corners = np.arange(faces.size).reshape(-1, 3)
    return tuple(np.concatenate([part[:, side] for side in _SIDES]) for part in (faces, corners))  # type: ignore[return-value]


def _parted(faces: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Give each fan of faces around a vertex a vertex of its own; return the faces, and each vertex's old number.

    Two corners are the same vertex where their faces share an edge there.
    """
    edges, corners = _sides(faces)
    keys = np.sort(edges, axis=1)
    order = np.lexsort(keys.T)
    pairs = np.flatnonzero((keys[order][1:] == keys[order][:-1]).all(axis=1))
    one, other = corners[order[pairs]], corners[order[pairs + 1]][:, ::-1]
    links = coo_array((np.ones(one.size, bool), (one.ravel(), other.ravel())), shape=(faces.size, faces.size))
    count, number = connected_components(links, directed=False)
    origin = np.empty(count, np.int64)
    origin[number] = faces.ravel()
    return number.reshape(-1, 3).astype(np.int64), origin


def _rim(faces: np.ndarray) -> np.ndarray:
    """Return the directed edges that belong to one face only."""
    edges, _ = _sides(faces)
    _, first, count = np.unique(np.sort(edges, axis=1), axis=0, return_index=True, return_counts=True)
    return edges[first[count == 1]]
