"""`fringecal phase`: phase maps of a session's phase-shifted captures, or of pictures, and what they show."""

from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
import typer
from rich.markup import escape
from rich.table import Table

from fringecal.cli.console import console, print_json
from fringecal.errors import PhaseError, SessionError
from fringecal.phase import (
    Diagnosis,
    Finding,
    PhaseSummary,
    StepEstimate,
    compare_repeats,
    diagnose,
    findings_of_repeats,
    summarise,
)
from fringecal.records.files import replacing
from fringecal.report.figures_phase import doctor_overview, phase_overview
from fringecal.session import Capture, Session, load_session
from fringecal.session.faults import PictureError
from fringecal.session.frames import read_bytes
from fringecal.session.picture import decode, to_grey

HELP = """Demodulate phase-shifted pictures: valid share, noise, fringe period and the steps they really have.

SOURCE is a session folder, or the pictures of one set in the order of --steps.

Example: fringecal phase bench/2026-11-22 --capture reference --out phase-maps

Example: fringecal phase a.png b.png c.png --steps 0,120,240

With --doctor, says what is wrong with the pictures, what it costs and what to do; exit code 3 if anything is.

Example: fringecal phase bench/2026-11-22 --doctor --out phase-maps
"""


@dataclass(frozen=True)
class _Set:
    """One phase-shifted set to be demodulated."""

    name: str
    frames: np.ndarray
    steps_rad: np.ndarray
    white_level: float | None
    reference: np.ndarray | None = None
    repeats: np.ndarray | None = None


def register(app: typer.Typer) -> None:
    """Add the verb to the command."""
    app.command(name="phase", help=HELP)(phase)


def phase(
    source: list[Path] = typer.Argument(..., help="Session folder, or pictures.", show_default=False),
    steps: str | None = typer.Option(None, "--steps", help="Steps of the pictures in deg: 0,120,240."),
    capture: str | None = typer.Option(None, "--capture", help="Only this capture of the session."),
    out: Path | None = typer.Option(None, "--out", help="Folder for NAME.npz (maps) and NAME.png (figure)."),
    doctor: bool = typer.Option(False, "--doctor", help="Say what is wrong with the pictures."),
    mm_per_rad: float | None = typer.Option(None, help="Height of one radian, mm: the doctor's costs in mm too."),
    as_json: bool = typer.Option(False, "--json", help="Print one JSON document (fringecal-phase/1)."),
) -> None:
    """Load, demodulate, save, print."""
    documents = []
    for one in _sets(source, steps, capture):
        summary = summarise(one.frames, one.steps_rad, white_level=one.white_level)
        files = _save(summary, one.name, out) if out else []
        document = _document(one, summary, files)
        if doctor:
            diagnosis = diagnose(
                one.frames,
                one.steps_rad,
                white_level=one.white_level,
                reference=one.reference,
                mm_per_rad=mm_per_rad,
            )
            document["findings"] = [asdict(finding) for finding in (*diagnosis.findings, *_between_repeats(one))]
            document["ripple_rad"] = {str(order): value for order, value in diagnosis.ripple_rad.items()}
            document["files"] += _save_doctor(diagnosis, one.name, out) if out else []
        documents.append(document)
    if as_json:
        print_json({"format": "fringecal-phase/1", "captures": documents})
    else:
        _show(documents)
    if any(document.get("findings") for document in documents):
        raise typer.Exit(3)


def _between_repeats(one: _Set) -> tuple[Finding, ...]:
    """Return what repeats of the set show, where there are several."""
    if one.repeats is None:
        return ()
    return findings_of_repeats(compare_repeats(one.repeats, one.steps_rad, white_level=one.white_level))


def _sets(source: list[Path], steps: str | None, capture: str | None) -> Iterator[_Set]:
    """Give the sets of a session or the one set of the pictures."""
    if len(source) == 1 and source[0].is_dir():
        if steps is not None:
            raise typer.BadParameter("a session states its own steps", param_hint="--steps")
        yield from _session_sets(source[0], capture)
    elif capture is not None:
        raise typer.BadParameter("pictures have no captures; give a session folder", param_hint="--capture")
    elif steps is None:
        raise typer.BadParameter("state the steps of the pictures, such as 0,120,240", param_hint="--steps")
    else:
        yield _picture_set(source, _parsed(steps))


def _session_sets(folder: Path, name: str | None) -> Iterator[_Set]:
    """Give every phase-shifted set of the session, or of one capture."""
    session = load_session(folder)
    shifted = {key: one for key, one in session.captures.items() if one.steps_rad}
    if name is not None and name not in shifted:
        known = ", ".join(shifted) or "none"
        raise PhaseError(f"{folder}: no phase-shifted capture is called {name!r}; there are: {known}")
    if not shifted:
        raise PhaseError(f"{folder}: no capture is phase-shifted; state steps_deg and list three frames or more")
    for key in [name] if name is not None else shifted:
        yield from _capture_sets(shifted[key], _reference_of(session, shifted[key]))


def _reference_of(session: Session, capture: Capture) -> Capture | None:
    """Return the session's picture of the bare plate, or for a plate any other, to compare a capture with."""
    others = [one for one in session.captures.values() if one.name != capture.name and one.steps_rad]
    same = [one for one in others if one.steps_rad == capture.steps_rad and one.periods == capture.periods]
    plates = [one for one in same if one.kind == "reference"]
    # A plate's own frames in another order show against anything else that the rig has taken.
    if capture.kind == "reference" and same:
        return same[0]
    return plates[0] if len(plates) == 1 else None


def _capture_sets(capture: Capture, plate: Capture | None) -> Iterator[_Set]:
    """Give one set for each fringe period and repeat of a capture."""
    periods, repeats = max(1, len(capture.periods)), capture.repeat
    for repeat in range(repeats):
        for period in range(periods):
            name = capture.name
            name += f"-period{period + 1}" if periods > 1 else ""
            name += f"-repeat{repeat + 1}" if repeats > 1 else ""
            frames = capture.read_set(repeat=repeat, period=period)
            bare = plate.read_set(period=period) if plate is not None else None
            if bare is not None and bare.shape != frames.shape:
                bare = None
            again = _repeats_of(capture, period) if repeat == 0 else None
            yield _Set(name, frames, np.asarray(capture.steps_rad), capture.white_level, bare, again)


def _repeats_of(capture: Capture, period: int) -> np.ndarray | None:
    """Return all repeats of one fringe period, (R, N, H, W), where there are several."""
    if capture.repeat < 2:
        return None
    return np.stack([capture.read_set(repeat=k, period=period) for k in range(capture.repeat)])


def _picture_set(paths: list[Path], steps_rad: np.ndarray) -> _Set:
    """Read pictures that belong to no session; all must be of one size and depth."""
    pictures = []
    for path in paths:
        try:
            picture = decode(read_bytes(path))
        except PictureError as error:
            raise SessionError([f"{path}: {error}"]) from error
        pictures.append(to_grey(picture.pixels, None, 2**picture.bits - 1))
    kinds = {(grey.shape, grey.dtype.str) for grey in pictures}
    if len(kinds) > 1:
        sizes = ", ".join(
            f"{path.name} {grey.shape[::-1]} {grey.dtype}" for path, grey in zip(paths, pictures, strict=True)
        )
        raise PhaseError(f"the pictures of one set must have one size and depth; found {sizes}")
    return _Set(paths[0].stem, np.stack(pictures), steps_rad, None)


def _parsed(steps: str) -> np.ndarray:
    """Read steps such as ``0,120,240``, deg."""
    try:
        return np.deg2rad([float(step) for step in steps.split(",")])
    except ValueError as error:
        raise typer.BadParameter(
            f"{steps!r} is not a list of numbers such as 0,120,240", param_hint="--steps"
        ) from error


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


def _save_doctor(diagnosis: Diagnosis, name: str, folder: Path) -> list[str]:
    """Write what the doctor looked at as a figure."""
    with replacing(folder / f"{name}-doctor.png") as path:
        doctor_overview(diagnosis, title=name).savefig(path)
    return [str(folder / f"{name}-doctor.png")]


def _document(one: _Set, summary: PhaseSummary, files: list[str]) -> dict[str, Any]:
    """Put one set into plain numbers; what could not be measured is absent, with a note."""
    map_ = summary.map
    document: dict[str, Any] = {
        "name": one.name,
        "steps_stated_deg": np.rad2deg(one.steps_rad).round(9).tolist(),
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
    if summary.steps is not None:
        document["steps"] = _steps_document(summary.steps)
    return document


def _steps_document(steps: StepEstimate) -> dict[str, Any]:
    """Put found steps into plain numbers."""
    return {
        "found_deg": np.rad2deg(steps.steps_rad).tolist(),
        "u_deg": np.rad2deg(steps.u_rad).tolist(),
        "gain_per_frame": steps.gain_per_frame.tolist(),
        "offset_per_frame": steps.offset_per_frame.tolist(),
        "blocks": steps.n_blocks,
        "differ": steps.significant,
    }


def _show(documents: list[dict[str, Any]]) -> None:
    """Print one table for people, then what needs a sentence."""
    table = Table(title="phase maps")
    for heading in (
        "set",
        "valid",
        "masked because",
        "B / levels",
        "u(phase) / rad",
        "period / px",
        "steps found / deg",
    ):
        table.add_column(heading, justify="left" if heading in ("set", "masked because") else "right")
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
        yield f"the steps differ from the stated {stated} deg by more than chance explains (u = {u:.3f} deg)"
    if one["undone"]:
        yield "the map is corrected: " + "; ".join(one["undone"])
    yield from one["notes"]
    for finding in one.get("findings", []):
        yield _finding_sentence(finding)
    if one.get("findings") == []:
        yield "the doctor finds nothing wrong that costs more than 0.004 rad"
    if one["files"]:
        yield "wrote " + ", ".join(one["files"])


def _finding_sentence(finding: dict[str, Any]) -> str:
    """Write one finding as a sentence: what, how large, what it costs, what to do."""
    rad, mm = finding["cost_rad"], finding["cost_mm"]
    cost = "costs pixels" if rad is None else f"costs {rad:.3f} rad rms" + (f", {mm:.3f} mm" if mm is not None else "")
    return f"{finding['name'].upper()}: {finding['what']} ({finding['how_large']}); {cost}; {finding['remedy']}"
