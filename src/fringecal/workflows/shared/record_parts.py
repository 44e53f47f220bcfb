"""What every record says of its session: which it was, its files with their hashes; and budgets as rows."""

from collections.abc import Iterable
from datetime import UTC, datetime

from fringecal.records import BudgetRow, InputFile, SessionNote
from fringecal.session import Capture, Session
from fringecal.uncertainty import Budget


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
        for path, _ in capture.files
    }
    files = [InputFile(capture=whose.get(file, ""), file=file, sha256=sha) for file, sha in session.inputs.items()]
    names = None if only is None else {"", *(capture.name for capture in only if capture is not None)}
    return tuple(file for file in files if names is None or file.capture in names)


def budget_rows(budget: Budget) -> tuple[BudgetRow, ...]:
    """Return the rows of a budget as records hold them, the largest first; in the unit of the result."""
    percents = budget.percents()
    return tuple(
        BudgetRow(label=source.identifier, u=u, contribution=u, percent=percents[source])
        for source, u in budget.contributions().items()
    )
