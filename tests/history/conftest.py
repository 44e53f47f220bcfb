"""Made-up entries: the numbers only have to come back."""

import hashlib

import pytest

from fringecal.history.entries import Entry, Reading
from fringecal.history.store import open_history


def make_entry(number, *, rig="bench-1", captured=None, readings=None, **more):
    """An entry that `number` tells from others, 12 readings by default."""
    values = [Reading(f"q{k}", number + k / 8, "mm", 0.01) for k in range(12)] if readings is None else readings
    return Entry(
        rig=rig,
        kind="verification",
        captured=captured or f"2026-01-{1 + number % 28:02d}T08:00:{number // 28 % 60:02d}+00:00",
        created="2026-11-22T10:00:00+00:00",
        sha256=hashlib.sha256(f"{rig} {number} {captured}".encode()).hexdigest(),
        decision="pass",
        readings=tuple(values),
        **more,
    )


@pytest.fixture
def history(tmp_path):
    with open_history(tmp_path / "history.db") as opened:
        yield opened
