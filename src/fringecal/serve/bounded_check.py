"""Check a session in a process whose memory and time are bounded: what comes in may be made to exhaust both."""

import os
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

from pydantic import ValidationError

from fringecal.serve.access import Refused
from fringecal.serve.supervisor import TIMED_OUT, Bounds, supervised
from fringecal.session import CheckReport

# Address space, MiB: the largest picture that is read takes 3 GiB beside the program's 0.5; and s: a thousand frames of
# five megapixels.
CHECK_BOUNDS = Bounds(memory_mib=6144, seconds=300.0)
_COMMAND = (sys.executable, "-P", "-m", "fringecal", "check")


def checked(folder: Path, bounds: Bounds = CHECK_BOUNDS, command: Sequence[str] = _COMMAND) -> CheckReport:
    """Return what `fringecal check` says of a folder.

    Parameters
    ----------
    folder
        The session's.
    bounds
        What the check may use.
    command
        The check.

    Raises
    ------
    Refused
        It needed more, or broke off otherwise.
    """
    process = supervised(
        [*command, str(folder.absolute()), "--json"],
        bounds,
        environment=os.environ | {"PYTHONUTF8": "1"},
        said=subprocess.DEVNULL,
    )
    # Its standard input stays open while it is waited for: that it closes ends the check.
    assert process.stdout is not None
    with process.stdout as answer:
        text = answer.read()
    code = process.wait()
    assert process.stdin is not None
    process.stdin.close()
    if code == TIMED_OUT:
        raise Refused(f"This session's check took more than {bounds.seconds:g} s; send fewer or smaller pictures.", 413)
    try:
        return CheckReport.model_validate_json(text)
    except ValidationError:
        words = f"This session's check broke off; it may use {bounds.memory_mib} MiB. Send fewer or smaller pictures."
        raise Refused(words, 413) from None
