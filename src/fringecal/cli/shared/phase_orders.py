"""Several periods on the command line: orders decided, saved, drawn and printed."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from fringecal.cli.shared.console import console
from fringecal.cli.shared.phase_sets import Group, PhaseSet
from fringecal.errors import PhaseError
from fringecal.phase import (
    AbsolutePhase,
    FringeOrders,
    PhaseSummary,
    RasterCoordinate,
    absolute_phase,
    decide_orders,
    orders_by_gray,
    summarise,
)
from fringecal.records import replacing
from fringecal.report import orders_overview
from fringecal.workflows.shared import raster_of_maps


def named[**P, T](one: PhaseSet | Group, function: Callable[P, T], *args: P.args, **kwargs: P.kwargs) -> T:
    """Call a function; what it refuses is said of the set."""
    try:
        return function(*args, **kwargs)
    except PhaseError as error:
        raise PhaseError(f"{one.name}: {error}") from error


def shortest_set(group: Group) -> int:
    """Return the number of the set with the shortest fringes."""
    return int(np.argmin(group.periods)) if group.periods else 0


def summarised(group: Group) -> list[PhaseSummary]:
    """Demodulate all sets of a group; wide fringes are taken to have the waveform of the shortest."""
    shortest = shortest_set(group)
    main = _summary(group.sets[shortest])
    return [main if k == shortest else _summary(one, main) for k, one in enumerate(group.sets)]


def _summary(one: PhaseSet, main: PhaseSummary | None = None) -> PhaseSummary:
    wave = None if main is None else main.wave
    return named(one, summarise, one.frames, one.phase_shifts_rad, white_level=one.white_level, wave=wave)


def counted_orders(group: Group, summaries: list[PhaseSummary]) -> tuple[FringeOrders, AbsolutePhase]:
    """Decide the orders of a group's shortest fringes, and count them over the picture."""
    maps = [summary.map for summary in summaries]
    if group.gray is not None:
        orders = named(group, orders_by_gray, maps[shortest_set(group)], group.gray)
    else:
        phases, sigmas = [m.phase for m in maps], [m.sigma for m in maps]
        orders = named(group, decide_orders, phases, sigmas, group.periods, projected=group.projected)
    return orders, named(group, absolute_phase, orders, projected=group.projected)


def raster_document(group: Group, summaries: list[PhaseSummary], out: Path | None) -> dict[str, Any]:
    """Count the projector's pixels along a group's axis, write them, and put what was found into plain numbers."""
    found = named(group, _raster, group, summaries)
    known = np.isfinite(found.px)
    return {
        "name": group.name,
        "axis": None if group.axis is None else group.axis.name,
        "extent_px": found.extent_px,
        "cycle_px": found.cycle_px,
        "zeros_rad": list(found.zeros_rad),
        "falls": found.falls,
        "known": float(known.mean()),
        "outside": found.outside,
        "u_px": float(np.median(found.u_px[known])) if known.any() else None,
        "sentences": [found.sentence()],
        "files": _save_raster(group.name, found, out) if out else [],
    }


def _raster(group: Group, summaries: list[PhaseSummary]) -> RasterCoordinate:
    assert group.axis is not None
    found = raster_of_maps([summary.map for summary in summaries], group.axis, group.gray)
    return found if group.lit is None else found.within(group.lit)


def _save_raster(name: str, found: RasterCoordinate, folder: Path) -> list[str]:
    with replacing(folder / f"{name}-projector.npz") as path:
        np.savez_compressed(path, projector_px=found.px, u_px=found.u_px)
    return [str(folder / f"{name}-projector.npz")]


def save_orders(name: str, orders: FringeOrders, absolute: AbsolutePhase, folder: Path) -> list[str]:
    """Write the absolute phase as maps and as a figure, each whole or not at all."""
    with replacing(folder / f"{name}-absolute.npz") as path:
        np.savez_compressed(path, absolute_phase_rad=absolute.phase, phase_in_cycle_rad=orders.phase)
    with replacing(folder / f"{name}-absolute.png") as path:
        orders_overview(orders, absolute, title=name).savefig(path)
    return [str(folder / f"{name}-absolute.{suffix}") for suffix in ("npz", "png")]


def orders_document(group: Group, orders: FringeOrders, absolute: AbsolutePhase, files: list[str]) -> dict[str, Any]:
    """Put orders into plain numbers."""
    return {
        "name": group.name,
        "periods": list(group.periods),
        "cycle": orders.cycle,
        "zeros_rad": list(orders.zeros_rad),
        "error_rate": orders.error_rate,
        "asked": orders.asked,
        "undecided": orders.undecided,
        "fringes": absolute.fringes,
        "in_one_cycle": absolute.in_one_cycle,
        "known_by": absolute.known_by,
        "offset_rad": orders.offset_rad,
        "cycle_undecided": absolute.undecided,
        "sentences": [orders.sentence(), absolute.sentence()],
        "files": files,
    }


def show_orders(document: dict[str, Any]) -> None:
    """Say how orders were decided and what was written."""
    sentences = document["sentences"]
    if document["files"]:
        sentences = [*sentences, "wrote " + ", ".join(document["files"])]
    for sentence in sentences:
        console.print(f"{document['name']}: {sentence}", markup=False, soft_wrap=True, highlight=False)
