"""A `lab.toml` to fill in: every administrative item of a calibration report with what it means, and nothing in it."""

from collections.abc import Iterator

from fringecal.records.certificates.laboratory import NEEDED

_EMPTY = '""'
_HEAD = """\
# What only the laboratory can say for a calibration report (fringecal certificate --lab).
# Fill in the empty values; one that stays empty counts as not stated, and is asked for by name.
format = 1
"""
_OPTIONAL = {
    "report": (
        'received = ""  # the day the rig came in, if it was sent; a day is 2026-11-22, without quotes',
        'begin = ""  # first and last day of the work; the day of the session where they are not stated',
        'end = ""',
    ),
    "laboratory": ('email = ""', 'phone = ""', 'code = ""  # its code in a register, if it has one'),
    "customer": ('street = ""', 'post_code = ""', 'email = ""', 'phone = ""'),
    "item": ('owner_id = ""  # the owner\'s own number for it',),
}
_TAIL = """
[[person]]  # who answers for the report; write the block once more for each further person
name = ""
role = ""  # for example head of the laboratory
signs = true  # who authorises it: one at least

# An artefact by the name of its target, as your books hold it; one block for each:
# [[standard]]
# target = ""
# identification = ""
# certificate = ""
"""


def lab_template() -> str:
    """Return the text of a `lab.toml` in which everything that a report needs stands empty, with a comment.

    Examples
    --------
    >>> print(lab_template().splitlines()[5])
    number = ""  # the report's own number
    """
    return _HEAD + "\n".join(_tables()) + "\n" + _TAIL


def _tables() -> Iterator[str]:
    tables = dict.fromkeys(key.partition(".")[0] for key in NEEDED)
    for table in tables:
        yield f"\n[{table}]"
        for key, meaning in NEEDED.items():
            owner, _, name = key.partition(".")
            if owner == table:
                yield f"{name} = {'[]' if table == 'conditions' else _EMPTY}  # {meaning}"
        yield from (f"# {line}" for line in _OPTIONAL.get(table, ()))
