"""Pieces that every report shares: numbers as text, tables of phase shifts, masks and budgets, inputs, files."""

import math
from collections.abc import Mapping, Sequence

import numpy as np
import pandas as pd

from fringecal.records import Check
from fringecal.report import (
    AS_U,
    DOF,
    Decision,
    FigureItem,
    InputFile,
    Section,
    Table,
    phase_overview,
)
from fringecal.session import Capture
from fringecal.uncertainty import EXPANDED_BY, Budget, Estimate
from fringecal.workflows.shared.capture_phase import CapturePhase

_ON_LIMIT = 0.005  # relative, within which a value of three digits rounds onto its limit
_SEVEREST_FIRST: tuple[Decision, ...] = ("fail", "conditionalFail", "conditionalPass", "pass", "info")


def concise(estimate: Estimate) -> str:
    """Print an estimate with its standard uncertainty in brackets, in units of the last digits (JCGM 100, 7.2.2).

    Examples
    --------
    >>> concise(Estimate(50.7061, 0.0496, "deg"))
    '50.706(50) deg'
    >>> concise(Estimate(1500.3, 5.04, "mm")), concise(Estimate(1222.1, 123.4, "mm"))
    ('1500.3(5.0) mm', '1222(123) mm')
    """
    unit = f" {estimate.unit}" if estimate.unit else ""
    if not (math.isfinite(estimate.value) and math.isfinite(estimate.u)) or estimate.u <= 0:
        return f"{estimate.value:.6g}{unit}"
    digits = max(0, 1 - math.floor(math.log10(estimate.u)))
    # Between 1 and 10 the decimal point falls between the two digits: "1500.3(5.0)".
    bracket = f"{estimate.u:.{digits}f}" if estimate.u >= 1 else f"{estimate.u * 10**digits:.0f}"
    return f"{estimate.value:.{digits}f}({bracket}){unit}"


def estimates_table(
    caption: str, estimates: Mapping[str, Estimate], *, first: str = "quantity", header_note: str = ""
) -> Table:
    """Tabulate estimates by name: value, u and 95 % expanded uncertainty."""
    rows = [
        {"value": e.value, "u": e.u, "U (95 %)": e.expanded().U, "dof": e.dof, "unit": e.unit}
        for e in estimates.values()
    ]
    frame = pd.DataFrame(rows)
    frame.insert(0, first, list(estimates))
    note = "; ".join(filter(None, (header_note, EXPANDED_BY)))
    return Table(caption, frame, note, {"value": "#.6g", "U (95 %)": AS_U, "dof": DOF}, {"value": "u"})


def budget_table(caption: str, budget: Budget) -> Table:
    """Tabulate a budget, the largest contribution first."""
    unit = budget.result.unit
    heading = f"contribution / ({unit})" if "/" in unit else f"contribution / {unit}"
    frame = budget.table().set_axis(["source of uncertainty", heading, "share of the variance / %"], axis="columns")
    formats = {heading: AS_U, "share of the variance / %": ".1f"}
    return Table(caption, frame, "standard uncertainties", formats)


def checks_table(checks: Sequence[Check]) -> Table:
    """Tabulate named checks with their limits and decisions, what did not pass first."""
    checks = sorted(checks, key=lambda check: _SEVEREST_FIRST.index(check.decision))
    keys = ("name", "value", "u", "expanded", "limit", "unit", "decision", "rule")
    frame = pd.DataFrame([{key: getattr(check, key) for key in keys} for check in checks], columns=list(keys))
    frame["u"] = frame["u"].where(frame["u"] != 0)  # of a bound that is compared as it is, nothing is known
    # A value that would round onto its limit gets the digits that show on which side it lies.
    near = any(c.value is not None and c.limit and 0 < abs(abs(c.value) / c.limit - 1) < _ON_LIMIT for c in checks)
    formats = {"value": ".6g" if near else ".3g", "U (95 %)": AS_U, "limit": ".3g"}
    names = ["check", *("U (95 %)" if key == "expanded" else key for key in keys[1:])]
    return Table("What was checked", frame.set_axis(names, axis="columns"), EXPANDED_BY, formats, {"value": "u"})


def severest(checks: Sequence[Check]) -> Decision:
    """Return the severest decision of some checks; information alone decides nothing.

    Examples
    --------
    >>> severest([Check(name="a", decision="pass"), Check(name="b", decision="info")])
    'pass'
    """
    found = {check.decision for check in checks}
    return next((decision for decision in _SEVEREST_FIRST if decision in found), "info")


def phase_section(captures: Sequence[CapturePhase]) -> Section:
    """Show the phase of captures: which phase shifts were used, their check, maps, and why pixels are masked."""
    return Section(
        "Phase",
        tuple(capture.sentence() for capture in captures),
        (_steps_table(captures), _mask_table(captures)),
        tuple(phase_figure(capture) for capture in captures),
    )


def phase_figure(capture: CapturePhase) -> FigureItem:
    """Draw phase, modulation, uncertainty and mask of one capture."""
    name, valid = capture.capture.name, capture.map.shares()["valid"]
    return FigureItem(
        f"Phase of {name}",
        phase_overview(capture.map, title=name),
        f"Four maps in the camera's picture: wrapped phase, modulation, standard uncertainty of the phase (median "
        f"{float(np.nanmedian(capture.map.sigma)):.3f} rad), and the mask: {100 * valid:.1f} % of it is valid.",
        "png",
    )


def _steps_table(captures: Sequence[CapturePhase]) -> Table:
    """Tabulate stated and found phase shifts, with what else differs from frame to frame."""
    rows = []
    for capture in captures:
        found = capture.estimated
        for n, (stated, used) in enumerate(
            zip(capture.capture.phase_shifts_rad, capture.phase_shifts_rad, strict=True)
        ):
            row = {"capture": capture.capture.name, "frame": n, "stated / deg": math.degrees(stated)}
            row["used / deg"] = math.degrees(used)
            if found is not None:
                row |= {
                    "found / deg": math.degrees(float(found.phase_shifts_rad[n])),
                    "u / deg": math.degrees(float(found.u_rad[n])),
                    "modulation": float(found.gain_per_frame[n]),
                    "background": float(found.background_per_frame[n]),
                    "offset / levels": float(found.offset_per_frame[n]),
                }
            rows.append(row)
    degrees = dict.fromkeys(("stated / deg", "used / deg", "found / deg", "u / deg"), ".3f")
    return Table(
        "Phase shifts",
        pd.DataFrame(rows),
        "found from the frames, relative to the first; modulation and background as shares of the frames' mean",
        degrees | {"modulation": ".4f", "background": ".4f", "offset / levels": "+z.2f"},
    )


def _mask_table(captures: Sequence[CapturePhase]) -> Table:
    """Tabulate the share of valid pixels and of each reason to mask one."""
    rows = [
        {"capture": capture.capture.name}
        | {f"{name.replace('_', ' ')} / %": 100 * share for name, share in capture.map.shares().items()}
        for capture in captures
    ]
    frame = pd.DataFrame(rows)
    formats = dict.fromkeys(frame.columns[1:], ".2f")
    return Table("Valid pixels", frame, "share of the picture; a pixel may be masked for several reasons", formats)


def inputs_of_capture(capture: Capture) -> tuple[InputFile, ...]:
    """List the pictures of a capture with their hashes."""
    files = zip(capture.paths, capture.sha256, strict=True)
    return tuple(InputFile(capture.name, path.name, digest) for path, digest in files)
