"""The report of a verification: error tables and profiles, height models and filters side by side."""

import math
from dataclasses import replace
from datetime import datetime

import numpy as np
import pandas as pd

from fringecal.projector import fitted_to
from fringecal.records import DEFAULT_LIMITS, Limits, software_versions
from fringecal.report import (
    DOF,
    Fact,
    FigureItem,
    Layer,
    Live,
    Report,
    Section,
    Table,
    Verdict,
    comparison_bars,
    error_map,
    profile_plot,
)
from fringecal.uncertainty import EXPANDED_BY
from fringecal.verification import ProfileCurve, ProfileErrors, ZigzagErrors, models_table, ranking_table
from fringecal.workflows.shared import (
    findings_section,
    height_item,
    inputs_of_capture,
    phase_section,
    readable_surface,
    severest,
    surface_item,
)
from fringecal.workflows.verify.checks import verification_checks
from fringecal.workflows.verify.run import Verification

_EN_LIMIT = 1.0
_PROFILE_COLUMNS = {
    "name": ("profile", "s"),
    "row_px": ("row / px", ".0f"),
    "y_mm": ("y / mm", ".1f"),
    "n": ("n", "d"),
    "mean_mm": ("mean / mm", "+z.4f"),
    "sd_mm": ("sd / mm", ".4f"),
    "max_abs_mm": ("max / mm", ".4f"),
    "mean_percent": ("mean / %", "+z.3f"),
    "max_percent": ("max / %", ".3f"),
    "u_mm": ("u(mean) / mm", "s"),
    "dof": ("dof", DOF),
    "en": ("En", "+z.2f"),
    "missing_share": ("masked share", ".3f"),
}
_POOLED_COLUMNS = {
    "rank": ("rank", "d"),
    "before": ("before", "s"),
    "after": ("after", "s"),
    "model": ("model", "s"),
    "fitted_to": ("fitted to", "s"),
    "mean_mm": ("mean / mm", "+z.4f"),
    "sd_mm": ("sd / mm", ".4f"),
    "rms_mm": ("rms / mm", ".4f"),
    "max_abs_mm": ("max / mm", ".4f"),
    "mean_percent": ("mean / %", "+z.3f"),
    "max_percent": ("max / %", ".3f"),
    "worst_band_percent": ("worst band / %", ".3f"),
    "mean_of_max_percent": ("mean of the maximum errors / %", ".3f"),
    "rms_mm_edges": ("rms with edges / mm", ".4f"),
    "max_percent_edges": ("max with edges / %", ".2f"),
}


def verification_report(
    found: Verification, *, command: str = "", created: datetime | None = None, limits: Limits = DEFAULT_LIMITS
) -> Report:
    """Return the report of a verification on a zig-zag.

    Parameters
    ----------
    found
        What the verification has found.
    command, created, limits
        As for `commission_report`.
    """
    sections = [errors_section(found.errors), profiles_section(found.errors), _models_section(found)]
    if found.filters:
        sections.append(_filters_section(found))
    return Report(
        title=f"Verification on {found.target.name}",
        subtitle=f"Capture {found.capture.name}; certificate: {found.target.certificate}",
        verdict=replace(verdict_of(found.errors), decision=severest(verification_checks(found, limits))),
        facts=_facts(found),
        sections=(
            *sections,
            surface_section(found),
            phase_section((found.phase,)),
            findings_section((found.diagnosed,)),
        ),
        inputs=inputs_of_capture(found.capture),
        versions=software_versions(),
        command=command,
        created=created,
    )


def verdict_of(errors: ZigzagErrors) -> Verdict:
    """Judge whether the heights agree with the certificate within both uncertainties.

    Every profile and all of them together must keep ``|En| <= 1``; without uncertainties there is no verdict.
    """
    judged = [p for p in (*errors.profiles, errors.pooled) if p.en is not None]
    if not judged:
        return Verdict("info", f"No verdict: no uncertainty is known. {errors.sentence}")
    worst = max(judged, key=lambda p: abs(p.en or 0.0))
    agrees = abs(worst.en or 0.0) <= _EN_LIMIT
    head = (
        f"Measured heights {'agree' if agrees else 'do not agree'} with the certificate within both "
        f"uncertainties: mean error {errors.pooled.mean_percent:+z.3f} % of the full height, largest |En| "
        f"{abs(worst.en or 0.0):.2f} ({_place(worst, errors)})."
    )
    return Verdict("pass" if agrees else "fail", f"{head} {errors.sentence}")


def _place(profile: ProfileErrors, errors: ZigzagErrors) -> str:
    return "all profiles together" if profile is errors.pooled else f"profile {profile.name}"


def _facts(found: Verification) -> tuple[Fact, ...]:
    errors = found.errors
    pooled = errors.pooled
    maxima = np.mean([p.max_percent for p in errors.profiles])
    return (
        Fact("Mean error", f"{pooled.mean_percent:+z.3f} %", "of the full height, edge zones out"),
        Fact("Standard deviation", f"{pooled.sd_mm:.4f} mm", f"{100 * pooled.sd_mm / errors.full_height_mm:.3f} %"),
        Fact("Mean of the maximum errors", f"{maxima:.2f} %", "over the profiles"),
        Fact("Worst band", f"{errors.worst_band_percent:.2f} %", "mean over a tenth of the length, or a flank"),
        Fact("Full height", f"{errors.full_height_mm:.3f} mm", "of the target"),
        Fact(
            "Bars seen",
            f"{found.pose.bars_seen} of {errors.shape.count}",
            f"turned by {found.pose.rotation_deg:+z.2f}°",
        ),
    )


def errors_section(errors: ZigzagErrors) -> Section:
    """Tabulate the errors per profile, without and with edge zones, flank by flank, and by component."""
    zone = (
        f"Edge zones reach {errors.edge_zone_mm:.2f} mm to each side of every ridge and valley, measured on the plate: "
        "there a pixel sees both flanks."
    )
    tables = (
        _profile_table(errors, edges=False),
        _profile_table(errors, edges=True),
        _flank_table(errors),
        _terms_table(errors),
    )
    return Section("Height errors", (zone,), tables)


def _profile_table(errors: ZigzagErrors, *, edges: bool) -> Table:
    along = "row" if errors.axis == "row" else "column"
    frame = errors.table(edges=edges)
    place = {"row_px": (f"{along} / px", ".0f")} | ({} if along == "row" else {"y_mm": ("y / mm", ".1f")})
    return _renamed(
        f"Errors per profile, edge zones {'included' if edges else 'left out'}",
        frame,
        _PROFILE_COLUMNS | place,
        f"measured - reference; percent of the full height {errors.full_height_mm:.3f} mm; "
        f"En = mean / U(mean), certificate included; {EXPANDED_BY}",
    )


def _renamed(caption: str, frame: pd.DataFrame, columns: dict[str, tuple[str, str]], note: str) -> Table:
    """Pick and name the columns of a table that are to be printed."""
    kept = [key for key in columns if key in frame.columns]
    names = [columns[key][0] for key in kept]
    formats = {name: form for name, form in columns.values() if form != "s"}
    uncertainties = {"mean / mm": "u(mean) / mm"} if "u_mm" in kept else {}
    return Table(caption, frame[kept].set_axis(names, axis="columns"), note, formats, uncertainties)


def _flank_table(errors: ZigzagErrors) -> Table:
    """Tabulate the flank angles, one row per flank and one column per profile."""
    flanks = errors.flank_table()
    if flanks.empty:
        return Table("Flank angles", pd.DataFrame({"flank": []}), "no flank has enough pixels")
    flanks["flank"] = [f"{bar} {side}" for bar, side in zip(flanks["bar"], flanks["side"], strict=True)]
    names = list(dict.fromkeys(flanks["profile"]))
    wide = flanks.pivot_table(index="flank", columns="profile", values="error_deg", sort=False)[names]
    wide["mean"] = wide.mean(axis=1)
    u = flanks.groupby("flank", sort=False)["u_deg"].apply(lambda part: math.sqrt(np.mean(np.square(part))))
    frame = wide.assign(**{"u of one": u}).reset_index()
    frame.columns = pd.Index([str(name) for name in frame.columns])
    formats = dict.fromkeys(frame.columns[1:-1], "+z.3f") | {"u of one": ".3f"}
    note = "measured - target / deg, by bar and side; positive is too steep"
    return Table("Flank angles", frame, note, formats)


def _terms_table(errors: ZigzagErrors) -> Table:
    frame = pd.DataFrame(
        {
            "term": [term.name.replace("_", " ") for term in errors.terms],
            "size": [term.size for term in errors.terms],
            "unit": [term.unit for term in errors.terms],
            "rms / mm": [term.rms_mm for term in errors.terms],
        }
    )
    return Table(
        "Components of the error", frame, "one regression over all flanks", {"size": "+.3g", "rms / mm": ".4f"}
    )


def profiles_section(errors: ZigzagErrors) -> Section:
    """Draw every profile: measured and reference height, and their difference with its band."""
    items = tuple(
        _profile_figure(errors, curve, profile) for curve, profile in zip(errors.curves, errors.profiles, strict=True)
    )
    return Section("Profiles", figures=items)


def _profile_figure(errors: ZigzagErrors, curve: ProfileCurve, profile: ProfileErrors) -> FigureItem:
    place = f"{errors.axis} {profile.row_px:.0f} px"
    figure = profile_plot(
        curve.across_mm,
        curve.measured_mm,
        curve.reference_mm,
        curve.u_mm,
        left_out=curve.edge,
        position_label="across the ridges / mm",
        title=f"profile {curve.name}, {place}",
    )
    alt = (
        f"Measured and reference height over {len(curve.across_mm)} pixels, and their difference below: mean "
        f"{profile.mean_mm:+z.4f} mm, largest {profile.max_abs_mm:.4f} mm outside the edge zones."
    )
    return FigureItem(f"Profile {curve.name}", figure, alt)


def _models_section(found: Verification) -> Section:
    """Set the height models side by side, and say why one constant angle is not enough."""
    frame = models_table(found.models)
    frame.insert(1, "fitted_to", [fitted_to(name) for name in found.models])
    note = "pooled over the profiles, edge zones out; percent of the full height"
    table = _renamed("Height models", frame, _POOLED_COLUMNS, note)
    errors = list(found.models.values())
    figure = _bars(list(found.models), errors, title=found.target.name)
    alt = "Bars of the largest error with mean and standard deviation for each height model: " + ", ".join(
        f"{name} {e.pooled.max_percent:.2f} %" for name, e in found.models.items()
    )
    return Section(
        "Height models", _model_sentences(found), (table,), (FigureItem("Height models compared", figure, alt),)
    )


def _model_sentences(found: Verification) -> tuple[str, ...]:
    constant, best = found.models.get("constant-angle"), found.models["projective"]
    if constant is None:
        return ()
    means = [p.mean_percent for p in constant.profiles]
    average = np.mean([p.max_percent for p in constant.profiles])
    return (
        f"The same phase read with one constant angle and one pitch for the whole field, as in the 2008 thesis, gives "
        f"profiles that are wrong by {min(means):+z.1f} to {max(means):+z.1f} % of the full height on average, and by "
        f"{average:.1f} % in the mean of their maximum errors.",
        "The projector's light diverges: pitch and angle change over the field, which one angle and one pitch cannot "
        f"follow. The projective model can: worst band {best.worst_band_percent:.2f} % against "
        f"{constant.worst_band_percent:.2f} %.",
        *_virtual(found),
    )


def _virtual(found: Verification) -> tuple[str, ...]:
    """Say of laws fitted pixel by pixel what they were fitted to: no flats of this session."""
    names = [name for name in found.models if fitted_to(name) != fitted_to("projective")]
    if not names:
        return ()
    return (
        f"{', '.join(names)}: laws of each pixel, fitted to {fitted_to(names[0])} itself. They show what such laws can "
        "hold of this rig, and no error that the rig model has as well.",
    )


def _bars(names: list[str], errors: list[ZigzagErrors], *, title: str):  # type: ignore[no-untyped-def]
    percent = [100 / e.full_height_mm for e in errors]
    return comparison_bars(
        names,
        [e.pooled.mean_percent for e in errors],
        [e.pooled.sd_mm * p for e, p in zip(errors, percent, strict=True)],
        [e.pooled.max_percent for e in errors],
        title=title,
    )


def _filters_section(found: Verification) -> Section:
    """Rank the combinations of filters (the thesis's table 4.8)."""
    table = _renamed(
        "Filters before and after the phase, best first",
        ranking_table(found.filters),
        _POOLED_COLUMNS,
        "3 x 3 filters on the frames and on the heights; pooled over the profiles, edge zones out",
    )
    names = [f"{r.before} / {r.after}" for r in found.filters]
    figure = _bars(names, [r.errors for r in found.filters], title="filter before / after")
    best, plain = found.filters[0], next((r for r in found.filters if r.before == r.after == "none"), None)
    sentence = f"Best: {best.before} before, {best.after} after, {best.errors.pooled.rms_mm:.4f} mm rms"
    sentence += "." if plain is None else f"; without any filter {plain.errors.pooled.rms_mm:.4f} mm."
    item = FigureItem("Filters compared", figure, f"Bars by combination of filters, best on top. {sentence}")
    return Section("Filters", (sentence,), (table,), (item,))


def surface_section(found: Verification) -> Section:
    """Show heights, their errors on the bars, and the surface as a view that can be turned."""
    surface, errors = found.surface, found.errors
    low, high = float(np.nanmin(surface.z)), float(np.nanmax(surface.z))
    seen = f"{100 * float(np.mean(surface.mask)):.1f} % of the picture has a height"
    values = readable_surface(surface, Layer("error", "mm", errors.error_mm, 4))
    items = (
        height_item("Height", surface, values, f"Height map, y up, {low:.1f} to {high:.1f} mm; {seen}."),
        FigureItem(
            "Height error on the bars",
            error_map(surface.x, surface.y, errors.error_mm),
            f"Map of measured minus reference height, {errors.area.rms_mm:.4f} mm rms on the flanks.",
            "png",
            Live(values),
        ),
        surface_item(
            "The bars in three dimensions",
            surface,
            values,
            f"Oblique view of {found.pose.bars_seen} bars side by side on the plate.",
        ),
    )
    return Section("Surface", (f"{seen}.",), (), items)
