"""The report of a measurement: an object's heights, their uncertainty, sections, and what was masked."""

from datetime import datetime

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from fringecal.projector import fitted_to
from fringecal.reconstruct import HeightMap, Reason
from fringecal.records import DEFAULT_LIMITS, Limits, software_versions
from fringecal.report import (
    AS_U,
    Fact,
    FigureItem,
    Live,
    ReadableMap,
    Report,
    Section,
    Table,
    Verdict,
    classification_overlay,
    sections_plot,
    uncertainty_map,
)
from fringecal.uncertainty import Influence, Source
from fringecal.workflows.reconstruct.checks import measurement_causes, measurement_checks, tie_offered
from fringecal.workflows.reconstruct.relief_section import relief_section
from fringecal.workflows.reconstruct.run import Measurement
from fringecal.workflows.shared import (
    checks_table,
    findings_section,
    height_item,
    inputs_of_capture,
    phase_section,
    readable_surface,
    severest,
    surface_item,
)

_SECTIONS = (0.25, 0.5, 0.75)  # of the rows that hold heights
_PERCENTILES = (0, 5, 25, 50, 75, 95, 100)  # of the heights, as a box plot with its ends has them


def measurement_report(
    found: Measurement, *, command: str = "", created: datetime | None = None, limits: Limits = DEFAULT_LIMITS
) -> Report:
    """Return the report of a reconstructed object.

    Parameters
    ----------
    found
        The object's surface and its phase.
    command, created
        As for `commission_report`.
    limits
        What the plate beside the object may differ by.
    """
    checks = measurement_checks(found, limits)
    values = readable_surface(found.surface)
    return Report(
        title=f"Surface of {found.capture.name}",
        subtitle="; ".join(filter(None, (_model(found), found.treatment.sentence, _tie(found)))),
        verdict=Verdict(severest(checks), _sentence(found)),
        facts=_facts(found),
        sections=(
            Section("Capture against calibration", causes_in_words(found, limits), (checks_table(checks),)),
            _height_section(found, values),
            relief_section(found, section_rows(found.surface.mask), values),
            _uncertainty_section(found, values),
            _mask_section(found),
            phase_section((found.phase,)),
            findings_section((found.diagnosed,)),
        ),
        inputs=inputs_of_capture(found.capture),
        versions=software_versions(),
        command=command,
        created=created,
    )


def _model(found: Measurement) -> str:
    """Name the height model, and what it was fitted to where that is no measurement."""
    fitted = fitted_to(found.model)
    return f"Height model: {found.model}" + ("" if fitted == fitted_to("projective") else f", fitted to {fitted}")


def _tie(found: Measurement) -> str:
    """State what was taken off the heights, if so."""
    if found.tied is None:
        return ""
    offset, u = found.tied.offset_mm, found.tied.u_mm
    return f"tied to the plate in view: {offset:+.4f} mm (u {u:.4f} mm) and its slopes taken off"


def causes_in_words(found: Measurement, limits: Limits = DEFAULT_LIMITS) -> tuple[str, ...]:
    """Return the causes for which a capture does not fit its calibration, one sentence each."""
    offered = tie_offered(found, limits)
    causes = tuple(f"Probable cause: {cause}." for cause in measurement_causes(found, limits))
    return (*causes, offered) if offered else causes


def _sentence(found: Measurement) -> str:
    z, u = found.surface.z, found.surface.u_z
    return (
        f"Heights from {np.nanmin(z):.3f} to {np.nanmax(z):.3f} mm on {100 * found.shares()['valid']:.1f} % of the "
        f"picture, with a median standard uncertainty of {np.nanmedian(u):.4f} mm per pixel. "
        "The verdict is on whether the capture fits the calibration, not on the object."
    )


def _facts(found: Measurement) -> tuple[Fact, ...]:
    surface = found.surface
    return (
        Fact("Largest height", f"{np.nanmax(surface.z):.3f} mm", "above the plate"),
        Fact("Smallest height", f"{np.nanmin(surface.z):.3f} mm"),
        Fact("Median u(z)", f"{np.nanmedian(surface.u_z):.4f} mm", "one pixel, combined"),
        Fact("Median random part", f"{np.nanmedian(surface.u_random):.4f} mm", "independent from pixel to pixel"),
        Fact("Valid pixels", f"{100 * found.shares()['valid']:.1f} %", "of the picture"),
    )


def _height_section(found: Measurement, values: ReadableMap) -> Section:
    surface = found.surface
    span = f"from {np.nanmin(surface.z):.2f} to {np.nanmax(surface.z):.2f} mm"
    rows = section_rows(surface.mask)
    items = (
        height_item("Height", surface, values, f"Height map, y up, {span}."),
        FigureItem(
            "Sections",
            _sections(surface, rows),
            f"Heights along picture rows {', '.join(map(str, rows))} with their 95 % band.",
        ),
        surface_item(
            "The surface in three dimensions", surface, values, f"Oblique view of the surface, heights {span}."
        ),
    )
    return Section("Height", (), (_distribution_table(surface),), items)


def section_rows(mask: NDArray[np.bool_]) -> tuple[int, ...]:
    """Choose three rows at quarters of those that hold valid pixels; fewer where there are fewer.

    Examples
    --------
    >>> mask = np.zeros((9, 4), bool); mask[2:7] = True
    >>> section_rows(mask)
    (3, 4, 5)
    """
    rows = np.flatnonzero(mask.any(axis=1))
    return tuple(sorted({int(rows[round(share * (rows.size - 1))]) for share in _SECTIONS}))


def _sections(surface: HeightMap, rows: tuple[int, ...]):  # type: ignore[no-untyped-def]
    names = [f"row {row} px, y = {np.nanmean(surface.y[row]):.1f} mm" for row in rows]
    return sections_plot(
        [surface.x[row] for row in rows],
        [surface.z[row] for row in rows],
        [surface.u_z[row] for row in rows],
        names,
    )


def _distribution_table(surface: HeightMap) -> Table:
    """Tabulate percentiles of height and uncertainty."""
    frame = pd.DataFrame(
        {
            "percentile": list(_PERCENTILES),
            "z / mm": np.nanpercentile(surface.z, _PERCENTILES),
            "u(z) / mm": np.nanpercentile(surface.u_z, _PERCENTILES),
            "random part / mm": np.nanpercentile(surface.u_random, _PERCENTILES),
        }
    )
    formats = {"z / mm": ".3f", "u(z) / mm": ".4f", "random part / mm": ".4f"}
    return Table("Distribution over the valid pixels", frame, "percentiles of each column by itself", formats)


def _uncertainty_section(found: Measurement, values: ReadableMap) -> Section:
    surface = found.surface
    sentence = (
        "Random parts differ from pixel to pixel and fall out of means; the others are common to neighbouring pixels "
        "and do not."
    )
    item = FigureItem(
        "Standard uncertainty of the height",
        uncertainty_map(surface.x, surface.y, surface.u_z),
        f"Map of u(z), y up, median {np.nanmedian(surface.u_z):.4f} mm.",
        "png",
        Live(values),
    )
    return Section("Uncertainty", (sentence,), (_causes_table(surface),), (item,))


def _causes_table(surface: HeightMap) -> Table:
    """Tabulate the budget of u(z): rms over the valid pixels by source, the largest first."""
    variances = {Source(Influence.PIXEL_PHASE): _mean_square(surface.u_random)}
    for number, source in enumerate(surface.systematic.sources):
        part = _mean_square(surface.systematic.map(number, surface.z))
        variances[source] = variances.get(source, 0.0) + part
    if surface.bias is not None:
        variances[Source(Influence.KNOWN_BIAS)] = _mean_square(surface.bias)
    total = sum(variances.values()) or 1.0
    ordered = sorted(variances.items(), key=lambda item: -item[1])
    frame = pd.DataFrame(
        {
            "cause": [source.text for source, _ in ordered],
            "rms over the surface / mm": [variance**0.5 for _, variance in ordered],
            "share of the variance / %": [100 * variance / total for _, variance in ordered],
        }
    )
    formats = {"rms over the surface / mm": AS_U, "share of the variance / %": ".1f"}
    return Table(
        "Uncertainty budget of the height", frame, "standard uncertainties of an unfiltered pixel's height", formats
    )


def _mean_square(values: NDArray[np.float64]) -> float:
    return float(np.nanmean(values**2))


def _mask_section(found: Measurement) -> Section:
    shares = found.shares()
    frame = pd.DataFrame(
        {
            "pixels": [name.replace("_", " ") for name in shares],
            "share of the picture / %": [100 * share for share in shares.values()],
        }
    )
    table = Table(
        "Valid and masked pixels", frame, "a pixel may have several reasons", {"share of the picture / %": ".2f"}
    )
    if found.surface.mask.all():
        return Section("Masked pixels", ("No pixel is masked.",), (table,))
    return Section("Masked pixels", (), (table,), (_mask_figure(found),))


def _mask_figure(found: Measurement) -> FigureItem:
    """Colour the masked pixels by the first reason that holds."""
    classes = np.zeros(found.surface.reasons.shape, np.uint8)
    for reason in reversed(Reason):
        classes[(found.surface.reasons & reason) > 0] = reason
    names = {int(r): (r.name or "").lower().replace("_", " ") for r in Reason if (classes == r).any()}
    figure = classification_overlay(found.phase.map.background, classes, names, title=found.capture.name)
    share = 100 * (1 - found.shares()["valid"])
    return FigureItem(
        "Masked pixels", figure, f"The picture with {share:.1f} % of its pixels coloured as masked.", "png"
    )
