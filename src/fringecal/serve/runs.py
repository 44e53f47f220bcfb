"""Commands that the dashboard runs: one at a time, each in a process that ends with the server."""

import contextlib
import os
import secrets
import shutil
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from datetime import datetime
from pathlib import Path

from fringecal.serve.access import Refused
from fringecal.serve.supervisor import Bounds, supervised

VERBS = ("commission", "verify", "audit")
_COMMAND = (sys.executable, "-P", "-m", "fringecal")
_MOST_LINES = 2000  # of a command's output that are kept: a commissioning says less than a hundred
_PATIENCE_S = Bounds.patience_s + 5.0  # after which not even its supervisor has stopped a command
_KEEP_ALIVE_S = 15.0  # of silence, after which a browser is sent something, so that one that left is found out


@dataclass
class Run:
    """A command under way or ended: what it printed so far, and its exit code once it has one."""

    key: str
    title: str
    session: str
    folder: Path
    started: datetime
    process: subprocess.Popen[str]
    lines: list[str] = field(default_factory=list)
    code: int | None = None
    cancelled: bool = False
    changed: threading.Condition = field(default_factory=threading.Condition)

    @property
    def out(self) -> Path:
        """Folder of the results, which appears in one piece when the command has ended."""
        return self.folder / "out"

    @property
    def last_line(self) -> str:
        """What it said last, but for where the report is: that lies in a folder of the server's."""
        said = (line.strip() for line in reversed(self.lines))
        return next((line for line in said if line and not line.startswith("report: ")), "")

    def follow(self, start: int = 0) -> Iterator[tuple[int, str] | None]:
        """Yield every line with its number from `start`, as it comes, until the end.

        Where none comes for a while, None is yielded: who no longer listens is found out only by being sent something.
        """
        while True:
            with self.changed:
                if len(self.lines) <= start and self.code is None:
                    self.changed.wait(_KEEP_ALIVE_S)
                fresh, ended = self.lines[start:], self.code is not None
            yield from enumerate(fresh, start)
            start += len(fresh)
            if ended:
                return
            if not fresh:
                yield None


class Runs:
    """All runs since the start of the server; one at a time is under way.

    Parameters
    ----------
    folder
        Work folder: each run has a fresh folder below it.
    command
        What to run the verbs by.
    """

    def __init__(self, folder: Path, command: Sequence[str] = _COMMAND) -> None:
        self._folder, self._command = folder, tuple(command)
        self._runs: dict[str, Run] = {}
        self._lock = threading.Lock()

    def newest_first(self) -> tuple[Run, ...]:
        """Every run, the newest first."""
        return tuple(self._runs.values())[::-1]

    def named(self, key: str) -> Run:
        """Return the run of this key.

        Raises
        ------
        Refused
            There is none, with code 404.
        """
        if key not in self._runs:
            raise Refused("There is no such run.", 404)
        return self._runs[key]

    def start(
        self,
        title: str,
        session: str,
        arguments: Callable[[Path], Sequence[str]],
        environment: Mapping[str, str] | None = None,
    ) -> Run:
        """Start a command.

        Parameters
        ----------
        title
            What to call it.
        session
            Key of the session that it is about.
        arguments
            Makes the arguments from the run's own folder; the results belong into ``out`` in it.
        environment
            Variables that it is given beside the server's own: what other users must not see.

        Raises
        ------
        Refused
            Another one is under way, with code 409.
        """
        with self._lock:
            if any(run.code is None for run in self._runs.values()):
                raise Refused("A run is under way; wait for its end, or stop it.", 409)
            key = secrets.token_hex(8)
            folder = self._folder / f"run-{key}"
            folder.mkdir(mode=0o700)
            process = _launched([*self._command, *arguments(folder)], environment or {})
            run = Run(key, title, session, folder, datetime.now(), process)
            self._runs[key] = run
        threading.Thread(target=_listen, args=(run,), daemon=True).start()
        return run

    def cancel(self, run: Run) -> None:
        """Stop a run, if it has not ended; it leaves no results."""
        if run.code is None:
            run.cancelled = True
            _stop(run)

    def close(self) -> None:
        """Stop what is under way, and wait until it has."""
        for run in self.newest_first():
            self.cancel(run)


def _launched(command: Sequence[str], beside: Mapping[str, str]) -> subprocess.Popen[str]:
    # Steps at once and without colours, in lines that fit the page.
    environment = os.environ | {"PYTHONUNBUFFERED": "1", "PYTHONUTF8": "1", "NO_COLOR": "1", "COLUMNS": "96"}
    return supervised(command, environment={**environment, **beside}, said=subprocess.STDOUT)


def _listen(run: Run) -> None:
    """Collect what a run prints, and its exit code; what an interrupted one was still writing is removed."""
    assert run.process.stdout is not None
    with run.process.stdout as said:
        for line in said:
            with run.changed:
                if len(run.lines) < _MOST_LINES:
                    run.lines.append(line.rstrip())
                run.changed.notify_all()
    code = run.process.wait()
    assert run.process.stdin is not None
    run.process.stdin.close()
    for partial in run.folder.glob(".*.partial"):
        shutil.rmtree(partial, ignore_errors=True)
    with run.changed:
        run.code = code
        run.changed.notify_all()


def _stop(run: Run) -> None:
    run.process.terminate()
    with run.changed:
        ended = run.changed.wait_for(lambda: run.code is not None, _PATIENCE_S)
    if not ended:
        with contextlib.suppress(ProcessLookupError):
            run.process.kill()
        with run.changed:
            run.changed.wait_for(lambda: run.code is not None, _PATIENCE_S)
