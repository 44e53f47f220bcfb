"""Which lines of millimetre paper were indexed: their distance in mm by what is stated and what the picture shows."""

from dataclasses import replace

from fringecal.detect import Ruling
from fringecal.errors import DetectionError
from fringecal.uncertainty import Estimate


def ruled_pitch(ruling: Ruling, stated: Estimate, heavy_every: int | None) -> Estimate:
    """Return the distance of the indexed lines, mm.

    Parameters
    ----------
    ruling
        What lies between the indexed lines, and which of them are heavier.
    stated
        Distance of the finest lines on the paper, mm.
    heavy_every
        Every how many of them a heavier one stands; None for lines of one weight.

    Raises
    ------
    DetectionError
        The picture does not tell which lines were indexed: with the distances that they may have.

    Examples
    --------
    >>> ruled_pitch(Ruling(5, (2,), 40.0), Estimate(1.0, 0.001, "mm"), 5).value
    5.0
    """
    parts = _parts_by(ruling, heavy_every)
    if parts is None:
        raise DetectionError(_candidates(ruling, stated, heavy_every))
    return replace(stated, value=stated.value * parts, u=stated.u * parts)


def _parts_by(ruling: Ruling, heavy_every: int | None) -> int | None:
    """Return the fine distances between indexed lines that what is stated and what is seen agree on."""
    if heavy_every is None:
        return 1 if ruling.parts == 1 else None
    if ruling.parts == 1:
        return 1 if heavy_every in ruling.rhythms else None
    all_heavy = ruling.parts % heavy_every == 0
    some_heavy = any(ruling.parts * rhythm == heavy_every for rhythm in ruling.rhythms)
    return ruling.parts if all_heavy or some_heavy else None


def _candidates(ruling: Ruling, stated: Estimate, heavy_every: int | None) -> str:
    """Say what the indexed lines may be."""
    each = sorted({1, ruling.parts, *((heavy_every,) if heavy_every else ruling.rhythms)})
    distances = " or ".join(f"{stated.value * parts:g}" for parts in each)
    what = "lines of one weight" if heavy_every is None else f"every {heavy_every}th line heavier"
    return (
        f"the distance of the indexed lines is ambiguous: {distances} mm. Seen: {ruling.sentence()}; stated: {what}, "
        f"{stated.value:g} mm apart. State heavy_every as the paper has it, take the picture closer, or use a sheet "
        "of lines of one weight"
    )
