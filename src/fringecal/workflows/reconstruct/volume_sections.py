"""The report of a capture measured by a rig that a board has calibrated."""

from datetime import datetime

import numpy as np
import pandas as pd

from fringecal.reconstruct import Reason
from fringecal.records import software_versions
from fringecal.report import (
    Fact,
    FigureItem,
    Report,
    Section,
    Table,
    Verdict,
    height_map,
    picture_map,
    uncertainty_map,
)
from fringecal.workflows.reconstruct.volume_run import VolumeMeasured
from fringecal.workflows.shared import inputs_of_capture

_WORDS = {
    Reason.NO_PHASE: "no phase",
    Reason.ORDER_UNDECIDED: "the two axes contradict each other",
    Reason.NO_RAY: "rays do not meet",
    Reason.OUT_OF_RANGE: "outside the calibrated volume",
}


def volume_shares(found: VolumeMeasured) -> dict[str, float]:
    """Return the share of the picture that is valid, and of each reason why pixels are masked."""
    reasons = found.volume.reasons
    shares = {words: float(np.mean((reasons & reason) != 0)) for reason, words in _WORDS.items()}
    return {"valid": float(found.volume.mask.mean())} | shares


def volume_report(found: VolumeMeasured, *, command: str = "", created: datetime | None = None) -> Report:
    """Return the report of a measured capture."""
    volume, shares = found.volume, volume_shares(found)
    over = f"over the plate of {found.plate}" if found.heights is not None else "in the camera's frame"
    u = float(
        np.nanmedian(found.heights.u_z if found.heights is not None else np.where(volume.mask, volume.u_z, np.nan))
    )
    return Report(
        title=f"Surface of {found.capture.name}",
        subtitle=f"measured {over}",
        verdict=Verdict("info", f"{100 * shares['valid']:.1f} % of the picture is measured, {over}."),
        facts=(
            Fact("Measured", f"{100 * shares['valid']:.1f} %", "of the picture"),
            Fact("u(z)", f"{u:.2g} mm", "median, standard uncertainty"),
            Fact("u of the phase", " and ".join(f"{one:.3f}" for one in found.u_px if one > 0) + " px", "by the phase"),
            *_plate_facts(found),
        ),
        sections=(Section("Surface", (), (_shares(shares),), _figures(found)),),
        inputs=inputs_of_capture(found.capture),
        versions=software_versions(),
        command=command,
        created=created,
    )


def _plate_facts(found: VolumeMeasured) -> tuple[Fact, ...]:
    if found.frame is None:
        return ()
    return (Fact("Scatter of the plate", f"{found.frame.scatter_mm:.2g} mm", "about its plane, robust"),)


def _shares(shares: dict[str, float]) -> Table:
    frame = pd.DataFrame({"pixels": list(shares), "share": [100 * share for share in shares.values()]})
    return Table("Pixels", frame, "% of the picture; a pixel may be masked for several reasons", {"share": ".2f"})


def _figures(found: VolumeMeasured) -> tuple[FigureItem, ...]:
    name, volume = found.capture.name, found.volume
    if found.heights is not None:
        over = found.heights
        return (
            FigureItem(
                "Heights", height_map(over.x, over.y, over.z, title=name), f"Heights of {name} over the plate.", "png"
            ),
            FigureItem(
                "Uncertainty of the heights",
                uncertainty_map(over.x, over.y, over.u_z, title=name),
                "Combined standard uncertainty of each height: its pixel's noise, and the calibration's part that "
                "plate and surface do not share.",
                "png",
            ),
        )
    depth, u = (np.where(volume.mask, one, np.nan) for one in (volume.z, volume.u_z))
    return (
        FigureItem(
            "Depth", picture_map(depth, "z / mm", title=name), f"Distance of {name} along the camera's axis.", "png"
        ),
        FigureItem(
            "Uncertainty of the depth",
            picture_map(u, "u(z) / mm", title=name),
            "Combined standard uncertainty of the distance of each pixel.",
            "png",
        ),
    )
