"""A camera and a projector from the files of other programs, or a camera alone where that is all they hold."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fringecal.camera import Lens
from fringecal.errors import RecordError
from fringecal.guarded import MOST_LENS, Refusal, bytes_of
from fringecal.projector import StatedPair
from fringecal.records.exports.cameramodel import lens_of_model
from fringecal.records.foreign.bouguet import bouguet_lens, bouguet_pair
from fringecal.records.foreign.lens_files import MATLAB, MODEL, STORAGE, entries_of_bytes
from fringecal.records.foreign.named_values import (
    LAYOUTS,
    MM_PER_M,
    Size,
    array_of,
    lens_of_entries,
    pair_of_entries,
    rotation_of,
    shift_of,
)

Array = NDArray[np.float64]

#: Names of rectification and projection matrix in ROS's camera_info, as its files and its topics have them.
_ROS = (("rectification_matrix", "projection_matrix"), ("R", "P"), ("r", "p"))


def read_pair(
    paths: Sequence[str | Path],
    *,
    camera_size: Size | None = None,
    projector_size: Size | None = None,
    unit_mm: float | None = None,
) -> StatedPair:
    """Read a camera and a projector.

    Parameters
    ----------
    paths
        One file that holds both (OpenCV's YAML or XML by the names that docs/camera.md lists, SLStudio's `.xml` and
        `.slcalib`, SLMaster's `caliInfo.yml`, Bouguet's `Calib_Results_stereo.mat`), or two, the camera's first:
        `.cameramodel`, ROS's camera_info, or OpenCV's intrinsics and extrinsics.
    camera_size, projector_size
        Width and height of the picture and of the projector's frame, px; they are needed where the file has none.
    unit_mm
        Millimetres of the file's unit of length; by default 1, and 1000 for ROS, whose files are in metres.

    Raises
    ------
    RecordError
        A file cannot be read, does not hold both, or states what is none.
    """
    found = read_stated(paths, camera_size=camera_size, projector_size=projector_size, unit_mm=unit_mm)
    if isinstance(found, Lens):
        raise RecordError(f"{paths[0]}: holds one lens; a camera and a projector were needed, give the other one too")
    return found


def read_stated(
    paths: Sequence[str | Path],
    *,
    camera_size: Size | None = None,
    projector_size: Size | None = None,
    unit_mm: float | None = None,
) -> StatedPair | Lens:
    """Read what files state: a camera and a projector, or a camera alone.

    Parameters and errors are those of `read_pair`.
    """
    if len(paths) not in (1, 2):
        raise RecordError(f"{len(paths)} files: a calibration is in one file, or in two, the camera's first")
    forms, entries = zip(*(_taken_apart(path) for path in paths), strict=True)
    try:
        if len(paths) == 2:
            return _of_two(forms, entries, (camera_size, projector_size), unit_mm)
        return _of_one(forms[0], entries[0], (camera_size, projector_size), unit_mm or 1.0)
    except (RecordError, Refusal) as error:
        raise RecordError(f"{' and '.join(map(str, paths))}: {error}") from error


def _taken_apart(path: str | Path) -> tuple[str, dict[str, Any]]:
    try:
        return entries_of_bytes(bytes_of(path, MOST_LENS))
    except Refusal as error:
        raise RecordError(f"{path}: {error}") from error


def _of_one(
    form: str, entries: Mapping[str, Any], sizes: tuple[Size | None, Size | None], unit_mm: float
) -> StatedPair | Lens:
    if form == MODEL:
        return lens_of_model(dict(entries))
    if form == MATLAB:
        if "fc" in entries:
            return bouguet_lens(entries, sizes[0])
        return bouguet_pair(entries, camera_size=sizes[0], projector_size=sizes[1], unit_mm=unit_mm)
    if any(all(name in entries for name in (*each.camera, *each.projector)) for each in LAYOUTS):
        return pair_of_entries(entries, camera_size=sizes[0], projector_size=sizes[1], unit_mm=unit_mm)
    return lens_of_entries(entries, sizes[0])


def _of_two(
    forms: Sequence[str],
    entries: Sequence[dict[str, Any]],
    sizes: tuple[Size | None, Size | None],
    unit_mm: float | None,
) -> StatedPair:
    if set(forms) == {MODEL}:
        return _mrcal_pair(entries, unit_mm or 1.0)
    if set(forms) != {STORAGE}:
        raise RecordError("two .cameramodel, two camera_info of ROS, or OpenCV's intrinsics and extrinsics were needed")
    if all(_ros_names(each) is not None for each in entries):
        return _ros_pair(entries, sizes, unit_mm or MM_PER_M)
    return pair_of_entries(
        entries[0] | entries[1], camera_size=sizes[0], projector_size=sizes[1], unit_mm=unit_mm or 1.0
    )


def _mrcal_pair(entries: Sequence[dict[str, Any]], unit_mm: float) -> StatedPair:
    """Return the pair of two `.cameramodel`: each says how the common reference stands to it."""
    lenses = [lens_of_model(each) for each in entries]
    rotations, shifts = zip(*(_pose(each) for each in entries), strict=True)
    rotation = rotations[1] @ rotations[0].T
    shift = shifts[1] - rotation @ shifts[0]
    regions = {
        who: region
        for who, each in zip(("camera", "projector"), entries, strict=True)
        if (region := _region(each)).size
    }
    return StatedPair(lenses[0], lenses[1], rotation, shift * unit_mm, "mrcal", valid_px=regions)


def _pose(entries: Mapping[str, Any]) -> tuple[Array, Array]:
    stated = array_of(entries, "rt_cam_ref")
    stated = array_of(entries, "extrinsics") if stated is None else stated
    if stated is None or stated.size != 6:
        raise RecordError("extrinsics are missing or no six numbers: how the devices stand to each other is not said")
    return rotation_of(stated.ravel()[:3]), shift_of(stated.ravel()[3:])


def _region(entries: Mapping[str, Any]) -> Array:
    """Return the contour inside which a model says that it holds; empty where it says nothing of it."""
    stated = array_of(entries, "valid_intrinsics_region")
    if stated is None or not stated.size:
        return np.zeros((0, 2))
    if stated.ndim != 2 or stated.shape[1] != 2 or not np.isfinite(stated).all():
        raise RecordError("valid_intrinsics_region is no list of places in the picture; leave it out or write it anew")
    return stated


def _ros_names(entries: Mapping[str, Any]) -> tuple[str, str] | None:
    return next((pair for pair in _ROS if all(name in entries for name in pair)), None)


def _ros_pair(entries: Sequence[dict[str, Any]], sizes: tuple[Size | None, Size | None], unit_mm: float) -> StatedPair:
    """Return the pair of two camera_info: both turn into one rectified frame, in which the second is shifted."""
    camera, projector = (lens_of_entries(each, size) for each, size in zip(entries, sizes, strict=True))
    turns, projections = zip(*(_rectified(each) for each in entries), strict=True)
    shifts = [np.array([p[0, 3] / p[0, 0], p[1, 3] / p[1, 1], 0.0]) for p in projections]
    rotation = turns[1].T @ turns[0]
    shift = turns[1].T @ (shifts[1] - shifts[0])
    return StatedPair(camera, projector, rotation_of(rotation), shift_of(shift) * unit_mm, "ROS")


def _rectified(entries: Mapping[str, Any]) -> tuple[Array, Array]:
    names = _ros_names(entries)
    assert names is not None  # whoever asks has seen it
    turn, projection = (array_of(entries, name) for name in names)
    if turn is None or projection is None or turn.size != 9 or projection.size != 12:
        raise RecordError(f"{names[0]} (3 x 3) or {names[1]} (3 x 4) is none; export the calibration anew")
    matrix = projection.reshape(3, 4)
    if not np.isfinite(matrix).all() or not (matrix[0, 0] > 0 and matrix[1, 1] > 0):
        raise RecordError(f"{names[1]} holds no positive focal lengths; export the calibration anew")
    return rotation_of(turn), matrix
