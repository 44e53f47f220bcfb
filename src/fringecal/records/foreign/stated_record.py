"""What was found of a calibration that another program made: its numbers, what speaks against it, and the decision."""

from typing import Final, Literal

from pydantic import Field

from fringecal.records.lens_record import LensRecord
from fringecal.records.parts import Decision, Digested, Part, Sha256, UtcTime, now_utc

PAIR_FORMAT: Final = "fringecal-pair/1"
PAIR_FILE = "pair.json"


class DoubtRecord(Part):
    """One reason that speaks against a calibration; `refused` is false where the matter is open."""

    subject: Literal["camera", "projector", "pair"]
    name: str
    refused: bool
    sentence: str


class PairsRecord(Part):
    """What places that belong together say of a calibration; null where nothing of the kind was given."""

    file: str
    poses: int = Field(ge=0)
    points: int = Field(ge=0)
    camera_rms_px: float | None = Field(default=None, ge=0)
    projector_rms_px: float | None = Field(default=None, ge=0)
    scale: float | None = Field(default=None, description="distances found over those that the board states")
    scale_u: float | None = Field(default=None, ge=0)
    form_rms_mm: float | None = Field(default=None, ge=0)


class PairDocument(Digested):
    """The file ``pair.json``: a calibration of another program or of given places, and whether it can be trusted."""

    format: Literal["fringecal-pair/1"] = PAIR_FORMAT
    created: UtcTime = Field(default_factory=now_utc, description="time of writing, UTC")
    software: dict[str, str] = Field(description="version by package")
    command: tuple[str, ...] = ()
    inputs: dict[str, Sha256] = Field(default_factory=dict, description="SHA-256 by file")
    decision: Decision
    kind: str = Field(description="whose format the files have")
    camera: LensRecord
    projector: LensRecord | None = None
    rotation: tuple[tuple[float, ...], ...] | None = Field(
        default=None, description="from the camera's frame to the projector's"
    )
    shift_mm: tuple[float, ...] | None = Field(default=None, description="of the camera's centre, projector's frame")
    doubts: tuple[DoubtRecord, ...] = ()
    pairs: PairsRecord | None = None
    notes: tuple[str, ...] = ()
