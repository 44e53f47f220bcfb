"""Run a calibration, a verification or an audit once more from its record: same files by hash, number by number."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from fringecal.errors import RecordError
from fringecal.records import (
    DEFAULT_LIMITS,
    AuditRecord,
    CalibrationRecord,
    CalibrationUsed,
    DigestState,
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
from fringecal.workflows.rerun.number_by_number import PART_OF_U, ROUNDING, Difference, differences, stated_alone
from fringecal.workflows.shared import calibration_of
from fringecal.workflows.verify import artefact_capture, artefact_record, verification_record, verify, verify_artefact

_OF_THE_MAKING = {"created", "software", "command", "digest"}
_SILENT = {"inputs", "limits", "appearance"}  # what older versions did not write is no difference
_VERBS = ("commission", "verify", "audit")
_CALIBRATION = "--calibration"
_EN = "en"
_VERDICT = "verdict"
_PLACE_OF_CALIBRATION = "file"  # where it lay; what it held is known by its hash
_NAMED = 3  # places that a sentence names


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
    digest
        Whether the record is as it was written: ``"fits"``, ``"differs"`` where it was edited since, ``"none"`` where
        it carries no digest of itself.
    unstated
        Places that this version states and the record does not: they cannot be compared.
    """

    fresh: Record
    differences: tuple[Difference, ...]
    versions: Mapping[str, tuple[str, str]]
    same_en: bool = True
    digest: DigestState = "none"
    unstated: tuple[str, ...] = ()

    @property
    def identical(self) -> bool:
        """Whether every number is the same to the last digit."""
        return not self.differences

    @property
    def agrees(self) -> bool:
        """Whether no result differs by more than its rule allows."""
        return not any(difference.matters for difference in self.differences)

    @property
    def repeats(self) -> bool:
        """Whether the record is repeated: no result differs, and the record was not edited."""
        return self.agrees and self.digest != "differs"

    @property
    def sentence(self) -> str:
        """State the result, and which software could be the reason."""
        other = ", ".join(
            f"{name} {then or 'absent'} then, {now or 'absent'} now" for name, (then, now) in self._sorted
        )
        reason = f" Other software: {other}." if other else " The software is the record's own."
        return f"{self._outcome}{self._about_digest}{self._about_unstated}{self._about_en}{reason}"

    @property
    def _outcome(self) -> str:
        """State what the comparison gave, and by which rule it holds."""
        if self.identical:
            return "The same files give the same numbers, to the last digit."
        worst = max((d.part_of_u or 0.0 for d in self.differences), default=0.0)
        if self.agrees:
            return (
                f"The same files give the same results: nothing differs by more than {worst:.1e} of its u, and numbers "
                f"that state none, each u and each covariance agree to {ROUNDING:.0e}."
            )
        found = [d for d in self.differences if d.matters]
        of_u = [d.part_of_u for d in found if d.part_of_u is not None]
        most = f" (at most {max(of_u):.2g} of u)" if of_u else ""
        return (
            f"The same files give other results in {len(found)} place(s): {len(of_u)} by more than {PART_OF_U:.0%} of "
            f"their u{most}, {len(found) - len(of_u)} that state no u, or are one, by more than rounding or in kind."
        )

    @property
    def _about_digest(self) -> str:
        """State whether a difference can be an edit of the record."""
        if self.digest == "differs":
            return (
                " The record was edited after it was written: the digest that it carries is not that of its content. "
                "What differs may be the edit."
            )
        if self.digest == "none" and not self.identical:
            return " The record carries no digest of itself (older versions wrote none): an edit would not be told."
        return ""

    @property
    def _about_unstated(self) -> str:
        """State what could not be compared because the record does not hold it."""
        if not self.unstated:
            return ""
        more = ", ..." if len(self.unstated) > _NAMED else ""
        return f" Not in the record, so not compared: {', '.join(self.unstated[:_NAMED])}{more}."

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
    session = load_session(folder)
    _demand_same_bytes(record, session)
    fresh = _again(record, session, calibration, progress)
    then = _comparable(record, exclude_unset=True)
    now, unstated = stated_alone(_comparable(fresh), then)
    same_en = record.en_definition == fresh.en_definition
    found = tuple(differences(then, now))
    if not same_en:
        found = _by_definition(found, {check.name for check in fresh.checks if check.score == "En"})
    versions = _other_versions(record.software, software_versions())
    return Rerun(fresh, found, versions, same_en, record.digest_state, tuple(unstated))


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
    in_force, used = _judged(record, calibration)
    found = audit(session, calibration_of(in_force), in_force, progress=progress)
    return audit_record(found, used, command=record.command, limits=limits)


def _demand_same_bytes(record: Record, session: Session) -> None:
    """Refuse a session of which a file was replaced between its hash and its reading.

    Raises
    ------
    RecordError
        As described.
    """
    needed = {file.file: file.sha256 for file in record.inputs}
    other = [name for name, sha256 in needed.items() if session.inputs.get(name, sha256) != sha256]
    if other:
        raise RecordError(f"{session.folder}: {', '.join(other)} changed while it was read; run the command again")


def _judged(record: VerificationRecord | AuditRecord, file: Path) -> tuple[CalibrationRecord, CalibrationUsed]:
    """Read the calibration that was judged, and refuse one that was replaced since its hash was taken.

    Raises
    ------
    RecordError
        As described.
    """
    in_force = read_calibration(file)
    if in_force.file_sha256 != record.calibration.sha256:
        raise RecordError(f"{file}: changed while it was read; run the command again")
    return in_force, CalibrationUsed.of(in_force, file)


def _verified_again(
    record: VerificationRecord, session: Session, calibration: Path, progress: Callable[[str], None]
) -> VerificationRecord:
    in_force, used = _judged(record, calibration)
    rig, limits = calibration_of(in_force), record.limits or DEFAULT_LIMITS
    capture = artefact_capture(session, record.capture, rig)
    if not isinstance(capture.target, Zigzag):
        other = verify_artefact(capture, rig, progress=progress)
        return artefact_record(other, session, used, command=record.command, limits=limits)
    rows, filters = tuple(round(profile.row_px) for profile in record.profiles), bool(record.filters)
    bars = verify(session, capture.name, rig, rows_px=rows, with_filters=filters, progress=progress)
    return verification_record(bars, session, used, command=record.command, limits=limits)


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


def _comparable(one: Record, *, exclude_unset: bool = False) -> dict[str, Any]:
    """Give what is compared: all but the making, the place of files, and how En is formed; checks by their names."""
    left_out: Any = dict.fromkeys((*_OF_THE_MAKING, "en_definition"), True)
    if not isinstance(one, CalibrationRecord):
        left_out["calibration"] = {_PLACE_OF_CALIBRATION}
    document = one.model_dump(mode="json", exclude=left_out, exclude_unset=exclude_unset)
    document["checks"] = {check.pop("name"): check for check in document.get("checks", ())}
    absent = {name for name in _SILENT if document.get(name) in (None, [])}
    return {name: value for name, value in document.items() if name not in absent}
