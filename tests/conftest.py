"""Which tests run in one worker: those that share a rig, so that it is commissioned once, else those of a file."""

from pathlib import Path

import pytest

TESTS = Path(__file__).parent

#: Session fixtures that take long, and the group of all tests that use one of them.
SHARED = {
    "thesis": "thesis rig",
    "thesis_7": "thesis rig",
    "oblique": "oblique rig",
    "commissioned": "command line",
    "calibration": "command line",
    "printed": "command line",
    "reconstructed": "command line",
}
#: Files that ask for a rig by its name while they run.
ASKING = {
    "workflows/test_thesis_rig.py": "workflows: thesis rig",
    "workflows/test_reports.py": "workflows: oblique rig",
}


def group_of(item: pytest.Item) -> str:
    file = item.path.relative_to(TESTS)
    if file.as_posix() in ASKING:
        return ASKING[file.as_posix()]
    if file.parts[0] in ("workflows", "cli"):
        used = [SHARED[name] for name in SHARED if name in getattr(item, "fixturenames", ())]
        if used:
            return f"{file.parts[0]}: {used[0]}"
    return file.as_posix()


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    for item in items:
        if item.path.is_relative_to(TESTS):
            item.add_marker(pytest.mark.xdist_group(group_of(item)))
