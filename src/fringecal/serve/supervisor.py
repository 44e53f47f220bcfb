"""Run a command that must not outlive who asked for it, within bounds: a process of its own between the two.

As a program it holds its standard input open: when that ends, because its owner closed it or is gone (a kill without
warning too), the command is asked to end, and after a while ended.
"""

import argparse
import contextlib
import os
import signal
import subprocess
import sys
import threading
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import IO, Any

TIMED_OUT = 124  # exit code, as of timeout(1)
_BY_SIGNAL = 128  # exit code of a command ended by a signal, less the signal's number, as shells say it
_KILL = getattr(signal, "SIGKILL", signal.SIGTERM)  # what Windows calls to terminate cannot be caught either
_PR_SET_PDEATHSIG = 1  # prctl(2): the signal that a process is sent when its parent ends


@dataclass(frozen=True)
class Bounds:
    """How much a command may use; None for as much as there is.

    Parameters
    ----------
    memory_mib
        Address space of each of its processes, MiB.
    seconds
        Time until it is asked to end, s.
    patience_s
        Time after which a command that was asked to end is ended, s.
    """

    memory_mib: int | None = None
    seconds: float | None = None
    patience_s: float = 10.0


def supervised(
    command: Sequence[str], bounds: Bounds | None = None, *, environment: Mapping[str, str], said: int | IO[Any]
) -> subprocess.Popen[str]:
    """Start a command that ends when the returned process's standard input is closed, or this process ends.

    Parameters
    ----------
    command
        Program and arguments.
    bounds
        What it may use.
    environment
        Its environment variables.
    said
        Where its standard error goes, as `subprocess` takes it; its standard output is a pipe.
    """
    bounds = bounds or Bounds()
    limits = [
        f"--memory={bounds.memory_mib or 0}",
        f"--seconds={bounds.seconds or 0}",
        f"--patience={bounds.patience_s}",
    ]
    return subprocess.Popen(
        [sys.executable, "-P", "-m", "fringecal.serve.supervisor", *limits, "--", *command],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=said,
        text=True,
        encoding="utf-8",
        errors="replace",
        env=dict(environment),
        start_new_session=True,  # Ctrl-C stops the owner, which then stops this
    )


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command named, and return its exit code."""
    parser = argparse.ArgumentParser(prog="supervisor")
    parser.add_argument("--memory", type=int, default=0)
    parser.add_argument("--seconds", type=float, default=0.0)
    parser.add_argument("--patience", type=float, default=Bounds.patience_s)
    parser.add_argument("command", nargs="+")
    asked = parser.parse_args(arguments)
    if asked.memory:
        _limit_memory(asked.memory)
    return _carried_out(asked.command, Bounds(seconds=asked.seconds or None, patience_s=asked.patience))


def _limit_memory(mebibytes: int) -> None:
    """Bound the address space of this process and of what it starts, where the system can."""
    with contextlib.suppress(ImportError):  # Windows
        import resource

        hard = resource.getrlimit(resource.RLIMIT_AS)[1]
        wanted = mebibytes << 20
        resource.setrlimit(resource.RLIMIT_AS, (wanted if hard < 0 else min(wanted, hard), hard))


def _carried_out(command: Sequence[str], bounds: Bounds) -> int:
    """Start the command, and return its exit code once neither it nor what it started is there any more."""
    process = subprocess.Popen(
        command,
        stdin=subprocess.DEVNULL,
        start_new_session=True,  # so that what it starts in turn ends with it
        preexec_fn=_end_with_parent if sys.platform == "linux" else None,  # no other thread runs yet
    )
    told, ended = threading.Event(), threading.Event()
    signal.signal(signal.SIGTERM, lambda *_: told.set())
    overtime: list[bool] = []
    for work, given in ((_tell_when_input_ends, (told,)), (_end_when_told, (process, told, ended, bounds, overtime))):
        threading.Thread(target=work, args=given, daemon=True).start()
    _wait_without_reaping(process)
    ended.set()
    _signal_group(process, _KILL)  # whatever it left running
    code = process.wait()
    if overtime:
        return TIMED_OUT
    return code if code >= 0 else _BY_SIGNAL - code


def _wait_without_reaping(process: subprocess.Popen[bytes]) -> None:
    """Wait for the end of a process, whose number stays its own until it is asked for its exit code."""
    if hasattr(os, "waitid"):
        os.waitid(os.P_PID, process.pid, os.WEXITED | os.WNOWAIT)
    else:
        process.wait()


def _tell_when_input_ends(told: threading.Event) -> None:
    # Past Python's buffer, whose lock would be held when the program ends first.
    with contextlib.suppress(OSError):
        while os.read(0, 1 << 16):
            pass
    told.set()


def _end_when_told(
    process: subprocess.Popen[bytes],
    told: threading.Event,
    ended: threading.Event,
    bounds: Bounds,
    overtime: list[bool],
) -> None:
    """Ask the command to end when its time is over or its owner gone; end it when it does not."""
    if not told.wait(bounds.seconds) and not ended.is_set():
        overtime.append(True)
    if ended.is_set():
        return
    _signal_group(process, signal.SIGTERM)
    if not ended.wait(bounds.patience_s):
        _signal_group(process, _KILL)


def _signal_group(process: subprocess.Popen[bytes], number: int) -> None:
    with contextlib.suppress(ProcessLookupError, PermissionError):
        if hasattr(os, "killpg"):
            os.killpg(process.pid, number)
        else:
            process.send_signal(number)


def _end_with_parent() -> None:
    """Have the kernel end this process when the supervisor itself is ended without warning."""
    with contextlib.suppress(OSError, AttributeError):
        import ctypes

        ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)


if __name__ == "__main__":
    sys.exit(main())
