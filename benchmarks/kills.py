"""Commands that replace results, ended at random moments: the old results are whole or the new ones, and nothing else.

    python benchmarks/kills.py [trials of a command] [trials of a writer] [seed] [trials of beginnings and ends]

A trial starts `fringecal grid` over older results, or a writer that replaces forty files over and over, and sends
SIGKILL, SIGTERM or SIGINT at a random moment: anywhere in the run, or as soon as results are gathered or put in place.
Then the folder must hold the old results as they were, or new ones of one run; a file of the user's own stays; nothing
hidden is left but after SIGKILL, and that is gone after the next command. Trials of beginnings and ends start the
command as a shell does, and strike while its libraries are loaded, or from when its result is printed until it is gone:
nothing but a line may be said, by any signal. Each trial is printed as it ends, and counts at last.
"""

import importlib
import multiprocessing
import os
import random
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Collection
from dataclasses import dataclass
from multiprocessing.process import BaseProcess as Process
from pathlib import Path

import cv2
import numpy as np

from fringecal.cli import entry
from fringecal.cli.app import _ended_tidily
from fringecal.records import result_folder

SIGNALS = (signal.SIGKILL, signal.SIGTERM, signal.SIGINT)
PATIENCE_S = 120.0
FILES = 40  # of the writer's results: as many as a calibration has with its figures and tables


@dataclass
class Bench:
    """A folder with results in `out`, and what is known of them."""

    place: Path
    inside: bool  # whether commands work in the very folder that is replaced, which then cannot be exchanged

    @property
    def out(self) -> Path:
        """The folder of results."""
        return self.place / "out"

    def hidden(self) -> list[str]:
        """Names that commands left beside it."""
        return sorted(path.name for path in self.place.iterdir() if path.name.startswith("."))

    def content(self) -> dict[str, bytes]:
        """Every file in the results but those kept of earlier ones."""
        files = (path for path in self.out.rglob("*") if path.is_file() and "earlier" not in path.parts)
        return {path.relative_to(self.out).as_posix(): path.read_bytes() for path in files}

    def start(self, work: Callable[..., None], *arguments: object) -> Process:
        """Start work in a process of its own that has everything loaded; what it says goes to a file."""
        context = multiprocessing.get_context("fork")
        ready = context.Event()
        process = context.Process(target=_quietly, args=(self, ready.set, work, arguments))
        process.start()
        ready.wait(PATIENCE_S)
        return process

    @property
    def said(self) -> Path:
        """Where the process says what it has to say."""
        return self.place.parent / "said.txt"


def _quietly(bench: Bench, ready: Callable[[], None], work: Callable[..., None], arguments: tuple[object, ...]) -> None:
    signal.signal(signal.SIGINT, signal.default_int_handler)
    if work is run_command:
        entry._listen(entry._at_start)  # from its first moment on, as the command does
    said = os.open(bench.said, os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
    os.dup2(said, 1)
    os.dup2(said, 2)
    os.chdir(bench.out if bench.inside else bench.place)
    ready()
    try:
        work(*arguments)
    except KeyboardInterrupt:  # before the command has begun
        sys.exit(130)


def run_command(arguments: list[str]) -> None:
    """Run the command as its entry point does."""
    sys.argv = ["fringecal", *arguments]
    entry.main()


def write_over_and_over(out: Path, first: int, last: int) -> None:
    """Replace results again and again, each time by files that all hold the run's number; tidy when told to end."""
    with _ended_tidily():
        try:
            for number in range(first, last):
                with result_folder(out, last="r.json") as staging:
                    (staging / "figures").mkdir()
                    for k in range(FILES):
                        (staging / ("figures" if k % 2 else ".") / f"{k}.txt").write_text(f"{number}\n" * 50)
                    (staging / "r.json").write_text(str(number))
        except KeyboardInterrupt:
            sys.exit(130)


def end(bench: Bench, process: Process, number: signal.Signals, when: Callable[[], bool], pause_s: float) -> bool:
    """Send a signal `pause_s` after something has happened; tell whether the process was still at work."""
    began = time.monotonic()
    while not when() and process.is_alive() and time.monotonic() - began < PATIENCE_S:
        time.sleep(0.0005)
    process.join(pause_s)
    struck = process.is_alive()
    if struck:
        os.kill(process.pid or 0, number)
    process.join(PATIENCE_S)
    said = bench.said.read_text(errors="replace")
    demand("Traceback" not in said, f"a traceback: {said[-400:]}")
    if number != signal.SIGKILL or not struck:
        demand(process.exitcode in (0, 3, 130, 143), f"exit code {process.exitcode}: {said[-300:]}")
    return struck


def demand(holds: bool, otherwise: str) -> None:
    """Note a broken trial."""
    if not holds:
        raise BrokenTrial(otherwise)


class BrokenTrial(Exception):
    """What a trial shows that none may."""


def demand_left(bench: Bench, number: signal.Signals, struck: bool, known: Collection[str] = ()) -> None:
    """Nothing hidden is left, but after SIGKILL; `known` is what had been left before the command began."""
    if number != signal.SIGKILL or not struck:
        demand(set(bench.hidden()) <= set(known), f"left behind: {bench.hidden()}")
    demand((bench.out / "diary.txt").read_bytes() == b"mine", "a file of the user's own is gone")


def writer_trial(bench: Bench, rng: random.Random, count: int) -> str:
    """End the writer somewhere in its work; its files must all be of one run."""
    number = rng.choice(SIGNALS)
    process = bench.start(write_over_and_over, bench.out, 1000 * count, 1000 * count + 900)
    struck = end(bench, process, number, lambda: True, rng.uniform(0.02, 0.3))
    if bench.inside and number == signal.SIGKILL:  # files are moved one by one there: the next command completes it
        write_over_and_over(bench.out, 0, 1) if bench.hidden() else None
    demand_left(bench, number, struck)
    demand_of_one_run(bench.content())
    write_over_and_over(bench.out, 1000 * count + 990, 1000 * count + 991)
    demand(bench.hidden() == [], f"the next command left {bench.hidden()}")
    return f"writer {number.name}{' in its folder' if bench.inside else ''}{'' if struck else ', too late'}"


def demand_of_one_run(content: dict[str, bytes]) -> None:
    """All files of the writer hold the same number."""
    numbers = {text.split(b"\n")[0] for name, text in content.items() if name != "diary.txt"}
    demand(len(content) == FILES + 2, f"{len(content)} files, {FILES + 2} were needed")
    demand(len(numbers) == 1, f"files of several runs: {sorted(numbers)}")


def command_trial(bench: Bench, rng: random.Random, count: int) -> str:
    """End `fringecal grid` at some moment; old results stand as they were, or all are of the new run."""
    number, moment = rng.choice(SIGNALS), rng.choice(("anywhere", "gathered", "gathered", "in place"))
    before, identity, known = bench.content(), bench.out.stat().st_ino, bench.hidden()
    began = time.time()
    happened: dict[str, tuple[Callable[[], bool], float]] = {
        "anywhere": (lambda: True, 2.5),
        "gathered": (lambda: bool(set(bench.hidden()) - set(known)), 1.0),
        "in place": (lambda: bench.out.stat().st_ino != identity, 0.01),
    }
    when, longest_s = happened[moment]
    arguments = ("grid", str(bench.place / f"{'ab'[count % 2]}.png"), "--target", "grid-10mm", "--out", str(bench.out))
    struck = end(bench, bench.start(run_command, list(arguments)), number, when, rng.uniform(0.0, longest_s))
    demand_left(bench, number, struck, known)
    after = bench.content()
    if after != before:
        demand(number == signal.SIGKILL or not bench.hidden(), f"the next command left {bench.hidden()}")
        old = [name for name in before if name != "diary.txt" and (bench.out / name).stat().st_mtime < began - 0.05]
        demand(not old, f"new results beside old {old[:5]}")
        demand(set(after) == set(before), f"other files: {sorted(set(after) ^ set(before))[:5]}")
    demand(struck or after != before, "nothing new was written")
    outcome = "old" if after == before else "new"
    return f"grid {number.name}, {moment}, {outcome}" + ("" if struck else ", too late")


def edge_trial(bench: Bench, rng: random.Random, count: int) -> str:
    """Start a command as a shell does, and strike at its beginning or its end; it says a line, whatever came."""
    number, at_end = rng.choice((signal.SIGTERM, signal.SIGINT, signal.SIGHUP)), count % 2 == 0
    arguments = (
        ["targets", "show", "grid-10mm"]
        if rng.random() < 0.5
        else ["grid", str(bench.place / "a.png"), "--target", "grid-10mm", "--out", str(bench.place / "edge")]
    )
    process = subprocess.Popen(
        [sys.executable, "-u", "-c", START, *arguments], stdout=subprocess.PIPE, stderr=subprocess.STDOUT, bufsize=0
    )
    assert process.stdout is not None
    read = process.stdout.read(1)  # said by START when Python itself stands
    if at_end:
        while (more := process.stdout.read(1)) not in (b"", b"\n"):
            read += more
    time.sleep(rng.uniform(0, 0.4 if at_end else 1.5))
    struck = process.poll() is None
    if struck:
        process.send_signal(number)
    try:
        read += process.communicate(timeout=PATIENCE_S)[0]
    except subprocess.TimeoutExpired as slow:
        process.kill()
        raise BrokenTrial(f"{number.name}: still there after {PATIENCE_S} s") from slow
    said = read.decode(errors="replace")
    demand("Traceback" not in said and "Exception ignored" not in said, f"a traceback: {said[-600:]}")
    demand(process.returncode in (0, 130, 143), f"exit code {process.returncode}: {said[-300:]}")
    demand(process.returncode == 0 or "run the command again" in said, f"{process.returncode} without a word: {said}")
    when = "end" if at_end else "beginning"
    return f"{arguments[0]} {number.name}, {when}, {process.returncode}" + ("" if struck else ", too late")


# As the installed command: signals as a shell's foreground job has them, and a sign that Python itself has begun.
START = (
    "import signal; signal.signal(signal.SIGINT, signal.default_int_handler); "
    "signal.signal(signal.SIGHUP, signal.SIG_DFL); signal.signal(signal.SIGTERM, signal.SIG_DFL); "
    "from fringecal.cli.entry import main; import os; os.write(1, b'.'); main()"
)


def grid_picture(rng: np.random.Generator) -> np.ndarray:
    """Draw a ruled grid of 16 px pitch with some noise."""
    picture = np.full((200, 240), 200.0)
    picture[:, 8::16] = picture[8::16, :] = 40.0
    return np.clip(cv2.GaussianBlur(picture, (0, 0), 0.8) + rng.normal(0, 1, picture.shape), 0, 255).astype(np.uint8)


def trials(
    kind: Callable[[Bench, random.Random, int], str], bench: Bench, count: int, seed: int
) -> tuple[Counter[str], list[str]]:
    """Run so many trials of a kind; return what came of them, and what broke."""
    outcomes, broken = Counter[str](), []
    for number in range(1, count + 1):
        try:
            outcome = kind(bench, random.Random(seed + number), number)
            outcomes[outcome] += 1
        except BrokenTrial as error:
            outcome = f"BROKEN: {error}"
            broken.append(f"{kind.__name__} {seed + number}: {error}")
        print(f"{kind.__name__} {seed + number}: {outcome}", flush=True)
    return outcomes, broken


def prepared(place: Path, *, inside: bool = False) -> Bench:
    """Make a bench with a file of the user's own and first results in it."""
    bench = Bench(place, inside)
    bench.out.mkdir(parents=True)
    (bench.out / "diary.txt").write_bytes(b"mine")
    return bench


def main(commands: int = 100, writers: int = 200, seed: int = 1, edges: int = 60) -> int:
    """Run the campaign and print it."""
    for verb in ("fringecal.workflows.grid", "fringecal.cli.grid", "fringecal.records", "fringecal.report"):
        importlib.import_module(verb)
    began, outcomes, broken = time.monotonic(), Counter[str](), []
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    with tempfile.TemporaryDirectory() as folder:
        for inside, count in ((False, writers), (True, writers // 4)):
            bench = prepared(Path(folder) / f"writer-{inside}", inside=inside)
            write_over_and_over(bench.out, 0, 1)
            found, wrong = trials(writer_trial, bench, count, seed)
            outcomes, broken = outcomes + found, broken + wrong
            print(f"writer: {sum(found.values())} trials, {time.monotonic() - began:.0f} s", flush=True)
        bench = prepared(Path(folder) / "grid")
        for name in "ab":
            cv2.imwrite(str(bench.place / f"{name}.png"), grid_picture(np.random.default_rng(ord(name))))
        arguments = ("grid", str(bench.place / "a.png"), "--target", "grid-10mm", "--out", str(bench.out))
        bench.start(run_command, list(arguments)).join()
        found, wrong = trials(command_trial, bench, commands, seed)
        outcomes, broken = outcomes + found, broken + wrong
        found, wrong = trials(edge_trial, bench, edges, seed)
        outcomes, broken = outcomes + found, broken + wrong
    for outcome, count in sorted(outcomes.items()):
        print(f"{count:5d} {outcome}")
    print(*broken, sep="\n")
    struck = sum(count for outcome, count in outcomes.items() if "too late" not in outcome)
    print(f"{struck} kills in {time.monotonic() - began:.0f} s, {len(broken)} broken trials")
    return min(1, len(broken))


if __name__ == "__main__":
    sys.exit(main(*map(int, sys.argv[1:5])))
