"""What can be wrong between the statements of a session: each rule is one function.

Rules about the pictures themselves are in `fringecal.session.pictures.picture_rules`.
"""

from collections import Counter, defaultdict
from collections.abc import Iterator, Sequence

from fringecal.session.document import FILE_NAME, SessionDocument
from fringecal.session.draft import Draft
from fringecal.session.faults import Fault, joined
from fringecal.session.fringes.fringe_axes import along, number_of_sets

_TARGETS_OF = {
    "grid": frozenset({"line-grid", "chessboard", "charuco", "dots"}),
    "board": frozenset({"chessboard", "charuco", "dots", "line-grid"}),
    "reference": frozenset({"flat"}),
    "strips": frozenset({"strips"}),
    "artefact": frozenset({"zigzag", "steps", "wedge", "box", "sphere", "ball-bar", "strips", "flat"}),
}
_USED_BY_CHOICE = frozenset({"strips", "artefact"})
_NEEDS_TARGET = frozenset({"grid", "board", "strips", "artefact"})
_SAME_STEP_DIGITS = 6  # of a degree: far below any step that a rig can make


def header_faults(document: SessionDocument) -> Iterator[Fault]:
    """See that the common steps give a phase."""
    if document.phase is not None:
        yield from step_faults(document.phase.steps_deg, f"{FILE_NAME}: phase.steps_deg")


def steps_stated_faults(draft: Draft, *, is_phase_sound: bool) -> Iterator[Fault]:
    """See that a phase-shifted capture has steps, and that its own, if any, give a phase."""
    where = f"{draft.label}: steps_deg"
    if draft.table.steps_deg is not None:
        yield from step_faults(draft.table.steps_deg, where)
    elif draft.steps_deg is None and is_phase_sound and not draft.broken & {"kind", "steps_deg"}:
        remedy = "write [phase] steps_deg = [0.0, 120.0, 240.0], or steps_deg = [] for pictures without"
        yield Fault(where, "no phase shifts are stated", remedy)


def step_faults(steps_deg: Sequence[float], where: str) -> Iterator[Fault]:
    """Refuse steps from which no phase can be computed; an empty list means no phase shifting."""
    distinct = {_modulo_turn(step) for step in steps_deg}
    if 0 < len(distinct) < 3:
        yield Fault(
            where,
            f"{len(distinct)} distinct phase shift(s) modulo 360 deg in {list(steps_deg)}, needed 3 or more",
            "state the phase shifts that were used, or steps_deg = [] for pictures without phase shifting",
        )
    twice = [step for step, n in Counter(steps_deg).items() if n > 1]
    if twice:
        yield Fault(
            where, f"the phase shift {joined(twice)} deg is listed more than once", "state each phase shift once"
        )


def _modulo_turn(step_deg: float) -> float:
    return round(step_deg % 360.0, _SAME_STEP_DIGITS) % 360.0


def turn_notes(steps_deg: Sequence[float], where: str) -> Iterator[str]:
    """Remark on steps a whole turn apart: right for a five-frame scheme, a slip elsewhere."""
    by_turn: dict[float, list[float]] = defaultdict(list)
    for step in dict.fromkeys(steps_deg):
        by_turn[_modulo_turn(step)].append(step)
    for equal in by_turn.values():
        if len(equal) > 1:
            yield f"{where}: the phase shifts {joined(equal)} deg are equal modulo 360 deg"


def step_notes(draft: Draft, phase_deg: Sequence[float] | None) -> Iterator[str]:
    """Remark on a capture's own steps."""
    own = draft.table.steps_deg
    if own is None:
        return
    yield from turn_notes(own, f"{draft.label}: steps_deg")
    if own and own == phase_deg:
        yield f"{draft.label}: steps_deg repeats that of [phase]; one of them is enough"


def count_faults(draft: Draft) -> Iterator[Fault]:
    """Compare the number of images with steps x periods x repeat."""
    if draft.broken & {"images", "periods", "fringes", "axes", "repeat"}:
        return
    if not draft.table.images and draft.table.maps is None:
        yield Fault(f"{draft.label}: images", "no images", "list at least one file")
    elif not draft.table.images:
        return
    elif draft.steps_deg is not None and draft.has_all_files:
        yield from _count_faults(draft, len(draft.steps_deg))


def _count_faults(draft: Draft, n_steps: int) -> Iterator[Fault]:
    found, n_sets, repeat = len(draft.files), number_of_sets(draft.table), draft.table.repeat
    group = max(1, n_steps) * n_sets
    needed = group * repeat
    # Without phase shifting any number of pictures per repeat will do.
    if found == needed or (n_steps == 0 and found % needed == 0):
        return
    yield Fault(
        f"{draft.label}: images",
        f"{found} images, needed {needed}: {n_steps or 1} phase shift(s) x {n_sets} {_sets_of(draft)}, "
        f"{repeat} time(s)",
        (f"state repeat = {found // group} if the set was repeated, or " if found % group == 0 else "")
        + "correct the list of images or the steps",
    )


def _sets_of(draft: Draft) -> str:
    """Say what one phase-shifted set is taken for each of."""
    return "period(s)" if draft.table.axes is None else f"period(s) along {' and '.join(draft.table.axes)}"


def target_faults(draft: Draft) -> Iterator[Fault]:
    """See that a capture has the target that its kind needs, and none that it cannot have."""
    if draft.broken & {"kind", "target"}:
        return
    kind, where = draft.table.kind, f"{draft.label}: target"
    wanted = _TARGETS_OF.get(kind, frozenset())
    kinds = joined(sorted(wanted), at_most=len(wanted))
    if draft.table.target is None and kind in _NEEDS_TARGET:
        yield Fault(where, f'a capture of kind "{kind}" without a target', f"name one of kind {kinds}")
    if draft.target is not None and wanted and draft.target.kind not in wanted:
        found = f'"{draft.table.target}" is of kind {draft.target.kind}, but the capture of kind {kind}'
        yield Fault(where, found, f"name a target of kind {kinds}, or correct the capture's kind")


def use_faults(draft: Draft) -> Iterator[Fault]:
    """See that only an artefact says what it is used for: what other captures are for is their kind."""
    if draft.broken & {"kind", "use"} or draft.table.use is None or draft.table.kind in _USED_BY_CHOICE:
        return
    found = f'use = "{draft.table.use}" in a capture of kind {draft.table.kind}'
    yield Fault(f"{draft.label}: use", found, f"leave it out; only {joined(sorted(_USED_BY_CHOICE))} have a choice")


def period_faults(draft: Draft) -> Iterator[Fault]:
    """Refuse two equal fringe periods: the second tells nothing new."""
    for key in ("periods", "fringes"):
        for name in draft.table.axes or ["u"]:
            stated: list[float] = along(getattr(draft.table, key), name)
            if len(set(stated)) < len(stated):
                yield Fault(f"{draft.label}: {key}", f"equal {key} in {stated}", "state each once; use repeat")
                break


def name_faults(drafts: Sequence[Draft]) -> Iterator[Fault]:
    """Refuse two captures of one name."""
    places: dict[str, list[int]] = defaultdict(list)
    for k, draft in enumerate(drafts):
        if "name" not in draft.broken:
            places[draft.table.name].append(k + 1)
    for name, numbers in places.items():
        if len(numbers) > 1:
            found = f"captures {joined(numbers)} have this name"
            yield Fault(f'capture "{name}"', found, "give each capture a name of its own")
