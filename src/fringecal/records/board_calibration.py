"""The record of a rig calibrated by a board in poses: camera and inverse camera, and what it rests on."""

from pathlib import Path
from typing import Any, Final, Literal, Self

from pydantic import Field, model_validator

from fringecal.errors import RecordError
from fringecal.guarded import Refusal, is_folder, json_of, text_of
from fringecal.records.calibration_record import CALIBRATION_FILE, ImageRecord
from fringecal.records.documents import document_of_bytes, record_bytes, write_document
from fringecal.records.limits import Limits
from fringecal.records.parts import Check, Dof, EstimateRecord, Matrix, Part, Provenance, is_covariance

BOARD_CALIBRATION_FORMAT: Final = "fringecal-board-calibration/1"
Triple = tuple[float, float, float]


class RasterRecord(Part):
    """How fringes count the projector's pixels along one axis.

    Counted is along `axis` from 0 at the centre of the first pixel; `zeros_rad` is the phase of each period there.
    """

    axis: Literal["u", "v"]
    extent_px: int = Field(gt=0)
    periods_px: tuple[float, ...]
    zeros_rad: tuple[float, ...]
    falls: bool = Field(description="the phase falls where pixels are counted up")


class PoseRecord(Part):
    """One pose of the board: what was seen of it, what is left of its points, or why it was left aside."""

    name: str
    used: bool
    reason: str = ""
    corners: int = Field(ge=0)
    lit: int = Field(ge=0, description="corners with a coordinate of the projector")
    camera_rms_px: float | None = None
    projector_rms_px: float | None = None
    tilt_deg: float | None = None
    distance_mm: float | None = None


class VolumeRecord(Part):
    """Where boards were, and how well the rig knows points there."""

    points_mm: tuple[Triple, ...] = Field(description="in the camera's frame")
    u_least_mm: float = Field(ge=0, description="root of the sum of squares over x, y, z, of the rig's part alone")
    u_largest_mm: float = Field(ge=0)


class BoardCalibrationRecord(Provenance):
    """The calibration of a rig by a board in poses, as written to ``calibration.json``.

    Points of the camera's frame (x right, y down, z forward from its centre, mm) are lit by the projector's place that
    `projector` images `rotation X + shift` to; `parameters` and `covariance` are in the order of `names`, turns count
    from `rotation`.
    """

    format: Literal["fringecal-board-calibration/1"] = BOARD_CALIBRATION_FORMAT
    image: ImageRecord
    columns: int = Field(gt=0, description="of the projector")
    rows: int = Field(gt=0, description="of the projector")
    names: tuple[str, ...]
    parameters: tuple[float, ...]
    rotation: tuple[Triple, Triple, Triple]
    covariance: Matrix
    dof: Dof = None
    camera_rms_px: float = Field(ge=0)
    projector_rms_px: float = Field(ge=0)
    stereo_rms_px: float = Field(ge=0)
    camera_s_px: float = Field(ge=0)
    projector_s_px: float = Field(ge=0)
    axes: tuple[Literal["u", "v"], ...]
    undetermined: tuple[str, ...] = ()
    raster: tuple[RasterRecord, ...]
    poses: tuple[PoseRecord, ...]
    volume: VolumeRecord
    board: dict[str, EstimateRecord] = Field(default_factory=dict, description="stretch and warp of the board, solved")
    baseline_mm: EstimateRecord
    angle_deg: EstimateRecord = Field(description="between the two axes")
    checks: tuple[Check, ...] = ()
    limits: Limits | None = None
    targets: dict[str, dict[str, Any]] = Field(default_factory=dict)
    notes: tuple[str, ...] = ()

    @model_validator(mode="after")
    def _sizes_agree(self) -> Self:
        if len(self.names) != len(self.parameters) or not is_covariance(self.covariance, len(self.names)):
            raise ValueError(f"{len(self.parameters)} parameters need as many names and a covariance of that size")
        return self


def board_calibration_of_bytes(content: bytes, name: str) -> BoardCalibrationRecord:
    """Read a board calibration from the bytes of its file; `name` is what a refusal calls it.

    Raises
    ------
    RecordError
        Not JSON, of another or a newer format, or damaged.
    """
    return document_of_bytes(content, BoardCalibrationRecord, BOARD_CALIBRATION_FORMAT, name=name)


def states_board_calibration(content: bytes) -> bool:
    """Tell whether the bytes of a file state the format of a calibration by a board; what cannot be read does not."""
    try:
        return json_of(text_of(content)).get("format") == BOARD_CALIBRATION_FORMAT
    except Refusal:
        return False


def is_board_calibration(path: str | Path) -> bool:
    """Tell whether a file states the format of a calibration by a board; what cannot be read does not."""
    try:
        return states_board_calibration(record_bytes(_file(path)))
    except RecordError:
        return False


def _file(path: str | Path) -> Path:
    return Path(path) / CALIBRATION_FILE if is_folder(path) else Path(path)


def read_board_calibration(path: str | Path) -> BoardCalibrationRecord:
    """Read a board calibration from its file, or from the folder that holds it.

    Raises
    ------
    RecordError
        As `board_calibration_of_bytes`; or the file cannot be read.
    """
    return board_calibration_of_bytes(record_bytes(_file(path)), str(path))


def write_board_calibration(record: BoardCalibrationRecord, folder: str | Path) -> Path:
    """Write ``calibration.json`` into a folder, whole or not at all, and return its path."""
    return write_document(record, Path(folder) / CALIBRATION_FILE)
