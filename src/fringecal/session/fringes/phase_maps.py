"""Phase maps that another program has made: `.npy`, `.npz` and `.mat`, read within limits and hashed."""

import hashlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fringecal.guarded import Refusal
from fringecal.guarded_arrays import (
    MAGIC_HDF5,
    MAGIC_MATLAB,
    MAGIC_NPY,
    MAGIC_ZIP,
    archive_of,
    array_of,
    matlab_of,
)
from fringecal.session.document import CaptureTable, MapTable, SessionDocument
from fringecal.session.faults import Fault, PictureError, hint, joined
from fringecal.session.model_file import outside_fault
from fringecal.session.pictures.size_limits import MOST_BYTES, regular_bytes

Array = NDArray[np.float64]


@dataclass(frozen=True)
class StatedMap:
    """One phase map of a capture.

    Parameters
    ----------
    axis, extent_px
        Along which axis of the projector its phase changes, and the projector's pixels along it.
    period_px
        Fringe period in these pixels.
    phase_rad
        (H, W), rad; NaN where there is none.
    path, sha256
        Its file.
    absolute
        Whether fringes are counted in it from the projector's edge on; else it is wrapped.
    zero_rad
        Phase at the centre of the projector's first pixel.
    falls
        Whether the phase falls where the projector's pixels are counted up.
    u_rad
        Standard uncertainty of the phase, rad.
    """

    axis: str
    extent_px: int
    period_px: float
    phase_rad: Array
    path: Path
    sha256: str
    absolute: bool
    zero_rad: float
    falls: bool
    u_rad: float


def read_maps(
    folder: Path, table: CaptureTable, document: SessionDocument, label: str
) -> tuple[tuple[StatedMap, ...], list[Fault]]:
    """Read the phase maps of a capture, and say what is wrong with each.

    Parameters
    ----------
    folder, table, document
        The session, and what it says of the capture.
    label
        How messages name the capture.
    """
    stated = table.maps or []
    resolution = None if document.projector is None else document.projector.resolution_px
    if stated and resolution is None:
        remedy = "write [projector] resolution_px = [columns, rows]"
        return (), [Fault(f"{label}: maps", "the projector's pixels are not stated, which a phase counts", remedy)]
    found: list[StatedMap] = []
    faults: list[Fault] = []
    for k, one in enumerate(stated):
        where = f"{label}: maps[{k + 1}]"
        try:
            found.append(_read(folder, one, resolution or [0, 0]))
        except PictureError as error:
            faults.append(Fault(where, error.found, error.remedy))
    return tuple(found), [*faults, *_together(found, label)]


def _read(folder: Path, stated: MapTable, resolution: Sequence[int]) -> StatedMap:
    extent = resolution["uv".index(stated.axis)]
    period = extent / stated.fringes if stated.fringes is not None else stated.period
    if period is None or (stated.period is not None and stated.fringes is not None):
        raise PictureError("one of period and fringes is needed, and one only", "state period in px, or fringes")
    outside = outside_fault(folder, stated.file, "")
    if outside is not None:
        raise PictureError(outside.found, outside.remedy)
    path = folder / stated.file
    content = regular_bytes(path)
    phase = _phase(_arrays(content), stated)
    return StatedMap(
        stated.axis,
        extent,
        period,
        phase,
        path,
        hashlib.sha256(content).hexdigest(),
        stated.absolute,
        float(np.deg2rad(stated.zero_deg)),
        stated.falling,
        _noise(phase) if stated.u_rad is None else stated.u_rad,
    )


def _arrays(content: bytes) -> dict[str, Any]:
    """Return the arrays of a file by name; a lone one has the name ""."""
    try:
        if content.startswith(MAGIC_NPY):
            return {"": array_of(content)}
        if content.startswith(MAGIC_ZIP):
            return archive_of(content, MOST_BYTES)
        if content.startswith(MAGIC_MATLAB):
            return dict[str, Any](matlab_of(content, MOST_BYTES))
    except Refusal as error:
        raise PictureError(str(error), "save the map again") from error
    if content.startswith(MAGIC_HDF5):
        raise PictureError(
            "is HDF5 (.mat of version 7.3 is, too), which is not read", "save the phase as .npz or .mat -v7"
        )
    raise PictureError("is no .npy, .npz or .mat file", "save the phase as one of them")


def _phase(arrays: dict[str, Any], stated: MapTable) -> Array:
    """Choose the array that is meant; a phase is one finite number a pixel, and NaN elsewhere."""
    name = stated.name if stated.name is not None else (next(iter(arrays)) if len(arrays) == 1 else None)
    if name is None or name not in arrays:
        names = joined(sorted(arrays)) or "no array"
        asked = "which one is meant is not stated" if name is None else f"there is no {name!r}"
        raise PictureError(f"holds {names}; {asked}", f"state name; {hint(name or '', arrays)}")
    phase = np.asarray(arrays[name])
    if phase.ndim != 2 or phase.dtype.kind not in "fiu" or not phase.size:  # noqa: PLR2004 -- rows and columns
        raise PictureError(f"holds {phase.dtype} of shape {phase.shape}", "a map is (H, W) of real numbers, rad")
    if phase.size > MOST_BYTES // np.dtype(np.float64).itemsize:
        raise PictureError(f"holds {phase.size} pixels, more than are read", "save the part that is needed")
    phase = phase.astype(np.float64)
    phase[~np.isfinite(phase)] = np.nan
    if not np.isfinite(phase).any():
        raise PictureError("holds no finite number", "save the phase in rad, NaN where there is none")
    return phase


def _noise(phase: Array) -> float:
    """Estimate a map's noise by second differences along rows, up to whole turns; rad."""
    bends = phase[:, :-2] - 2 * phase[:, 1:-1] + phase[:, 2:]
    bends = np.abs(bends - 2 * np.pi * np.round(bends / (2 * np.pi)))
    known = bends[np.isfinite(bends)]
    return float(1.4826 * np.median(known) / np.sqrt(6)) if known.size else 0.0


def _together(maps: Sequence[StatedMap], label: str) -> Iterator[Fault]:
    """See that the maps of a capture are of one size, and that each axis has one reading."""
    sizes = sorted({f"{one.phase_rad.shape[1]} x {one.phase_rad.shape[0]} px" for one in maps})
    if len(sizes) > 1:
        yield Fault(f"{label}: maps", f"maps differ: {joined(sizes)}", "give maps of one picture")
    for axis in "uv":
        of_axis = [one for one in maps if one.axis == axis]
        if sum(one.absolute for one in of_axis) > 1 or len({one.falls for one in of_axis}) > 1:
            yield Fault(
                f"{label}: maps",
                f"several absolute maps, or both directions, along {axis}",
                "give one absolute map for each axis, or wrapped ones of one direction",
            )
