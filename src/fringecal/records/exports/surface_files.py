"""Height maps on disk: arrays, pictures, meshes and x3p, all in the plate frame, never mirrored."""

import json
from collections.abc import Iterable
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pandas as pd
import tifffile
import trimesh
import x3pio

from fringecal import __version__
from fringecal.errors import RecordError
from fringecal.reconstruct import VolumeMap
from fringecal.records.exports.regular_grid import demand_maps, regular_grid, sample_spacing_mm
from fringecal.records.exports.solids import closed_body, thinned
from fringecal.records.exports.triangles import Surface, Triangles, triangulate
from fringecal.records.files import replacing

_MM = 1e-3
_MESHES = (".ply", ".stl", ".obj")


def write_npz(path: str | Path, surface: Surface) -> Path:
    """Write ``x, y, z, u_z`` (mm, NaN where masked) and ``mask`` (True = valid), one value per pixel."""
    mask = np.asarray(surface.mask, dtype=bool)
    demand_maps(surface.x, surface.y, surface.z, surface.u_z, mask)
    x, y, z, u_z = (np.where(mask, part, np.nan) for part in (surface.x, surface.y, surface.z, surface.u_z))
    with replacing(path) as sibling:
        np.savez(sibling, x=x, y=y, z=z, u_z=u_z, mask=mask)
    return Path(path)


def write_points(path: str | Path, volume: VolumeMap, place_px: np.ndarray) -> Path:
    """Write points of the camera's frame as one value per pixel, whole or not at all.

    ``x, y, z, u_x, u_y, u_z`` (mm, NaN where masked), ``reasons`` (`Reason` bits, 0 where valid), and
    ``column, row`` (px of the projector, NaN where not known).
    """
    names = ("x", "y", "z", "u_x", "u_y", "u_z")
    maps = {name: np.where(volume.mask, getattr(volume, name), np.nan) for name in names}
    with replacing(path) as sibling:
        np.savez(sibling, reasons=volume.reasons, column=place_px[0], row=place_px[1], **maps)  # type: ignore[arg-type]
    return Path(path)


def write_tif(path: str | Path, surface: Surface) -> Path:
    """Write z as a float32 TIFF in mm, row 0 at the top as in the camera's picture.

    Its resolution tags hold the median sample spacing (pixels per centimetre); its description
    is JSON that names quantity, unit, spacing and orientation.
    """
    x, y, z = (np.where(surface.mask, part, np.nan) for part in (surface.x, surface.y, surface.z))
    demand_maps(x, y, z)
    spacing = sample_spacing_mm(x, y)
    description = {
        "quantity": "height above the plate",
        "unit": "mm",
        "sample_spacing_mm": spacing,
        "orientation": "row 0 at the top: plate x to the right, plate y up",
        "software": f"fringecal {__version__}",
    }
    with replacing(path) as sibling:
        tifffile.imwrite(
            sibling,
            z.astype(np.float32),
            photometric="minisblack",
            resolution=(10 / spacing, 10 / spacing),
            resolutionunit="CENTIMETER",
            description=json.dumps(description),
            metadata=None,
        )
    return Path(path)


def write_mesh(path: str | Path, surface: Surface, *, max_jump_mm: float | None = None, stride: int = 1) -> Path:
    """Write the surface as ``.ply`` or ``.stl`` (binary) or ``.obj``: mm, right-handed, z up.

    Parameters
    ----------
    path
        Its suffix chooses the format.
    surface
        Height map in the plate frame.
    max_jump_mm, stride
        As for `fringecal.records.exports.triangles.triangulate`; the jump limit stands in the file's header.

    Raises
    ------
    RecordError
        The suffix is another, or no triangle can be made.
    """
    return _write_triangles(path, triangulate(surface, max_jump_mm=max_jump_mm, stride=stride))


def write_x3p(
    path: str | Path,
    surface: Surface,
    *,
    spacing_mm: float | None = None,
    max_jump_mm: float | None = None,
    created: datetime | None = None,
) -> Path:
    """Write the surface as x3p (ISO 25178-72): a regular grid in metres, rows toward +y.

    The offset of the grid's first node keeps plate-frame coordinates; nodes that were not
    measured are marked invalid.

    Parameters
    ----------
    path
        File to write.
    surface
        Height map in the plate frame.
    spacing_mm, max_jump_mm
        As for `fringecal.records.exports.regular_grid.regular_grid`.
    created
        Time that the file states as its date; the present if left out.
    """
    x, y, z = (np.where(surface.mask, part, np.nan) for part in (surface.x, surface.y, surface.z))
    grid = regular_grid(x, y, z, spacing_mm=spacing_mm, max_jump_mm=max_jump_mm)
    step = grid.spacing_mm * _MM
    origin = x3pio.Placement(offset=(grid.x_mm[0] * _MM, grid.y_mm[0] * _MM, 0.0))
    with replacing(path) as sibling:
        x3pio.write(
            sibling,
            grid.z_mm * _MM,
            x_scale=step,
            y_scale=step,
            placement=origin,
            coordinate_system=x3pio.CoordinateSystem.VIEW,
            metadata=_x3p_metadata(created),
        )
    return Path(path)


def write_profiles(path: str | Path, surface: Surface, rows: Iterable[int]) -> Path:
    """Write sections along picture rows as CSV: row, x, y, z and u(z) in mm, measured points only."""
    mask = np.asarray(surface.mask, dtype=bool)
    chosen = np.array(sorted(set(rows)), dtype=int)
    place, columns = np.nonzero(mask[chosen])
    numbers = chosen[place]
    maps = {"x": surface.x, "y": surface.y, "z": surface.z, "u(z)": surface.u_z}
    parts = {f"{name} / mm": np.asarray(values)[numbers, columns] for name, values in maps.items()}
    with replacing(path) as sibling:
        pd.DataFrame({"row / px": numbers, **parts}).to_csv(sibling, index=False, float_format="%.6f")
    return Path(path)


def write_surfaces(
    folder: str | Path,
    surface: Surface,
    *,
    name: str = "height",
    max_jump_mm: float | None = None,
    stride: int = 1,
    faces: int | None = None,
    watertight: bool = False,
) -> tuple[Path, ...]:
    """Write a height map in every format.

    Parameters
    ----------
    folder, surface, name
        Where, what, and the files' name without suffix.
    max_jump_mm, stride
        As for `fringecal.records.exports.triangles.triangulate`; `stride` thins the meshes and the x3p, never the maps.
    faces
        Number of faces that the meshes keep (`fringecal.records.exports.solids.thinned`); all by default.
    watertight
        Write the meshes as bodies closed down to a flat base 1 mm below the lowest point.
    """
    folder = Path(folder)
    triangles = triangulate(surface, max_jump_mm=max_jump_mm, stride=stride)
    triangles = thinned(triangles, faces) if faces is not None else triangles
    triangles = closed_body(triangles) if watertight else triangles
    spacing_mm = stride * sample_spacing_mm(
        np.where(surface.mask, surface.x, np.nan), np.where(surface.mask, surface.y, np.nan)
    )
    return (
        write_npz(folder / f"{name}.npz", surface),
        write_tif(folder / f"{name}.tif", surface),
        *(_write_triangles(folder / f"{name}{suffix}", triangles) for suffix in _MESHES),
        write_x3p(folder / f"{name}.x3p", surface, spacing_mm=spacing_mm, max_jump_mm=max_jump_mm),
    )


def _write_triangles(path: str | Path, triangles: Triangles) -> Path:
    suffix = Path(path).suffix.lower()
    if suffix not in _MESHES:
        raise RecordError(f"{path}: a mesh is written as one of {', '.join(_MESHES)}, found {suffix!r}")
    attributes = {"u_z": triangles.u_z_mm.astype(np.float32)} if suffix == ".ply" else None
    mesh = trimesh.Trimesh(triangles.vertices_mm, triangles.faces, process=False, vertex_attributes=attributes)
    with replacing(path) as sibling:
        sibling.write_bytes(_encode(mesh, suffix, _header(triangles)))
    return Path(path)


def _encode(mesh: trimesh.Trimesh, suffix: str, header: str) -> bytes:
    """Encode the mesh with a header that states unit and jump limit, which no mesh format has keys for."""
    if suffix == ".obj":
        return mesh.export(file_type="obj", header=header, include_normals=False, digits=6).encode()
    if suffix == ".stl":
        return header.encode().ljust(80)[:80] + mesh.export(file_type="stl")[80:]
    content = mesh.export(file_type="ply", vertex_normal=False)
    start, rest = content.split(b"\nelement", 1)
    return start + b"\ncomment " + header.encode() + b"\nelement" + rest


def _header(triangles: Triangles) -> str:
    return f"fringecal {__version__}, mm, z up, jumps over {triangles.max_jump_mm:.3g} mm left open"


def _x3p_metadata(created: datetime | None) -> x3pio.Metadata:
    return x3pio.Metadata(
        date=created or datetime.now(UTC),
        instrument=x3pio.Instrument("fringecal", "fringe projection", "", __version__),
        probing_system=x3pio.ProbingSystem(x3pio.ProbingType.NON_CONTACTING, "fringe projection"),
        comment="height above the plate; x and y in the plate frame",
    )
