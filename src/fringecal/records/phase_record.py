"""What a record keeps of phase-shifted captures: steps, light, the fringes' shape, and what was wrong."""

from typing import Literal, Self

from pydantic import Field, model_validator

from fringecal.records.parts import Part, Uncertainty


class FindingRecord(Part):
    """One thing that is wrong with a capture's frames.

    The phase error `cost_rad` is rms over a fringe, and null where pixels are lost rather than wrong; `undone` says
    that the phase used was corrected for it.
    """

    name: str
    what: str
    how_large: str
    cost_rad: float | None = Field(default=None, ge=0)
    cost_mm: float | None = Field(default=None, ge=0)
    remedy: str
    undone: bool = False


class StepsRecord(Part):
    """The frames of one capture: steps as stated, as found and which were used; brightness; findings.

    Modulation and background of each frame are shares of the mean over the frames, the offset is in grey levels;
    they are null where they could not be measured.
    """

    capture: str
    stated_rad: tuple[float, ...]
    estimated_rad: tuple[float, ...] | None = None
    u_rad: tuple[Uncertainty, ...] | None = None
    used: Literal["stated", "estimated"] = "stated"
    modulation_per_frame: tuple[float, ...] | None = None
    background_per_frame: tuple[float, ...] | None = None
    offset_per_frame: tuple[float, ...] | None = None
    undone: tuple[str, ...] = Field(default=(), description="what was corrected, one sentence each")
    notes: tuple[str, ...] = Field(default=(), description="what could not be checked")
    findings: tuple[FindingRecord, ...] = ()


class WaveRecord(Part):
    """The waveform on the plate: harmonics 2, 3, 4 as complex shares of the first."""

    ratios_real: tuple[float, ...]
    ratios_imaginary: tuple[float, ...]
    u: tuple[Uncertainty, ...] = Field(description="standard uncertainty of each part")
    blocks: int = Field(gt=0, description="parts of the picture that were measured")
    exponent: float = Field(description="g of (1/2 + cos/2)^g with this second harmonic")
    u_exponent: Uncertainty

    @model_validator(mode="after")
    def _as_many_of_each(self) -> Self:
        if not len(self.ratios_real) == len(self.ratios_imaginary) == len(self.u):
            raise ValueError("ratios_real, ratios_imaginary and u must be equally long")
        return self


class OrdersRecord(Part):
    """How the rig counts the fringes of several periods: ratios of the shortest period to each longer one.

    `zeros_rad` are the longer fringes' phases where the shortest is 0; `number` is added to the orders that the
    periods give, up to whole cycles.
    """

    cycle: int = Field(gt=0, description="fringes after which all periods meet again")
    ratios: tuple[float, ...]
    zeros_rad: tuple[float, ...]
    number: int = Field(ge=0)

    @model_validator(mode="after")
    def _one_zero_for_each(self) -> Self:
        if len(self.ratios) != len(self.zeros_rad):
            raise ValueError("ratios and zeros_rad must be equally long")
        return self
