"""Signals at the command's beginning, in its work, in a destructor and at its end: one line, the right code."""

import subprocess
import sys

import pytest

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="signals of another kind")

# The command's libraries take a second to load; what they would do is told here by a module in their place.
STAND_IN = """
import os, signal, sys, threading, time, types
signal.signal(signal.SIGINT, signal.default_int_handler)  # whatever runs these tests may ignore them
for number in (signal.SIGTERM, signal.SIGHUP):
    signal.signal(number, signal.SIG_DFL)
from fringecal.cli import entry

class Loaded(types.ModuleType):
    def __getattr__(self, name):
        if name.startswith("__"):
            raise AttributeError(name)
        if WHEN == "beginning":
            signal.raise_signal(NUMBER)
        return {"main": work, "stop_interrupted": stop}[name]

def stop():
    print("told", entry.told_to_end)
    sys.exit(143 if entry.told_to_end else 130)

class Mortal:
    def __del__(self):
        signal.raise_signal(NUMBER)

def work():
    print("at work", flush=True)
    if WHEN == "work":
        try:
            signal.raise_signal(NUMBER)
        finally:
            for _ in range(3):  # further ones do not disturb what clears away
                signal.raise_signal(NUMBER)
            print("tidy", flush=True)
    if WHEN == "destructor":
        Mortal()
        time.sleep(5)
        print("lost")
    if WHEN == "end":
        import atexit
        atexit.register(signal.raise_signal, NUMBER)
        sys.exit(3)

sys.modules["fringecal.cli.app"] = Loaded("app")
entry.main()
"""


def outcome(when: str, name: str) -> tuple[int, str, str]:
    program = f"import signal\nWHEN, NUMBER = {when!r}, signal.{name}\n{STAND_IN}"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=60)
    assert "Traceback" not in done.stderr, done.stderr
    return done.returncode, done.stdout, done.stderr


@pytest.mark.parametrize(("name", "word", "code"), [("SIGINT", "interrupted", 130), ("SIGTERM", "terminated", 143)])
def test_while_libraries_are_loaded_nothing_was_begun(name, word, code):
    assert outcome("beginning", name) == (code, "", f"{word}: nothing was written; run the command again\n")


@pytest.mark.parametrize(("name", "code", "told"), [("SIGINT", 130, "[]"), ("SIGHUP", 143, "[1]")])
def test_work_is_broken_off_once_and_clears_away(name, code, told):
    found, printed, _ = outcome("work", name)
    assert (found, printed.splitlines()) == (code, ["at work", "tidy", f"told {told}"])


def test_an_interruption_in_a_destructor_is_not_lost():
    found, printed, _ = outcome("destructor", "SIGINT")
    assert (found, printed.splitlines()) == (130, ["at work", "told []"])


@pytest.mark.parametrize("name", ["SIGINT", "SIGTERM"])
def test_what_comes_when_all_is_done_changes_nothing(name):
    assert outcome("end", name) == (3, "at work\n", "")
