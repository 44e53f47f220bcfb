"""Formats of a height map that are written on request: point clouds, and Gwyddion's."""

from collections.abc import Sequence
from pathlib import Path

from fringecal.errors import RecordError
from fringecal.reconstruct import cloud_of_map
from fringecal.records.exports.cloud_files import FORMATS, demand_cloud_format, demand_package, write_cloud
from fringecal.records.exports.gwy_file import write_gwy
from fringecal.records.exports.triangles import Surface

FURTHER = (*FORMATS, "gwy")


def demand_further(forms: Sequence[str]) -> None:
    """Refuse a format that is none, or whose package is missing, before any work.

    Raises
    ------
    RecordError
        With what to do.
    """
    for form in forms:
        if form == "gwy":
            demand_package("gwyfile", form)
        elif form in FORMATS:
            demand_cloud_format(form)
        else:
            raise RecordError(f"a surface is also written as one of {', '.join(FURTHER)}, found {form!r}")


def write_further(
    folder: str | Path, surface: Surface, forms: Sequence[str], *, name: str = "height", spacing_mm: float | None = None
) -> tuple[Path, ...]:
    """Write a height map in further formats.

    Parameters
    ----------
    folder, surface, name
        Where, what, and the files' name without ending.
    forms
        Of `FURTHER`: every valid pixel as a point with u(z) (`ply`, `ply-text`, `las`, `e57`), or a grid (`gwy`).
    spacing_mm
        Of the grid; by default that of the samples.

    Raises
    ------
    RecordError
        As `demand_further`; or nothing is valid.
    """
    demand_further(forms)
    folder = Path(folder)
    paths = []
    for form in dict.fromkeys(forms):
        if form == "gwy":
            paths.append(write_gwy(folder / f"{name}.gwy", surface, spacing_mm=spacing_mm))
        else:
            paths.append(write_cloud(folder / f"{name}{FORMATS[form][0]}", cloud_of_map(surface), form))
    return tuple(paths)
