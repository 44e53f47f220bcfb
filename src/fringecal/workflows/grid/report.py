"""Results of one picture of a grid, as parts of a report: its lines, the scale of the thesis's tables, the lens."""

from dataclasses import dataclass

import numpy as np
import pandas as pd

from fringecal.camera import (
    SIGNIFICANCE,
    DistortionTest,
    ThesisScale,
    check_points,
    effect_of_neglect_px,
    family_rms_px,
)
from fringecal.detect import FAMILIES, GridDetection, line_section
from fringecal.report import (
    AS_U,
    FigureItem,
    Section,
    Table,
    distortion_quiver,
    grid_overlay,
    neglect_map,
    scale_map,
    section_plot,
)
from fringecal.uncertainty import Estimate, uncertainty_text, value_text
from fringecal.workflows.shared import concise, estimates_table

#: Residuals this many times larger than the crossings' own uncertainty are no longer noise alone: a sheet that is not
#: flat, or a lens with more terms. Up to it, lines that run nearly along the pixels may be the reason.
LARGEST_RESIDUAL_RATIO = 3.0


@dataclass(frozen=True)
class GridPicture:
    """A picture of a grid with what was found in it; `scale` and `pitch_mm` are None without a target."""

    name: str
    picture: np.ndarray
    detection: GridDetection
    test: DistortionTest
    scale: ThesisScale | None = None
    pitch_mm: Estimate | None = None
    used: np.ndarray | None = None

    @property
    def mm_per_px(self) -> float | None:
        """Mean scale, if the pitch is known."""
        return None if self.scale is None else self.scale.mean.value


def lines_section(grid: GridPicture) -> Section:
    """Show the lines over their picture, and the brightness across them (the thesis's figure 3.20)."""
    found = grid.detection
    counts = [len(found.family(family)) for family in FAMILIES]
    sentence = (
        f"{counts[0]} horizontal and {counts[1]} vertical {found.polarity} lines, "
        f"{found.profile.width_px:.1f} px wide; {len(found.row)} crossings, each known to "
        f"{float(np.median(found.sigma_px)):.3f} px (median u per axis)."
    )
    figures = [_overlay(grid, counts)]
    if found.profile.blur_px > 0:  # dots have none, and no lines to be crossed
        figures.append(_profile(grid))
    return Section("Lines of the grid", (sentence,), (), tuple(figures))


def _profile(grid: GridPicture) -> FigureItem:
    sections = {str(family): line_section(grid.picture, grid.detection, family) for family in reversed(FAMILIES)}
    return FigureItem(
        "Intensity profile across the lines",
        section_plot(sections),
        "Grey level along one section across the vertical lines and one across the horizontal lines; marks stand "
        "where lines were found.",
    )


def _overlay(grid: GridPicture, counts: list[int]) -> FigureItem:
    found = grid.detection
    return FigureItem(
        "Lines and crossings found",
        grid_overlay(grid.picture, found, used=grid.used, title=grid.name),
        f"The picture with {counts[0]} horizontal and {counts[1]} vertical lines and {len(found.row)} crossings drawn "
        "over it; some crossings carry their row and column.",
        "png",
    )


def scale_section(grid: GridPicture) -> Section:
    """Give the mean scale, the distances it comes from, and its errors over the field (tables 3.1 to 3.4)."""
    if grid.scale is None or grid.pitch_mm is None:
        return Section("Scale", ("No scale: the grid's target was not named.",))
    scale = grid.scale
    factors = {"along u (vertical lines)": scale.horizontal, "along v (horizontal lines)": scale.vertical}
    others = {"mean": scale.mean, "image centre, by the fitted view": grid.test.scale_at_centre(grid.pitch_mm)}
    figure = FigureItem(
        "Error of the mean scale over the field",
        scale_map(grid.detection, grid.pitch_mm.value, scale.mean.value),
        f"Error of the length of every piece of line by the mean scale, in percent; largest of the check distances "
        f"{scale.largest_error_percent:+.3f} %. A slope means tilt, a bowl means lens distortion.",
        "png",
    )
    tables = (
        estimates_table("Scale from distances between lines", factors | others, first="scale"),
        *thesis_tables(scale),
    )
    return Section("Mean scale", (anisotropy_sentence(scale),), tables, (figure,))


def anisotropy_sentence(scale: ThesisScale) -> str:
    """Say whether the scales of both directions differ significantly."""
    ratio = scale.anisotropy
    p = scale.anisotropy_p
    beyond = "differ significantly" if p < SIGNIFICANCE else "do not differ significantly"
    return (
        f"The two directions {beyond} (vertical over horizontal {concise(ratio)}, p = {p:.2g}); a tilt causes this as "
        "well as pixels that are not square. The camera fit on the plate separates them."
    )


def thesis_tables(scale: ThesisScale) -> tuple[Table, ...]:
    """Tabulate line distances and the errors of the mean scale, the thesis's way (its tables 3.1 to 3.4)."""
    factors = f"mean scale {concise(scale.mean)}; distances in the middle third of the picture"
    errors = f"distances at other places by the mean scale; largest error {scale.largest_error_percent:+.3f} %"
    parts = (
        ("Distances between vertical lines", scale.vertical_lines, factors),
        ("Distances between horizontal lines", scale.horizontal_lines, factors),
        ("Errors of distances between vertical lines", scale.horizontal_errors, errors),
        ("Errors of distances between horizontal lines", scale.vertical_errors, errors),
    )
    return tuple(Table(caption, _by_span(frame), note, _SPAN_FORMATS) for caption, frame, note in parts)


_SHOWN = {
    "distance_px": ("mean distance / px", "sd distance / px"),
    "factor_mm_per_px": ("mean scale / (mm/px)", "sd scale / (mm/px)"),
    "error_mm": ("mean error / mm", "sd error / mm"),
    "error_percent": ("mean error / %", "sd error / %"),
}
_SPAN_FORMATS = dict.fromkeys((sd for _, sd in _SHOWN.values()), AS_U) | {
    "nominal / mm": "g",
    "mean distance / px": ".3f",
    "mean scale / (mm/px)": ".5f",
    "mean error / mm": "+z.3f",
    "mean error / %": "+z.3f",
}


def _by_span(frame: pd.DataFrame) -> pd.DataFrame:
    """Gather one row for each span between lines: the single distances would fill pages."""
    groups = frame.groupby(["part", "span"], sort=False)
    columns = {"distances": groups.size(), "nominal / mm": groups["distance_mm"].mean()}
    for name, (mean, sd) in _SHOWN.items():
        if name in frame:
            columns |= {mean: groups[name].mean(), sd: groups[name].std()}
    return pd.DataFrame(columns).fillna(0.0).reset_index()


def distortion_section(grid: GridPicture) -> Section:
    """Give the lens distortion, its values at check points, and the error of neglecting it."""
    test, shape = grid.test, grid.detection.shape
    points = check_points(test, shape, mm_per_px=grid.mm_per_px)
    formats = dict.fromkeys(points.columns[1:], "+.3f") | dict.fromkeys(("u / px", "v / px"), ".1f")
    note = "distance of the crossing from the best plane view of the grid; outward: the lens's own displacement"
    before = float(np.sqrt(np.mean(test.residual_before_px**2)))
    after = float(np.sqrt(np.mean(test.residual_after_px**2)))
    quiver = FigureItem(
        "Residuals without and with the lens",
        distortion_quiver(test, shape),
        f"Arrows at the crossings, observed minus fitted: {before:.3f} px rms with a plane view alone, {after:.3f} px "
        "with the lens. Arrows that point alike in a region show what a model leaves out.",
        "png",
    )
    found = test.verdict != "none"
    neglect = FigureItem(
        "Error of neglecting the lens" if found else "Distance of the crossings from the best plane view",
        neglect_map(test, shape, mm_per_px=grid.mm_per_px),
        "Every crossing coloured by the error of its position when the lens is neglected."
        if found
        else "Every crossing coloured by its distance from the best plane view. No distortion was found in "
        "it: the rest is the scatter of the crossings and of the lines' own places.",
        "png",
    )
    tables = (_straightness_table(test), Table("Distortion at check points", points, note, formats))
    return Section("Lens distortion", distortion_sentences(test, grid.mm_per_px), tables, (quiver, neglect))


def grid_sentence(grid: GridPicture) -> str:
    """Give the results of the picture in one line; the sections give the details."""
    found, size = grid.test.verdict, distortion_size(grid.test)
    lens = f"no lens distortion was found ({size})" if found == "none" else f"{found} distortion, {size}"
    scale = (
        "no scale, since the target was not named" if grid.scale is None else f"mean scale {concise(grid.scale.mean)}"
    )
    return f"{len(grid.detection.row)} crossings: {scale}; {lens}."


def distortion_size(test: DistortionTest) -> str:
    """Say in a few words how large the lens's distortion is, or its detection limit."""
    if test.verdict == "none":
        return f"detection limit {uncertainty_text(test.detection_limit_px)} px at 95 %"
    return f"{concise(test.max_px)} at {test.radius_px:.0f} px from its centre"


def distortion_sentences(test: DistortionTest, mm_per_px: float | None) -> tuple[str, ...]:
    """State verdict, size, detection limit, error of neglecting the lens, and centre."""
    at = f"{value_text(test.max_px.value, test.max_px.u)} px (u = {uncertainty_text(test.max_px.u)} px) at "
    at += f"{test.radius_px:.0f} px from its centre"
    limit = f"detection limit {uncertainty_text(test.detection_limit_px)} px at 95 %"
    if test.verdict == "none":
        verdict = f"No lens distortion was found: {at}; {limit} (F-test, p = {test.p_value:.2g})."
    else:
        verdict = f"The lens shows {test.verdict} distortion: {at} (F-test, p = {test.p_value:.2g}); {limit}."
    if test.irregular_px:
        verdict += f" {_sheet_sentence(test, mm_per_px)}"
    elif test.misfit > LARGEST_RESIDUAL_RATIO:
        verdict += (
            f" The crossings' residuals are {test.misfit:.1f} times their own uncertainty: lines that are "
            "not quite straight or evenly spaced, a sheet that is not quite flat, or a distortion of another form."
        )
    worst = float(effect_of_neglect_px(test).max())
    error = f"{worst:.3g} px" if mm_per_px is None else f"{worst * mm_per_px:.3g} mm ({worst:.3g} px)"
    neglected = f"With the lens neglected, positions have errors of up to {error}."
    if test.verdict == "none":
        neglected = f"Crossings lie up to {error} from the best plane view; no distortion was found in it."
    sentences = [verdict, neglected]
    if test.centre is not None:
        u, v = test.centre
        sentences.append(
            f"Its centre lies at u = {concise(u)}, v = {concise(v)}. A tilt of the camera is fitted beside it: "
            "without that, a tilt would appear as a displacement of the centre."
        )
    return tuple(sentences)


def _sheet_sentence(test: DistortionTest, mm_per_px: float | None) -> str:
    """Say by how much the sheet's lines stand off their places, and what that leaves to say of the lens."""
    size = f"{test.irregular_px:.2g} px" if mm_per_px is None else f"{test.irregular_px * mm_per_px:.2g} mm"
    told = f"The sheet is irregular by {size} rms: its lines do not stand where an even ruling has them, "
    if test.verdict != "none":
        return told + "so that the lens is told by their bending alone."
    return (
        told + "and are not bent as a lens bends them; no statement about a lens that displaces by less than "
        f"{test.detection_limit_px:.2g} px."
    )


def _straightness_table(test: DistortionTest) -> Table:
    rows = [
        {
            "lines": family,
            "before / px": family_rms_px(test.straightness_before, family),
            "after / px": family_rms_px(test.straightness_after, family),
        }
        for family in FAMILIES
    ]
    formats = {"before / px": ".4f", "after / px": ".4f"}
    note = "rms distance of their points from straight, before and after the lens is taken out"
    return Table("Straightness of the lines", pd.DataFrame(rows), note, formats)
