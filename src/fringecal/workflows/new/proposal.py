"""What a folder's pictures are, as far as looking tells, and what has to be asked."""

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from fringecal.detect import board_in
from fringecal.errors import SessionError, TargetError
from fringecal.targets import list_targets, read_target
from fringecal.workflows.new.fringe_structure import LIGHTS, FringeSet, Light, fringe_set, off_a_plane, period_ratios
from fringecal.workflows.new.picture_series import Series
from fringecal.workflows.new.still_content import StillContent, content_of

KINDS = ("grid", "board", "reference", "strips", "artefact", "object")
_BARE_SHARE = 0.02  # of the pixels off a smooth phase up to which a plate is bare
_LEAST_FRAMES = 3  # of a phase-shifted series
_MOST_LOOKED_AT = 5  # pictures of a series in which boards are sought
_NAMES = {
    "reference": ("reference", "plate", "plane", "ref", "bare"),
    "strips": ("strip", "glass"),
    "artefact": ("bar", "block", "step", "box", "wedge", "zig", "ball", "sphere", "flat", "rect", "artefact"),
    "board": ("board", "chess", "charuco", "pose", "aruco", "calib"),
    "grid": ("grid", "paper", "ruling", "dots"),
    "object": ("object", "leaf", "part", "scan", "face"),
}
"""Parts of names that people give; they decide where looking leaves several kinds."""
_TARGETS = {
    "grid": ("line-grid", "chessboard", "charuco", "dots"),
    "board": ("chessboard", "charuco", "dots"),
    "strips": ("strips",),
    "artefact": ("zigzag", "steps", "box", "wedge", "flat", "sphere", "ball-bar"),
}
"""Kinds of target that each kind of capture may show."""


@dataclass(frozen=True)
class Proposal:
    """One capture as it would be written.

    Parameters
    ----------
    name, kind
        Of the capture; the kind is None where neither looking nor the name tells it.
    seen
        What was seen, in words.
    table
        Keys of the capture but for name, kind and target.
    target
        Name or path of its target, None where not known.
    target_kinds
        Kinds of target that it may have.
    asks
        What cannot be known from the pictures: the option that states it, and why.
    """

    name: str
    kind: str | None
    seen: str
    table: Mapping[str, Any]
    target: str | None = None
    target_kinds: tuple[str, ...] = ()
    asks: tuple[tuple[str, str], ...] = ()


@dataclass(frozen=True)
class Stated:
    """What a person said of the captures, by their names; "*" stands for all, of targets and periods."""

    kinds: Mapping[str, str] = field(default_factory=dict)
    targets: Mapping[str, str] = field(default_factory=dict)
    periods: Mapping[str, Sequence[float]] = field(default_factory=dict)
    patterns: str | None = None
    without: frozenset[str] = frozenset()


def looked_at(series: Sequence[Series], tell: Callable[[str], None] = lambda _: None) -> list[Proposal]:
    """Say what all series show, as far as looking and their names tell.

    Parameters
    ----------
    series
        Pictures of a folder.
    tell
        Called with what is being looked at.
    """
    found = []
    for one in series:
        tell(f"looking at {one.name}")
        images = [still.grey for still in one.stills]
        alike = len({image.shape for image in images}) == 1
        fringes = fringe_set(np.stack(images), _lights_named(one)) if len(images) >= _LEAST_FRAMES and alike else None
        found.append(_of_fringes(one, fringes) if fringes is not None else _of_stills(one))
    return found


def decided(found: Sequence[Proposal], folder: Path, stated: Stated) -> list[Proposal]:
    """Add what a person stated and what targets lie in the folder, and what is still to be asked.

    Parameters
    ----------
    found
        What looking told.
    folder
        Where targets are sought.
    stated
        What a person said.

    Raises
    ------
    SessionError
        Something is stated of a capture that there is not, or a kind that is none.
    """
    _demand_known(found, stated)
    kept = [replace(one, kind=stated.kinds.get(one.name, one.kind)) for one in found if one.name not in stated.without]
    targets = _targets_in(folder)
    return [_asked(_with_target(one, targets, stated), stated) for one in _one_reference(kept, stated)]


def _said[T](of: Mapping[str, T], name: str) -> T | None:
    """Return what is stated of one capture, or of all."""
    return of.get(name, of.get("*"))


def _demand_known(found: Sequence[Proposal], stated: Stated) -> None:
    """Refuse what is stated of nothing."""
    names = {one.name for one in found}
    said = {*stated.kinds, *stated.targets, *stated.periods, *stated.without} - {"*"}
    faults = [
        f"{name}: there is no such series of pictures; there are {', '.join(sorted(names))}" for name in said - names
    ]
    faults += [
        f"{name}: {kind!r} is no kind of capture; {', '.join(KINDS)}"
        for name, kind in stated.kinds.items()
        if kind not in KINDS
    ]
    if faults:
        raise SessionError(faults)


def _lights_named(one: Series) -> dict[int, Light]:
    """Return the pictures whose names say how the projector lit them."""
    words = [re.split(r"[^a-z]+", Path(file).stem.lower().replace("grey", "gray")) for file in one.files]
    return {place: light for place, said in enumerate(words) for light in LIGHTS if light in said}


def _of_fringes(one: Series, found: FringeSet) -> Proposal:
    """Describe a phase-shifted series."""
    board, number = board_in(found.background), len(found.blocks)
    seen = f"{len(found.steps_deg)} phase shifts" + (f", {number} sets" if number > 1 else "")
    kind: str | None
    if board is not None:
        kind, seen = "board", f"{seen} on {_a(board.kind)}: {board.words}"
    elif off_a_plane(found) < _BARE_SHARE:
        kind, seen = "reference", f"{seen}; the phase is smooth all over: a bare plate"
    else:
        kind = _named(one.name, ("strips", "artefact", "object", "board"))
        seen = f"{seen}; the phase breaks or bends: something stands there"
    table = {"images": _files(one, found.frames), "steps_deg": list(found.steps_deg)} | _lights(one, found)
    table |= _periods(found)
    return Proposal(one.name, kind, seen, table, target_kinds=(board.kind,) if board is not None else ())


def _files(one: Series, places: Sequence[int]) -> list[str]:
    return [one.files[k] for k in places]


def _lights(one: Series, found: FringeSet) -> dict[str, Any]:
    """Name the pictures that are not phase-shifted."""
    lights = {"gray": found.gray, "white": found.white, "black": found.black}
    return {key: _files(one, places) for key, places in lights.items() if places}


def _periods(found: FringeSet) -> dict[str, Any]:
    """State axes and the ratios of periods of several sets, as far as they can be seen."""
    if len(found.blocks) == 1:
        return {}
    axes = tuple(dict.fromkeys(found.axes))
    ratios = period_ratios(found)
    if len(axes) == 1:
        return {"periods": [round(float(each), 4) for each in ratios]}
    return {"axes": list(axes)}


def _of_stills(one: Series) -> Proposal:
    """Describe pictures that are not phase-shifted."""
    looks = [content_of(still.grey) for still in one.stills[:_MOST_LOOKED_AT]]
    contents = [look.content for look in looks]
    usual = max(dict.fromkeys(contents), key=contents.count)
    words = next(look.words for look in looks if look.content == usual)
    table: dict[str, Any] = {"images": list(one.files), "steps_deg": []}
    number = len(one.stills)
    if usual in ("chessboard", "charuco", "dots") and number > 1:
        return Proposal(one.name, "board", f"{number} pictures of {_a(usual)}: {words}", table, target_kinds=(usual,))
    if usual in ("chessboard", "charuco", "dots", "line-grid"):
        kind = "board" if usual != "line-grid" and _named(one.name, ("board",)) else "grid"
        return Proposal(one.name, kind, f"{_a(usual)}: {words}", table, target_kinds=(usual,))
    return Proposal(one.name, None, _nothing(looks[0], number), table)


def _a(content: str) -> str:
    names = {"dots": "a grid of dots", "line-grid": "a line grid", "charuco": "a ChArUco board"}
    return names.get(content, f"a {content}")


def _nothing(look: StillContent, number: int) -> str:
    several = "" if number == 1 else f" in {number} pictures that no phase shifts join"
    return f"{look.words}{several}"


def _named(name: str, kinds: Sequence[str]) -> str | None:
    """Return which of some kinds a name speaks of, if any."""
    lower = name.lower()
    return next((kind for kind in kinds if any(word in lower for word in _NAMES[kind])), None)


def _one_reference(found: list[Proposal], stated: Stated) -> list[Proposal]:
    """Leave one bare plate: what is stated, what its name says, else the first; others may be flats or objects."""
    bare = [one for one in found if one.kind == "reference"]
    if len(bare) < 2:
        return found
    chosen = next((one for one in bare if stated.kinds.get(one.name) == "reference"), None)
    chosen = chosen or next((one for one in bare if _named(one.name, ("reference",))), bare[0])
    return [
        replace(one, kind=stated.kinds.get(one.name, _named(one.name, ("artefact", "object"))))
        if one.kind == "reference" and one is not chosen
        else one
        for one in found
    ]


def _targets_in(folder: Path) -> dict[str, str]:
    """Return the kind of every target file in a folder, by its path there."""
    found = {}
    for path in sorted(folder.glob("*.toml")):
        try:
            found[path.name] = str(read_target(path)[0].kind)
        except TargetError:
            continue
    return found


def _with_target(one: Proposal, targets: Mapping[str, str], stated: Stated) -> Proposal:
    """Give a capture the one target of the folder that fits, or the one that is stated."""
    if one.kind not in _TARGETS:
        return replace(one, target=stated.targets.get(one.name))
    kinds = one.target_kinds or _TARGETS[one.kind]
    fitting = [name for name, kind in targets.items() if kind in kinds]
    named = [name for name in fitting if one.name.lower() in name.lower()]
    only = (named or fitting)[0] if len(named or fitting) == 1 else None
    return replace(one, target=_said(stated.targets, one.name) or only, target_kinds=kinds)


def _asked(one: Proposal, stated: Stated) -> Proposal:
    """Add what has to be asked."""
    asks = []
    table = dict(one.table)
    if one.kind is None:
        which = ", ".join(KINDS)
        why = f"{one.seen}: what it is cannot be told ({which}; or --without {one.name})"
        asks.append((f"--kind {one.name}=KIND", why))
    if one.kind in _TARGETS and one.target is None:
        shipped = [name for name in list_targets() if str(read_target(name)[0].kind) in one.target_kinds]
        asks.append((f"--target {one.name}=TARGET", f"its sizes are not in the picture; shipped: {', '.join(shipped)}"))
    if stated.patterns and (len(table.get("periods", ())) or "axes" in table):
        table = {key: value for key, value in table.items() if key not in ("periods", "axes", "steps_deg")}
        table["patterns"] = stated.patterns
    elif (periods := _said(stated.periods, one.name)) is not None and ("axes" in table or "periods" in table):
        table["periods"] = list(periods)
    elif "axes" in table:
        option = "--periods '*=P1,P2,...' and --projector WIDTHxHEIGHT (or --patterns FILE)"
        asks.append((option, "fringes along both axes count the projector's pixels"))
    return replace(one, table=table, asks=tuple(asks))
