"""What the writers' processes run; a module of its own, since they import it anew."""

import hashlib
from collections.abc import Iterator
from itertools import batched, count, islice
from multiprocessing.synchronize import Event

from fringecal.history.entries import Entry, Reading
from fringecal.history.store import open_history

READINGS_EACH = 6


def entries(number: int) -> Iterator[Entry]:
    for row in count():
        name = f"writer {number}, row {row}"
        yield Entry(
            rig=f"rig {number}",
            kind="audit",
            captured="2026-11-22T10:00:00+00:00",
            created="2026-11-22T10:00:00+00:00",
            sha256=hashlib.sha256(name.encode()).hexdigest(),
            decision="pass",
            readings=tuple(Reading(f"q{k}", float(row), "mm") for k in range(READINGS_EACH)),
        )


def append_many(where: str, number: int, rows: int, batch: int) -> None:
    """Append entries in transactions of `batch`."""
    with open_history(where) as history:
        for chunk in batched(islice(entries(number), rows), batch):
            assert history.append(chunk) == len(chunk)


def append_for_ever(where: str, number: int, opened: Event) -> None:
    """Append one entry after the other until killed."""
    with open_history(where) as history:
        opened.set()
        for entry in entries(number):
            history.append([entry])
