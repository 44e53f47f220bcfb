"""The report of a lens: parameters, pictures, residuals, coverage of the field, and its uncertainty as a map."""

from datetime import datetime

import numpy as np
import pandas as pd

from fringecal.calibration import BoardPicture, KnownLens, LensFindings
from fringecal.camera import LENS_NAMES, Lens, LensFit
from fringecal.records import software_versions
from fringecal.report import (
    Fact,
    FigureItem,
    InputFile,
    Report,
    Section,
    Table,
    Verdict,
    boards_overlay,
    lens_coverage,
    lens_uncertainty_map,
    residual_quiver,
)
from fringecal.workflows.shared import concise, estimates_table

_LABELS = {
    "fx_px": "focal length along u",
    "fy_px": "focal length along v",
    "cx_px": "principal point, u",
    "cy_px": "principal point, v",
}


def lens_section(known: KnownLens, distance_mm: float | None = None) -> Section:
    """Give parameters and uncertainty of the lens by itself.

    Parameters
    ----------
    known
        The lens and where it comes from.
    distance_mm
        Distance of the object from the camera, for the map of uncertainty; the boards' own if left out.
    """
    if known.findings is None:
        return Section("Lens", known.notes, (lens_table(known.lens),))
    found = known.findings
    distance = found.fit.distance_mm if distance_mm is None else distance_mm
    tables = (lens_table(known.lens), _solution(found.fit, distance), _pictures(found))
    return Section("Lens", known.notes, tables, _figures(found, distance))


def lens_report(
    found: LensFindings,
    *,
    distance_mm: float | None = None,
    inputs: tuple[InputFile, ...] = (),
    command: str = "",
    created: datetime | None = None,
) -> Report:
    """Return the report of a lens fitted to board pictures."""
    fit, lens = found.fit, found.fit.lens
    focal = concise(lens.estimate("fx_px"))
    return Report(
        title="Lens of a camera",
        subtitle=f"from {len(fit.views)} pictures of {found.target.name}",
        verdict=Verdict("info", f"The focal length is {focal}; {found.notes[1]}"),
        facts=(
            Fact("Focal length", focal, "along u"),
            Fact("Residual", f"{fit.rms_px:.3f} px", f"rms of {fit.points} points"),
            Fact("Form deviation of the board", _warp(fit), "across its columns and rows"),
            Fact("Pictures", f"{len(fit.views)} of {len(found.pictures)}", "show the board"),
        ),
        sections=(lens_section(KnownLens(lens, findings=found), distance_mm),),
        inputs=inputs,
        versions=software_versions(),
        command=command,
        created=created,
    )


def _warp(fit: LensFit) -> str:
    if fit.board_warp_mm is None:
        return "taken as flat"
    return " and ".join(f"{warp:+.3f}" for warp in fit.board_warp_mm) + " mm"


def lens_table(lens: Lens) -> Table:
    """Tabulate the parameters of a lens, with their u where it is known."""
    estimates = {_LABELS.get(name, name): lens.estimate(name) for name in LENS_NAMES}
    note = "Brown's distortion, OpenCV's order" if lens.covariance_known else "the file states no uncertainty"
    if lens.covariance_known:
        return estimates_table("Lens parameters", estimates, first="parameter", header_note=note)
    rows = [{"parameter": name, "value": e.value, "unit": e.unit} for name, e in estimates.items()]
    return Table("Lens parameters", pd.DataFrame(rows), note, {"value": "#.6g"})


def _solution(fit: LensFit, distance_mm: float) -> Table:
    """Tabulate points, residuals and uncertainties of the fit."""
    u = fit.uncertainty_at_px(distance_mm)
    rows = [
        ("points used", fit.points, ""),
        ("points left out", fit.outliers, ""),
        ("residual, rms", fit.rms_px, "px"),
        ("mean distance of the boards", fit.distance_mm, "mm"),
        (f"u of the projection at {distance_mm:.0f} mm, median over the picture", float(np.nanmedian(u)), "px"),
        (f"u of the projection at {distance_mm:.0f} mm, largest", float(np.nanmax(u)), "px"),
        ("factor on u from odd against even pictures", fit.inflation, ""),
    ]
    if fit.halves_px is not None:
        rows.append(("odd against even pictures, median", float(np.nanmedian(fit.halves_px)), "px"))
    if fit.board_warp_mm is not None:
        axes = zip(("columns", "rows"), fit.board_warp_mm, strict=True)
        rows += [(f"warp of the board across its {name}", warp, "mm") for name, warp in axes]
    frame = pd.DataFrame(rows, columns=["quantity", "value", "unit"])
    return Table("Fit of the lens", frame, f"solved by {fit.solver}", {"value": ".4g"})


def _pictures(found: LensFindings) -> Table:
    fits = {picture.name: view for picture, view in found.found}
    rows = []
    for picture in found.pictures:
        view = fits.get(picture.name)
        row: dict[str, object] = {"picture": picture.name, "points": 0, "left out": 0, "status": _status(picture)}
        if view is not None:
            row |= {"points": len(view.seen_px), "left out": len(view.left_out_px), "status": "used"}
            row |= {"rms / px": view.rms_px, "tilt / deg": view.tilt_deg, "distance / mm": view.distance_mm}
        rows.append(row)
    formats = {"rms / px": ".3f", "tilt / deg": ".1f", "distance / mm": ".0f"}
    order = ["picture", "status", "points", "left out", *formats]
    return Table("Pictures of the board", pd.DataFrame(rows)[order], "tilt from the optical axis", formats)


def _status(picture: BoardPicture) -> str:
    """Say why a picture was not used."""
    return "no board" if picture.view is None else "disagrees"


def _figures(found: LensFindings, distance_mm: float) -> tuple[FigureItem, ...]:
    fit = found.fit
    fits = {picture.name: view for picture, view in found.found}
    drawn = [(picture.name, picture.image, fits.get(picture.name)) for picture in found.pictures]
    points = np.concatenate([view.seen_px for view in fit.views])
    rest = np.concatenate([view.residual_px for view in fit.views])
    shape = (fit.lens.height_px, fit.lens.width_px)
    u = fit.uncertainty_at_px(distance_mm)
    return (
        FigureItem(
            "Boards found",
            boards_overlay(drawn),
            f"Pictures of the board with the points found in them; {len(fits)} of {len(drawn)} show it.",
            "png",
        ),
        FigureItem(
            "Residuals of the boards",
            residual_quiver(points, rest, shape, title="observed - modelled"),
            f"Arrows at the points of all boards, observed minus modelled, {fit.rms_px:.3f} px rms. Arrows that point "
            "alike in a region would show what the lens model leaves out.",
        ),
        FigureItem(
            "Coverage of the field",
            lens_coverage(fit),
            "Points of all boards in the picture, coloured by tilt. Where there are none, the lens is extrapolated.",
        ),
        FigureItem(
            "Uncertainty of the projection",
            lens_uncertainty_map(fit, distance_mm),
            f"Standard uncertainty over the picture of where a point at {distance_mm:.0f} mm is seen: median "
            f"{float(np.nanmedian(u)):.2g} px, at most {float(np.nanmax(u)):.2g} px.",
            "png",
        ),
    )
