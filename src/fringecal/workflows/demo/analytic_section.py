"""The report's section on the thesis's simulation by formula."""

from collections.abc import Sequence

import numpy as np
import pandas as pd

from fringecal.report import FigureItem, Layer, Live, Section, Table, analytic_overview, readable_plate, surface_view
from fringecal.thesis import ANGLES_DEG, AnalyticCase

_WORDS = (
    "Three cosine images of a rectangle and of a zig-zag on a flat background, amplitude 127.5, are drawn by formula, "
    "rounded to 8 bits and read back: the error of the method itself, without lens, light and rig. A height step "
    "cannot be distinguished from one that is a whole fringe higher: the rectangle's pitch is wide enough that its "
    "fringe shift is less than half a fringe. The zig-zag's slopes are unwrapped over several fringes, "
    "from the background on."
)
_OFF_PX = 1.0  # a pixel further off has another fringe's order: noise of 8 bits makes less than a tenth of it


def analytic_section(cases: Sequence[AnalyticCase]) -> Section:
    """Return table and figures of the thesis's own images (its section 4.2).

    Parameters
    ----------
    cases
        Every object at every angle.
    """
    formats = {"largest error / px": ".4f", "rms error, those left out / px": ".4f"}
    table = Table(
        "Heights read from images drawn by formula",
        pd.DataFrame([_row(case) for case in cases]),
        "angles are measured from the normal; pixels with an error over 1 px have another fringe's order: they lie on "
        "the upright ends of the zig-zag",
        formats,
        row_header=False,
    )
    shown = [case for case in cases if case.angle_deg == ANGLES_DEG[-1]]
    figures = tuple(figure for case in shown for figure in _figures(case))
    return Section("The thesis's own images", (_WORDS,), (table,), figures)


def _row(case: AnalyticCase) -> dict[str, object]:
    error = np.abs(case.height_px - case.true_px)
    right = error <= _OFF_PX
    return {
        "object": case.name,
        "angle / deg": case.angle_deg,
        "pitch / px": case.pitch_px,
        "largest error / px": float(error[right].max()),
        "rms error, those left out / px": float(np.sqrt(np.mean(error[right] ** 2))),
        "pixels with an error over 1 px": int((~right).sum()),
    }


def _figures(case: AnalyticCase) -> tuple[FigureItem, FigureItem]:
    name = f"{case.name} at {case.angle_deg:g} deg"
    v, u = np.mgrid[: case.true_px.shape[0], : case.true_px.shape[1]].astype(float)
    view = surface_view(u, v[::-1], case.height_px, unit="px", title=f"{name}: height read")
    overview = analytic_overview(
        case.frames[0], case.phase.phase, case.height_px, case.true_px, rows=case.rows, title=name
    )
    values = readable_plate(u, v[::-1], (Layer("z", "px", case.height_px, 2),), unit="px")
    return (
        FigureItem(f"Image, phase, height, sections: {name}", overview, f"images and sections of the {name}", "png"),
        FigureItem(f"Surface: {name}", view, f"surface of the {name}", "png", Live(values, 1.0)),
    )
