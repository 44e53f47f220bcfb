"""The document `session.toml`, format 1, as pydantic models: what may be written in it and what may not."""

from pathlib import PurePath
from typing import Annotated, Literal, get_args

from pydantic import AwareDatetime, BaseModel, ConfigDict, Field, FiniteFloat, model_validator

from fringecal.targets import Quantity

FILE_NAME = "session.toml"

Kind = Literal["grid", "board", "reference", "strips", "artefact", "object"]
Channel = Literal["mean", "red", "green", "blue", "luma"]
Use = Literal["calibration", "verification"]
KINDS: tuple[str, ...] = get_args(Kind)

Bits = Annotated[int, Field(ge=8, le=16)]
Text = Annotated[str, Field(min_length=1)]


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
    """Where the projector is nominally, for the theory table; seen in a mirror if there is one."""

    position_mm: Quantity
    mirror: MirrorTable | None = None

    @model_validator(mode="after")
    def _three_coordinates(self) -> "ProjectorTable":
        _demand_point("position_mm", self.position_mm)
        return self


def _demand_point(key: str, place: Quantity) -> None:
    if not (isinstance(place.value, tuple) and len(place.value) == 3):
        raise ValueError(f"{key} must be {{ value = [x, y, z], u = [ux, uy, uz] }} in the plate frame")


class PhaseTable(_Table):
    """Phase shifts that hold for every phase-shifted capture that states none of its own."""

    steps_deg: list[FiniteFloat]


class CaptureTable(_Table):
    """One capture: pictures of one thing, taken for one purpose.

    `images` are in the order repeat, then period, then step (the step changes fastest). An empty
    `steps_deg` says that the pictures are not phase-shifted. `gray` lists Gray-code pictures, the
    coarsest bit first. `use` says whether an artefact takes part in the calibration or stays independent of
    it, for verification: strips take part unless told otherwise, other artefacts stay out.
    """

    name: Annotated[str, Field(pattern=r"^[^\s/\\][^/\\]*$")]
    kind: Kind
    target: Text | None = None
    images: list[Text]
    steps_deg: list[FiniteFloat] | None = None
    periods: Annotated[list[Annotated[FiniteFloat, Field(gt=0)]], Field(min_length=1)] | None = None
    gray: list[Text] | None = None
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
