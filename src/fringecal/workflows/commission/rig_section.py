"""The rig's part of a commissioning report: strips, joint fit, projector."""

import math

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from fringecal.camera import CAMERA_NAMES
from fringecal.projector import RIG_NAMES, RigCalibration, projector_estimates, seen_axes
from fringecal.report import FigureItem, Section, Table, classification_overlay
from fringecal.uncertainty import EXPANDED_BY, Estimate, en_score
from fringecal.workflows.commission.calibrated_session import CalibratedSession
from fringecal.workflows.commission.residual_section import ResidualMaps, residual_figures
from fringecal.workflows.shared import projector_of, rig_figure

Array = NDArray[np.float64]

_UNITS = {"nx": "rad/mm", "ny": "rad/mm", "nz": "rad/mm", "n0": "rad", "dx": "1/mm", "dy": "1/mm", "dz": "1/mm"}


def strips_section(found: CalibratedSession, residuals: ResidualMaps) -> Section:
    """Say where the strips were found and how their fringe order was decided."""
    regions = found.result.strips.found.regions
    count = f"{len(regions.seen)} of {len(found.result.strips.found.heights_mm)}"
    seen = f"{count} strips are in the picture, at {regions.direction_deg:z.1f} deg."
    decided = tuple(
        f"Strips of {height:g} mm: fringe order {decision.order:+d}, {decision.reason}."
        for height, decision in found.result.orders.items()
    )
    moved = found.result.strips.found.plate_drift_rad
    drift = f"On the bare plate the phase moved by {moved:+z.4f} rad between reference and strips."
    tables = (_orders_table(found), _strips_table(residuals))
    return Section("Strips", (seen, *decided, drift), tables, (_strips_figure(found),))


def _orders_table(found: CalibratedSession) -> Table:
    """Tabulate every fringe order tried, and the rig that would follow from it."""
    decisions = {id(decision): decision for decision in found.result.orders.values()}
    rows = [
        {
            "order": candidate.order,
            "chosen": candidate.order == decision.order,
            "possible": candidate.possible,
            "strips / mm": ", ".join(f"{h:g}" for h, d in found.result.orders.items() if d is decision),
            "angle / deg": candidate.angle_deg,
            "line height / mm": candidate.line_height_mm,
            "line side / mm": candidate.line_side_mm,
            "residual / rad": candidate.block_rms_rad,
            "phase - prediction / rad": candidate.predicted_difference_rad,
        }
        for decision in decisions.values()
        for candidate in decision.candidates
    ]
    formats = {
        "angle / deg": ".2f",
        "line height / mm": ".0f",
        "line side / mm": ".0f",
        "residual / rad": ".4f",
        "phase - prediction / rad": "+z.2f",
    }
    note = "place of the projector's line; prediction from the stated projector position, where there is one"
    return Table("Fringe order of the strips", pd.DataFrame(rows), note, formats)


def _strips_table(residuals: ResidualMaps) -> Table:
    """Tabulate the strips seen, with the height by which each deviates from the joint fit."""
    rows = []
    for point in residuals.strips:
        for label in np.unique(point.label[point.label > 0]):
            inside = point.label == label
            rows.append(
                {
                    "strip": int(label),
                    "height / mm": point.height.value,
                    "u / mm": point.height.u,
                    "points": int(np.count_nonzero(inside)),
                    "median residual / rad": float(np.median(point.residual_rad[inside])),
                    "as height / mm": float(np.median(point.as_height_mm[inside])),
                }
            )
    rows.sort(key=lambda row: row["strip"])
    formats = {"height / mm": ".4g", "median residual / rad": "+z.4f", "as height / mm": "+z.4f"}
    note = "residual of the joint fit; a strip whose stated height is wrong has a large one"
    return Table("Strips", pd.DataFrame(rows), note, formats, {"height / mm": "u / mm"})


def _strips_figure(found: CalibratedSession) -> FigureItem:
    labels = found.result.strips.found.regions.labels
    classes = np.where(labels > 0, 1, np.where(labels == 0, 2, 3))
    names = {1: "strip top", 2: "plate", 3: "edge zone or no phase"}
    figure = classification_overlay(found.strips.map.background, classes, names, title=found.strips.capture.name)
    shares = ", ".join(f"{name} {100 * np.mean(classes == number):.1f} %" for number, name in names.items())
    return FigureItem("Strips found", figure, f"The picture of the strips, coloured by class: {shares}.", "png")


def rig_section(found: CalibratedSession, residuals: ResidualMaps) -> Section:
    """Give the residuals of plate and strips in the joint fit, and the projector position."""
    fit = found.result.fit
    used, total = (sum(int(n) for n in counts) for counts in zip(*(_counts(r) for r in fit.residuals), strict=True))
    sentences = (
        f"The rig model of {len(RIG_NAMES)} numbers and a smooth plate residual fits {used} of {total} points on "
        f"plate and strips to {fit.rms_rad:.4f} rad rms ({fit.plate_rms_rad:.4f} rad on the plate).",
        f"Beyond the noise of a pixel the plate's phase scatters by {found.result.rig.excess_rad:.4f} rad, which the "
        "uncertainty of every height includes.",
        _line_sentence(found),
    )
    tables = (_parameters_table(found.result.rig), *_projector_tables(found))
    figures = (*residual_figures(found.result, residuals), *rig_figure(found.session, found.result.rig))
    return Section(
        "Rig",
        sentences,
        tables,
        figures,
    )


def _counts(residual: Array) -> tuple[int, int]:
    return int(np.isfinite(residual).sum()), residual.size


def _line_sentence(found: CalibratedSession) -> str:
    if not np.all(np.isfinite(found.result.rig.model.projector_mm)):
        return "The projector's light is parallel within its uncertainty: the projector has no position."
    origin = "the stated position" if found.session.projector else "the plate's origin"
    return (
        "The fringes determine the line on which the projector stands, not its place along it; given is the point of "
        f"that line nearest to {origin}."
    )


def _parameters_table(calibration: RigCalibration) -> Table:
    cut, end = len(CAMERA_NAMES), len(CAMERA_NAMES) + len(RIG_NAMES)
    u = np.sqrt(np.diag(calibration.covariance)[cut:end])
    frame = pd.DataFrame(
        {
            "parameter": RIG_NAMES,
            "value": calibration.model.parameters,
            "u": u,
            "unit": [_UNITS[name] for name in RIG_NAMES],
        }
    )
    note = "phase = (nx x + ny y + nz z + n0) / (dx x + dy y + dz z + 1) + smooth plate residual"
    return Table("Rig parameters", frame, note, {"value": ".7g"}, {"value": "u"})


def _projector_tables(found: CalibratedSession) -> tuple[Table, ...]:
    """Tabulate the projector's point beside where the session says it stands."""
    position = projector_of(found.session)
    fitted = projector_estimates(found.result.rig, position)
    if not fitted:
        return ()
    seen = np.array(seen_axes(found.result.rig.model))
    u = np.array([e.u for e in fitted])
    frame = pd.DataFrame({"axis": list("xyz"), "fitted / mm": [e.value for e in fitted], "u / mm": u})
    frame["from"] = np.where(seen, "fringes", "not determined by these fringes")
    if position is None:
        frame.loc[~seen, "u / mm"] = np.nan
    else:
        frame["from"] = np.where(seen, "fringes", "stated; not determined by these fringes")
        frame["stated / mm"], frame["u(stated) / mm"] = position.value_mm, position.u_mm
        frame["difference / mm"] = np.where(seen, frame["fitted / mm"] - position.value_mm, np.nan)
        frame["En"] = [
            en_score(one, Estimate(float(value), float(u_mm), "mm")) if along and max(one.u, u_mm) > 0 else math.nan
            for one, value, u_mm, along in zip(fitted, position.value_mm, position.u_mm, seen, strict=True)
        ]
    formats = dict.fromkeys(("fitted / mm", "stated / mm"), ".1f") | {"difference / mm": "+z.1f", "En": "+z.2f"}
    uncertainties = {"fitted / mm": "u / mm", "stated / mm": "u(stated) / mm"}
    note = "plate frame; the fringes do not determine the coordinate along them"
    if position is not None:
        note = f"{note}; En = difference / root sum of squares of both U; {EXPANDED_BY}"
    uncertainties = {name: u for name, u in uncertainties.items() if name in frame}
    return (Table("Position of the projector", frame, note, formats, uncertainties),)
