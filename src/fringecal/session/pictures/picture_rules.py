"""What can be wrong with the pictures of a session, each and between them: each rule is one function."""

from collections import Counter, defaultdict
from collections.abc import Container, Iterable, Iterator, Mapping, Sequence
from pathlib import Path

from fringecal.session.draft import Draft
from fringecal.session.faults import Fault, joined

# A frame with less than 5 % of its pixels unsaturated, or whose pixels but the brightest 0.5 % stay
# below 2 % of white (5 of 255), shows nothing; above 5 % saturation a reader should know.
_SATURATED_FAULT, _SATURATED_NOTE, _DARK_FAULT = 0.95, 0.05, 0.02


def colour_faults(draft: Draft, camera_channel: str | None) -> Iterator[Fault]:
    """Refuse colour for which no channel rule is stated."""
    coloured = [frame.path.name for frame in draft.all_frames if frame.is_colour]
    if coloured and (draft.table.channel or camera_channel) is None and "channel" not in draft.broken:
        yield Fault(
            draft.label,
            f"colour pictures without a rule for their channels: {joined(coloured)}",
            'state channel = "green" (or "mean", "red", "blue", "luma") there or under [camera]',
        )


def uniformity_faults(drafts: Sequence[Draft]) -> Iterator[Fault]:
    """Refuse pictures of different sizes or bit depths, within a capture and between captures."""
    sizes = {d.label: [(f.path.name, f"{f.width_px} x {f.height_px} px") for f in d.all_frames] for d in drafts}
    yield from _differences(sizes, "take or export all pictures at one size")
    # A capture that states its own bits means to differ from the others.
    stated = {draft.label for draft in drafts if draft.table.bits is not None}
    depths = {d.label: [(f.path.name, f"{f.bits} bit") for f in d.all_frames] for d in drafts}
    remedy = "export all at the camera's own depth, or state bits in the capture"
    yield from _differences(depths, remedy, may_differ=stated)


def _differences(
    found: Mapping[str, Sequence[tuple[str, str]]], remedy: str, *, may_differ: Container[str] = ()
) -> Iterator[Fault]:
    """Compare the (name, value) of each capture within it and with what most pictures have."""
    usual = Counter(value for rows in found.values() for _, value in rows).most_common(1)
    for label, rows in found.items():
        values = dict.fromkeys(value for _, value in rows)
        if len(values) > 1:
            groups = [f"{v} ({joined([n for n, w in rows if w == v], at_most=3)})" for v in values]
            yield Fault(label, f"pictures differ: {joined(groups)}", remedy)
        elif values and usual[0][0] not in values and label not in may_differ:
            yield Fault(label, f"{next(iter(values))}, while most pictures have {usual[0][0]}", remedy)


def duplicate_faults(drafts: Sequence[Draft], folder: Path) -> Iterator[Fault]:
    """Find one file listed twice, one file copied, and one picture saved twice (a stale frame)."""
    uses: dict[Path, list[str]] = defaultdict(list)
    for draft in drafts:
        for path in draft.every_file:
            uses[path].append(draft.label)
    for path, labels in uses.items():
        if len(labels) > 1:
            found = f"{_relative(path, folder)} is listed {len(labels)} times"
            yield Fault(_named(labels), found, "a picture belongs to one place; list each file once")
    facts = {path: frame for draft in drafts for path, frame in draft.facts.items()}
    hashes = {path: frame.sha256 for path, frame in facts.items()}
    for paths in _groups(hashes):
        yield _same(paths, uses, folder, "byte for byte the same file")
    for paths in _groups({path: frame.pixel_digest for path, frame in facts.items()}):
        if len({hashes[path] for path in paths}) > 1:
            yield _same(paths, uses, folder, "the same picture, pixel for pixel, in different files")


def _groups(digests: Mapping[Path, str]) -> list[list[Path]]:
    """Group the paths that share a digest, groups of two and more."""
    groups: dict[str, list[Path]] = defaultdict(list)
    for path, digest in digests.items():
        groups[digest].append(path)
    return [paths for paths in groups.values() if len(paths) > 1]


def _same(paths: Sequence[Path], uses: Mapping[Path, list[str]], folder: Path, what: str) -> Fault:
    return Fault(
        _named(label for path in paths for label in uses[path]),
        f"{joined(_relative(path, folder) for path in paths)} are {what}",
        "a camera's noise makes two frames differ, so one is stale or wrongly copied; take it again",
    )


def _named(labels: Iterable[str]) -> str:
    return " and ".join(dict.fromkeys(labels))


def _relative(path: Path, folder: Path) -> str:
    return path.relative_to(folder).as_posix()


def exposure_faults(draft: Draft, white_level: int) -> Iterator[Fault]:
    """Refuse frames that are nearly all black or nearly all saturated; Gray-code pictures may be."""
    for frame in draft.frames:
        where = f"{draft.label}: {frame.path.name}"
        # In a set of mixed depths, which is a fault of its own, the others are not dark for it.
        white_level = min(white_level, (1 << frame.bits) - 1)
        saturated = frame.saturated_share(white_level)
        if saturated >= _SATURATED_FAULT:
            found = f"{saturated:.1%} of the pixels are saturated (at {white_level})"
            yield Fault(where, found, "expose for a shorter time and take it again")
        elif frame.bright <= _DARK_FAULT * white_level:
            found = f"99.5 % of the pixels are at or below {frame.bright} of {white_level}: black"
            yield Fault(where, found, "see that projector and camera work, expose longer and take it again")


def exposure_notes(draft: Draft, white_level: int) -> Iterator[str]:
    """Remark on frames with many saturated pixels."""
    for frame in draft.frames:
        saturated = frame.saturated_share(white_level)
        if _SATURATED_NOTE <= saturated < _SATURATED_FAULT:
            yield f"{draft.label}: {frame.path.name}: {saturated:.1%} of the pixels are saturated"


def file_notes(draft: Draft) -> Iterator[str]:
    """Remark on lossy files and on orientations that are not applied."""
    lossy = [frame.path.name for frame in draft.all_frames if frame.container.format == "JPEG"]
    if lossy:
        yield f"{draft.label}: JPEG is lossy, so noise and fine detail are not the camera's: {joined(lossy)}"
    turned = [frame.path.name for frame in draft.all_frames if frame.container.orientation != 1]
    if turned:
        yield f"{draft.label}: an EXIF orientation is stated and not applied: {joined(turned)}"
