"""The small pieces that every record is made of: estimates, budget rows, checks, inputs."""

import math
from datetime import UTC, datetime
from typing import Annotated, Literal, Self

import numpy as np
from pydantic import AfterValidator, AwareDatetime, BaseModel, BeforeValidator, ConfigDict, Field, PrivateAttr

from fringecal.errors import RecordError
from fringecal.uncertainty import Estimate

_ASYMMETRY = 1e-8  # of a correlation: numbers are written to nine digits at least
_NEGATIVE = 1e-6  # of its least eigenvalue, likewise: rounding of digits that were written

Decision = Literal["pass", "conditionalPass", "conditionalFail", "fail", "info"]
DigestState = Literal["fits", "differs", "none"]


class Part(BaseModel):
    """Base of all record models: frozen, no unknown keys, and no NaN or infinity anywhere."""

    # "constants" keeps a NaN of a free field visible to the writer, which refuses it; the default
    # would turn it into null without a word.
    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False, ser_json_inf_nan="constants")


def _infinite_to_null(value: object) -> object:
    return None if isinstance(value, float) and value == math.inf else value


Dof = Annotated[
    float | None,
    Field(gt=0, description="degrees of freedom of u; null means infinite: u is taken as exactly known"),
    BeforeValidator(_infinite_to_null),
]
Uncertainty = Annotated[float, Field(ge=0, description="standard uncertainty, in the unit of the value")]
Sha256 = Annotated[str, Field(pattern="^[0-9a-f]{64}$", description="SHA-256 of the file, lower-case hex")]
Matrix = tuple[tuple[float, ...], ...]
UtcTime = Annotated[AwareDatetime, AfterValidator(lambda time: time.astimezone(UTC))]


def now_utc() -> datetime:
    """Give the time of writing, in UTC and to the second."""
    return datetime.now(UTC).replace(microsecond=0)


class ValueU(Part):
    """A value with its standard uncertainty; the unit stands in the key that holds it."""

    value: float
    u: Uncertainty
    dof: Dof = None


class VectorU(Part):
    """Several values of one kind with their standard uncertainties; the unit stands in the key."""

    value: tuple[float, ...]
    u: tuple[Uncertainty, ...]


class EstimateRecord(Part):
    """An estimate as it stands in a record; infinite degrees of freedom are written as null.

    Examples
    --------
    >>> EstimateRecord.of(Estimate(50.7, 0.02, unit="deg")).model_dump_json()
    '{"value":50.7,"u":0.02,"dof":null,"unit":"deg"}'
    """

    value: float
    u: Uncertainty
    dof: Dof = None
    unit: str

    @classmethod
    def of(cls, estimate: Estimate) -> Self:
        """Take over an estimate of the toolkit."""
        return cls(value=float(estimate.value), u=float(estimate.u), dof=float(estimate.dof), unit=estimate.unit)

    def estimate(self, label: str = "") -> Estimate:
        """Give the estimate back, with infinite degrees of freedom where the record has null."""
        dof = math.inf if self.dof is None else self.dof
        return Estimate(self.value, self.u, unit=self.unit, label=label, dof=dof)


class BudgetRow(Part):
    """One influence of an uncertainty budget.

    `u` is in the influence's own unit, `contribution` = abs(sensitivity) u in the unit of the
    result, `percent` the share of the result's variance (negative where correlation cancels).
    """

    label: str
    u: Uncertainty
    contribution: float
    percent: float


class Check(Part):
    """A named check: what was found, what was allowed, and the decision with its rule.

    `limit` is null where none applies; such a check can only inform, so its decision is ``"info"``. `value` is
    null where nothing could be measured: that informs, or fails where it should have been possible.
    """

    name: str
    value: float | None = None
    limit: float | None = None
    decision: Decision
    u: Uncertainty | None = None
    expanded: Uncertainty | None = Field(default=None, description="expanded uncertainty at 95 %")
    unit: str = ""
    rule: str = ""
    score: Literal["En"] | None = Field(default=None, description="what the value is, if it is a score")


class InputFile(Part):
    """A file that the results were computed from.

    `capture` is empty for what belongs to the whole session (session.toml, targets, a lens); `file` is the path in
    the session's folder, in older records the name alone.
    """

    capture: str
    file: str
    sha256: Sha256


class SessionNote(Part):
    """Which session the record comes from: the rig's name is the key of its history."""

    rig: str
    captured: AwareDatetime | None = None
    operator: str | None = None
    temperature_degC: float | None = None
    minutes_since_power_on: float | None = None


class Digested(Part):
    """A document that carries a digest of its own content, so that an edited one is told from another result.

    `digest_state` says whether the digest is that of the content that was read; ``"none"`` where there is no digest, as
    in records of older versions.
    """

    digest: Sha256 | None = Field(
        default=None,
        description="SHA-256 of everything else in this document; null in records of older versions (docs/records.md)",
    )
    _edited: bool = PrivateAttr(default=False)
    _file_sha256: str | None = PrivateAttr(default=None)

    @property
    def digest_state(self) -> DigestState:
        """Whether the document is as it was written."""
        if self._edited:
            return "differs"
        return "none" if self.digest is None else "fits"

    @property
    def file_sha256(self) -> str:
        """SHA-256 of the very bytes that the document was read from.

        Raises
        ------
        ValueError
            It was not read from a file.
        """
        if self._file_sha256 is None:
            raise ValueError("the record was not read from a file, and has no hash")
        return self._file_sha256

    def demand_unedited(self, what: str) -> None:
        """Refuse to use a document whose content is not what was written.

        Parameters
        ----------
        what
            What it is, in a message.

        Raises
        ------
        RecordError
            It carries a digest, and that is not the content's.
        """
        if self.digest_state == "differs":
            raise RecordError(
                f"the {what} was edited after it was written: the digest that it carries is not that of its content; "
                "use it as it was written, or make it again"
            )

    def mark_read_from(self, sha256: str) -> None:
        """Note the hash of the bytes that the document was read from."""
        self._file_sha256 = sha256

    def mark_edited(self) -> None:
        """Note that the digest is not that of the content: known to whoever read the text."""
        self._edited = True


class Provenance(Digested):
    """What every record says about its own making, so that it can be made again."""

    format: str
    created: UtcTime = Field(default_factory=now_utc, description="time of writing, UTC")
    software: dict[str, str] = Field(description="version by package")
    command: tuple[str, ...] = Field(default=(), description="command line, one argument each")
    session: SessionNote
    inputs: tuple[InputFile, ...] = ()
    en_definition: str | None = Field(
        default=None,
        description="how every En was formed; null in records of older versions, which took U = 2 u for most of them",
    )


def is_covariance(matrix: Matrix, size: int) -> bool:
    """Return whether a matrix is `size` x `size`, symmetric and positive semi-definite within rounding.

    Rounding is judged on the correlation matrix, since parameters differ by many decades.

    Examples
    --------
    >>> is_covariance(((1e-12, 0.0), (0.0, 4.0)), 2), is_covariance(((1.0, 2.0), (2.0, 1.0)), 2)
    (True, False)
    """
    if len(matrix) != size or any(len(row) != size for row in matrix):
        return False
    array = np.array(matrix, dtype=float).reshape(size, size)
    scale = np.sqrt(np.abs(np.diag(array)))
    scale[scale == 0] = 1.0
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        correlation = array / scale / scale[:, None]
    if not np.isfinite(correlation).all():
        return False
    symmetric = np.allclose(correlation, correlation.T, atol=_ASYMMETRY)
    return bool(symmetric and (size == 0 or np.linalg.eigvalsh(correlation).min() > -_NEGATIVE))
