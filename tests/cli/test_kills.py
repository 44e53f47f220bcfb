"""kill -9 at random moments of commission and audit: whole results or none, and a history of whole rows."""

import hashlib
import json
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
from fringecal.records.audit import AUDIT_FILE, read_audit
from fringecal.records.calibration import CALIBRATION_FILE, read_calibration

from .victims import PRELOAD, run

KILLS = int(os.environ.get("FRINGECAL_KILLS", "2"))  # 200 take a quarter of an hour
LINES = 26  # that a command prints, about; a moment is after one of them, so that all parts of the work have theirs
PAUSE_S = 0.6
PATIENCE_S = 120
ARCHIVE = max((Path(__file__).parents[1] / "records" / "archive").glob("[0-9]*"))

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="no fork server, and signals of another kind")


@pytest.fixture(scope="module")
def context():
    """Processes forked from one that has everything loaded."""
    server = multiprocessing.get_context("forkserver")
    server.set_forkserver_preload(["tests.cli.victims", *PRELOAD])
    return server


def kill(context, arguments, line: int, pause_s: float) -> bool:
    """Start a command and kill it `pause_s` after its line of that number; tell whether it was still at work."""
    reader, writer = context.Pipe(duplex=False)
    process = context.Process(target=run, args=([str(a) for a in arguments], writer))
    process.start()
    writer.close()
    with os.fdopen(os.dup(reader.fileno())) as lines:
        for number, _ in enumerate(lines):
            if number == line:
                break
        time.sleep(pause_s)
        process.kill()
        process.join(PATIENCE_S)
    reader.close()
    assert process.exitcode in (0, 3, -signal.SIGKILL)
    return process.exitcode < 0


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
    session, verbs = shutil.copytree(ARCHIVE / "session", tmp_path / "session"), ("commission", "audit")
    killed, known = 0, set()
    for number in range(KILLS):
        verb, record = verbs[number % 2], (CALIBRATION_FILE, AUDIT_FILE)[number % 2]
        # By turns into a folder of its own and over an older result.
        out = tmp_path / (verb if number % 4 < 2 else f"{verb}-{number}")
        more = () if verb == "commission" else ("--calibration", ARCHIVE)
        arguments = (verb, session, *more, "--out", out, "--history", history)
        killed += kill(context, arguments, chance.randrange(LINES), chance.uniform(0, PAUSE_S))
        demand_whole(out, record, pictures=3)
        rows = rows_of(history)
        assert known <= rows
        if (out / record).exists() and (sha := hashlib.sha256((out / record).read_bytes()).hexdigest()) in rows:
            assert json.loads((out / record).read_text())["session"]["rig"] == "thesis"
            known.add(sha)
        known |= rows
    assert killed > 0
    if KILLS >= 50:  # enough that some must have come through, and others not
        assert 0 < len(known) < KILLS
