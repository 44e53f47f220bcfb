"""`fringecal phase`: phase maps of a session's phase-shifted captures, or of pictures, and what they show."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import typer
from rich import box
from rich.markup import escape
from rich.table import Table

from fringecal.cli.shared.console import console, print_json
from fringecal.cli.shared.exit_codes import EXIT_OUT_OF_TOLERANCE
from fringecal.cli.shared.phase_orders import (
    counted_orders,
    named,
    orders_document,
    raster_document,
    save_orders,
    shortest_set,
    show_orders,
    summarised,
)
from fringecal.cli.shared.phase_sets import (
    Group,
    PhaseSet,
    Stated,
    StatedPeriods,
    holds_session,
    picture_group,
    pictures_of,
    session_groups,
)
from fringecal.cli.shared.pictures import demand_channel
from fringecal.phase import (
    Diagnosis,
    Finding,
    FindingKind,
    Look,
    PhaseShiftEstimate,
    PhaseSummary,
    compare_repeats,
    demand_phase,
    diagnose,
    findings_of_repeats,
    looked_for,
)
from fringecal.records import replacing
from fringecal.report import diagnostics_overview, phase_overview

HELP = """Demodulate phase-shifted pictures: valid share, noise, fringe period and the phase shifts found.

SOURCE is a session folder, a folder of pictures, or the pictures of one set in the order of --steps; with --periods
all frames of the first period, then of the next. Several periods give an absolute phase. --counts states the fringes
in the whole projected picture instead, --extent its length: isolated pieces are then counted too.

Example: fringecal phase bench/2026-11-22 --capture reference --out phase-maps

Example: fringecal phase a.png b.png c.png --steps 0,120,240

With --diagnose, says what is wrong with the pictures, the phase error it causes and what to do; exit code 3 if
anything is.

Example: fringecal phase bench/2026-11-22 --diagnose --out phase-maps
"""


def register(app: typer.Typer) -> None:
    """Add the verb to the command."""
    app.command(name="phase", help=HELP)(phase)


def phase(
    source: list[Path] = typer.Argument(..., help="Session folder, or pictures.", show_default=False),
    steps: str | None = typer.Option(None, "--steps", help="Phase shifts of the pictures in deg: 0,120,240."),
    periods: str | None = typer.Option(None, "--periods", help="Fringe periods of the pictures: 12,96."),
    counts: str | None = typer.Option(None, "--counts", help="Instead: fringes in the projected picture: 8,1."),
    extent: float | None = typer.Option(None, help="Length of the projected picture in the unit of --periods."),
    channel: str | None = typer.Option(None, "--channel", help="Colour pictures: mean, red, green, blue or luma."),
    bits: int | None = typer.Option(None, min=8, max=16, help="Bits of the camera where files have 16: 10, 12, 14."),
    capture: str | None = typer.Option(None, "--capture", help="Only this capture of the session."),
    out: Path | None = typer.Option(None, "--out", help="Folder for NAME.npz (maps) and NAME.png (figure)."),
    diagnostics: bool = typer.Option(False, "--diagnose", "--doctor", help="Say what is wrong with the pictures."),
    mm_per_rad: float | None = typer.Option(None, help="Height of one radian, mm: states phase errors in mm too."),
    as_json: bool = typer.Option(False, "--json", help="Print one JSON document (fringecal-phase/1)."),
) -> None:
    """Load, demodulate, save, print."""
    documents: list[dict[str, Any]] = []
    orders: list[dict[str, Any]] = []
    rasters: list[dict[str, Any]] = []
    for group in _groups(source, steps, _periods(periods, counts, extent), (channel, bits), capture):
        summaries = summarised(group)
        diagnoses = [_diagnosed(group, one, mm_per_rad) if diagnostics else None for one in group.sets]
        for one, summary, diagnosis in zip(group.sets, summaries, diagnoses, strict=True):
            if diagnosis is None or not diagnosis[1]:
                named(one, demand_phase, summary, one.frames, one.phase_shifts_rad)
        if group.axis is not None and not diagnostics:
            rasters.append(raster_document(group, summaries, out))
        counted = counted_orders(group, summaries) if group.counts_by_itself and not diagnostics else None
        for one, summary, diagnosis in zip(group.sets, summaries, diagnoses, strict=True):
            documents.append(_written(one, summary, diagnosis, out))
        if counted is not None:
            orders.append(orders_document(group, *counted, save_orders(group.name, *counted, out) if out else []))
    if as_json:
        print_json({"format": "fringecal-phase/1", "captures": documents, "orders": orders, "projector": rasters})
    else:
        _show(documents)
        for one_order in (*orders, *rasters):
            show_orders(one_order)
    if any(document.get("findings") for document in documents):
        raise typer.Exit(EXIT_OUT_OF_TOLERANCE)


def _written(
    one: PhaseSet, summary: PhaseSummary, diagnosis: tuple[Diagnosis, list[Finding]] | None, out: Path | None
) -> dict[str, Any]:
    """Write what is to be written of a set, and put it into plain numbers; frames that are no set make no map."""
    if diagnosis is None:
        return _document(one, summary, _save(summary, one.name, out) if out else [])
    found, _ = diagnosis
    files = _save(summary, one.name, out) if out and not found.fatal else []
    files += _save_diagnosis(found, one.name, out) if out else []
    document = _document(one, summary, files) | _diagnosis_document(diagnosis)
    return document | ({"undone": []} if found.fatal else {})


def _diagnosed(group: Group, one: PhaseSet, mm_per_rad: float | None) -> tuple[Diagnosis, list[Finding]]:
    """Return the diagnosis of a set, and all findings with those between its repeats."""
    found = diagnose(
        one.frames,
        one.phase_shifts_rad,
        white_level=one.white_level,
        reference=one.reference,
        mm_per_rad=mm_per_rad,
        of_several=one is not group.sets[shortest_set(group)],
    )
    return found, [*found.findings, *_between_repeats(one)]


def _diagnosis_document(diagnosis: tuple[Diagnosis, list[Finding]]) -> dict[str, Any]:
    """Put the findings into plain numbers."""
    ripple = {str(order): value for order, value in diagnosis[0].ripple_rad.items()}
    return {
        "findings": [finding.document() for finding in diagnosis[1]],
        "ripple_rad": ripple,
        "looked": [look.document() for look in diagnosis[0].looks],
    }


def _between_repeats(one: PhaseSet) -> tuple[Finding, ...]:
    """Return what repeats of the set show, where there are several."""
    if one.repeats is None:
        return ()
    return findings_of_repeats(compare_repeats(one.repeats, one.phase_shifts_rad, white_level=one.white_level))


def _periods(periods: str | None, counts: str | None, extent: float | None) -> StatedPeriods:
    """Read the periods, or the counts of fringes that stand for them."""
    if counts is not None and (periods is not None or extent is not None):
        raise typer.BadParameter("counts say what --periods and --extent would", param_hint="--counts")
    if extent is not None and not (np.isfinite(extent) and extent > 0):
        raise typer.BadParameter(f"{extent:g} is no length", param_hint="--extent")
    if counts is None:
        return StatedPeriods(tuple(_numbers(periods, "--periods")) if periods is not None else (), extent)
    numbers = _numbers(counts, "--counts")
    if min(numbers) <= 0:
        raise typer.BadParameter(f"{counts!r}: counts of fringes are above 0", param_hint="--counts")
    return StatedPeriods(tuple(1 / number for number in numbers), 1.0)


def _groups(
    source: list[Path],
    steps: str | None,
    periods: StatedPeriods,
    reading: tuple[str | None, int | None],
    capture: str | None,
) -> Iterator[Group]:
    """Give the sets of a session, or those of the pictures, read by a channel and with bits."""
    channel, bits = reading
    folder = source[0] if len(source) == 1 and source[0].is_dir() else None
    if folder is not None and (holds_session(folder) or steps is None):
        own = {
            "--steps": steps,
            "--periods (or --counts)": periods.lengths or None,
            "--channel": channel,
            "--bits": bits,
        }
        for option, value in own.items():
            if value is not None:
                raise typer.BadParameter(f"a session states its own {option[2:]}", param_hint=option)
        yield from session_groups(folder, capture, periods.extent)
    elif capture is not None:
        raise typer.BadParameter("pictures have no captures; give a session folder", param_hint="--capture")
    elif steps is None:
        raise typer.BadParameter("state the phase shifts of the pictures, such as 0,120,240", param_hint="--steps")
    else:
        demand_channel(channel)
        stated = Stated(np.deg2rad(_numbers(steps, "--steps")), periods, channel, bits)
        yield picture_group(source if folder is None else pictures_of(folder), stated)


def _numbers(text: str, option: str) -> list[float]:
    """Read numbers such as ``0,120,240``."""
    try:
        found = [float(part) for part in text.split(",")]
    except ValueError:
        found = []
    if not found or not np.isfinite(found).all():
        raise typer.BadParameter(f"{text!r} is not a list of numbers such as 0,120,240", param_hint=option)
    return found


def _save(summary: PhaseSummary, name: str, folder: Path) -> list[str]:
    """Write maps and figure, each whole or not at all."""
    map_ = summary.map
    with replacing(folder / f"{name}.npz") as path:
        np.savez_compressed(
            path,
            phase_rad=map_.phase,
            sigma_rad=map_.sigma,
            modulation=map_.modulation,
            background=map_.background,
            reasons=map_.reasons,
        )
    with replacing(folder / f"{name}.png") as path:
        phase_overview(map_, title=name).savefig(path)
    return [str(folder / f"{name}.{suffix}") for suffix in ("npz", "png")]


def _save_diagnosis(diagnosis: Diagnosis, name: str, folder: Path) -> list[str]:
    """Draw the diagnostics as a figure."""
    with replacing(folder / f"{name}-diagnostics.png") as path:
        diagnostics_overview(diagnosis, title=name).savefig(path)
    return [str(folder / f"{name}-diagnostics.png")]


def _document(one: PhaseSet, summary: PhaseSummary, files: list[str]) -> dict[str, Any]:
    """Put one set into plain numbers; what could not be measured is absent, with a note."""
    map_ = summary.map
    document: dict[str, Any] = {
        "name": one.name,
        "steps_stated_deg": np.rad2deg(one.phase_shifts_rad).round(9).tolist(),
        "shares": map_.shares(),
        "modulation": summary.median_modulation,
        "u_phase_rad": summary.median_sigma_rad,
        "noise": {"read_sigma": map_.noise.read_sigma, "gain": map_.noise.gain},
        "undone": list(summary.undone),
        "notes": list(summary.notes),
        "files": files,
    }
    if summary.period is not None:
        period = summary.period
        document["period"] = {"value_px": period.period_px, "direction_deg": period.direction_deg}
    if summary.phase_shifts is not None:
        document["steps"] = _steps_document(summary.phase_shifts)
    return document


def _steps_document(steps: PhaseShiftEstimate) -> dict[str, Any]:
    """Put found phase shifts into plain numbers."""
    return {
        "found_deg": np.rad2deg(steps.phase_shifts_rad).tolist(),
        "u_deg": np.rad2deg(steps.u_rad).tolist(),
        "gain_per_frame": steps.gain_per_frame.tolist(),
        "offset_per_frame": steps.offset_per_frame.tolist(),
        "blocks": steps.n_blocks,
        "differ": steps.significant,
    }


def _show(documents: list[dict[str, Any]]) -> None:
    """Print one table for people, then what needs a sentence."""
    table = Table(
        title="phase maps; a pixel may be masked for several reasons", box=box.SIMPLE_HEAD, padding=(0, 1, 0, 0)
    )
    for heading in (
        "set",
        "valid",
        "masked because",
        "B\nlevels",
        "u(phase)\nrad",
        "period\npx",
        "phase\nshifts\ndeg",
    ):
        left = heading in ("set", "masked because")
        # A cause or a list of phase shifts may go on below; a number that is cut cannot be read.
        table.add_column(heading, justify="left" if left else "right", no_wrap=not left and "shifts" not in heading)
    for one in documents:
        table.add_row(*_row(one))
    console.print(table)
    for one in documents:
        for sentence in _sentences(one):
            console.print(f"{one['name']}: {sentence}", markup=False, soft_wrap=True, highlight=False)


def _row(one: dict[str, Any]) -> list[str]:
    """Write one set as cells."""
    causes = {name: share for name, share in one["shares"].items() if name != "valid" and share > 0}
    found = one.get("steps")
    return [
        escape(one["name"]),
        f"{one['shares']['valid']:.2%}",
        ", ".join(f"{name.replace('_', ' ')} {share:.2%}" for name, share in causes.items()) or "-",
        f"{one['modulation']:.1f}",
        f"{one['u_phase_rad']:.4f}",
        f"{one['period']['value_px']:.2f}" if "period" in one else "-",
        ", ".join(f"{round(step, 2) + 0.0:.2f}" for step in found["found_deg"]) if found else "-",
    ]


def _sentences(one: dict[str, Any]) -> Iterator[str]:
    """Say what the table cannot."""
    found = one.get("steps")
    if found and found["differ"]:
        stated = ", ".join(f"{step:g}" for step in one["steps_stated_deg"])
        u = max(found["u_deg"])
        yield f"the phase shifts differ significantly from the stated {stated} deg (u = {u:.3f} deg)"
    if one["undone"]:
        yield "the map is corrected: " + "; ".join(one["undone"])
    yield from one["notes"]
    for finding in one.get("findings", []):
        yield _finding_sentence(finding)
    looks = [Look(**look) for look in one.get("looked", [])]
    if one.get("findings") == []:
        blind = any(not look.could for look in looks)
        yield f"the diagnostics find nothing wrong{' in what they could see' if blind else ''}"
    yield from looked_for(looks)
    if one["files"]:
        yield "wrote " + ", ".join(one["files"])


def _finding_sentence(finding: dict[str, Any]) -> str:
    """Write one finding as a sentence: what, how large, the phase error it causes, what to do."""
    rad, mm = finding["cost_rad"], finding["cost_mm"]
    effect = (
        "masks pixels"
        if rad is None
        else f"phase error {rad:.3f} rad rms" + (f", {mm:.3f} mm" if mm is not None else "")
    )
    name = FindingKind(finding["name"]).text.upper()
    return f"{name}: {finding['what']} ({finding['how_large']}); {effect}; {finding['remedy']}"
