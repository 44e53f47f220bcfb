"""What an audit's failed checks mean for who wants to measure: said before anything else."""

from collections.abc import Iterable, Sequence

from fringecal.records import Check
from fringecal.uncertainty import value_text

_NAMED = 3  # failed checks that the sentence names: the table holds all
_HEIGHTS, _LENGTHS, _CHANGE = "change of height scale", "change of scale", "change of "


def consequence_sentence(checks: Sequence[Check]) -> str:
    """Say by how much what is measured would be wrong and what to do; nothing where every check is passed.

    Parameters
    ----------
    checks
        All of an audit.

    Examples
    --------
    >>> scale = Check(name="change of height scale, on the strips", value=0.41, limit=0.3, u=0.02, unit="%",
    ...               decision="fail")
    >>> consequence_sentence([scale])
    'Heights +0.410 % wrong, limit 0.3 %: do not measure with this calibration.'
    """
    failed = _worst_first(check for check in checks if check.decision == "fail")
    if failed:
        return f"{_listed(failed)}: do not measure with this calibration."
    doubtful = _worst_first(check for check in checks if check.decision == "conditionalFail")
    if doubtful:
        return f"Not proved to be within limits: {_listed(doubtful)}; audit again or calibrate before you measure."
    return ""


def _worst_first(checks: Iterable[Check]) -> list[Check]:
    """Heights first, then lengths, then what is furthest beyond its limit."""
    return sorted(checks, key=lambda check: (_rank(check), -_share(check)))


def _rank(check: Check) -> int:
    return 0 if check.name.startswith(_HEIGHTS) else 1 if check.name == _LENGTHS else 2


def _share(check: Check) -> float:
    return abs(check.value or 0.0) / check.limit if check.limit else 0.0


def _listed(checks: Sequence[Check]) -> str:
    named = "; ".join(map(_words, checks[:_NAMED]))
    return named + (f"; and {len(checks) - _NAMED} more" if len(checks) > _NAMED else "")


def _words(check: Check) -> str:
    """Say one check that was not passed: what is wrong, by how much, and how much it may be."""
    if check.value is None or check.limit is None:
        return check.name
    unit = f" {check.unit}" if check.unit else ""
    number, limit = value_text(check.value, check.u, sign=True, otherwise=".3g"), f"limit {check.limit:g}{unit}"
    if check.name.startswith(_HEIGHTS):
        return f"Heights {number}{unit} wrong, {limit}"
    if check.name == _LENGTHS:
        return f"Lengths along the plate {number}{unit} wrong, {limit}"
    score = "En " if check.score == "En" else ""
    return f"{check.name.removeprefix(_CHANGE)} {score}{number}{unit}, {limit}"
