"""Entries of a table beside those of the history: the same, new, or in contradiction, to be settled by a correction."""

import hashlib
from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, replace
from typing import Any

from fringecal.errors import HistoryError
from fringecal.history.entries import Entry
from fringecal.history.store import READING_COLUMNS, History

_OF_ENTRY = ("rig", "kind", "captured", "decision", "operator", "temperature_degC", "minutes_since_power_on")


def settled(history: History, entries: Sequence[Entry], *, correct: bool) -> list[Entry]:
    """Return the entries that are to be appended: not those that are there already, and corrections as such.

    An entry contradicts one of the history that has its hash, or its rig, kind and time and one of its quantities, and
    holds other values.

    Parameters
    ----------
    history
        What is there.
    entries
        What is to be added.
    correct
        Whether an entry supersedes the one that it contradicts.

    Raises
    ------
    HistoryError
        One contradicts the history and is no correction, or corrects only a part of an entry.
    """
    known = _known(history, {entry.rig for entry in entries})
    replaced = {entry.supersedes for entry in known.values()}
    by_time: dict[tuple[str, str, str], list[Entry]] = defaultdict(list)
    for entry in known.values():
        if entry.sha256 not in replaced:
            by_time[entry.rig, entry.kind, entry.captured].append(entry)
    return list(_settled(entries, known, by_time, correct))


def _settled(
    entries: Sequence[Entry],
    known: Mapping[str, Entry],
    by_time: Mapping[tuple[str, str, str], Sequence[Entry]],
    correct: bool,
) -> Iterator[Entry]:
    for entry in entries:
        same = known.get(entry.sha256)
        # One that was corrected since is left so, unless it is to stand again.
        if same is not None and _content(same) == _content(entry) and not correct:
            continue
        there = by_time.get((entry.rig, entry.kind, entry.captured), ())
        rivals = [one for one in there if one.sha256 == entry.sha256 or _names(one) & _names(entry)]
        if any(_content(one) == _content(entry) for one in rivals):
            continue
        if same is not None or (rivals and entry.supersedes is None):
            yield _correction(entry, rivals, correct)
        else:
            yield entry


def _correction(entry: Entry, rivals: Sequence[Entry], correct: bool) -> Entry:
    place = f"{entry.rig}, {entry.captured}, {entry.kind}"
    if not correct:
        found = _difference(entry, rivals[0]) if rivals else "it was corrected since"
        raise HistoryError(f"{place}: the history holds other values ({found}); --correct supersedes them")
    if len(rivals) != 1:
        raise HistoryError(f"{place}: {len(rivals)} entries of the history would be corrected, needed one")
    missing = sorted(_names(rivals[0]) - _names(entry))
    if missing:
        raise HistoryError(f"{place}: the correction lacks {', '.join(missing)}; state every quantity of the entry")
    old = rivals[0].sha256
    number = hashlib.sha256(repr((old, _content(entry))).encode()).hexdigest()
    return replace(entry, sha256=number, supersedes=old)


def _difference(entry: Entry, other: Entry) -> str:
    """Name the first value that differs."""
    theirs = {reading.quantity: asdict(reading) for reading in other.readings}
    for reading in entry.readings:
        ours, known = asdict(reading), theirs.get(reading.quantity, {})
        for name in READING_COLUMNS:
            if ours[name] != known.get(name):
                return f"{reading.quantity}: {name} is {known.get(name)}, the table says {ours[name]}"
    names = [name for name in _OF_ENTRY if getattr(entry, name) != getattr(other, name)]
    return ", ".join(f"{name} is {getattr(other, name)}, the table says {getattr(entry, name)}" for name in names)


def _names(entry: Entry) -> set[str]:
    return {reading.quantity for reading in entry.readings}


def _content(entry: Entry) -> tuple[Any, ...]:
    readings = sorted(repr(tuple(asdict(reading)[name] for name in READING_COLUMNS)) for reading in entry.readings)
    return (*(getattr(entry, name) for name in _OF_ENTRY), tuple(readings))


def _known(history: History, rigs: set[str]) -> dict[str, Entry]:
    """Read the entries of some rigs back from the history, by hash."""
    from fringecal.history.entries import Reading

    found: dict[str, Entry] = {}
    for rig in sorted(rigs):
        rows = history.readings(rig, superseded=True)
        rows = rows.astype(object).where(rows.notna(), None)
        readings: dict[str, list[Reading]] = defaultdict(list)
        for row in rows[["sha256", *READING_COLUMNS]].to_dict("records"):
            readings[row.pop("sha256")].append(Reading(**{str(name): value for name, value in row.items()}))
        entries = history.entries(rig, superseded=True)
        for row in entries.astype(object).where(entries.notna(), None).to_dict("records"):
            fields = {str(name): value for name, value in row.items() if name != "appended"}
            found[row["sha256"]] = Entry(**fields, readings=tuple(readings[row["sha256"]]))
    return found
