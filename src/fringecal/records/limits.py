"""Limits of acceptance that a laboratory owns: `limits.toml`, format 1, with defaults argued in docs/limits.md."""

import difflib
from pathlib import Path
from typing import Annotated, Any, Literal, get_args

from pydantic import BaseModel, ConfigDict, Field

from fringecal.records.owned import read_owned

LIMITS_FILE = "limits.toml"

Limit = Annotated[float, Field(gt=0, allow_inf_nan=False)]


class _Table(BaseModel):
    """A table of limits: unknown keys and text where a number belongs are refused."""

    model_config = ConfigDict(extra="forbid", frozen=True)


class CommissionLimits(_Table):
    """What a commissioning must keep."""

    plate_residual_rad: Limit = 0.10
    grid_residual_px: Limit = 0.30
    angle_u_deg: Limit = 0.5
    angle_en: Limit = 1.0
    height_en: Limit = 1.0
    noise_ratio: Limit = 1.5
    plate_form_mm: Limit = 0.05
    frames_rad: Limit = 0.10


class VerifyLimits(_Table):
    """What a verification must keep; a tolerance on the mean error is the laboratory's own affair."""

    en: Limit = 1.0
    mean_error_percent: Limit | None = None


class AuditLimits(_Table):
    """By how much a rig may have changed since its calibration."""

    scale_percent: Limit = 0.1
    tilt_deg: Limit = 0.1
    distortion_px: Limit = 0.3
    blur_px: Limit = 0.3
    plate_phase_rad: Limit = 0.10
    plate_form_mm: Limit = 0.05
    height_scale_percent: Limit = 0.3
    angle_deg: Limit = 0.1
    contrast_percent: Limit = 10.0
    modulation_percent: Limit = 30.0
    noise_percent: Limit = 50.0
    harmonic: Limit = 0.03
    artefact_en: Limit = 1.0


class Limits(_Table):
    """All limits, and the decision rule's level: the probability at which conformity counts as proved."""

    format: Literal[1] = 1
    level: Annotated[float, Field(ge=0.5, lt=1)] = 0.95
    commission: CommissionLimits = CommissionLimits()
    verify: VerifyLimits = VerifyLimits()
    audit: AuditLimits = AuditLimits()


DEFAULT_LIMITS = Limits()


def read_limits(path: str | Path) -> Limits:
    """Read a laboratory's limits; what the file leaves out keeps its default.

    Parameters
    ----------
    path
        The TOML file.

    Raises
    ------
    RecordError
        The file cannot be read, is not TOML, states no format 1, or holds a key or value that is no limit.
    """
    return read_owned(path, Limits, name="a file of limits", fault=_fault)


def limits_for(session: str | Path, stated: str | Path | None = None) -> Limits:
    """Return the limits stated, else those of `limits.toml` beside the session's pictures, else the defaults.

    Raises
    ------
    RecordError
        As in `read_limits`.
    """
    if stated is not None:
        return read_limits(stated)
    beside = Path(session) / LIMITS_FILE
    return read_limits(beside) if beside.is_file() else DEFAULT_LIMITS


def _fault(error: Any) -> str:
    """Say what is wrong with one key, and which key may have been meant."""
    place, message, found = error["loc"], error["msg"], error.get("input")
    name = ".".join(map(str, place))
    if not message.startswith("Extra inputs"):
        return f"{name}: {message} (found {found!r})"
    known = _keys(place[:-1])
    near = difflib.get_close_matches(str(place[-1]), known, n=1, cutoff=0.5)
    return f"{name}: no such limit; " + (f"did you mean {near[0]!r}?" if near else f"known: {', '.join(known)}")


def _keys(place: tuple[int | str, ...]) -> list[str]:
    """Return the keys that a table of the document may have."""
    table: type[BaseModel] = Limits
    for name in place:
        field = table.model_fields[str(name)].annotation
        table = next(t for t in (field, *get_args(field)) if isinstance(t, type) and issubclass(t, BaseModel))
    return list(table.model_fields)
