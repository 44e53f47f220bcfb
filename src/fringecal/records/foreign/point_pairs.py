"""Lists of places that belong together, camera and projector, pose by pose: CSV, or arrays of npz and .mat."""

import csv
import io
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fringecal.errors import RecordError
from fringecal.guarded import MIB, Refusal, bytes_of, quoted, shortened, text_of
from fringecal.guarded_arrays import MAGIC_HDF5, MAGIC_MATLAB, MAGIC_ZIP, archive_of, matlab_of
from fringecal.projector import PointPairs

Array = NDArray[np.float64]

MOST_PAIRS_FILE = 64 * MIB  # a million pairs with the board's points take 60 MiB as text
MOST_POSES = 10_000
_PLACES = (("camera_u_px", "camera_v_px"), ("projector_u_px", "projector_v_px"))
_BOARD = ("x_mm", "y_mm", "z_mm")
_NEEDED = (
    "columns pose, camera_u_px, camera_v_px, projector_u_px, projector_v_px and, of a board, x_mm, y_mm (, z_mm); or "
    "arrays camera_px and projector_px (poses, n, 2) and board_mm (poses, n, 3)"
)


def read_point_pairs(path: str | Path) -> tuple[PointPairs, ...]:
    """Read places that belong together, one value for each pose.

    Parameters
    ----------
    path
        A CSV with a row for each pair, or an `.npz` or `.mat` with arrays; docs/camera.md says which. A projector's
        coordinate that is not known is empty, or NaN.

    Raises
    ------
    RecordError
        The file cannot be read, lacks a column or array, or holds what is no number.
    """
    try:
        content = bytes_of(path, MOST_PAIRS_FILE)
        if content.startswith(MAGIC_ZIP):
            return _of_arrays(archive_of(content))
        if content.startswith((MAGIC_MATLAB, MAGIC_HDF5)):
            return _of_arrays(matlab_of(content))
        return _of_rows(text_of(content))
    except (Refusal, RecordError) as error:
        raise RecordError(f"{path}: {error}; needed: {_NEEDED}") from error
    except (ValueError, OSError, csv.Error) as error:
        raise RecordError(f"{path}: cannot be taken apart ({shortened(error)}); needed: {_NEEDED}") from error


def _of_arrays(arrays: Mapping[str, Any]) -> tuple[PointPairs, ...]:
    places = [_stack(arrays, name, 2) for name in ("camera_px", "projector_px")]
    if places[0].shape != places[1].shape:
        raise RecordError(f"camera_px {places[0].shape} and projector_px {places[1].shape} are not alike")
    board = _stack(arrays, "board_mm", 3) if "board_mm" in arrays else None
    if board is not None and len(board) == 1:
        board = np.broadcast_to(board, (len(places[0]), *board.shape[1:]))
    if board is not None and board.shape[:2] != places[0].shape[:2]:
        raise RecordError(f"board_mm {board.shape} has not the points of camera_px {places[0].shape}")
    return tuple(_pose(places[0][k], places[1][k], None if board is None else board[k]) for k in range(len(places[0])))


def _stack(arrays: Mapping[str, Any], name: str, width: int) -> Array:
    if name not in arrays:
        raise RecordError(f"{name} is missing")
    found = np.asarray(arrays[name], dtype=float)
    found = found[None] if found.ndim == 2 else found
    if found.ndim != 3 or found.shape[2] != width or not 0 < len(found) <= MOST_POSES:
        raise RecordError(f"{name} has the shape {found.shape}, (poses, n, {width}) was needed")
    return found


def _of_rows(text: str) -> tuple[PointPairs, ...]:
    rows = csv.reader(io.StringIO(text))
    head = [name.strip() for name in next(rows, [])]
    missing = [name for pair in _PLACES for name in pair if name not in head]
    if missing:
        raise RecordError(f"column {missing[0]} is missing")
    numbers: dict[str, list[list[float]]] = {}
    names = [*_PLACES[0], *_PLACES[1], *(name for name in _BOARD if name in head)]
    at = [head.index(name) for name in names]
    pose_at = head.index("pose") if "pose" in head else None
    for line, row in enumerate(rows, start=2):
        if not any(cell.strip() for cell in row):
            continue
        if len(row) != len(head):
            raise RecordError(f"line {line} has {len(row)} fields, {len(head)} were needed")
        pose = "" if pose_at is None else row[pose_at].strip()
        numbers.setdefault(pose, []).append([_number(row[k], line) for k in at])
    if not 0 < len(numbers) <= MOST_POSES:
        raise RecordError(f"{len(numbers)} poses; 1 to {MOST_POSES} are read")
    return tuple(_of_columns(np.array(rows_of)) for rows_of in numbers.values())


def _of_columns(table: Array) -> PointPairs:
    board = table[:, 4:] if table.shape[1] > 5 else None
    if board is not None and board.shape[1] == 2:
        board = np.column_stack([board, np.zeros(len(board))])
    return _pose(table[:, :2], table[:, 2:4], board)


def _pose(camera: Array, projector: Array, board: Array | None) -> PointPairs:
    """Return a pose without the points that the camera does not see."""
    seen = np.isfinite(camera).all(axis=1) & (board is None or np.isfinite(board).all(axis=1))
    return PointPairs(camera[seen], projector[seen], None if board is None else np.array(board[seen]))


def _number(cell: str, line: int) -> float:
    if not cell.strip():
        return float("nan")
    try:
        return float(cell)
    except ValueError as error:
        raise RecordError(f"line {line}: {quoted(cell)} is no number") from error
