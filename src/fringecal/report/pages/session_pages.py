"""Pages on which a session folder is sent in, checked and run."""

from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime

from fringecal.report.pages.dashboard import render
from fringecal.report.views import DECISIONS
from fringecal.session import CheckReport

_WHAT = {
    "calibration.json": "the record: everything found, its budget and its inputs",
    "verification.json": "the record: errors beside the certificate, and its inputs",
    "audit.json": "the record: changes since the calibration, and its inputs",
    "camera.cameramodel": "the camera, for mrcal and others",
    "report.html": "report, opened as a page",
    "report.pdf": "the same on sheets",
}
_VERDICTS = {decision: f"{word} {sign}" for decision, (word, sign) in DECISIONS.items()}


@dataclass(frozen=True)
class Seal:
    """What one rendering of a page proves itself with: `nonce` marks its script, `token` its forms."""

    nonce: str
    token: str


@dataclass(frozen=True)
class RunParts:
    """A command that was started: its key and title, the key of its session, and when."""

    key: str
    title: str
    session: str
    started: datetime


def sessions_page(
    seal: Seal,
    limits: tuple[int, int, Sequence[str]],
    folders: Sequence[str],
    sessions: Sequence[tuple[str, str]],
    runs: Sequence[tuple[str, str]],
) -> str:
    """Show where a session folder is chosen or dropped, and what is at the desk already.

    Parameters
    ----------
    seal
        Nonce and token.
    limits
        Most files, most megabytes, and the endings of file names that are taken.
    folders
        Names of session folders on this machine that may be opened.
    sessions, runs
        Key and title of each, the newest first.
    """
    files, megabytes, suffixes = limits
    return render(
        "sessions.html.j2",
        title="Check and run a session",
        subtitle="A session is a folder of pictures with a session.toml.",
        seal=seal,
        files=files,
        megabytes=megabytes,
        suffixes=suffixes,
        folders=folders,
        sessions=sessions,
        runs=runs,
    )


def session_page(
    seal: Seal, key: str, label: str, outcome: CheckReport, calibrations: Sequence[tuple[str, str]]
) -> str:
    """Show what the check of a session found, and offer what can be run on it.

    Parameters
    ----------
    seal
        Nonce and token.
    key, label
        The session.
    outcome
        Its check.
    calibrations
        Value and label of every calibration of its rig, the newest first.
    """
    captures = outcome.captures or []
    rows = [
        (c.name, c.kind, c.target_name or "-", len(c.images) + len(c.gray), c.width_px, c.height_px) for c in captures
    ]
    found = f"rig {outcome.rig}, {outcome.captured:%Y-%m-%d %H:%M}" if outcome.ok else ""
    return render(
        "session.html.j2",
        title=label,
        subtitle=found or f"{_counted(len(outcome.faults), 'fault')} in it",
        seal=seal,
        key=key,
        outcome=outcome,
        faults=[(fault.where, fault.found, fault.remedy) for fault in outcome.faults],
        captures=rows,
        artefacts=[c.name for c in captures if c.kind == "artefact" and c.use != "calibration"],
        calibrations=calibrations,
    )


def run_page(seal: Seal, run: RunParts, lines: Sequence[str], ending: tuple[str, str, tuple[str, ...]] | None) -> str:
    """Show a command under way with its steps as they come, or how it ended and what it wrote.

    Parameters
    ----------
    seal
        Nonce and token.
    run
        The command.
    lines
        What it printed so far.
    ending
        Decision, how it ended, and the names of the files that it wrote; None while it is under way.
    """
    decision, told, files = ending or ("info", "Under way.", ())
    return render(
        "run.html.j2",
        title=run.title,
        subtitle=f"Started {run.started:%Y-%m-%d %H:%M:%S}",
        seal=seal,
        key=run.key,
        session=run.session,
        lines=lines,
        ended=ending is not None,
        decision=decision,
        verdict=_VERDICTS[decision] if files else "No result",
        told=told,
        files=[(name, _WHAT.get(name, "")) for name in files],
    )


def _counted(count: int, what: str) -> str:
    return f"{count} {what}" if count == 1 else f"{count} {what}s"
