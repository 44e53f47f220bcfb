"""What `fringecal check --json` prints, as a model with a published JSON Schema."""

import math
from importlib import resources
from typing import Any, Literal

from pydantic import AwareDatetime, BaseModel, ConfigDict, Field

from fringecal.session.captures import Capture
from fringecal.session.checking import SessionCheck
from fringecal.session.fringes.fringe_axes import FringeAxis

SCHEMA_FILE = "check.schema.json"


class _Row(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class ImageRow(_Row):
    """One picture file."""

    file: str = Field(description="Path relative to the session folder.")
    sha256: str = Field(pattern=r"^[0-9a-f]{64}$")


class AxisRow(_Row):
    """Fringes that vary along one axis of the projector."""

    axis: str = Field(description="u counts the projector's columns, v its rows.")
    extent_px: int
    periods_px: list[float]
    zeros_deg: list[float]


class CaptureRow(_Row):
    """One capture as it was read."""

    name: str
    kind: str
    target: str | None = Field(description="Kind of the target, null where the capture has none.")
    target_name: str | None = Field(default=None, description="What the target's file calls it.")
    width_px: int
    height_px: int
    bits: int = Field(description="Bits of the container, 8 or 16.")
    white_level: int = Field(description="Value of a saturated pixel.")
    channel: str | None
    steps_deg: list[float]
    periods: list[float]
    repeat: int
    use: str = Field(description="calibration or verification.")
    images: list[ImageRow]
    gray: list[ImageRow]
    maps: list[ImageRow] = Field(default=[], description="Phase maps in place of frames.")
    axes: list[AxisRow] = Field(default=[], description="Of the projector's raster, in the order of the images.")
    white: list[ImageRow] = []
    black: list[ImageRow] = []


class FaultRow(_Row):
    """One reason to refuse the session."""

    where: str
    found: str
    remedy: str


class CheckReport(_Row):
    """Outcome of `fringecal check`."""

    format: Literal["fringecal-check/1"] = "fringecal-check/1"
    folder: str
    ok: bool
    rig: str | None = Field(description="Null where there are faults, as are the next two.")
    captured: AwareDatetime | None
    captures: list[CaptureRow] | None
    faults: list[FaultRow]
    notes: list[str]


def check_report(check: SessionCheck) -> CheckReport:
    """Put the outcome of a check into the form that is printed as JSON."""
    session = check.session
    return CheckReport(
        folder=str(check.folder),
        ok=session is not None,
        rig=session.rig if session else None,
        captured=session.captured if session else None,
        captures=[_capture_row(c, check) for c in session.captures.values()] if session else None,
        faults=[FaultRow(where=f.where, found=f.found, remedy=f.remedy) for f in check.faults],
        notes=list(check.notes),
    )


def _capture_row(capture: Capture, check: SessionCheck) -> CaptureRow:
    def rows(paths: tuple[Any, ...], hashes: tuple[str, ...]) -> list[ImageRow]:
        names = (path.relative_to(check.folder).as_posix() for path in paths)
        return [ImageRow(file=name, sha256=h) for name, h in zip(names, hashes, strict=True)]

    return CaptureRow(
        name=capture.name,
        kind=capture.kind,
        target=capture.target.kind if capture.target else None,
        target_name=capture.target.name if capture.target else None,
        width_px=capture.shape[1],
        height_px=capture.shape[0],
        bits=capture.bits,
        white_level=capture.white_level,
        channel=capture.channel,
        steps_deg=[round(math.degrees(step), 9) for step in capture.phase_shifts_rad],
        periods=list(capture.periods),
        repeat=capture.repeat,
        use=capture.use,
        images=rows(capture.paths, capture.sha256),
        gray=rows(capture.gray_paths, capture.gray_sha256),
        maps=rows(tuple(m.path for m in capture.maps), tuple(m.sha256 for m in capture.maps)),
        axes=[_axis_row(axis) for axis in capture.axes],
        white=rows(capture.white_paths, capture.white_sha256),
        black=rows(capture.black_paths, capture.black_sha256),
    )


def _axis_row(axis: FringeAxis) -> AxisRow:
    zeros = [round(math.degrees(zero), 9) for zero in axis.zeros_rad]
    return AxisRow(axis=axis.name, extent_px=axis.extent_px, periods_px=list(axis.periods_px), zeros_deg=zeros)


def check_schema() -> dict[str, Any]:
    """Make the JSON Schema (2020-12) of the report from its model.

    Examples
    --------
    >>> check_schema()["type"]
    'object'
    """
    schema = CheckReport.model_json_schema(mode="serialization")
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", "title": "fringecal check", **schema}


def published_schema() -> str:
    """Read the schema as it is shipped."""
    return (resources.files("fringecal.session") / "schema" / SCHEMA_FILE).read_text(encoding="utf-8")
