"""SLStudio's own text of a calibration (`.slcalib`): a name on a line, its numbers on the lines below."""

import re
from typing import Any

from fringecal.guarded import Refusal, shortened

SLCALIB = "#V1.0 SLStudio calibration"
_NUMBER = re.compile(r"[-+]?(?:[0-9]{1,40}\.?[0-9]{0,40}|\.[0-9]{1,40})(?:[eE][-+]?[0-9]{1,4})?")
_NAME = re.compile(r"(?P<name>[A-Za-z_]\w*)(?::\s*(?P<value>\S+))?")


def slcalib_of(text: str) -> dict[str, Any]:
    r"""Return the entries of such a file: numbers, or lists of numbers.

    Raises
    ------
    Refusal
        A line is neither a name nor numbers.

    Examples
    --------
    >>> slcalib_of("#V1.0 SLStudio calibration\nTp\n1 2 3\n\ncam_error: 0.25")
    {'Tp': [1.0, 2.0, 3.0], 'cam_error': 0.25}
    """
    entries: dict[str, Any] = {}
    name = ""
    for line in text.splitlines():
        words = line.split()
        if not words or line.startswith("#"):
            continue
        found = _NAME.fullmatch(line.strip())
        if found is not None:
            name = found["name"]
            entries[name] = _number(found["value"]) if found["value"] else []
        elif name and isinstance(entries[name], list):
            entries[name] += [_number(word) for word in words]
        else:
            raise Refusal(f"cannot be taken apart at {shortened(line, 60)!r}; export it anew")
    return entries


def _number(word: str) -> float:
    if _NUMBER.fullmatch(word) is None:
        raise Refusal(f"holds {shortened(word, 60)!r} where a number was needed; export it anew")
    return float(word)
