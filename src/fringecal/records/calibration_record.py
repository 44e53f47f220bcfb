"""The calibration record: everything that is needed to apply, judge and re-solve a calibration."""

from math import comb
from pathlib import Path
from typing import Any, Final, Literal, Self

from pydantic import Field, model_validator

from fringecal.records.documents import parse_document, read_document, write_document
from fringecal.records.lens_record import LensRecord
from fringecal.records.limits import Limits
from fringecal.records.look_record import LookRecord
from fringecal.records.parts import (
    BudgetRow,
    Check,
    Dof,
    EstimateRecord,
    Matrix,
    Part,
    Provenance,
    Uncertainty,
    ValueU,
    VectorU,
    is_covariance,
)
from fringecal.records.phase_record import OrdersRecord, StepsRecord, WaveRecord

CALIBRATION_FORMAT: Final = "fringecal-calibration/1"
CALIBRATION_FILE = "calibration.json"


class ImageRecord(Part):
    """Size of the camera's picture in px, and the grey value at which it saturates."""

    width: int = Field(gt=0)
    height: int = Field(gt=0)
    white_level: float = Field(gt=0)


class CameraRecord(Part):
    """The camera that maps pixels to rays in the plate frame: named parameters with covariance."""

    model: str = "plate"
    names: tuple[str, ...]
    parameters: tuple[float, ...]
    covariance: Matrix
    telecentric: bool
    width: int = Field(gt=0, description="picture width, px")
    height: int = Field(gt=0, description="picture height, px")

    @model_validator(mode="after")
    def _sizes_agree(self) -> Self:
        _demand_agreement(self.names, self.parameters, self.covariance)
        return self


class ScaleRecord(Part):
    """The mean scale, also along the columns' and the rows' direction alone (mm/px)."""

    mean: EstimateRecord
    horizontal: EstimateRecord
    vertical: EstimateRecord


class StraightnessRecord(Part):
    """Rms distance of the lines' points from straight, px, as seen and with the lens taken out."""

    horizontal_before: float = Field(ge=0)
    horizontal_after: float = Field(ge=0)
    vertical_before: float = Field(ge=0)
    vertical_after: float = Field(ge=0)


class DistortionRecord(Part):
    """The verdict on lens distortion, with the smallest displacement that would have been found."""

    verdict: Literal["none", "barrel", "pincushion"]
    max_px: ValueU = Field(description="largest displacement over the field")
    detection_limit_px: float = Field(ge=0)
    k1: float = 0.0
    k2: float = 0.0
    p_value: float = Field(ge=0, le=1)
    centre_px: VectorU | None = Field(None, description="centre of distortion (u, v), if the grid determines it")
    straightness_px: StraightnessRecord | None = None


class ColumnRecord(Part):
    """The projection angle in one column: as measured, as apparent to the camera, and in theory.

    `angle_deg` is the projector's own angle, from the plate's normal; `apparent_deg` includes
    the camera's; `theory_deg`, `difference_deg` and `en` are null where no position is stated.
    `dof` are the degrees of freedom of `u_deg`.
    """

    u_px: float
    x_mm: float
    breaks: int = Field(ge=0)
    angle_deg: float
    u_deg: Uncertainty
    dof: Dof = None
    apparent_deg: float | None = None
    theory_deg: float | None = None
    difference_deg: float | None = None
    en: float | None = None


class TheoryRecord(Part):
    """The angle at the origin that the stated positions of projector and camera give."""

    angle: EstimateRecord
    projector_position_mm: VectorU
    camera_height_mm: ValueU | None = None
    difference_deg: float | None = None
    en: float | None = None
    sentence: str = ""


class ProjectionRecord(Part):
    """The projection angle at the plate-frame origin, column by column, and against theory."""

    angle: EstimateRecord
    apparent_angle: EstimateRecord | None = None
    columns: tuple[ColumnRecord, ...] = ()
    theory: TheoryRecord | None = None


class PlateResidual(Part):
    """Smooth residual of the plate's phase about the rig model (rad): a polynomial of x and y.

    `box` is (x_min, x_max, y_min, y_max) in mm; x and y are scaled to -1..1 over it before the
    polynomial is evaluated, and nothing is known outside it.
    """

    degree: int = Field(ge=0)
    coefficients: tuple[float, ...]
    box: tuple[float, float, float, float]

    @model_validator(mode="after")
    def _complete(self) -> Self:
        allowed = (comb(self.degree + 2, 2), (self.degree + 1) ** 2)
        if len(self.coefficients) not in allowed:
            raise ValueError(
                f"degree {self.degree} takes {allowed[0]} coefficients (total degree) or {allowed[1]} "
                f"(degree in each), found {len(self.coefficients)}"
            )
        if not (self.box[0] < self.box[1] and self.box[2] < self.box[3]):
            raise ValueError("box must be x_min < x_max, y_min < y_max")
        return self


class ModeRecord(Part):
    """One uncertainty component: the effect of one standard uncertainty of it on camera, rig and plate residual.

    `effect` runs over the camera's parameters, the rig's, then the plate residual's coefficients; the joint
    covariance of all of them is the sum over the modes of effect times effect transposed.
    """

    label: str
    effect: tuple[float, ...]
    dof: Dof = None


class RigRecord(Part):
    """The fitted rig model: named parameters with covariance, and how well it fits.

    `cross_covariance` (rows: rig parameters, columns: camera parameters) keeps what the joint
    fit knows of both together; null means that the two were fitted apart.
    """

    model: str
    parameter_names: tuple[str, ...]
    parameters: tuple[float, ...]
    covariance: Matrix
    cross_covariance: Matrix | None = None
    residual_rms_rad: float = Field(ge=0)
    plate_residual_rms_rad: float = Field(ge=0)
    plate_residual: PlateResidual | None = None
    projector_mm: tuple[float, float, float] | None = Field(
        default=None, description="point on the line that all planes of equal phase share; null when collimated"
    )
    projector_u_mm: tuple[float, float, float] | None = Field(
        default=None,
        description="standard uncertainty of projector_mm; along the fringes that of the stated position, null without",
    )
    excess_rad: float = Field(default=0.0, ge=0, description="plate residual beyond the camera's noise, rad rms")
    modes: tuple[ModeRecord, ...] = ()

    @model_validator(mode="after")
    def _sizes_agree(self) -> Self:
        _demand_agreement(self.parameter_names, self.parameters, self.covariance)
        return self


class ForecastRecord(Part):
    """What a height will be known to: standard uncertainty over the field in mm, and by cause."""

    height_mm: float
    u_mm: Uncertainty
    u_least_mm: Uncertainty
    u_largest_mm: Uncertainty
    causes_mm: dict[str, float]


class ProposalRecord(Part):
    """What one more artefact would do to the standard uncertainty of each height in `forecasts`, mm."""

    name: str
    heights_mm: tuple[float, ...]
    u_height_mm: Uncertainty
    u_before_mm: tuple[float, ...]
    u_after_mm: tuple[float, ...]


class AdviceRecord(Part):
    """What to measure next: forecasts by height, proposals with the best first, and plain sentences."""

    forecasts: tuple[ForecastRecord, ...]
    proposals: tuple[ProposalRecord, ...] = ()
    sentences: tuple[str, ...] = ()


class AppearanceRecord(Part):
    """How the pictures looked, for later audits: sharpness of the grid's lines, and the light on the bare plate.

    Medians over the plate; null where the session did not show it.
    """

    grid_blur_px: float | None = Field(default=None, ge=0, description="standard deviation of the blur of grid lines")
    grid_blur_from: Literal["sections", "raster"] = Field(
        default="sections", description="what it was fitted to: sections through the lines, or raw pixels"
    )
    modulation_levels: float | None = Field(default=None, gt=0)
    contrast: float | None = Field(default=None, gt=0, description="modulation over background")
    noise_levels: float | None = Field(default=None, ge=0, description="of one picture at the median background")
    harmonic: float | None = Field(default=None, ge=0, description="second harmonic of the fringes over the first")
    u_harmonic: Uncertainty | None = None
    repeats: int = Field(default=1, ge=1, description="sets of the bare plate")
    scatter_modulation: float | None = Field(default=None, ge=0, description="relative sd from set to set of repeats")
    scatter_contrast: float | None = Field(default=None, ge=0, description="as scatter_modulation")


class UnseenErrorRecord(Part):
    """How large an error of one statement this session would have shown, as an error of heights."""

    name: str = Field(description="what is stated")
    stated: EstimateRecord
    error_percent: float | None = Field(
        description="smallest error of the statement that a check shows with 95 %; null where none up to half of it"
    )
    height_percent: float = Field(description="largest height error by it, or by an error of half the statement")
    limit_percent: float
    shown_by: str = Field(description="the check that shows it; empty where none does")
    heights_rest_on_it: bool = Field(description="false for the certificate of what was only verified on")


class CalibrationRecord(Provenance):
    """The calibration of a rig, as written to ``calibration.json``."""

    format: Literal["fringecal-calibration/1"] = CALIBRATION_FORMAT
    image: ImageRecord
    camera: CameraRecord
    lens: LensRecord | None = Field(default=None, description="the lens as stated or solved before the grid")
    steps: tuple[StepsRecord, ...] = ()
    wave: WaveRecord | None = Field(default=None, description="waveform; null where not measured")
    orders: OrdersRecord | None = Field(default=None, description="how several periods number the fringes")
    scale: ScaleRecord
    distortion: DistortionRecord
    projection: ProjectionRecord
    rig: RigRecord
    budgets: dict[str, tuple[BudgetRow, ...]] = Field(default_factory=dict, description="rows by quantity")
    checks: tuple[Check, ...] = ()
    limits: Limits | None = Field(default=None, description="what was judged by; null in records of older versions")
    targets: dict[str, dict[str, Any]] = Field(
        default_factory=dict, description="full content of each target used, by its name"
    )
    notes: tuple[str, ...] = ()
    advice: AdviceRecord | None = None
    unseen: tuple[UnseenErrorRecord, ...] | None = Field(
        default=None,
        description="what a wrong statement could have done without showing; null in records of older versions",
    )
    appearance: AppearanceRecord | None = Field(default=None, description="null in records of older versions")
    look: LookRecord | None = Field(default=None, description="the plate's picture; null in records of older versions")

    @model_validator(mode="after")
    def _rig_and_camera_agree(self) -> Self:
        cross = self.rig.cross_covariance
        shape = (len(self.rig.parameters), len(self.camera.parameters))
        if cross is not None and (len(cross) != shape[0] or any(len(row) != shape[1] for row in cross)):
            raise ValueError(f"rig.cross_covariance must be {shape[0]} x {shape[1]} (rig x camera)")
        terms = len(self.rig.plate_residual.coefficients) if self.rig.plate_residual else 0
        for mode in self.rig.modes:
            if len(mode.effect) != sum(shape) + terms:
                raise ValueError(f"rig.modes: {mode.label!r} needs {sum(shape) + terms} effects")
        return self


def _demand_agreement(names: tuple[str, ...], parameters: tuple[float, ...], covariance: Matrix) -> None:
    if len(names) != len(parameters) or len(set(names)) != len(names):
        raise ValueError(f"{len(parameters)} parameters need as many different names, found {len(names)}")
    if not is_covariance(covariance, len(parameters)):
        raise ValueError(
            f"covariance must be {len(parameters)} x {len(parameters)}, symmetric and positive semi-definite"
        )


def read_calibration(path: str | Path) -> CalibrationRecord:
    """Read a calibration record from its file, or from the folder that holds it.

    Raises
    ------
    RecordError
        The file is missing, not JSON, of another or a newer format, or lacks a key.
    """
    return read_document(path, CalibrationRecord, CALIBRATION_FORMAT, file_name=CALIBRATION_FILE)


def parse_calibration(text: str, *, name: str = "calibration") -> CalibrationRecord:
    """Read a calibration record from its text; `name` is what a refusal calls it.

    Raises
    ------
    RecordError
        The text is not JSON, of another or a newer format, or lacks a key.
    """
    return parse_document(text, CalibrationRecord, CALIBRATION_FORMAT, name=name)


def write_calibration(record: CalibrationRecord, folder: str | Path) -> Path:
    """Write ``calibration.json`` into a folder, whole or not at all, and return its path."""
    return write_document(record, Path(folder) / CALIBRATION_FILE)
