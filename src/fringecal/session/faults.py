"""A fault says where, what was found and what to do; a wrong name is met with the nearest right one."""

import difflib
from collections.abc import Iterable
from dataclasses import dataclass

from fringecal.errors import SessionError


@dataclass(frozen=True)
class Fault:
    """One reason to refuse a session.

    Parameters
    ----------
    where
        The file, key or capture that is at fault.
    found
        What is there, with numbers, and what was needed.
    remedy
        What to do about it.
    """

    where: str
    found: str
    remedy: str

    def __str__(self) -> str:
        """One sentence: where, what, remedy."""
        return f"{self.where}: {self.found}; {self.remedy}"


class PictureError(SessionError):
    """A picture file that cannot be trusted: what was found in it and what to do."""

    def __init__(self, found: str, remedy: str = "copy the file again from the camera") -> None:
        self.found, self.remedy = found, remedy
        super().__init__([f"{found}; {remedy}"])


_ALIKE = 0.6  # similarity of names by difflib, its own default: about two slips in a name of six letters


def nearest(name: str, known: Iterable[str]) -> str | None:
    """Return the known name that looks most like `name`, or None if none is similar.

    Examples
    --------
    >>> nearest("hieght_mm", ["height_mm", "model"])
    'height_mm'
    """
    names = sorted(known)
    folded = {known_name.casefold(): known_name for known_name in names}
    close = difflib.get_close_matches(name.casefold(), list(folded), n=1, cutoff=_ALIKE)
    return folded[close[0]] if close else None


def hint(name: str, known: Iterable[str]) -> str:
    """Say ``did you mean ...?`` or list what is known."""
    names = sorted(known)
    close = nearest(name, names)
    if close is not None:
        return f'did you mean "{close}"?'
    return f"known here: {', '.join(names)}" if names else "remove it"


def joined(items: Iterable[object], *, at_most: int = 6) -> str:
    """Join for a sentence, shortened when there are many."""
    texts = [str(item) for item in items]
    shown = ", ".join(texts[:at_most])
    return shown if len(texts) <= at_most else f"{shown}, ... ({len(texts)} in all)"
