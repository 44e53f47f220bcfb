"""Limits of acceptance that a laboratory owns: `limits.toml`, format 1, with defaults argued in docs/limits.md."""

import difflib
from pathlib import Path
from typing import Annotated, Any, Literal, get_args

from pydantic import BaseModel, ConfigDict, Field

from fringecal.guarded import is_file, quoted
from fringecal.records.owned import read_owned
from fringecal.uncertainty import COVERAGE

LIMITS_FILE = "limits.toml"

Limit = Annotated[float, Field(gt=0, allow_inf_nan=False)]


class _Table(BaseModel):
    """A table of limits: unknown keys and text where a number belongs are refused."""

    model_config = ConfigDict(extra="forbid", frozen=True)


class CommissionLimits(_Table):
    """What a commissioning must keep."""

    plate_residual_rad: Limit = (
        0.10  # 1.6 % of a fringe: beyond it the plate is no plane, or frames do not belong together
    )
    grid_residual_px: Limit = 0.30  # six times what crossings are found to
    height_percent: Limit = 2.0  # by a wrong statement; as the angle's u below allows by itself
    angle_u_deg: Limit = 0.5  # 1.8 % of a height at 50 deg
    angle_en: Limit = 1.0  # beyond 1 two numbers contradict each other (ISO 13528)
    height_en: Limit = 1.0  # likewise
    noise_ratio: Limit = 1.5  # scatter of repeats over the camera's own: beyond it projector or mount move
    plate_form_mm: Limit = 0.05  # the model does not contain the warp of a plate
    frames_rad: Limit = 0.10  # as the plate's residual


class VerifyLimits(_Table):
    """What a verification must keep; a tolerance on the mean error is the laboratory's own affair."""

    en: Limit = 1.0
    scatter_ratio: Limit = 1.3  # of pixels' departures over their u: 0.8 to 1.1 on about 100 sound artefacts
    largest_ratio: Limit = 1.5  # of the largest departure over what it stays below in 99 of 100 cases
    mean_error_percent: Limit | None = None


class ReconstructLimits(_Table):
    """How the plate beside an object may differ from that of the calibration."""

    plate_height_mm: Limit = 0.1  # every height is off by as much
    plate_rise_mm: Limit = 0.2  # over the plate in view
    picture_shift_px: Limit = 0.3  # as the grid's residual: where a surface rises by 45 deg, heights are off by as much
    contrast_percent: Limit = 10.0  # as an audit's: what blurs the fringes by so much moves edges by half a pixel
    sharpness_percent: Limit = 30.0  # of texture as fine as a pixel, which a blur of 0.5 px takes
    frames_apart_px: Limit = 0.1  # at a line from 50 to 150 grey levels it makes 0.1 rad, and U of most heights
    noise_percent: Limit = 10.0  # the random part of u(z) would be wrong by as much
    harmonic: Limit = 0.03  # as an audit's
    plate_scatter_ratio: Limit = 1.5  # 1.0 to 1.2 on sound captures; a frame moved by 2 px gives 10 and more


class AuditLimits(_Table):
    """By how much a rig may have changed since its calibration."""

    scale_percent: Limit = 0.1  # 0.4 mm over 440 mm; a camera 1500 mm away that sinks by 1.5 mm
    tilt_deg: Limit = 0.1  # a third of what changes the scale by 0.17 % over that field
    distortion_px: Limit = 0.3  # as the grid's residual
    blur_px: Limit = 0.3  # moves an edge's foot by one pixel
    plate_phase_rad: Limit = 0.10  # 0.1 mm of height at 8 mm pitch and 50 deg
    plate_form_mm: Limit = 0.05  # the model does not contain the warp of a plate
    height_scale_percent: Limit = 0.3  # 0.085 mm on a zig-zag of 28 mm
    angle_deg: Limit = 0.1  # the same at 50 deg
    contrast_percent: Limit = 10.0  # the random part of u(z) grows by a tenth
    modulation_percent: Limit = 30.0  # by four tenths
    noise_percent: Limit = 50.0  # by a half
    harmonic: Limit = 0.03  # of the fringes' second over the first: a ripple of 0.03 rad with three steps
    artefact_en: Limit = 1.0  # beyond 1 two numbers contradict each other (ISO 13528)


class Limits(_Table):
    """All limits, and the decision rule's level: the probability at which conformity counts as proved."""

    format: Literal[1] = 1
    level: Annotated[float, Field(ge=0.5, lt=1)] = COVERAGE
    commission: CommissionLimits = CommissionLimits()
    verify: VerifyLimits = VerifyLimits()
    reconstruct: ReconstructLimits = ReconstructLimits()
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
    return read_limits(beside) if is_file(beside) else DEFAULT_LIMITS


def _fault(error: Any) -> str:
    """Say what is wrong with one key, and which key may have been meant."""
    place, message, found = error["loc"], error["msg"], error.get("input")
    name = ".".join(map(str, place))
    if not message.startswith("Extra inputs"):
        return f"{name}: {message} (found {quoted(found)})"
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
