"""A command as it was typed, for records and for those who run it again."""

from collections.abc import Mapping, Sequence


def command_line(verb: str, arguments: Sequence[object]) -> tuple[str, ...]:
    """Return the command as typed, for the record: all that its results depend on.

    A history is left out: its URL may hold a password, and nothing in the record comes from it.
    """
    return ("fringecal", verb, *(str(a) for a in arguments))


def given(options: Mapping[str, object]) -> tuple[str, ...]:
    """Return options with their values as they are typed; what is empty was not given.

    Examples
    --------
    >>> given({"--capture": "bars", "--rows": "", "--limits": None})
    ('--capture', 'bars')
    """
    return tuple(str(word) for name, value in options.items() if value not in (None, "") for word in (name, value))
