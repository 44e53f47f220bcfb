"""Fringes along the axes of a projector's raster: what a capture states of them, and what cannot be so."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from fringecal.session.document import AxisAngles, AxisFiles, AxisLengths, CaptureTable, SessionDocument
from fringecal.session.draft import Draft
from fringecal.session.faults import Fault, joined

# Orders are distinguished by what is left of the other periods; noise and ripple of 0.25 rad hide less than this.
_APART_TURNS = 0.04
_MOST_ORDERS = 65536  # fringes across a projector's picture: no fringe is narrower than a pixel
_WITHOUT_FRINGES = frozenset({"grid"})
_BY_AXIS = (AxisLengths, AxisAngles, AxisFiles)


@dataclass(frozen=True)
class FringeAxis:
    """The fringes of one capture that vary along one axis of the projector.

    Parameters
    ----------
    name
        "u" for fringes that vary along the projector's rows, so that they count its columns; "v" for the other.
    extent_px
        Pixels of the projector along it.
    periods_px
        Fringe periods in these pixels, in the order of the files.
    zeros_rad
        Phase of each at the centre of the projector's first pixel, rad, where it is stated; else empty.
    gray
        How many of the capture's Gray-code pictures are this axis's.
    falls
        Whether the phase falls where the projector's pixels are counted up; None where nothing is stated.
    """

    name: str
    extent_px: int
    periods_px: tuple[float, ...]
    zeros_rad: tuple[float, ...] = ()
    gray: int = 0
    falls: bool | None = None


def axes_of(
    table: CaptureTable, resolution_px: Sequence[int] | None, gray: Mapping[str, int]
) -> tuple[FringeAxis, ...]:
    """Return the axes of a sound capture; none where it states none.

    Parameters
    ----------
    table
        What the document says of it.
    resolution_px
        Columns and rows of the projector.
    gray
        Number of Gray-code pictures found for each axis.
    """
    if table.axes is None or resolution_px is None:
        return ()
    extents = dict(zip("uv", resolution_px, strict=True))
    return tuple(
        FringeAxis(
            name,
            extents[name],
            _periods_px(table, name, extents[name]),
            tuple(np.deg2rad(along(table.zeros_deg, name)).tolist()),
            gray.get(name, 0),
            None if table.falling is None else name in table.falling,
        )
        for name in table.axes
    )


def along[T](stated: list[T] | AxisLengths | AxisAngles | AxisFiles | None, name: str) -> list[T]:
    """Return what a key states for one axis: its own list, or the one that both have."""
    if isinstance(stated, _BY_AXIS):
        return list(getattr(stated, name) or [])  # type: ignore[arg-type]
    return list(stated or [])


def number_of_sets(table: CaptureTable) -> int:
    """Return how many phase-shifted sets a capture holds for each time it was taken."""
    stated = table.fringes if table.periods is None else table.periods
    return sum(max(1, len(along(stated, name))) for name in table.axes or ["u"])


def _periods_px(table: CaptureTable, name: str, extent_px: int) -> tuple[float, ...]:
    counts = along(table.fringes, name)
    return tuple(extent_px / count for count in counts) if counts else tuple(along(table.periods, name))


def first_ambiguity_px(periods_px: ArrayLike, extent_px: float) -> float | None:
    """Return after how many pixels all fringes look the same again; None if that is beyond the projector's picture.

    Examples
    --------
    >>> first_ambiguity_px([18, 20], 1920), first_ambiguity_px([1920 / 59, 1920 / 64, 1920 / 70], 1920)
    (180.0, None)
    """
    periods = np.asarray(periods_px, np.float64)
    shortest = float(periods.min())
    starts = np.arange(1, min(int(extent_px / shortest * (1 - _APART_TURNS)), _MOST_ORDERS) + 1) * shortest
    turns = starts[:, None] / periods[None, :]
    same = np.abs(turns - np.rint(turns)).max(axis=1) < _APART_TURNS
    return float(starts[same.argmax()]) if same.any() else None


def axis_faults(draft: Draft, document: SessionDocument, *, is_projector_sound: bool) -> Iterator[Fault]:
    """See that what a capture states of its fringes goes together and with the projector."""
    table = draft.table
    if table.pose is not None and table.kind != "board":
        yield Fault(f"{draft.label}: pose", f"a capture of kind {table.kind} has none", "leave it out")
    if draft.broken & {"axes", "periods", "fringes", "zeros_deg", "gray", "kind", "maps"}:
        return
    if table.maps is not None:
        yield from _with_maps(draft)
        return
    if table.axes is None:
        yield from _without_axes(draft)
        return
    where = f"{draft.label}: axes"
    if table.kind in _WITHOUT_FRINGES:
        yield Fault(where, f"a picture of kind {table.kind} is taken by room light", "leave axes out")
    if len(set(table.axes)) < len(table.axes):
        yield Fault(where, f"{table.axes}: an axis is listed twice", 'list each once: axes = ["u", "v"]')
    if draft.steps_deg == ():
        yield Fault(where, "fringes without phase shifts", "state steps_deg, or leave axes out")
    yield from _statement_faults(draft)
    resolution = None if document.projector is None else document.projector.resolution_px
    if resolution is not None:
        yield from _range_faults(draft, dict(zip("uv", resolution, strict=True)))
    elif is_projector_sound:
        remedy = "write [projector] resolution_px = [columns, rows]"
        yield Fault(where, "the projector's pixels are not stated, which its axes count", remedy)


_BESIDE_MAPS = ("images", "axes", "periods", "fringes", "zeros_deg", "falling", "gray", "steps_deg")


def _with_maps(draft: Draft) -> Iterator[Fault]:
    """Refuse frames and what is stated of them beside phase maps, which state it themselves."""
    for key in _BESIDE_MAPS:
        if getattr(draft.table, key):
            found = "stated beside maps, which are the phase already"
            yield Fault(f"{draft.label}: {key}", found, "leave it out (images = []), or the maps")
    sizes = {(frame.height_px, frame.width_px) for frame in draft.all_frames}
    shapes = {one.phase_rad.shape for one in draft.maps}
    if sizes and shapes and sizes != shapes:
        found = f"maps of {_sizes(shapes)}, while its pictures have {_sizes(sizes)}"
        yield Fault(f"{draft.label}: maps", found, "give maps and pictures of one camera, uncropped")


def _sizes(shapes: Iterable[tuple[int, ...]]) -> str:
    return joined(f"{shape[1]} x {shape[0]} px" for shape in sorted(shapes))


def _without_axes(draft: Draft) -> Iterator[Fault]:
    """Refuse what makes sense along an axis only."""
    table = draft.table
    for key in ("fringes", "zeros_deg", "falling", "white", "black"):
        if getattr(table, key) is not None:
            found = "stated for fringes that vary along no stated axis"
            yield Fault(f"{draft.label}: {key}", found, 'state axes = ["u"], ["v"] or ["u", "v"], or leave it out')
    for key in ("periods", "gray"):
        if isinstance(getattr(table, key), _BY_AXIS):
            yield Fault(f"{draft.label}: {key}", "a table for each axis, but no axes", 'state axes = ["u", "v"]')


def _statement_faults(draft: Draft) -> Iterator[Fault]:
    """See that periods, zeros and codes are stated once, and for each axis that there is."""
    table, axes = draft.table, draft.table.axes or []
    if table.periods is not None and table.fringes is not None:
        found = "periods and fringes are two statements of one fact"
        yield Fault(f"{draft.label}: fringes", found, "keep periods (px of the projector) or fringes (numbers)")
    for key in ("periods", "fringes", "zeros_deg", "gray"):
        stated = getattr(table, key)
        if isinstance(stated, _BY_AXIS) and {n for n in "uv" if along(stated, n)} != set(axes):
            named = [name for name in "uv" if along(stated, name)]
            found = f"stated for {joined(named) or 'no axis'}, while axes = {axes}"
            yield Fault(f"{draft.label}: {key}", found, "state it for each of the capture's axes, and no other")
    beside = sorted(set(table.falling or []) - set(axes))
    if beside:
        yield Fault(
            f"{draft.label}: falling", f"{joined(beside)} is no axis of axes = {axes}", "list axes of the capture"
        )
    if isinstance(table.gray, list) and len(axes) > 1:
        found = "one list of pictures for two axes"
        yield Fault(f"{draft.label}: gray", found, 'write gray = { u = ["gu-*.png"], v = ["gv-*.png"] }')


def _range_faults(draft: Draft, extents: Mapping[str, int]) -> Iterator[Fault]:
    """See that the fringes of each axis tell every pixel of the projector from every other."""
    table = draft.table
    for name in table.axes or []:
        periods = _periods_px(table, name, extents[name])
        where = f"{draft.label}: {'periods' if table.fringes is None else 'fringes'}"
        if not periods:
            remedy = "state periods in px of the projector, or fringes, their numbers across its picture"
            yield Fault(where, f"no fringe period along {name}", remedy)
            continue
        zeros = along(table.zeros_deg, name)
        if zeros and len(zeros) != len(periods):
            found = f"{len(zeros)} phase zeros for {len(periods)} periods along {name}"
            yield Fault(f"{draft.label}: zeros_deg", found, "state one for each period, in the order of the files")
        if not along(table.gray, name):
            yield from _ambiguity_faults(table, where, name, periods, extents[name])


def _ambiguity_faults(
    table: CaptureTable, where: str, name: str, periods: Sequence[float], extent: int
) -> Iterator[Fault]:
    """Refuse periods that leave open which part of the projector lights a pixel; say if another reading does not."""
    again = first_ambiguity_px(periods, extent)
    if again is None:
        return
    numbers = along(table.fringes, name) or along(table.periods, name)
    other, key = (numbers, "periods") if table.fringes is not None else ([extent / n for n in numbers], "fringes")
    listed = ", ".join(f"{number:g}" for number in numbers)
    unit = "fringes" if table.fringes is not None else "px"
    yield Fault(
        where,
        f"[{listed}] {unit} along {name} look the same again after {again:.4g} px, and the projector has {extent}: "
        "which of its pixels lights a point stays open",
        "add a longer period or a Gray code"
        if first_ambiguity_px(other, extent) is not None
        else f"as {key} = [{listed}] they would not: is that what is meant? Else add a longer period or a Gray code",
    )
