"""Check a session folder as a whole, and load it if nothing is wrong."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from fringecal.errors import SessionError
from fringecal.guarded import is_file
from fringecal.session import statement_rules as consistency
from fringecal.session.assemble import assemble, use_of
from fringecal.session.captures import Session
from fringecal.session.document import FILE_NAME, SessionDocument
from fringecal.session.draft import Draft, draft_capture
from fringecal.session.faults import Fault
from fringecal.session.fringes.fringe_axes import axis_faults
from fringecal.session.model_file import ReadModel, model_file
from fringecal.session.parse import Parsed, parse_folder
from fringecal.session.pictures import picture_rules as comparison
from fringecal.session.pictures.capture_files import FrameFacts
from fringecal.session.pictures.white_level import WhiteLevel, white_level
from fringecal.targets import Target


@dataclass(frozen=True)
class SessionCheck:
    """Outcome of a check: the session if it may be used, else every fault.

    Parameters
    ----------
    folder
        The folder that was checked.
    session
        None if there are faults.
    faults
        Every reason to refuse the folder.
    notes
        What is worth knowing and no reason to refuse.
    kinds
        Name and kind of every capture that `session.toml` states, as far as it could be read.
    taking_part
        Names of those that take part in the calibration.
    """

    folder: Path
    session: Session | None
    faults: tuple[Fault, ...]
    notes: tuple[str, ...]
    kinds: tuple[tuple[str, str], ...] = ()
    taking_part: tuple[str, ...] = ()


def load_session(folder: str | Path) -> Session:
    """Read a session folder.

    Parameters
    ----------
    folder
        The folder that holds `session.toml`, or that file itself.

    Raises
    ------
    SessionError
        If anything is wrong with it; the error lists all faults, each with what to do.

    Examples
    --------
    >>> session = load_session("tests/records/archive/0.1.0/session")
    >>> [capture.kind for capture in session.captures.values()][:3]
    ['grid', 'reference', 'strips']
    """
    check = check_session(folder)
    if check.session is None:
        raise SessionError([str(fault) for fault in check.faults])
    return check.session


def check_session(folder: str | Path, *, read_model: ReadModel | None = None) -> SessionCheck:
    """Find everything that is wrong with a session folder; never raises for what is in it.

    Parameters
    ----------
    folder
        The folder that holds `session.toml`, or that file itself.
    read_model
        Reads the camera model, if one is named, from its bytes (`fringecal.records.lens_of_bytes`); without it the file
        is only seen to be there.
    """
    folder = Path(folder)
    if folder.name == FILE_NAME and is_file(folder):
        folder = folder.parent
    parsed = parse_folder(folder)
    if parsed.document is None:
        return SessionCheck(folder, None, parsed.faults, ())
    examined: dict[Path, FrameFacts | Fault] = {}
    targets: dict[str, tuple[Target, str]] = {}
    drafts = [draft_capture(folder, parsed, k, examined, targets) for k in range(len(parsed.document.capture))]
    levels = [_level(draft, parsed.document) for draft in drafts]
    model, model_faults = model_file(folder, parsed.document, read_model)
    faults = tuple(dict.fromkeys((*model_faults, *_faults(folder, parsed, drafts, levels))))
    notes = tuple(dict.fromkeys(_notes(parsed.document, drafts, levels)))
    session = None if faults else assemble(folder, parsed, drafts, [level.value for level in levels], model)
    kinds = tuple((draft.table.name, draft.table.kind) for draft in drafts)
    taking_part = tuple(draft.table.name for draft in drafts if use_of(draft.table) == "calibration")
    return SessionCheck(folder, session, faults, notes, kinds, taking_part)


def _level(draft: Draft, document: SessionDocument) -> WhiteLevel:
    return white_level(draft.all_frames, draft.table.bits or document.camera.bits, draft.label)


def _faults(folder: Path, parsed: Parsed, drafts: Sequence[Draft], levels: Sequence[WhiteLevel]) -> Iterator[Fault]:
    yield from parsed.faults
    yield from consistency.header_faults(parsed.sound_document)
    for draft, level in zip(drafts, levels, strict=True):
        yield from draft.faults
        yield from consistency.steps_stated_faults(draft, is_phase_sound=parsed.is_sound("phase"))
        yield from consistency.count_faults(draft)
        yield from consistency.target_faults(draft)
        yield from consistency.period_faults(draft)
        yield from axis_faults(draft, parsed.sound_document, is_projector_sound=parsed.is_sound("projector"))
        yield from consistency.use_faults(draft)
        yield from comparison.colour_faults(draft, parsed.sound_document.camera.channel)
        yield from level.faults
        yield from comparison.exposure_faults(draft, level.value)
    yield from consistency.name_faults(drafts)
    yield from comparison.uniformity_faults(drafts)
    yield from comparison.duplicate_faults(drafts, folder)


def _notes(document: SessionDocument, drafts: Sequence[Draft], levels: Sequence[WhiteLevel]) -> Iterator[str]:
    phase_deg = document.phase.steps_deg if document.phase else None
    if phase_deg is not None:
        yield from consistency.turn_notes(phase_deg, f"{FILE_NAME}: phase.steps_deg")
    for draft, level in zip(drafts, levels, strict=True):
        yield from consistency.step_notes(draft, phase_deg)
        yield from level.notes
        yield from comparison.exposure_notes(draft, level.value)
        yield from comparison.file_notes(draft)
    kinds = {draft.table.kind for draft in drafts}
    if "strips" in kinds and "reference" not in kinds:
        yield 'strips without a capture of kind "reference", the bare plate under the same fringes'
