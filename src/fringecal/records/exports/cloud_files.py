"""Point clouds on disk, each point with its uncertainty: PLY (binary and text), LAS and E57."""

import hashlib
import importlib.util
import uuid
from pathlib import Path
from typing import Any

import numpy as np

from fringecal import __version__
from fringecal.errors import RecordError
from fringecal.reconstruct import PointCloud
from fringecal.records.files import replacing

_MM = 1e-3
#: Name of a format, the file's ending, and the package that writes it.
FORMATS: dict[str, tuple[str, str | None]] = {
    "ply": ("-cloud.ply", None),
    "ply-text": ("-cloud-text.ply", None),
    "las": (".las", "laspy"),
    "e57": (".e57", "pye57"),
}
LAS_STEP_MM = 1e-5  # LAS counts whole steps in 32 bit: 10 nm reach 21 m to either side
_LAS_REACH_MM = LAS_STEP_MM * 2**31
_E57_EXTENSION = ("fringecal", "urn:fringecal:e57:uncertainty:1")
"""Prefix and name of the extension that holds the uncertainties; the standard has no field for them."""
_GUID_SPACE = uuid.UUID("5f1f5f0e-5b5c-4b8e-9d0f-0c0d9a1f57e5")
"""Space of the names from which scans are numbered: the same points give the same number, as E57 wants one."""


def demand_cloud_format(name: str) -> None:
    """Refuse a format that is none, or whose package is missing, before any work.

    Raises
    ------
    RecordError
        With what to do.
    """
    if name not in FORMATS:
        raise RecordError(f"a point cloud is written as one of {', '.join(FORMATS)}, found {name!r}")
    demand_package(FORMATS[name][1], name)


def demand_package(package: str | None, name: str) -> None:
    """Refuse a format whose package is not installed."""
    if package is not None and importlib.util.find_spec(package) is None:
        raise RecordError(f"{name} is written by {package}, which is not installed; install fringecal[clouds]")


def write_cloud(path: str | Path, cloud: PointCloud, form: str) -> Path:
    """Write a point cloud, whole or not at all.

    Parameters
    ----------
    path
        File to write.
    cloud
        Points in mm, with their uncertainty.
    form
        "ply" (binary, little-endian), "ply-text", "las" (1.4, uncertainties as extra dimensions, mm) or "e57" (metres,
        as its standard asks, uncertainties in an extension).

    Raises
    ------
    RecordError
        The format is none or its package is missing, or LAS cannot hold a coordinate.
    """
    demand_cloud_format(form)
    write = {"ply": _write_ply, "ply-text": _write_ply_text, "las": _write_las, "e57": _write_e57}[form]
    with replacing(path) as sibling:
        write(sibling, cloud)
    return Path(path)


def _rows(cloud: PointCloud) -> np.ndarray[Any, np.dtype[Any]]:
    """Points as rows of named numbers: coordinates in float64, uncertainties in float32."""
    known = cloud.known_u
    rows = np.empty(len(cloud), dtype=[(axis, "<f8") for axis in "xyz"] + [(name, "<f4") for name in known])
    for axis, column in zip("xyz", cloud.points_mm.T, strict=True):
        rows[axis] = column
    for name, column in known.items():
        rows[name] = column
    return rows


def _ply_head(rows: np.ndarray[Any, np.dtype[Any]], cloud: PointCloud, form: str) -> str:
    names = rows.dtype.names or ()
    kinds = "".join(f"property {'double' if len(name) == 1 else 'float'} {name}\n" for name in names)
    return (
        f"ply\nformat {form} 1.0\n"
        f"comment fringecal {__version__}, mm, {cloud.frame} frame, u is a standard uncertainty\n"
        f"element vertex {len(rows)}\n{kinds}end_header\n"
    )


def _write_ply(path: Path, cloud: PointCloud) -> None:
    rows = _rows(cloud)
    with path.open("wb") as file:
        file.write(_ply_head(rows, cloud, "binary_little_endian").encode())
        file.write(rows.tobytes())


def _write_ply_text(path: Path, cloud: PointCloud) -> None:
    rows = _rows(cloud)
    numbers = np.column_stack([rows[name] for name in rows.dtype.names or ()])
    formats = ["%.6f"] * 3 + ["%.6g"] * (numbers.shape[1] - 3)
    with path.open("w", encoding="utf-8", newline="\n") as file:
        file.write(_ply_head(rows, cloud, "ascii"))
        np.savetxt(file, numbers, fmt=formats, newline="\n")


def _write_las(path: Path, cloud: PointCloud) -> None:
    import laspy

    if np.abs(cloud.points_mm).max() >= _LAS_REACH_MM:
        raise RecordError(f"LAS counts steps of {LAS_STEP_MM:g} mm and reaches {_LAS_REACH_MM / 1e3:.0f} m; write E57")
    header = laspy.LasHeader(point_format=6, version="1.4")
    header.scales = np.full(3, LAS_STEP_MM)
    header.offsets = np.zeros(3)
    header.system_identifier = f"{cloud.frame} frame, mm"[:32]
    header.generating_software = f"fringecal {__version__}"[:32]
    known = cloud.known_u
    header.add_extra_dims(
        [laspy.ExtraBytesParams(name, np.dtype("f4"), f"standard uncertainty {name[-1]}, mm") for name in known]
    )
    las = laspy.LasData(header)
    las.x, las.y, las.z = cloud.points_mm.T
    for name, column in known.items():
        las[name] = column.astype(np.float32)
    las.write(str(path))


def _write_e57(path: Path, cloud: PointCloud) -> None:
    import pye57

    names = {f"cartesian{axis.upper()}": column * _MM for axis, column in zip("xyz", cloud.points_mm.T, strict=True)}
    known = {f"{_E57_EXTENSION[0]}:{name}": column * _MM for name, column in cloud.known_u.items()}
    file = pye57.E57(str(path), mode="w")
    try:
        file.image_file.extensionsAdd(*_E57_EXTENSION)
        _append_scan(pye57.libe57, file, cloud, names | known)
    finally:
        file.close()


def _append_scan(lib: Any, file: Any, cloud: PointCloud, columns: dict[str, np.ndarray]) -> None:
    """Append one scan by the library's own calls: its Python layer knows the standard's fields alone."""
    image = file.image_file
    scan, prototype = lib.StructureNode(image), lib.StructureNode(image)
    guid = uuid.uuid5(_GUID_SPACE, hashlib.sha256(cloud.points_mm.tobytes()).hexdigest())
    scan.set("guid", lib.StringNode(image, f"{{{guid}}}"))
    scan.set("name", lib.StringNode(image, f"{cloud.frame} frame"))
    scan.set("description", lib.StringNode(image, f"fringecal {__version__}; u is a standard uncertainty, metres"))
    for name in columns:
        prototype.set(name, lib.FloatNode(image, 0.0, lib.E57_DOUBLE, lib.E57_DOUBLE_MIN, lib.E57_DOUBLE_MAX))
    codecs = lib.VectorNode(image, True)
    points = lib.CompressedVectorNode(image, prototype, codecs)
    scan.set("points", points)
    file.data3d.append(scan)
    buffers = lib.VectorSourceDestBuffer()
    kept = [np.ascontiguousarray(column, dtype=float) for column in columns.values()]
    for name, column in zip(columns, kept, strict=True):
        buffers.append(lib.SourceDestBuffer(image, name, column, len(column), True, True))
    points.writer(buffers).write(len(cloud))
