"""What every record says of its session: which it was, its files with their hashes; and budgets as rows."""

from collections.abc import Iterable, Mapping
from datetime import UTC, datetime

from fringecal.records import BudgetRow, InputFile, SessionNote
from fringecal.session import Capture, Session


def session_note(session: Session) -> SessionNote:
    """Return which session the record comes from."""
    return SessionNote(
        rig=session.rig,
        captured=session.captured.astimezone(UTC) if isinstance(session.captured, datetime) else None,
        operator=session.operator,
        temperature_degC=session.temperature_degC,
        minutes_since_power_on=session.minutes_since_power_on,
    )


def inputs_of(session: Session, *, only: Iterable[Capture | None] | None = None) -> tuple[InputFile, ...]:
    """Return the files of a session with their hashes; of some captures alone, those and what all captures share.

    Shared files, such as session.toml, belong to no capture.
    """
    whose = {
        path.relative_to(session.folder).as_posix(): capture.name
        for capture in session.captures.values()
        for path in (*capture.paths, *capture.gray_paths)
    }
    files = [InputFile(capture=whose.get(file, ""), file=file, sha256=sha) for file, sha in session.inputs.items()]
    names = None if only is None else {"", *(capture.name for capture in only if capture is not None)}
    return tuple(file for file in files if names is None or file.capture in names)


def budget_rows(contributions: Mapping[str, float]) -> tuple[BudgetRow, ...]:
    """Return budget rows, the largest first; contributions are in the unit of the result."""
    total = sum(c**2 for c in contributions.values()) or 1.0
    rows = sorted(contributions.items(), key=lambda item: -abs(item[1]))
    return tuple(BudgetRow(label=label, u=abs(c), contribution=abs(c), percent=100 * c**2 / total) for label, c in rows)
