"""Two records side by side: each number against its own uncertainty where it states one, else to rounding."""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np

from fringecal.records import PackedArray, unpacked

PART_OF_U = 0.01  # a number that differs by less than this of its standard uncertainty is the same number
ROUNDING = 1e-6  # of a u, a covariance or a number without u: threads and other kernels of one processor change 2e-10
LEAST = 1e-12  # mm, px, deg, rad, of a share or probability: what is left where numbers of about 1 cancel

Rule = Literal["u", "rounding", "exact", "text", "structure"]

_U_OF = {
    "value": "u",
    "angle_deg": "u_deg",
    "difference_deg": "u_deg",
    "mean_mm": "u_mm",
    "measured": "u_measured",
    "error": "u_measured",
    "projector_mm": "projector_u_mm",
    "estimated_rad": "u_rad",
    "ratios_real": "u",
    "ratios_imaginary": "u",
    "exponent": "u_exponent",
    "harmonic": "u_harmonic",
}
_COVARIANCE, _CROSS, _MODES = "covariance", "cross_covariance", "modes"
_PARAMETERS, _BUDGETS, _CAUSES = "parameters", "budgets", "causes_mm"
_OF_WHOLE = {"en": 1.0, "percent": 100.0}  # a score is about 1, a share is one of 100 %
_STATED = {"limits", "targets", "target", "image", "session", "inputs"}  # as it was given, not computed
# What explains in words what stands in numbers beside it: listed where it differs, and no result.
_PROSE = {"sentence", "sentences", "notes", "rule", "reason", "what", "how_large", "remedy", "undone"}
_FREE = {"budgets", "targets", "target", "causes_mm"}  # tables whose keys no format lists
_PACKED = {"shape", "step", "data"}


@dataclass(frozen=True)
class Difference:
    """One place in which two records differ, by the rule that it was compared by.

    Parameters
    ----------
    place
        Keys and numbers in lists, from the top.
    then, now
        What stands there in either.
    part_of_u
        The difference as a part of the standard uncertainty that stands beside `then`, if one does.
    defined
        Whether another definition of En alone explains it: what En is formed from is compared for itself.
    rule
        ``"u"``; ``"rounding"``: `ROUNDING` of the number or of what it is a part of (the u of parameters for their
        covariance, the largest row of a budget); ``"exact"`` for counts and what was stated; ``"text"`` for what
        explains; ``"structure"`` for everything else that is no number.
    beyond
        Whether it is more than its rule allows.
    """

    place: str
    then: object
    now: object
    part_of_u: float | None = None
    defined: bool = False
    rule: Rule = "structure"
    beyond: bool = True

    @property
    def matters(self) -> bool:
        """Whether a result differs: a number by more than its rule allows, a verdict, a name, or the structure."""
        return self.beyond and not self.defined


@dataclass(frozen=True)
class Yardstick:
    """By what a number is compared, or each number of a list: its u, or the size that rounding is a part of."""

    sizes: Any = None
    of_u: bool = False
    exact: bool = False

    def at(self, number: int) -> "Yardstick":
        """Return that of one number of the list."""
        if not _is_list(self.sizes):
            return replace(self, sizes=None if self.of_u else self.sizes)
        return replace(self, sizes=self.sizes[number] if number < len(self.sizes) else None)

    @property
    def size(self) -> float:
        """The size; zero where none is known."""
        return float(self.sizes) if _is_number(self.sizes) else 0.0


_ROUNDING_ALONE = Yardstick()


def differences(then: Any, now: Any) -> Iterator[Difference]:
    """Walk through two documents side by side and give every place in which they differ.

    A number is compared with its u where `then` states one (also as a covariance's diagonal), and counts as another
    from `PART_OF_U` of it. Any other number, each u and each number of a covariance is compared to `ROUNDING`, so that
    a u that was made larger cannot hide what it belongs to; counts, and what was stated, digit by digit. Components of
    one source are compared by the covariance that they make together: which way each points is open.

    Examples
    --------
    >>> (found,) = differences({"scale": {"value": 1.0, "u": 0.1}}, {"scale": {"value": 1.05, "u": 0.1}})
    >>> found.place, found.rule, round(found.part_of_u, 3), found.matters
    ('scale.value', 'u', 0.5, True)
    >>> [(d.place, d.rule, d.matters) for d in differences({"u": 0.1, "n": 1.0}, {"u": 0.2, "n": 1.0 + 1e-9})]
    [('u', 'rounding', True), ('n', 'rounding', False)]
    """
    yield from _walk(then, now, "", _ROUNDING_ALONE)


def stated_alone(now: Any, then: Any, place: str = "") -> tuple[Any, list[str]]:
    """Take from `now` what `then` does not state at all, and give the places of what was taken and holds something.

    A record of an older version lacks keys that were added since; a key that is there is compared, null or not.
    """
    if isinstance(now, Mapping) and isinstance(then, Mapping):
        kept, taken = {}, []
        for name, value in now.items():
            inside = f"{place}.{name}" if place else str(name)
            if name in then:
                free = name in _FREE
                kept[name], more = (value, []) if free else stated_alone(value, then[name], inside)
                taken += more
            elif value not in (None, [], {}, ""):
                taken.append(inside)
        return kept, taken
    if _is_list(now) and _is_list(then) and len(now) == len(then):
        pairs = [stated_alone(a, b, f"{place}[{n}]") for n, (a, b) in enumerate(zip(now, then, strict=True))]
        return [kept for kept, _ in pairs], [name for _, more in pairs for name in more]
    return now, []


def _walk(then: Any, now: Any, place: str, by: Yardstick) -> Iterator[Difference]:
    name = place.rpartition(".")[2].partition("[")[0]
    if isinstance(then, Mapping) and isinstance(now, Mapping):
        yield from _walk_table(then, now, place, by)
    elif name in _PROSE and not isinstance(then, bool):
        if then != now:
            yield Difference(place, then, now, rule="text", beyond=False)
    elif name == _MODES and _same_sources(then, now):
        yield from _modes(then, now, place)
    elif _is_list(then) and _is_list(now) and len(then) == len(now):
        for number, (a, b) in enumerate(zip(then, now, strict=True)):
            yield from _walk(a, b, f"{place}[{number}]", by.at(number))
    elif _is_number(then) and _is_number(now):
        if then != now:
            yield _numbers(place, then, now, by)
    elif then != now:
        yield Difference(place, then, now)


def _walk_table(then: Mapping[str, Any], now: Mapping[str, Any], place: str, by: Yardstick) -> Iterator[Difference]:
    if then.keys() == now.keys() == _PACKED:
        yield from _arrays(then, now, place)
        return
    for name in dict.fromkeys((*then, *now)):
        inside = f"{place}.{name}" if place else str(name)
        inner = by if by.exact or by.size else _yardstick(name, then)
        yield from _walk(then.get(name), now.get(name), inside, inner)


def _numbers(place: str, then: float, now: float, by: Yardstick) -> Difference:
    apart = abs(float(now) - float(then))
    if by.of_u and by.size > 0:
        part = apart / by.size
        return Difference(place, then, now, part, rule="u", beyond=part > PART_OF_U)
    if by.exact or (isinstance(then, int) and isinstance(now, int)):
        return Difference(place, then, now, rule="exact")
    allowed = ROUNDING * max(abs(then), abs(now), by.size) + (0.0 if by.size > 0 else LEAST)
    return Difference(place, then, now, rule="rounding", beyond=apart > allowed)


def _arrays(then: Mapping[str, Any], now: Mapping[str, Any], place: str) -> Iterator[Difference]:
    """Compare two packed arrays, which are rounded to a step: a number may come out on either side of a half."""
    if then == now:
        return
    if (then["shape"], then["step"]) != (now["shape"], now["step"]):
        yield Difference(place, then["shape"], now["shape"])
        return
    a, b = (unpacked(PackedArray.model_validate(dict(one))) for one in (then, now))
    known = np.isfinite(a) & np.isfinite(b)
    apart = float(np.abs(a - b, where=known, out=np.zeros(a.shape)).max(initial=0.0))
    other = int(np.count_nonzero(np.isfinite(a) != np.isfinite(b)))
    if apart > 0 or other > 0:
        beyond = apart > 1.5 * then["step"] or other > 0
        words = f"up to {apart:.3g} apart, {other} value(s) in one alone"
        yield Difference(f"{place}.data", "an array", words, rule="rounding", beyond=beyond)


def _yardstick(name: str, then: Mapping[str, Any]) -> Yardstick:
    """Return by what the number, list or table `name` is compared, from what stands beside it in the record."""
    if name in _STATED:
        return Yardstick(exact=True)
    if name == _COVARIANCE:
        u = _deviations(then.get(name))
        return Yardstick(np.outer(u, u).tolist()) if u else _ROUNDING_ALONE
    if name == _CROSS:
        return Yardstick(_of_cross(then.get(name), then.get(_MODES)))
    if name == _CAUSES:
        return Yardstick(max(then[name].values(), default=None))
    if name in _OF_WHOLE:
        return Yardstick(_OF_WHOLE[name])
    return Yardstick(_deviations(then.get(_COVARIANCE)) if name == _PARAMETERS else then.get(_U_OF.get(name, "")), True)


def _deviations(covariance: Any) -> list[float] | None:
    if not _is_list(covariance):
        return None
    return [math.sqrt(max(row[number], 0.0)) for number, row in enumerate(covariance)]


def _of_cross(cross: Any, modes: Any) -> list[list[float]] | None:
    """Return the sizes of a covariance between rig (rows) and camera (columns): both parameters' u, by the modes."""
    if not (cross and modes):
        return None
    u, columns = np.sqrt(np.diag(_covariance_of(modes))), len(cross[0])
    sizes: list[list[float]] = np.outer(u[columns : columns + len(cross)], u[:columns]).tolist()
    return sizes


def _covariance_of(modes: Any) -> Any:
    """Sum effect times effect transposed."""
    effects = np.array([mode["effect"] for mode in modes], dtype=float)
    return effects.T @ effects


def _same_sources(then: Any, now: Any) -> bool:
    """Whether two lists of modes name the same sources as often, each with as many effects."""
    both = [[(mode["label"], len(mode["effect"])) for mode in one] for one in (then, now) if _is_list(one)]
    return len(both) == 2 and bool(both[0]) and sorted(both[0]) == sorted(both[1])


def _modes(then: Any, now: Any, place: str) -> Iterator[Difference]:
    """Compare components by source: the covariance that all of one source make, and their degrees of freedom.

    Several components of one source are the principal axes of its covariance; where two are equally long, rounding
    decides which way they point, and nothing that is computed from a calibration depends on it.
    """
    u = np.sqrt(np.diag(_covariance_of(then)))
    sizes = np.outer(u, u)
    for label in dict.fromkeys(mode["label"] for mode in then):
        a, b = ([mode for mode in one if mode["label"] == label] for one in (then, now))
        where = f"{place}[{label!r}]"
        covariances = [_covariance_of(one) for one in (a, b)]
        if [mode["effect"] for mode in a] != [mode["effect"] for mode in b]:
            apart = np.divide(np.abs(covariances[1] - covariances[0]), sizes, where=sizes > 0, out=np.zeros_like(sizes))
            worst = np.unravel_index(int(np.argmax(apart)), apart.shape)
            before, after = (float(covariance[worst]) for covariance in covariances)
            beyond = bool(apart[worst] > ROUNDING or (covariances[1][sizes == 0] != 0).any())
            yield Difference(f"{where}.covariance", before, after, rule="rounding", beyond=beyond)
        yield from _walk(
            [mode.get("dof") for mode in a], [mode.get("dof") for mode in b], f"{where}.dof", _ROUNDING_ALONE
        )


def _is_number(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)


def _is_list(value: object) -> bool:
    return isinstance(value, Sequence) and not isinstance(value, str)
