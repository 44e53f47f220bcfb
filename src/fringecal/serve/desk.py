"""The dashboard's desk: session folders that are open, and the commands that may be run on them."""

import itertools
import secrets
import threading
from collections.abc import Hashable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from fringecal.report import REPORT_FILE
from fringecal.serve.access import Refused
from fringecal.serve.bounded_check import checked
from fringecal.serve.runs import VERBS, Run, Runs
from fringecal.serve.uploads import Bounds
from fringecal.session import FILE_NAME, CheckReport

_MOST_FOLDERS = 500  # of those below --sessions that are offered: a list that is longer is not read
_CALIBRATION = "calibration.json"
_DB_VARIABLE = "FRINGECAL_HISTORY"  # in the environment of a run, where only its owner sees it
_MOST_WATCHERS = 8  # pages on which the progress of a run is followed
_WAIT_S = 10.0  # for the check of another session to end, before a reader is told to come back


@dataclass(frozen=True)
class Opened:
    """A session folder at the desk, and what to call it."""

    key: str
    folder: Path
    label: str


@dataclass(frozen=True)
class Desk:
    """What the desk works with.

    Parameters
    ----------
    db
        The history that is served.
    work
        Folder for uploads and results.
    token
        Secret of this server.
    runs
        The commands.
    root
        Folder of session folders that may be opened by name, if any.
    bounds
        Limits of an upload.
    opened
        Sessions by key.
    """

    db: str
    work: Path
    token: str
    runs: Runs
    root: Path | None = None
    bounds: Bounds = field(default_factory=Bounds)
    opened: dict[str, Opened] = field(default_factory=dict)
    # One at a time: each may use much memory.
    checking: threading.Lock = field(default_factory=threading.Lock)
    # Each holds a thread of the server, of which some must be left to make pages.
    watchers: threading.Semaphore = field(default_factory=lambda: threading.Semaphore(_MOST_WATCHERS))

    def open(self, folder: Path, label: str) -> Opened:
        """Put a session folder on the desk."""
        opened = Opened(secrets.token_hex(8), folder, label)
        self.opened[opened.key] = opened
        return opened

    def session(self, key: str) -> Opened:
        """Return the session of this key.

        Raises
        ------
        Refused
            There is none, with code 404.
        """
        if key not in self.opened:
            raise Refused("There is no such session; choose its folder again.", 404)
        return self.opened[key]

    def check(self, opened: Opened) -> CheckReport:
        """Check a session as it is now, in a process of its own.

        Raises
        ------
        Refused
            It needs more memory or time than a check may use; or another check goes on.
        """
        if not self.checking.acquire(timeout=_WAIT_S):
            raise Refused("Another session is being checked; load this page again in a while.", 503)
        try:
            return checked(opened.folder)
        finally:
            self.checking.release()

    def offered(self) -> dict[str, Path]:
        """Session folders below the root by relative name, at most two folders deep."""
        if self.root is None:
            return {}
        root = self.root.resolve()
        files = (file for depth in ("*", "*/*") for file in sorted(root.glob(f"{depth}/{FILE_NAME}")))
        inside = (file.parent for file in files if file.resolve().is_relative_to(root))
        return {folder.relative_to(root).as_posix(): folder for folder in itertools.islice(inside, _MOST_FOLDERS)}


def ending(run: Run) -> tuple[str, str, tuple[str, ...]] | None:
    """Verdict, how it ended in words, and the files there are; None while under way."""
    from fringecal.history import read_entry

    if run.code is None:
        return None
    if not run.out.is_dir():
        if run.cancelled:
            return "info", "Stopped; nothing was written.", ()
        return "fail", f"Ended with exit code {run.code}: no results. {run.last_line}", ()
    names = sorted(file.name for file in run.out.iterdir() if file.is_file())
    names.sort(key=lambda name: name != REPORT_FILE)
    return read_entry(run.out).decision, f"Ended with exit code {run.code}. {run.last_line}", tuple(names)


def calibrations(desk: Desk, rig: str) -> list[tuple[str, str]]:
    """Calibrations of a rig, as (value, label): of the runs here and of the history, the newest first."""
    from fringecal.history import open_history

    here = [
        (f"run-{run.key}", f"{run.title}, run here")
        for run in desk.runs.newest_first()
        if run.code in (0, 3) and (run.out / _CALIBRATION).is_file() and _rig_of(run.out) == rig
    ]
    with open_history(desk.db, create=False) as history:
        entries = history.entries(rig)
    found = entries[entries["kind"] == "calibration"].iloc[::-1]
    return here + [(f"record-{row['sha256']}", _record_label(row)) for row in found.to_dict("records")]


def _record_label(row: Mapping[Hashable, Any]) -> str:
    return f"{str(row['captured'])[:16].replace('T', ' ')}, {row['decision']}, {row['sha256'][:8]}"


def _rig_of(folder: Path) -> str:
    from fringecal.history import read_entry

    return read_entry(folder).rig


def start(desk: Desk, opened: Opened, asked: dict[str, str]) -> Run:
    """Start the verb that a form asks for.

    Raises
    ------
    Refused
        The form asks for something that its page did not offer, or another run is under way.
    """
    verb, capture = asked.get("verb", ""), asked.get("capture", "")
    if verb not in VERBS:
        raise Refused(f"{verb[:40]!r} is not run here; {', '.join(VERBS)} are")
    report = desk.check(opened)
    if report.rig is None:
        raise Refused("the session has faults; mend them first, as its page says", 409)
    if capture and capture not in {row.name for row in report.captures or ()}:
        raise Refused(f"the session has no capture {capture[:120]!r}")
    record = None if verb == "commission" else _calibration(desk, report.rig, asked.get("calibration", ""))

    def arguments(folder: Path) -> list[str]:
        stated = [verb, str(opened.folder.absolute()), f"--out={folder / 'out'}"]
        if record is not None:
            (folder / _CALIBRATION).write_bytes(record)
            stated.append(f"--calibration={folder / _CALIBRATION}")
        if verb == "verify" and capture:
            stated.append(f"--capture={capture}")
        return stated + ([f"--history={named}"] if asked.get("history") else [])

    # A URL may hold a password, and everyone on this machine can read a command's words.
    named, hidden = (f"env:{_DB_VARIABLE}", {_DB_VARIABLE: desk.db}) if "://" in desk.db else (desk.db, {})
    return desk.runs.start(f"{verb} {opened.label}", opened.key, arguments, hidden)


def _calibration(desk: Desk, rig: str, chosen: str) -> bytes:
    """Return the content of the calibration that was chosen; only those offered can be."""
    from fringecal.history import open_history

    if chosen not in dict(calibrations(desk, rig)):
        raise Refused(f"choose a calibration of rig {rig}: {chosen[:80]!r} is none")
    kind, _, key = chosen.partition("-")
    if kind == "run":
        return (desk.runs.named(key).out / _CALIBRATION).read_bytes()
    with open_history(desk.db, create=False) as history:
        text = history.document(key)
    if text is None:
        raise Refused("the history holds the numbers of this calibration alone, not its document; choose another", 404)
    return text.encode()
