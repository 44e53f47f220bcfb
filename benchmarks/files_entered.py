"""How many files a reader enters who follows a session through `commission`, and how often they turn back.

Files are listed in the order in which the program first enters them. A reader who follows the calls has to turn back
where the next file is called from another one than that just entered. Faces and what loads them do not count.

    python benchmarks/files_entered.py [SESSION] [--report] [--list]
"""

import argparse
import sys
from pathlib import Path
from types import FrameType

import fringecal
from fringecal.session import load_session
from fringecal.workflows.commission import commission, commission_report

PACKAGE = str(Path(fringecal.__file__).parent)
ARCHIVE = Path(__file__).parents[1] / "tests" / "records" / "archive" / "0.1.0" / "session"


class Trail:
    """Files of the package in the order of first entry, and from which file each was entered."""

    def __init__(self) -> None:
        self.entered: dict[str, str] = {}

    def __call__(self, frame: FrameType, event: str, _: object) -> None:
        name = frame.f_code.co_filename
        if event != "call" or not counts(name) or name in self.entered or frame.f_code.co_name == "<module>":
            return
        caller = frame.f_back
        while caller is not None and (not counts(caller.f_code.co_filename) or caller.f_code.co_filename == name):
            caller = caller.f_back
        self.entered[name] = "" if caller is None else caller.f_code.co_filename

    @property
    def turned_back(self) -> int:
        files = list(self.entered)
        return sum(self.entered[after] != before for before, after in zip(files, files[1:], strict=False))


def counts(name: str) -> bool:
    return name.startswith(PACKAGE) and not name.endswith("__init__.py")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("session", nargs="?", type=Path, default=ARCHIVE)
    parser.add_argument("--report", action="store_true", help="also into the report")
    parser.add_argument("--list", action="store_true", help="name the files")
    asked = parser.parse_args()
    trail = Trail()
    sys.setprofile(trail)
    found = commission(load_session(asked.session))
    if asked.report:
        commission_report(found)
    sys.setprofile(None)
    for file in trail.entered if asked.list else ():
        print(Path(file).relative_to(PACKAGE))
    print(f"{len(trail.entered)} files entered, {trail.turned_back} times turned back")


if __name__ == "__main__":
    main()
