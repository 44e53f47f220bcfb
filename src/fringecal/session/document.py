"""The document `session.toml`, format 1, as pydantic models: what may be written in it and what may not."""

from pathlib import PurePath
from typing import Annotated, Literal, get_args

from pydantic import AwareDatetime, BaseModel, ConfigDict, Discriminator, Field, FiniteFloat, Tag, model_validator

from fringecal.targets import Quantity

FILE_NAME = "session.toml"

Kind = Literal["grid", "board", "reference", "strips", "artefact", "object"]
Channel = Literal["mean", "red", "green", "blue", "luma"]
Use = Literal["calibration", "verification"]
KINDS: tuple[str, ...] = get_args(Kind)

Bits = Annotated[int, Field(ge=8, le=16)]
Text = Annotated[str, Field(min_length=1)]
Axis = Literal["u", "v"]
Lengths = Annotated[list[Annotated[FiniteFloat, Field(gt=0)]], Field(min_length=1)]
Pixels = Annotated[int, Field(ge=2, le=65536)]


class _Table(BaseModel):
    """A table that refuses unknown keys and text where a number belongs."""

    model_config = ConfigDict(extra="forbid", strict=True, frozen=True)


class CameraTable(_Table):
    """What is known of the camera beforehand; everything optional."""

    model: Text | None = None
    height_mm: Quantity | None = None
    telecentric: bool = False
    bits: Bits | None = None
    channel: Channel | None = None

    @model_validator(mode="after")
    def _height_once(self) -> "CameraTable":
        if self.telecentric and self.height_mm is not None:
            raise ValueError(
                "height_mm and telecentric = true are two statements of one fact: "
                "a telecentric camera has no height; keep the one that is true"
            )
        if self.height_mm is not None and not _is_positive_scalar(self.height_mm):
            raise ValueError("height_mm must be one positive length: the entrance pupil above the plate")
        return self


class MirrorTable(_Table):
    """A plane mirror between lamp and plate: a point of its surface, and the direction across it."""

    point_mm: Quantity
    normal: Annotated[tuple[FiniteFloat, FiniteFloat, FiniteFloat], Field(strict=False)]

    @model_validator(mode="after")
    def _plane(self) -> "MirrorTable":
        _demand_point("point_mm", self.point_mm)
        if not any(self.normal):
            raise ValueError("normal must be a direction [nx, ny, nz] in the plate frame, not [0, 0, 0]")
        return self


class ProjectorTable(_Table):
    """What is known of the projector: where it stands nominally, seen in a mirror if there is one; its raster."""

    position_mm: Quantity | None = None
    mirror: MirrorTable | None = None
    resolution_px: Annotated[list[Pixels], Field(min_length=2, max_length=2)] | None = None
    pixel_aspect: Annotated[FiniteFloat, Field(gt=0)] | None = None
    pixels: Literal["square", "diamond"] | None = None

    @model_validator(mode="after")
    def _says_something(self) -> "ProjectorTable":
        if self.position_mm is None and self.resolution_px is None:
            raise ValueError("position_mm is missing, and resolution_px as well: one of them is what the table is for")
        if self.pixel_aspect is not None and self.pixels is not None:
            raise ValueError("pixel_aspect and pixels are two statements of one fact; keep one of them")
        if self.position_mm is None and self.mirror is not None:
            raise ValueError("a mirror without position_mm moves nothing: state where the projector itself stands")
        if self.position_mm is not None:
            _demand_point("position_mm", self.position_mm)
        return self


def _demand_point(key: str, place: Quantity) -> None:
    if not (isinstance(place.value, tuple) and len(place.value) == 3):
        raise ValueError(f"{key} must be {{ value = [x, y, z], u = [ux, uy, uz] }} in the plate frame")


class PhaseTable(_Table):
    """Phase shifts that hold for every phase-shifted capture that states none of its own."""

    steps_deg: list[FiniteFloat]


class AxisLengths(_Table):
    """Numbers of fringes that differ from one axis of the projector to the other."""

    u: Lengths | None = None
    v: Lengths | None = None


class AxisAngles(_Table):
    """Phase zeros that differ from one axis of the projector to the other."""

    u: list[FiniteFloat] | None = None
    v: list[FiniteFloat] | None = None


class AxisFiles(_Table):
    """Gray-code pictures of each axis of the projector."""

    u: list[Text] | None = None
    v: list[Text] | None = None


class MapTable(_Table):
    """A phase map made by another program: its file, which array of it, and along which axis it counts."""

    file: Text
    name: Text | None = None
    axis: Axis
    period: Annotated[FiniteFloat, Field(gt=0)] | None = None
    fringes: Annotated[FiniteFloat, Field(gt=0)] | None = None
    absolute: bool = False
    zero_deg: FiniteFloat = 0.0
    falling: bool = False
    u_rad: Annotated[FiniteFloat, Field(gt=0)] | None = None


IN_ONE, BY_AXIS = "one list for all", "a table by axis"  # tags of unions; no message shows them


def _form(stated: object) -> str:
    return BY_AXIS if isinstance(stated, dict | BaseModel) else IN_ONE


_BY_FORM = Discriminator(_form)
LengthsByAxis = Annotated[Annotated[Lengths, Tag(IN_ONE)] | Annotated[AxisLengths, Tag(BY_AXIS)], _BY_FORM]
AnglesByAxis = Annotated[Annotated[list[FiniteFloat], Tag(IN_ONE)] | Annotated[AxisAngles, Tag(BY_AXIS)], _BY_FORM]
FilesByAxis = Annotated[Annotated[list[Text], Tag(IN_ONE)] | Annotated[AxisFiles, Tag(BY_AXIS)], _BY_FORM]


class CaptureTable(_Table):
    """One capture: pictures of one thing, taken for one purpose.

    `images` are in the order repeat, then period, then step (the step changes fastest). An empty
    `steps_deg` says that the pictures are not phase-shifted. `gray` lists Gray-code pictures, the
    coarsest bit first. `use` says whether an artefact takes part in the calibration or stays independent of
    it, for verification: strips take part unless told otherwise, other artefacts stay out.
    With `axes` the images are in the order repeat, axis, period, step; `periods` are then in pixels of the
    projector, or `fringes` states their numbers across its picture. `patterns` names a `patterns.toml` that says axes,
    periods, zeros and phase shifts in their place. Captures of kind board with one `pose` show one place of the board.
    """

    name: Annotated[str, Field(pattern=r"^[^\s/\\][^/\\]*$")]
    kind: Kind
    target: Text | None = None
    images: list[Text]
    steps_deg: list[FiniteFloat] | None = None
    axes: Annotated[list[Axis], Field(min_length=1, max_length=2)] | None = None
    periods: LengthsByAxis | None = None
    fringes: LengthsByAxis | None = None
    zeros_deg: AnglesByAxis | None = None
    falling: list[Axis] | None = None
    gray: FilesByAxis | None = None
    maps: Annotated[list[MapTable], Field(min_length=1)] | None = None
    patterns: Text | None = None
    pose: Text | None = None
    white: list[Text] | None = None
    black: list[Text] | None = None
    repeat: Annotated[int, Field(ge=1)] = 1
    use: Use | None = None
    bits: Bits | None = None
    channel: Channel | None = None


class SessionDocument(_Table):
    """The whole of `session.toml`."""

    format: Literal[1]
    rig: Text
    captured: AwareDatetime
    operator: Text | None = None
    temperature_degC: FiniteFloat | None = None
    temperature_u_degC: Annotated[FiniteFloat, Field(ge=0)] | None = None
    minutes_since_power_on: Annotated[FiniteFloat, Field(ge=0)] | None = None
    camera: CameraTable = CameraTable()
    projector: ProjectorTable | None = None
    phase: PhaseTable | None = None
    capture: Annotated[list[CaptureTable], Field(min_length=1)]


def _is_positive_scalar(quantity: Quantity) -> bool:
    return isinstance(quantity.value, float) and quantity.value > 0


def is_inside(relative: str) -> bool:
    """Say whether a relative path stays inside the folder it starts from."""
    path = PurePath(relative)
    return bool(path.parts) and not path.is_absolute() and ".." not in path.parts
