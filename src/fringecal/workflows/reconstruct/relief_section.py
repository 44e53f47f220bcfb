"""What stands on the plate: contour lines, area, volume, and folds, each with its uncertainty."""

import pandas as pd

from fringecal.errors import FitError
from fringecal.reconstruct import Extent, extent_of, row_section
from fringecal.report import FigureItem, Live, ReadableMap, Section, Table, contour_map
from fringecal.verification import Fold, folds_of, folds_table
from fringecal.workflows.reconstruct.run import Measurement


def relief_section(found: Measurement, rows: tuple[int, ...], values: ReadableMap) -> Section:
    """Return the report's section on what stands on the plate.

    Parameters
    ----------
    found
        The measured object.
    rows
        Picture rows along which folds are looked for.
    values
        The surface as the reader of the page takes its values.
    """
    surface = found.surface
    sentences, tables = [], []
    try:
        extent = extent_of(surface, found.calibration, model=found.model)
        tables.append(_extent_table(extent))
    except FitError as error:
        sentences.append(f"No area and volume: {error}.")
    folds = _folds(found, rows)
    if folds:
        tables.append(_folds_table(folds))
    else:
        sentences.append(f"The sections along rows {', '.join(map(str, rows))} show no ridge between two valleys.")
    figure = contour_map(surface.x, surface.y, surface.z)
    alt = "Contour map, y up, lines at round heights."
    item = FigureItem("Lines of equal height", figure, alt, "png", Live(values))
    return Section("Relief", tuple(sentences), tuple(tables), (item,))


def _folds(found: Measurement, rows: tuple[int, ...]) -> dict[int, tuple[Fold, ...]]:
    folds = {}
    for row in rows:
        try:
            folds[row] = folds_of(row_section(found.surface, found.calibration, row, model=found.model))
        except FitError:
            continue  # a row beside the pleats
    return folds


def _folds_table(folds: dict[int, tuple[Fold, ...]]) -> Table:
    frame = folds_table(folds)
    formats = {name: ".3f" for name in frame.columns[2:] if not name.startswith("u(")}
    uncertainties = {name: doubt for name in formats if (doubt := "u({}) / {}".format(*name.split(" / "))) in frame}
    note = (
        "ridges between two valleys; angle between the straight middle halves of both flanks, 180 for a flat sheet; "
        "spacing to the next ridge, straight and along the surface"
    )
    return Table("Ridges and folds along picture rows", frame, note, formats, uncertainties)


def _extent_table(extent: Extent) -> Table:
    frame = pd.DataFrame(
        [
            ("area of the surface", extent.area_mm2, extent.u_area_mm2, "mm2"),
            ("area on the plate", extent.projected_mm2, extent.u_projected_mm2, "mm2"),
            ("volume down to the plate", extent.volume_mm3, extent.u_volume_mm3, "mm3"),
        ],
        columns=["quantity", "value", "u", "unit"],
    )
    note = f"what stands more than {extent.above_mm:.3g} mm above the plate; masked pixels count in none"
    return Table("Area and volume", frame, note, {"value": ".6g"}, {"value": "u"})
