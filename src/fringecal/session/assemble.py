"""From a checked document and its files to a session."""

import math
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

from fringecal.session.captures import CameraKnown, Capture, MirrorKnown, ProjectorKnown, Session
from fringecal.session.document import FILE_NAME, CaptureTable, ProjectorTable, SessionDocument
from fringecal.session.draft import Draft
from fringecal.session.fringes.fringe_axes import along, axes_of
from fringecal.session.model_file import ModelFile
from fringecal.session.parse import Parsed

_ASPECTS = {"square": 1.0, "diamond": 0.5}  # distance of rows over that of columns
_ROOM_U_DEGC = 1.0  # of a temperature that states none: a room thermometer, and an artefact that has lain beside it


def assemble(
    folder: Path, parsed: Parsed, drafts: Sequence[Draft], white_levels: Sequence[int], model: ModelFile | None
) -> Session:
    """Build the session of a folder in which no fault was found; every hash is that of the bytes that were used."""
    document = parsed.sound_document
    captures = [_capture(draft, white, document) for draft, white in zip(drafts, white_levels, strict=True)]
    return Session(
        folder=folder,
        rig=document.rig,
        captured=document.captured,
        camera=_camera(document, model),
        projector=_projector(document.projector),
        phase_shifts_rad=_radians(document.phase.steps_deg if document.phase else ()),
        captures={capture.name: capture for capture in captures},
        inputs=dict(_inputs(folder, parsed, drafts, model)),
        operator=document.operator,
        temperature_degC=document.temperature_degC,
        minutes_since_power_on=document.minutes_since_power_on,
    )


def _projector(table: ProjectorTable | None) -> ProjectorKnown | None:
    if table is None:
        return None
    mirror = None if table.mirror is None else MirrorKnown(table.mirror.point_mm, table.mirror.normal)
    resolution = None if table.resolution_px is None else (table.resolution_px[0], table.resolution_px[1])
    aspect = table.pixel_aspect if table.pixels is None else _ASPECTS[table.pixels]
    return ProjectorKnown(table.position_mm, mirror, resolution, aspect)


def _camera(document: SessionDocument, model: ModelFile | None) -> CameraKnown:
    camera = document.camera
    if model is None:
        return CameraKnown(height_mm=camera.height_mm, telecentric=camera.telecentric)
    return CameraKnown(model.path, camera.height_mm, camera.telecentric, model.content)


def use_of(table: CaptureTable) -> str:
    """Tell what a capture is for: as stated, else strips take part in the calibration, and nothing else does."""
    return table.use or ("calibration" if table.kind == "strips" else "verification")


def _capture(draft: Draft, white_level: int, document: SessionDocument) -> Capture:
    table = draft.table
    shape, bits = _form(draft)
    room = document.temperature_degC, document.temperature_u_degC or _ROOM_U_DEGC
    resolution = None if document.projector is None else document.projector.resolution_px
    axes = axes_of(table, resolution, draft.gray_counts)
    return Capture(
        name=table.name,
        kind=table.kind,
        target=None if draft.target is None else draft.target.warmed(*room),
        paths=draft.files,
        sha256=_hashes(draft, draft.files),
        phase_shifts_rad=_radians(draft.steps_deg or ()),
        shape=shape,
        bits=bits,
        white_level=white_level,
        repeat=table.repeat,
        periods=axes[0].periods_px if axes else tuple(along(table.periods, "u")),
        gray_paths=draft.gray_files,
        gray_sha256=_hashes(draft, draft.gray_files),
        axes=axes,
        maps=draft.maps,
        white_paths=draft.white_files,
        white_sha256=_hashes(draft, draft.white_files),
        black_paths=draft.black_files,
        black_sha256=_hashes(draft, draft.black_files),
        channel=table.channel or document.camera.channel,
        use=use_of(table),
        pose=table.pose or "",
    )


def _form(draft: Draft) -> tuple[tuple[int, int], int]:
    """Return the size of a capture's pictures, or of its maps, and the bits of its files."""
    if draft.all_frames:
        first = draft.all_frames[0]
        return (first.height_px, first.width_px), first.bits
    height, width = draft.maps[0].phase_rad.shape
    return (height, width), 8


def _hashes(draft: Draft, files: Iterable[Path]) -> tuple[str, ...]:
    return tuple(draft.facts[path].sha256 for path in files)


def _inputs(
    folder: Path, parsed: Parsed, drafts: Sequence[Draft], model: ModelFile | None
) -> Iterator[tuple[str, str]]:
    yield FILE_NAME, parsed.sha256
    if model is not None:
        yield str(parsed.sound_document.camera.model), model.sha256
    yield from parsed.pattern_files
    for draft in drafts:
        if draft.target_sha256:  # a shipped target is known by its name and is no file here
            yield str(draft.table.target), draft.target_sha256
    for draft in drafts:
        for path in draft.every_file:
            yield path.relative_to(folder).as_posix(), draft.facts[path].sha256
        for one in draft.maps:
            yield one.path.relative_to(folder).as_posix(), one.sha256


def _radians(steps_deg: Iterable[float]) -> tuple[float, ...]:
    return tuple(math.radians(step) for step in steps_deg)
