"""The lens of a camera as records keep it: parameters with covariance, where they come from, what they rest on."""

from typing import Final, Literal, Self

from pydantic import Field, model_validator

from fringecal.records.parts import Digested, Matrix, Part, Uncertainty, UtcTime, is_covariance, now_utc

LENS_FORMAT: Final = "fringecal-lens/1"
LENS_FILE = "lens.json"


class BoardPictureRecord(Part):
    """One picture of the board; numbers are null where it was not used, and `reason` says why."""

    name: str
    points: int = Field(default=0, ge=0, description="points used")
    left_out: int = Field(default=0, ge=0, description="points taken for wrong corners")
    rms_px: float | None = Field(default=None, ge=0)
    tilt_deg: float | None = Field(default=None, description="of the board's normal from the optical axis")
    distance_mm: float | None = Field(default=None, description="board's middle from the camera's centre")
    reason: str = ""


class ProjectionUncertainty(Part):
    """Standard uncertainty of where a point at a distance is seen, over the picture."""

    distance_mm: float = Field(gt=0)
    median_px: Uncertainty
    max_px: Uncertainty


class BoardSolution(Part):
    """What a lens from board pictures rests on."""

    solver: Literal["mrcal", "opencv"]
    model: str = Field(default="brown", description="lens model that was solved, of mrcal's names if not Brown's")
    left_rms_px: float | None = Field(default=None, description="what Brown's lens leaves of that model, rms")
    board: str
    rms_px: float = Field(ge=0)
    points: int
    outliers: int = Field(ge=0)
    dof: int = Field(gt=0)
    board_warp_mm: tuple[float, float] | None = Field(
        default=None, description="warp of the board across its columns and rows; null if taken as flat"
    )
    halves_median_px: float | None = Field(
        default=None, description="lens of the odd against lens of the even pictures; null if too few"
    )
    inflation: float = Field(ge=1, description="factor on u, from the halves; part of the covariance")
    projection: ProjectionUncertainty
    pictures: tuple[BoardPictureRecord, ...]


class LensRecord(Part):
    """A pinhole with Brown's distortion (OpenCV's order), stated by a file or solved from board pictures.

    `covariance` is null where the file states none: the lens then counts as exact.
    """

    names: tuple[str, ...]
    parameters: tuple[float, ...]
    covariance: Matrix | None = None
    width: int = Field(gt=0, description="picture width, px")
    height: int = Field(gt=0, description="picture height, px")
    file: str | None = Field(default=None, description="file that states the lens")
    boards: BoardSolution | None = None
    notes: tuple[str, ...] = ()

    @model_validator(mode="after")
    def _sizes_agree(self) -> Self:
        if len(self.names) != len(self.parameters):
            raise ValueError(f"{len(self.parameters)} parameters need as many names, found {len(self.names)}")
        if self.covariance is not None and not is_covariance(self.covariance, len(self.parameters)):
            raise ValueError("covariance must be square, symmetric and positive semi-definite, a row per parameter")
        return self


class LensDocument(Digested):
    """The file ``lens.json``: a lens by itself, as `fringecal lens` writes it."""

    format: Literal["fringecal-lens/1"] = LENS_FORMAT
    created: UtcTime = Field(default_factory=now_utc, description="time of writing, UTC")
    software: dict[str, str] = Field(description="version by package")
    command: tuple[str, ...] = ()
    inputs: dict[str, str] = Field(default_factory=dict, description="SHA-256 by picture")
    lens: LensRecord
