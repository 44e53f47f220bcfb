"""What the dashboard starts ends with it, and uses no more than it may."""

import os
import subprocess
import sys
import time
from pathlib import Path

import pytest

from fringecal.serve.access import Refused
from fringecal.serve.bounded_check import checked
from fringecal.serve.supervisor import TIMED_OUT, Bounds, supervised

pytestmark = pytest.mark.skipif(not Path("/proc/self/status").exists(), reason="looks for processes in /proc")

# Starts a process of its own, says both numbers, and sleeps; a deaf one does not end when it is asked to.
SLEEPS = """
import os, signal, subprocess, sys, time
if "deaf" in sys.argv:
    signal.signal(signal.SIGTERM, signal.SIG_IGN)
child = subprocess.Popen([sys.executable, "-S", "-c", "import time; time.sleep(60)"])
print(os.getpid(), child.pid, flush=True)
time.sleep(60)
"""
# An owner that is killed without warning: it can tidy nothing.
OWNS = f"""
import os, subprocess, sys, time
from fringecal.serve.supervisor import supervised
process = supervised([sys.executable, "-S", "-c", {SLEEPS!r}], environment=os.environ, said=subprocess.DEVNULL)
print(process.pid, process.stdout.readline(), flush=True)
time.sleep(60)
"""


def supervise(script, *words, bounds=None):
    command = [sys.executable, "-S", "-c", script, *words]
    return supervised(command, bounds, environment=os.environ, said=subprocess.DEVNULL)


def is_running(number: int) -> bool:
    try:
        return ") Z " not in Path(f"/proc/{number}/stat").read_text()
    except FileNotFoundError:
        return False


def demand_gone(numbers: list[int], seconds: float = 15.0) -> None:
    until = time.monotonic() + seconds
    while any(map(is_running, numbers)) and time.monotonic() < until:
        time.sleep(0.05)
    assert not any(map(is_running, numbers))


def test_a_command_is_carried_out_and_its_exit_code_passed_on():
    with supervise("import sys; print(sys.stdin.read() == '', flush=True); sys.exit(3)") as process:
        assert process.stdout.read() == "True\n"  # nothing of what reaches the supervisor reaches the command
        assert process.wait() == 3


def test_killing_the_owner_ends_the_command_and_what_it_started():
    with subprocess.Popen([sys.executable, "-c", OWNS], stdout=subprocess.PIPE, text=True) as owner:
        numbers = [int(word) for word in owner.stdout.readline().split()]
        assert len(numbers) == 3
        assert all(map(is_running, numbers))
        owner.kill()
        demand_gone(numbers)


def test_killing_the_supervisor_ends_the_command():
    with supervise(SLEEPS) as process:
        numbers = [int(word) for word in process.stdout.readline().split()]
        process.kill()
        demand_gone(numbers[:1])
        os.kill(numbers[1], 9)  # what the command had started itself nobody is left to know


def test_a_command_that_does_not_end_when_asked_is_ended():
    with supervise(SLEEPS, "deaf", bounds=Bounds(patience_s=1.0)) as process:
        numbers = [int(word) for word in process.stdout.readline().split()]
        process.terminate()
        time.sleep(0.5)
        assert is_running(numbers[0])
        demand_gone(numbers)


def test_time_is_bounded():
    with supervise(SLEEPS, bounds=Bounds(seconds=0.5)) as process:
        numbers = [int(word) for word in process.stdout.readline().split()]
        assert process.wait() == TIMED_OUT
        assert not any(map(is_running, numbers))


def test_memory_is_bounded():
    for mebibytes, code in ((100, 0), (600, 1)):
        with supervise(f"bytearray({mebibytes} << 20)", bounds=Bounds(memory_mib=400)) as process:
            assert process.wait() == code


@pytest.mark.parametrize(
    ("script", "bounds", "words"),
    [
        ("import time; time.sleep(60)", Bounds(seconds=0.5), "more than 0.5 s"),
        ("bytearray(600 << 20)", Bounds(memory_mib=400), "may use 400 MiB"),
        ("import os; os.abort()", Bounds(), "broke off"),
        ("print('{}')", Bounds(), "broke off"),
        ("print('no JSON')", Bounds(), "broke off"),
    ],
)
def test_a_check_that_breaks_off_is_refused_in_one_sentence(tmp_path, script, bounds, words):
    with pytest.raises(Refused, match=words) as refused:
        checked(tmp_path, bounds, (sys.executable, "-S", "-c", script))
    assert refused.value.code == 413


def test_a_folder_is_checked_in_a_process_of_its_own(tmp_path):
    report = checked(tmp_path)
    assert not report.ok
    assert [fault.found for fault in report.faults] == ["no session.toml in the folder"]
