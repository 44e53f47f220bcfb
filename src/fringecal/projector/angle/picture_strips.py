"""Strips in one grey picture with fringes: which pixels they cover, and a phase coarse enough to number the fringes.

As the thesis did, one picture is all there is. The fringes are demodulated line by line; the plate's phase is the
smooth one of the two levels that makes a row of strips as the target states it.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fringecal.camera import PlateCamera
from fringecal.errors import DetectionError, FitError
from fringecal.phase import LineCarrier, SmoothPhase, demodulate_lines, fringed, plate_phase_on, plate_phases
from fringecal.projector.orders.whole_fringes import explained
from fringecal.projector.standards.strip_phase import StripPhase, strips_from_step
from fringecal.targets import Strips

Array = NDArray[np.float64]

_ALONG_DEG = 25.0  # between strips and fringes below which a fringe crosses hardly any edge
_ON_LEVEL_RAD = 0.35  # a twentieth of a fringe: noise and the smooth level's residual stay within it
_SURE = 0.9  # share of the pixels that lie on the level their label asks for, above which no other level is tried


@dataclass(frozen=True)
class PictureStrips:
    """What one picture shows: the fringes, the plate's smooth phase (NaN where no fringes are), and the strips."""

    carrier: LineCarrier
    plate_phase_rad: Array
    strips: StripPhase


def strips_in_picture(
    image: ArrayLike, target: Strips, camera: PlateCamera, *, projector_mm: Array | None = None
) -> Iterator[PictureStrips]:
    """Find the strips in one picture by the phase they add to the plate's, in every way that shows them.

    Where only part of the strips is lit, gaps may make a row of strips as well as strips do: what the fringe order then
    says of the lamp must tell.

    Parameters
    ----------
    image
        Grey values, (H, W).
    target
        Count, width, gap and height of the strips.
    camera
        The camera on the plate.
    projector_mm
        The stated position of the projector: only tells why strips do not show.

    Raises
    ------
    PhaseError
        No fringes in the picture.
    DetectionError
        No row of strips as the target states it, or strips along the fringes.
    """
    carrier = demodulate_lines(image)
    valid = fringed(carrier)
    unsure: list[tuple[float, PictureStrips]] = []
    errors: list[Exception] = []
    tried: list[SmoothPhase] = []
    sure = False
    for plate in plate_phases(carrier, valid):
        tried.append(plate)
        try:
            share, found = _found(carrier, plate, valid, target, camera)
        except (DetectionError, FitError) as error:
            errors.append(error)
            continue
        if share > _SURE:
            sure = True
            _demand_crossing(carrier, found.strips)
            yield found
        else:
            unsure.append((share, found))
    if sure:
        return
    if not unsure:
        reason = DetectionError(f"in this one picture the strips cannot be distinguished from the plate: {errors[0]}")
        height = float(np.mean(target.height_mm.array(target.count)))
        raise explained(reason, np.where(valid, tried[0].map(), np.nan), camera, height, projector_mm)
    for _, found in sorted(unsure, key=lambda one: -one[0]):
        _demand_crossing(carrier, found.strips)
        yield found


def _found(
    carrier: LineCarrier, plate: SmoothPhase, valid: NDArray[np.bool_], target: Strips, camera: PlateCamera
) -> tuple[float, PictureStrips]:
    """Find the strips over one level of phase; also the share of pixels that lie where their label asks for it."""
    strips = strips_from_step(_step(carrier, plate), valid, target, camera)
    plate = plate_phase_on(carrier, valid & (strips.regions.labels == 0), plate)
    strips = strips_from_step(_step(carrier, plate), valid, target, camera)
    share = _agreement(_step(carrier, plate), strips)
    return share, PictureStrips(carrier, np.where(valid, plate.map(), np.nan), strips)


def _step(carrier: LineCarrier, plate: SmoothPhase) -> Array:
    return np.angle(carrier.signal * np.exp(-1j * plate.map()))


def _agreement(step: Array, strips: StripPhase) -> float:
    """Share of the labelled pixels that are on the plate's level where they should be, and off it on strips."""
    labels = strips.regions.labels
    near = np.abs(step) < _ON_LEVEL_RAD
    return float(min(near[labels == 0].mean(), 1 - near[labels > 0].mean()))


def _demand_crossing(carrier: LineCarrier, strips: StripPhase) -> None:
    """Refuse strips that run along the fringes: a fringe crosses no edge of them, and shows no break."""
    fringes_deg = 0.0 if carrier.along == "rows" else 90.0
    apart = abs((strips.regions.direction_deg - fringes_deg + 90) % 180 - 90)
    if apart < _ALONG_DEG:
        raise DetectionError(
            f"the strips run along the fringes ({apart:.0f} deg between them): no fringe crosses an edge, so that no "
            "break shows. Lay the strips across the fringes, or use phase-shifted pictures."
        )
