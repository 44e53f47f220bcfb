"""A capture under examination: its files found and decoded once, its target read, what fails noted."""

import hashlib
from dataclasses import dataclass, field
from pathlib import Path

from fringecal.errors import TargetError
from fringecal.session.document import AxisFiles, CaptureTable
from fringecal.session.faults import Fault, PictureError
from fringecal.session.fringes.phase_maps import StatedMap, read_maps
from fringecal.session.model_file import outside_fault
from fringecal.session.parse import Parsed
from fringecal.session.pictures.capture_files import FrameFacts, examine, expand
from fringecal.targets import Target, read_target

PICTURE_KINDS = frozenset({"grid", "board"})


@dataclass(frozen=True)
class Draft:
    """A capture under examination.

    Parameters
    ----------
    label
        How messages name it.
    table
        What the document says of it.
    broken
        Keys of the table that hold stand-ins; rules that depend on them say nothing.
    steps_deg
        Steps that apply to it; None where none are known.
    files, gray_files
        Files found.
    facts
        What is known of the files that could be read, by path.
    has_all_files
        Whether every entry of `images` named at least one file.
    target
        The target, if one is named and could be read.
    faults
        What could not be found or read.
    target_sha256
        Of the bytes that the target was read from; empty for a shipped target.
    maps
        Phase maps that another program made.
    gray_counts
        How many of the Gray-code pictures belong to each axis of the projector, where axes are stated.
    white_files, black_files
        Pictures lit evenly, and not at all, by the projector.
    """

    label: str
    table: CaptureTable
    broken: frozenset[str]
    steps_deg: tuple[float, ...] | None
    files: tuple[Path, ...]
    gray_files: tuple[Path, ...]
    facts: dict[Path, FrameFacts]
    has_all_files: bool
    target: Target | None
    faults: tuple[Fault, ...]
    target_sha256: str = ""
    gray_counts: dict[str, int] = field(default_factory=dict)
    white_files: tuple[Path, ...] = ()
    black_files: tuple[Path, ...] = ()
    maps: tuple[StatedMap, ...] = ()

    @property
    def every_file(self) -> tuple[Path, ...]:
        """All picture files of the capture, in the order in which it lists them."""
        return (*self.files, *self.gray_files, *self.white_files, *self.black_files)

    @property
    def frames(self) -> list[FrameFacts]:
        """Facts of the readable images, each file once."""
        return [self.facts[path] for path in dict.fromkeys(self.files) if path in self.facts]

    @property
    def all_frames(self) -> list[FrameFacts]:
        """Facts of all readable pictures of the capture, each file once."""
        return [self.facts[path] for path in dict.fromkeys(self.every_file) if path in self.facts]


def draft_capture(
    folder: Path,
    parsed: Parsed,
    index: int,
    examined: dict[Path, FrameFacts | Fault],
    targets: dict[str, tuple[Target, str]],
) -> Draft:
    """Find and read everything that one capture names.

    Parameters
    ----------
    folder, parsed
        The session folder and its document.
    index
        Which capture of the document.
    examined
        Files that other captures have read; what this one reads is added.
    targets
        Targets, likewise, with the hashes of their files.
    """
    table = parsed.sound_document.capture[index]
    broken = parsed.broken_keys(index)
    label = f"capture {index + 1}" if "name" in broken else f'capture "{table.name}"'
    files, faults = expand(folder, table.images, f"{label}: images")
    gray, gray_faults = _gray_files(folder, table, label)
    lights = [expand(folder, getattr(table, key) or [], f"{label}: {key}") for key in ("white", "black")]
    gray_files = tuple(path for paths in gray.values() for path in paths)
    every = (*files, *gray_files, *(path for paths, _ in lights for path in paths))
    found = [_examined(folder, path, label, examined) for path in dict.fromkeys(every)]
    maps, map_faults = ((), []) if "maps" in broken else read_maps(folder, table, parsed.sound_document, label)
    target, target_sha256, target_faults = _target(folder, table, label, targets)
    return Draft(
        label=label,
        table=table,
        broken=broken,
        steps_deg=_steps_deg(parsed, table, broken),
        files=tuple(files),
        gray_files=gray_files,
        facts={facts.path: facts for facts in found if isinstance(facts, FrameFacts)},
        has_all_files=not faults,
        target=target,
        faults=(
            *faults,
            *gray_faults,
            *(fault for _, light_faults in lights for fault in light_faults),
            *(f for f in found if isinstance(f, Fault)),
            *target_faults,
            *map_faults,
        ),
        target_sha256=target_sha256,
        gray_counts={name: len(paths) for name, paths in gray.items()},
        maps=maps,
        white_files=tuple(lights[0][0]),
        black_files=tuple(lights[1][0]),
    )


def _gray_files(folder: Path, table: CaptureTable, label: str) -> tuple[dict[str, list[Path]], list[Fault]]:
    """Find the Gray-code pictures of each axis; those of no axis stand under the first that is stated, or "u"."""
    names = table.axes or ["u"]
    if isinstance(table.gray, AxisFiles):
        found = {n: expand(folder, getattr(table.gray, n) or [], f"{label}: gray.{n}") for n in dict.fromkeys(names)}
    else:
        found = {names[0]: expand(folder, table.gray or [], f"{label}: gray")}
    return {name: paths for name, (paths, _) in found.items()}, [f for _, faults in found.values() for f in faults]


def _examined(folder: Path, path: Path, label: str, examined: dict[Path, FrameFacts | Fault]) -> FrameFacts | Fault:
    if path not in examined:
        try:
            examined[path] = examine(path)
        except PictureError as error:
            where = f"{label}: {path.relative_to(folder).as_posix()}"
            examined[path] = Fault(where, error.found, error.remedy)
    return examined[path]


def _target(
    folder: Path, table: CaptureTable, label: str, targets: dict[str, tuple[Target, str]]
) -> tuple[Target | None, str, list[Fault]]:
    """Read the target of a capture: a shipped one by its name, or a file in the session's folder with its hash."""
    if table.target is None:
        return None, "", []
    if table.target in targets:
        return *targets[table.target], []
    own = table.target.endswith(".toml")
    outside = outside_fault(folder, table.target, f"{label}: target") if own else None
    if outside is not None:
        return None, "", [outside]
    try:
        target, content = read_target(table.target, folder=folder)
        targets[table.target] = target, hashlib.sha256(content).hexdigest() if own else ""
        return *targets[table.target], []
    except TargetError as error:
        # A target's message has its remedies in it, one line per fault; here it is one sentence.
        found = "; ".join(line.removeprefix("  - ") for line in str(error).splitlines())
        return None, "", [Fault(f"{label}: target", found, "correct the target or name another")]


def _steps_deg(parsed: Parsed, table: CaptureTable, broken: frozenset[str]) -> tuple[float, ...] | None:
    if table.steps_deg is not None:
        return tuple(table.steps_deg)
    if broken & {"steps_deg", "kind", "axes"}:
        return None
    if table.maps is not None or (table.kind in PICTURE_KINDS and table.axes is None):
        return ()
    phase = parsed.sound_document.phase
    return tuple(phase.steps_deg) if phase is not None else None
