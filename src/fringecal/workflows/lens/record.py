"""Between what is known of a lens and what a record holds of it."""

import numpy as np

from fringecal.calibration import KnownLens, LensFindings
from fringecal.camera import LENS_NAMES
from fringecal.records import BoardPictureRecord, BoardSolution, LensRecord, ProjectionUncertainty


def lens_record(known: KnownLens, *, distance_mm: float | None = None) -> LensRecord:
    """Return the record of a lens.

    Parameters
    ----------
    known
        The lens and where it comes from.
    distance_mm
        Distance for which its uncertainty is stated; the boards' own if left out.
    """
    lens = known.lens
    covariance = (lens.covariance + lens.covariance.T) / 2
    return LensRecord(
        names=LENS_NAMES,
        parameters=tuple(map(float, lens.values)),
        covariance=tuple(tuple(map(float, row)) for row in covariance) if lens.covariance_known else None,
        width=lens.width_px,
        height=lens.height_px,
        file=known.file,
        boards=None if known.findings is None else _solution(known.findings, distance_mm),
        notes=known.notes,
    )


def _solution(found: LensFindings, distance_mm: float | None) -> BoardSolution:
    fit = found.fit
    distance = fit.distance_mm if distance_mm is None else distance_mm
    u = fit.uncertainty_at_px(distance)
    return BoardSolution(
        solver=fit.solver,
        board=found.target.name,
        rms_px=fit.rms_px,
        points=fit.points,
        outliers=fit.outliers,
        dof=fit.dof,
        model="brown" if fit.rich is None else fit.rich.model,
        left_rms_px=None if fit.left_px is None else float(np.sqrt(np.mean(fit.left_px**2))),
        board_warp_mm=fit.board_warp_mm,
        halves_median_px=None if fit.halves_px is None else float(np.nanmedian(fit.halves_px)),
        inflation=fit.inflation,
        projection=ProjectionUncertainty(
            distance_mm=distance, median_px=float(np.nanmedian(u)), max_px=float(np.nanmax(u))
        ),
        pictures=_pictures(found),
    )


def _pictures(found: LensFindings) -> tuple[BoardPictureRecord, ...]:
    fits = {picture.name: view for picture, view in found.found}
    rows = []
    for picture in found.pictures:
        view = fits.get(picture.name)
        if view is None:
            reason = picture.reason or "disagrees with the other pictures"
            rows.append(BoardPictureRecord(name=picture.name, reason=reason))
            continue
        rows.append(
            BoardPictureRecord(
                name=picture.name,
                points=len(view.seen_px),
                left_out=len(view.left_out_px),
                rms_px=view.rms_px,
                tilt_deg=view.tilt_deg,
                distance_mm=view.distance_mm,
            )
        )
    return tuple(rows)
