"""A calibration report from records: their numbers, what the laboratory states, and nothing that neither says."""

import datetime
from collections.abc import Iterator, Sequence

from fringecal.errors import RecordError
from fringecal.records import (
    BoardCalibrationRecord,
    CalibrationRecord,
    Certificate,
    Check,
    Decision,
    Laboratory,
    Method,
    Statement,
    UsedStandard,
    VerificationRecord,
    impossible_in,
    missing_in,
)
from fringecal.uncertainty import COVERAGE
from fringecal.workflows.certificate.results import conformity_of, errors_of, groups_of
from fringecal.workflows.shared import severest

_NORM = "ISO/IEC 17025:2017"
_COMMISSIONING = {
    False: "Grid paper, bare plate and strips are photographed; camera, phase in space and heights of the strips are "
    "fitted jointly (fringecal, procedure 'commissioning').",
    True: "A board is photographed in several poses under fringes along the projector's axes; camera, projector as an "
    "inverse camera, poses and the board's form are fitted jointly (fringecal, docs/board-rigs.md).",
}
_NOT_CALIBRATED = "not calibrated"  # what the certificate of an artefact says that has none


def certificate_of(
    record: CalibrationRecord | BoardCalibrationRecord,
    sha256: str,
    lab: Laboratory,
    *,
    verification: VerificationRecord | None = None,
    draft: bool = False,
) -> Certificate:
    """Gather a calibration report.

    Parameters
    ----------
    record, sha256
        The calibration, and the hash of its file.
    lab
        What the laboratory states.
    verification
        Errors against an artefact, measured with this very calibration.
    draft
        Let pass what the laboratory does not state; the report then calls itself a draft.

    Raises
    ------
    RecordError
        Something that a report needs is not stated, all of it named; or the verification belongs to another
        calibration or rig; or one of both was edited after it was written.
    """
    record.demand_unedited("calibration")
    if verification is not None:
        verification.demand_unedited("verification")
    missing = missing_in(lab, temperature_stated=record.session.temperature_degC is not None)
    if missing and not draft:
        needed = "\n  ".join(missing)
        raise RecordError(
            f"what a calibration report needs is not stated\n  {needed}\n"
            "state it in the laboratory's file, --lab lab.toml (`fringecal certificate --template lab.toml` writes one "
            "to fill in), or ask for a --draft"
        )
    _demand_same(record, sha256, verification)
    checks = (*record.checks, *(verification.checks if verification else ()))
    day = (record.session.captured or record.created).date()
    _demand_possible(record, lab, day)
    standards = tuple(_standards(record, lab, verification))
    return Certificate(
        lab=lab,
        missing=missing,
        begin=lab.report.begin or day,
        end=lab.report.end or day,
        temperature_degC=_temperature(record, lab),
        humidity_percent=_ends(lab.conditions.humidity_percent),
        groups=(*groups_of(record), *errors_of(verification)),
        conformities=tuple(conformity_of(check) for check in checks if check.value is not None),
        decision=_decision(record, checks, verification),
        methods=_methods(record, verification),
        standards=standards,
        statements=(*_statements(lab, standards, missing), *_unseen(record, verification)),
        software=record.software,
        record_sha256=sha256,
    )


def _decision(
    record: CalibrationRecord | BoardCalibrationRecord, checks: Sequence[Check], verification: VerificationRecord | None
) -> Decision:
    """Return the severest outcome; no pass where nothing says what a wrong statement could do unseen."""
    found = severest(checks)
    if isinstance(record, BoardCalibrationRecord):
        proved = _measures_a_length(verification)
    else:
        proved = record.unseen is not None
    return "conditionalPass" if found == "pass" and not proved else found


def _measures_a_length(verification: VerificationRecord | None) -> bool:
    """Tell whether an artefact's certified length was measured: it alone shows a board whose print is of another scale.

    Flatness and bows are certified as 0, which any scale leaves.
    """
    readings = () if verification is None else verification.readings
    return any(one.unit == "mm" and one.en is not None and bool(one.reference) for one in readings)


def _demand_possible(record: CalibrationRecord | BoardCalibrationRecord, lab: Laboratory, day: datetime.date) -> None:
    """Refuse days and conditions that cannot be, in a draft as well: who reads one must not find them.

    Raises
    ------
    RecordError
        All of them named, each with the reason.
    """
    facts = lab.report
    taken = record.session.temperature_degC
    if lab.conditions.temperature_degC is None and taken is not None:
        lab = lab.model_copy(update={"conditions": lab.conditions.model_copy(update={"temperature_degC": (taken,)})})
    wrong = list(impossible_in(lab, begin=facts.begin or day, end=facts.end or day))
    if record.session.captured is not None and facts.begin is not None and facts.begin > day:
        wrong.append(f"report.begin: the work cannot begin on {facts.begin}, after the pictures were taken on {day}")
    if record.session.captured is not None and facts.end is not None and facts.end < day:
        wrong.append(f"report.end: the work cannot end on {facts.end}, before the pictures were taken on {day}")
    if wrong:
        raise RecordError("the laboratory's file states what cannot be\n  " + "\n  ".join(wrong))


def _demand_same(
    record: CalibrationRecord | BoardCalibrationRecord, sha256: str, verification: VerificationRecord | None
) -> None:
    if verification is None:
        return
    if verification.calibration.sha256 != sha256:
        raise RecordError(
            "the verification was made with another calibration (SHA-256 "
            f"{verification.calibration.sha256[:12]}..., this one is {sha256[:12]}...); verify with this one"
        )
    if verification.session.rig != record.session.rig:
        raise RecordError(
            f"the verification is of rig {verification.session.rig!r}, the calibration of {record.session.rig!r}"
        )


def _ends(values: Sequence[float] | None) -> tuple[float, float] | None:
    return None if values is None else (min(values), max(values))


def _temperature(record: CalibrationRecord | BoardCalibrationRecord, lab: Laboratory) -> tuple[float, float] | None:
    stated = lab.conditions.temperature_degC
    measured = record.session.temperature_degC
    return _ends(stated) if stated is not None else _ends(None if measured is None else (measured,))


# ---- how, against what, and what the reader must know ---------------------------------------------
def _methods(
    record: CalibrationRecord | BoardCalibrationRecord, verification: VerificationRecord | None
) -> tuple[Method, ...]:
    level = COVERAGE if record.limits is None else record.limits.level
    older = any(one is not None and one.en_definition is None for one in (record, verification))
    return (
        Method("Commissioning of a fringe-projection rig", _COMMISSIONING[isinstance(record, BoardCalibrationRecord)]),
        Method(
            "Expanded uncertainty",
            "Stated is the standard uncertainty times the coverage factor k given with it, for a coverage probability "
            "of 95 %; propagated from the covariance of the fit and the stated uncertainties of the artefacts. k is "
            "Student's t for the effective degrees of freedom, 1.96 where these are infinite.",
            ("JCGM 100:2008",),
            "basic_uncertainty",
        ),
        Method(
            "En",
            "En stands in a record of an older version, and is formed as the rule beside it says."
            if older
            else "En = difference / root sum of squares of both expanded uncertainties, formed as above.",
            () if older else ("ISO 13528:2022", "ISO/IEC 17043:2023"),
        ),
        Method(
            "Decision rule",
            f"A value conforms if it is within its limit with a probability of at least {100 * level:g} % (pass), "
            "conditionally if it is within it with a smaller one; beyond it likewise. En numbers are held against "
            "their limit without a further guard band. The limits are the laboratory's (limits.toml).",
            ("JCGM 106:2012",),
            "basic_conformity",
        ),
    )


def _unseen(
    record: CalibrationRecord | BoardCalibrationRecord, verification: VerificationRecord | None
) -> Iterator[Statement]:
    """State what of the statements on which heights rest was not proved."""
    if isinstance(record, BoardCalibrationRecord):
        if not _measures_a_length(verification):
            yield Statement(
                "Conformity is conditional: nothing shows whether the squares of the board are as large as stated, and "
                "all lengths are in proportion to them; verify on a sphere, a ball bar or a block of steps."
            )
        return
    if record.unseen is None:
        yield Statement(
            "The record is of an older version and does not say which errors of what was stated (heights of artefacts, "
            "pitch, camera) the session would have shown: conformity is conditional at best."
        )
        return
    for one in record.unseen:
        if one.heights_rest_on_it and one.height_percent > one.limit_percent:
            yield Statement(
                f"Conformity is conditional: nothing in the session shows whether the {one.name} is as stated to "
                f"better than {one.height_percent:.2g} % of heights (limit {one.limit_percent:g} %)."
            )


def _standards(
    record: CalibrationRecord | BoardCalibrationRecord, lab: Laboratory, verification: VerificationRecord | None
) -> Iterator[UsedStandard]:
    used = dict(record.targets)
    if verification is not None:
        used.setdefault(str(verification.target.get("name", verification.capture)), verification.target)
    stated = {standard.target: standard for standard in lab.standard}
    strange = [name for name in stated if name not in used]
    if strange:
        raise RecordError(
            f"standard {', '.join(map(repr, strange))} took no part; the calibration used {', '.join(map(repr, used))}"
        )
    for name, target in used.items():
        own = stated.get(name)
        certificate = own.certificate if own is not None and own.certificate else str(target.get("certificate", ""))
        yield UsedStandard(name, certificate or "no certificate stated", own.identification if own else "")


def _statements(lab: Laboratory, standards: Sequence[UsedStandard], missing: Sequence[str]) -> Iterator[Statement]:
    if missing:
        keys = ", ".join(text.partition(":")[0] for text in missing)
        yield Statement(f"DRAFT, not a calibration report: not stated are {keys}.")
    signing = " and ".join(p.name for p in lab.person if p.signs) or "nobody yet"
    yield Statement(
        f"This file carries no electronic signature. It counts when signed by who authorises it: {signing}.",
        _NORM,
        "7.8.2.1 o",
    )
    yield Statement("The results relate only to the item calibrated, in its condition then.", _NORM, "7.8.2.1 l")
    yield Statement("This report may be reproduced in full only, but for written consent.", _NORM, "7.8.2.1")
    yield Statement(
        "This is a calibration report of the laboratory named, not of an accreditation body; no interval of "
        "recalibration is recommended.",
        _NORM,
        "7.8.4.3",
    )
    uncalibrated = [s.name for s in standards if _NOT_CALIBRATED in s.certificate or s.certificate.startswith("no ")]
    if uncalibrated:
        yield Statement(
            f"The results are not shown to be traceable to the SI; not calibrated: {', '.join(uncalibrated)}.",
            _NORM,
            "7.8.4.1 c",
        )
    else:
        yield Statement(
            "Traceability rests on the certificates of the artefacts listed as measuring equipment.",
            _NORM,
            "7.8.4.1 c",
        )
