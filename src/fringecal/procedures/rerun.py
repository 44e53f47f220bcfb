"""Run a calibration once more from its record: the same files by hash, and number by number the same results."""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from fringecal.errors import RecordError
from fringecal.procedures.commission import commission
from fringecal.procedures.recording import calibration_record
from fringecal.records.calibration import CalibrationRecord
from fringecal.records.limits import DEFAULT_LIMITS
from fringecal.records.provenance import sha256_of, software_versions
from fringecal.session import load_session

PART_OF_U = 0.01  # a number that differs by less than this of its standard uncertainty is the same number

_OF_THE_MAKING = {"created", "software", "command"}
_SILENT = {"inputs", "limits", "appearance"}  # what older versions did not write is no difference
_PAIRS = {"value": "u", "angle_deg": "u_deg", "u_mm": "u_mm"}
_JUDGED_WORDS = {"decision", "verdict", "model"}  # other words only say in figures what is compared anyway


@dataclass(frozen=True)
class Difference:
    """One place in which two records differ; numbers with an uncertainty tell the difference as a part of it."""

    place: str
    then: object
    now: object
    part_of_u: float | None = None

    @property
    def matters(self) -> bool:
        """Whether a result differs: by more than rounding against its uncertainty, in a verdict, or in structure."""
        if self.part_of_u is not None:
            return self.part_of_u > PART_OF_U
        if isinstance(self.then, str) and isinstance(self.now, str):
            return self.place.rpartition(".")[2] in _JUDGED_WORDS
        return not (_is_number(self.then) and _is_number(self.now))


@dataclass(frozen=True)
class Rerun:
    """What running a calibration again has shown.

    Parameters
    ----------
    fresh
        The record that the same files give today.
    differences
        Every place in which it differs from the record; empty if all numbers are the same to the last digit.
    versions
        Software that is not the record's: then and now by package; empty text where it was or is not there.
    """

    fresh: CalibrationRecord
    differences: tuple[Difference, ...]
    versions: Mapping[str, tuple[str, str]]

    @property
    def identical(self) -> bool:
        """Whether every number is the same to the last digit."""
        return not self.differences

    @property
    def agrees(self) -> bool:
        """Whether no result differs by more than rounding."""
        return not any(difference.matters for difference in self.differences)

    @property
    def sentence(self) -> str:
        """Say what came out, and which software could be the reason."""
        other = ", ".join(
            f"{name} {then or 'absent'} then, {now or 'absent'} now" for name, (then, now) in self._sorted
        )
        reason = f" Other software: {other}." if other else " The software is the record's own."
        if self.identical:
            return f"The same files give the same numbers, to the last digit.{reason}"
        worst = max((d.part_of_u or 0.0 for d in self.differences), default=0.0)
        if self.agrees:
            return f"The same files give the same results: nothing differs by more than {worst:.1e} of its u.{reason}"
        count = sum(difference.matters for difference in self.differences)
        return f"The same files give other results in {count} place(s), at most {worst:.2g} of u.{reason}"

    @property
    def _sorted(self) -> list[tuple[str, tuple[str, str]]]:
        return sorted(self.versions.items())


def rerun(record: CalibrationRecord, folder: Path, *, progress: Callable[[str], None] = lambda _: None) -> Rerun:
    """Commission again from the record's own files, and compare every number.

    Parameters
    ----------
    record
        The calibration.
    folder
        The session it was made from.
    progress
        Called with a short sentence before each step.

    Raises
    ------
    RecordError
        A file of the record is missing or has another content; all of them are named.
    SessionError
        The folder is no session any more.
    """
    progress("hashes of the files")
    demand_inputs(record, folder)
    found = commission(load_session(folder), progress=progress)
    fresh = calibration_record(found, command=record.command, limits=record.limits or DEFAULT_LIMITS)
    then, now = (_compared(one, record) for one in (record, fresh))
    return Rerun(fresh, tuple(differences(then, now)), _other_versions(record.software, software_versions()))


def session_folder(record: CalibrationRecord) -> Path:
    """Return the session that the record's command line names.

    Raises
    ------
    RecordError
        The record holds no command line: it was not made by the command.
    """
    verb, *arguments = record.command[1:] or ("",)
    if verb != "commission" or not arguments:
        raise RecordError("the record names no session that it was made from; name the folder with --session")
    return Path(arguments[0])


def demand_inputs(record: CalibrationRecord, folder: Path) -> None:
    """Refuse a folder in which a file of the record is missing or has another content."""
    faults = [fault for file in record.inputs if (fault := _fault(folder, file.file, file.sha256))]
    if faults:
        raise RecordError(f"{folder}: not the files that the calibration was made from\n  " + "\n  ".join(faults))


def _fault(folder: Path, name: str, expected: str) -> str:
    try:
        found = sha256_of(folder / name)
    except RecordError:
        return f"{name}: missing, or not readable; put the file back, or name the right folder with --session"
    return "" if found == expected else f"{name}: another content (SHA-256 {found[:12]}..., needed {expected[:12]}...)"


def _other_versions(then: Mapping[str, str], now: Mapping[str, str]) -> dict[str, tuple[str, str]]:
    names = sorted({*then, *now})
    return {name: (then.get(name, ""), now.get(name, "")) for name in names if then.get(name) != now.get(name)}


def _compared(one: CalibrationRecord, written: CalibrationRecord) -> dict[str, Any]:
    """Give what is compared: all but the making, and nothing that an older version did not write."""
    document = one.model_dump(mode="json", exclude=_OF_THE_MAKING | {"inputs"})
    absent = {name for name in _SILENT if getattr(written, name, None) in (None, ())}
    return {name: value for name, value in document.items() if name not in absent}


def differences(then: Any, now: Any, place: str = "", u: float | None = None) -> Iterator[Difference]:
    """Walk through two documents side by side and give every place in which they differ.

    Examples
    --------
    >>> list(differences({"scale": {"value": 1.0, "u": 0.1}}, {"scale": {"value": 1.05, "u": 0.1}}))
    [Difference(place='scale.value', then=1.0, now=1.05, part_of_u=0.5000000000000004)]
    """
    if isinstance(then, Mapping) and isinstance(now, Mapping):
        for name in dict.fromkeys((*then, *now)):
            doubt = then.get(_PAIRS.get(name, ""))
            inside = f"{place}.{name}" if place else str(name)
            yield from differences(then.get(name), now.get(name), inside, doubt if _is_number(doubt) else None)
    elif _is_list(then) and _is_list(now) and len(then) == len(now):
        for number, (a, b) in enumerate(zip(then, now, strict=True)):
            yield from differences(a, b, f"{place}[{number}]")
    elif then != now:
        yield Difference(place, then, now, _part(then, now, u))


def _part(then: object, now: object, u: float | None) -> float | None:
    if not u or not (_is_number(then) and _is_number(now)):
        return None
    return abs(float(now) - float(then)) / u  # type: ignore[arg-type]


def _is_number(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)


def _is_list(value: object) -> bool:
    return isinstance(value, Sequence) and not isinstance(value, str)
