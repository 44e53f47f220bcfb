"""kill -9 at random moments of commission and audit: whole results or none, and a history of whole rows."""

import hashlib
import multiprocessing
import os
import random
import shutil
import signal
import sys
import time
from pathlib import Path

import pytest

from fringecal.history.entries import read_entry
from fringecal.history.store import open_history
from fringecal.records.audit_record import AUDIT_FILE, read_audit
from fringecal.records.calibration_record import CALIBRATION_FILE, read_calibration

from .victims import PRELOAD, run

KILLS = int(os.environ.get("FRINGECAL_KILLS", "2"))  # 200 take a quarter of an hour
PATIENCE_S = 120
VERBS = {"commission": CALIBRATION_FILE, "audit": AUDIT_FILE}
# A moment is drawn up to so many seconds after something has happened. Whole runs take about five, ten where figures
# are drawn; what is written is moved into place within a tenth, and a row of the history within two hundredths.
MOMENTS = {"first result written": 1.2, "record written": 0.12, "record in place": 0.04, "start": 5.0}
DRAWN_EVERY = 10  # trials draws its figures; in the others blank ones are written
ARCHIVE = max((Path(__file__).parents[1] / "records" / "archive").glob("[0-9]*"))

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="no fork server, and signals of another kind")


@pytest.fixture(scope="module")
def context():
    """Processes forked from one that has everything loaded."""
    server = multiprocessing.get_context("forkserver")
    server.set_forkserver_preload(["tests.cli.victims", *PRELOAD])
    return server


def session_without_bars(folder: Path) -> Path:
    """Copy the archived session but for its bars, whose heights take an audit longer than all the rest."""
    shutil.copytree(ARCHIVE / "session", folder)
    document = folder / "session.toml"
    captures = document.read_text().split("[[capture]]")
    document.write_text("[[capture]]".join(part for part in captures if "angle-bars" not in part))
    return folder


def kill(context, arguments, happened, pause_s: float, *, drawn: bool) -> bool:
    """Start a command and kill it `pause_s` after something happened; tell whether it was still at work."""
    process = context.Process(target=run, args=([str(a) for a in arguments], drawn))
    process.start()
    end = time.monotonic() + PATIENCE_S
    while not happened() and process.is_alive():
        assert time.monotonic() < end
        time.sleep(0.001)
    process.join(pause_s)
    process.kill()
    process.join(PATIENCE_S)
    assert process.exitcode in (0, 3, -signal.SIGKILL)
    return process.exitcode < 0


def happening(moment: str, out: Path, record: str):
    """Return a function that tells whether a command has come so far."""
    before = (out / record).stat().st_ino if (out / record).exists() else None
    left = set(staged(out))  # by those that were killed earlier

    def in_place() -> bool:
        return (out / record).exists() and (out / record).stat().st_ino != before

    def written() -> bool:
        return in_place() or any((folder / record).exists() for folder in set(staged(out)) - left)

    happened = {"first result written": lambda: in_place() or set(staged(out)) - left, "record written": written}
    return {"start": lambda: True, "record in place": in_place, **happened}[moment]


def staged(out: Path) -> list[Path]:
    """Folders in which results are gathered before they move into place."""
    return list(out.parent.glob(f".{out.name}.*.partial"))


def demand_whole(folder: Path, record: str, pictures: int) -> None:
    """Every file that a result folder holds is whole; a record stands beside all that it belongs with."""
    if not folder.exists():
        return
    ends = {".html": b"</html>", ".pdf": b"%%EOF", ".json": b"}", ".svg": b"</svg>", ".png": b"IEND\xaeB`\x82"}
    for file in folder.rglob("*"):
        assert ".partial" not in file.name
        if file.suffix in ends:
            assert file.read_bytes().rstrip().endswith(ends[file.suffix]), file
    if (folder / record).exists():
        (read_audit if record == AUDIT_FILE else read_calibration)(folder)
        assert {"report.html", "report.pdf", "tables", "figures"} <= {path.name for path in folder.iterdir()}
        assert len(list((folder / "figures").iterdir())) >= pictures


def rows_of(history: Path) -> set[str]:
    """Hashes of the records in a history, each of which is there with its text and all its readings."""
    if not history.exists():
        return set()
    with open_history(history) as opened:
        entries, readings = opened.entries(), opened.readings()
        for sha256 in entries["sha256"]:
            text = opened.document(sha256)
            assert hashlib.sha256(text.encode()).hexdigest() == sha256
            file = history.with_name("row.json")
            file.write_bytes(text.encode())
            assert (readings["sha256"] == sha256).sum() == len(read_entry(file).readings)
    return set(entries["sha256"])


def test_kills_leave_whole_results_and_whole_rows(context, tmp_path):
    chance, history = random.Random(9), tmp_path / "history.db"
    session = session_without_bars(tmp_path / "session")
    killed, known = dict.fromkeys(MOMENTS, 0), set()
    for number in range(KILLS):
        verb, moment = list(VERBS)[number % 2], list(MOMENTS)[number // 2 % len(MOMENTS)]
        # By turns into a folder of its own and over an older result.
        out = tmp_path / (f"{verb}-{number}" if number // 8 % 2 else verb)
        more = () if verb == "commission" else ("--calibration", ARCHIVE)
        arguments = (verb, session, *more, "--out", out, "--history", history)
        happened = happening(moment, out, VERBS[verb])
        # The first, a second before the record is written, cannot come too late.
        pause_s = chance.uniform(0, MOMENTS[moment]) if number else 0.0
        struck = kill(context, arguments, happened, pause_s, drawn=number % DRAWN_EVERY == 9)
        killed[moment] += struck
        demand_whole(out, VERBS[verb], pictures=3)
        rows = rows_of(history)
        assert known <= rows
        assert struck or hashlib.sha256((out / VERBS[verb]).read_bytes()).hexdigest() in rows
        known = rows
    assert KILLS == 0 or sum(killed.values()) > 0
    # Of fifty, every moment must strike some at work, and some must pass.
    if KILLS >= 50:
        assert min(killed.values()) > 0, killed
        assert 0 < len(known) < KILLS
