"""Run a calibration, a verification or an audit once more from its record: same files by hash, number by number."""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from fringecal.errors import RecordError
from fringecal.records import (
    DEFAULT_LIMITS,
    CalibrationRecord,
    Record,
    VerificationRecord,
    earlier_record,
    read_calibration,
    sha256_of,
    software_versions,
)
from fringecal.session import Session, load_session
from fringecal.targets import Zigzag
from fringecal.workflows.audit import audit, audit_record
from fringecal.workflows.commission import calibration_record, commission
from fringecal.workflows.shared import calibration_of
from fringecal.workflows.verify import artefact_capture, artefact_record, verification_record, verify, verify_artefact

PART_OF_U = 0.01  # a number that differs by less than this of its standard uncertainty is the same number

_OF_THE_MAKING = {"created", "software", "command"}
_SILENT = {"inputs", "limits", "appearance"}  # what older versions did not write is no difference
_PAIRS = {"value": "u", "angle_deg": "u_deg", "mean_mm": "u_mm", "measured": "u_measured", "u_mm": "u_mm"}
_VERBS = ("commission", "verify", "audit")
_CALIBRATION = "--calibration"
_JUDGED_WORDS = {"decision", "verdict", "model"}  # other texts repeat what is compared anyway
_EN = "en"
_VERDICT = "verdict"
# Degrees of freedom that records without `en_definition` did not write beside u, as pydantic leaves them out.
_LATER_DOF: Any = {
    "projection": {"columns": {"__all__": {"dof"}}},
    "distortion": {"max_px": {"dof"}},
    **{part: {"__all__": {"dof"}} for part in ("profiles", "profiles_with_edges", "readings", "changes")},
}


@dataclass(frozen=True)
class Difference:
    """One place in which two records differ; the difference of numbers with an uncertainty is given as a part of it.

    `defined` is whether another definition of En alone explains it: what En is formed from is compared for itself.
    """

    place: str
    then: object
    now: object
    part_of_u: float | None = None
    defined: bool = False

    @property
    def matters(self) -> bool:
        """Whether a result differs: by more than rounding against its uncertainty, in a verdict, or in structure."""
        if self.defined:
            return False
        if self.part_of_u is not None:
            return self.part_of_u > PART_OF_U
        if isinstance(self.then, str) and isinstance(self.now, str):
            return self.place.rpartition(".")[2] in _JUDGED_WORDS
        return not (_is_number(self.then) and _is_number(self.now))


@dataclass(frozen=True)
class Rerun:
    """What doing the work of a record again has shown.

    Parameters
    ----------
    fresh
        The record that the same files give today.
    differences
        Every place in which it differs from the record; empty if all numbers are the same to the last digit.
    versions
        Software that is not the record's: then and now by package; empty text where it was or is not there.
    same_en
        Whether the record forms En as this version does.
    """

    fresh: Record
    differences: tuple[Difference, ...]
    versions: Mapping[str, tuple[str, str]]
    same_en: bool = True

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
        """State the result, and which software could be the reason."""
        other = ", ".join(
            f"{name} {then or 'absent'} then, {now or 'absent'} now" for name, (then, now) in self._sorted
        )
        reason = f" Other software: {other}." if other else " The software is the record's own."
        reason = f"{self._about_en}{reason}"
        if self.identical:
            return f"The same files give the same numbers, to the last digit.{reason}"
        worst = max((d.part_of_u or 0.0 for d in self.differences), default=0.0)
        if self.agrees:
            return f"The same files give the same results: nothing differs by more than {worst:.1e} of its u.{reason}"
        count = sum(difference.matters for difference in self.differences)
        return f"The same files give other results in {count} place(s), at most {worst:.2g} of u.{reason}"

    @property
    def _about_en(self) -> str:
        """State that En has another definition, and which outcomes differ for that reason alone."""
        if self.same_en:
            return ""
        outcomes = [d for d in self.differences if d.defined and isinstance(d.now, str)]
        turned = ", ".join(f"{d.place} ({d.then} then, {d.now} now)" for d in outcomes)
        return (
            f" The record forms En by another definition ({self.fresh.en_definition} now; U = 2 u in older versions): "
            "what En is formed from is compared, En itself is not."
            + (f" By the definition alone differ: {turned}." if outcomes else "")
        )

    @property
    def _sorted(self) -> list[tuple[str, tuple[str, str]]]:
        return sorted(self.versions.items())


def rerun(
    record: Record,
    folder: Path,
    calibration: Path | None = None,
    *,
    progress: Callable[[str], None] = lambda _: None,
) -> Rerun:
    """Do again what a record holds, from the record's own files, and compare every number.

    Parameters
    ----------
    record
        A calibration, a verification or an audit.
    folder
        The session it was made from.
    calibration
        The calibration that was judged, as its file; a calibration needs none.
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
    demand_inputs(record, folder, calibration)
    fresh = _again(record, load_session(folder), calibration, progress)
    then, now = (_compared(one, record) for one in (record, fresh))
    same_en = record.en_definition == fresh.en_definition
    found = tuple(differences(then, now))
    if not same_en:
        found = _by_definition(found, {check.name for check in fresh.checks if check.score == "En"})
    return Rerun(fresh, found, _other_versions(record.software, software_versions()), same_en)


def _by_definition(found: Sequence[Difference], scores: set[str]) -> tuple[Difference, ...]:
    """Mark what another definition of En explains: scores, outcomes of checks that are scores, a verdict by those."""
    places = {f"checks.{name}.{key}" for name in scores for key in ("value", "decision")}
    marked = [replace(d, defined=d.place in places or d.place.rpartition(".")[2] == _EN) for d in found]
    turned = [d.defined for d in marked if d.place.startswith("checks.") and d.place.endswith(".decision")]
    # Another outcome for another reason is a difference of its own, so that the verdict need not count as well.
    return tuple(replace(d, defined=True) if d.place == _VERDICT and any(turned) else d for d in marked)


def _again(record: Record, session: Session, calibration: Path | None, progress: Callable[[str], None]) -> Record:
    """Do the work, judged by what the record was judged by."""
    limits = record.limits or DEFAULT_LIMITS
    if isinstance(record, CalibrationRecord):
        return calibration_record(commission(session, progress=progress), command=record.command, limits=limits)
    assert calibration is not None  # else it would have been refused as missing
    if isinstance(record, VerificationRecord):
        return _verified_again(record, session, calibration, progress)
    in_force = read_calibration(calibration)
    found = audit(session, calibration_of(in_force), in_force, progress=progress)
    return audit_record(found, calibration, command=record.command, limits=limits)


def _verified_again(
    record: VerificationRecord, session: Session, calibration: Path, progress: Callable[[str], None]
) -> VerificationRecord:
    rig, limits = calibration_of(read_calibration(calibration)), record.limits or DEFAULT_LIMITS
    capture = artefact_capture(session, record.capture, rig)
    if not isinstance(capture.target, Zigzag):
        other = verify_artefact(capture, rig, progress=progress)
        return artefact_record(other, session, calibration, command=record.command, limits=limits)
    rows, filters = tuple(round(profile.row_px) for profile in record.profiles), bool(record.filters)
    bars = verify(session, capture.name, rig, rows_px=rows, with_filters=filters, progress=progress)
    return verification_record(bars, session, calibration, command=record.command, limits=limits)


def session_folder(record: Record) -> Path:
    """Return the session that the record's command line names.

    Raises
    ------
    RecordError
        The record holds no command line: it was not made by the command.
    """
    verb, *arguments = record.command[1:] or ("",)
    if verb not in _VERBS or not arguments:
        raise RecordError("the record names no session that it was made from; name the folder with --session")
    return Path(arguments[0])


def calibration_file(record: Record) -> Path | None:
    """Return the calibration that the record's command line names; None for a calibration itself.

    Raises
    ------
    RecordError
        The record was made with a calibration, but names none.
    """
    if isinstance(record, CalibrationRecord):
        return None
    try:
        stated = Path(record.command[record.command.index(_CALIBRATION) + 1])
    except (ValueError, IndexError):
        raise RecordError(f"the record names no calibration that it was made with; name one, {_CALIBRATION}") from None
    return stated / record.calibration.file if stated.is_dir() else stated


def demand_inputs(record: Record, folder: Path, calibration: Path | None = None) -> None:
    """Refuse files of which one that the record was made from is missing or has another content.

    Raises
    ------
    RecordError
        As described; every such file is named.
    """
    checked = [_fault(folder / file.file, file.file, file.sha256, "--session") for file in record.inputs]
    if not isinstance(record, CalibrationRecord):
        used = record.calibration
        checked.append(_fault(calibration or Path(), used.file, used.sha256, _CALIBRATION))
    faults = [fault for fault in checked if fault]
    if faults:
        raise RecordError(f"{folder}: not the files that the record was made from\n  " + "\n  ".join(faults))


def _fault(file: Path, name: str, expected: str, option: str) -> str:
    try:
        found = sha256_of(file)
    except RecordError:
        return f"{name}: missing, or not readable; put the file back, or name the right place with {option}"
    if found == expected:
        return ""
    fault = f"{name}: another content (SHA-256 {found[:12]}..., needed {expected[:12]}...)"
    kept = earlier_record(file, expected)
    return f"{fault}; it was replaced since, the one needed is kept: {option} {kept}" if kept.is_file() else fault


def _other_versions(then: Mapping[str, str], now: Mapping[str, str]) -> dict[str, tuple[str, str]]:
    names = sorted({*then, *now})
    return {name: (then.get(name, ""), now.get(name, "")) for name in names if then.get(name) != now.get(name)}


def _compared(one: Record, written: Record) -> dict[str, Any]:
    """Give what is compared: all but the making, and nothing that an older version did not write."""
    left_out: Any = dict.fromkeys((*_OF_THE_MAKING, "inputs", "en_definition"), True)
    if written.en_definition is None:
        left_out |= _LATER_DOF
    document = one.model_dump(mode="json", exclude=left_out)
    absent = {name for name in _SILENT if getattr(written, name, None) in (None, ())}
    document["checks"] = _checks(one, written)
    return {name: value for name, value in document.items() if name not in absent}


def _checks(one: Record, written: Record) -> dict[str, dict[str, Any]]:
    """Give the checks that the record holds, by name: a newer version may judge more, and state more of each."""
    known = {check.name: check for check in written.checks}
    return {
        check.name: check.model_dump(mode="json", exclude={"name", "rule", "expanded", "score"})
        for check in one.checks
        if check.name in known
    }


def differences(then: Any, now: Any, place: str = "", u: float | None = None) -> Iterator[Difference]:
    """Walk through two documents side by side and give every place in which they differ.

    Examples
    --------
    >>> list(differences({"scale": {"value": 1.0, "u": 0.1}}, {"scale": {"value": 1.05, "u": 0.1}}))
    [Difference(place='scale.value', then=1.0, now=1.05, part_of_u=0.5000000000000004, defined=False)]
    """
    if isinstance(then, Mapping) and isinstance(now, Mapping):
        for name in dict.fromkeys((*then, *now)):
            u_then = then.get(_PAIRS.get(name, ""))
            inside = f"{place}.{name}" if place else str(name)
            yield from differences(then.get(name), now.get(name), inside, u_then if _is_number(u_then) else None)
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
