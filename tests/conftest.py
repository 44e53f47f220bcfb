"""How tests are shared out among workers: those of a file go to one, files that use one rig too, the longest first.

What a fixture of wide scope makes, each worker makes for itself, and a rig takes longer to commission than most that is
done with it. Workers, and the commands that tests start, inherit what is set here for all.
"""

import os
import sys
from pathlib import Path

import pytest

# Before numpy is loaded, as the command sets it: a worker has one processor.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

if sys.dont_write_bytecode:  # where nothing is written beside sources, each command would compile every library anew
    sys.pycache_prefix = str(Path(__file__).parents[1] / ".pytest_cache" / "bytecode")
    sys.dont_write_bytecode = False
    os.environ["PYTHONPYCACHEPREFIX"] = sys.pycache_prefix
    os.environ.pop("PYTHONDONTWRITEBYTECODE", None)

#: Files that go to one worker, since they share what takes long to make. The longest come first, so that no worker is
#: left alone with one of them at the end. The first two begin at once: they have few compiled functions in common, for
#: what one worker has compiled the others find.
TOGETHER = {
    "the command on the oblique rig": (
        "cli/test_results.py",
        "cli/test_audit_command.py",
        "cli/test_browser.py",
        "cli/test_browser_maps.py",
        "cli/test_certificate_command.py",
        "cli/test_interruption.py",
        "cli/test_serve.py",
        "cli/test_serve_sessions.py",
        "cli/test_wrong_input.py",
    ),
    "drawn grids": ("camera/test_camera_campaign.py", "camera/test_grid_pictures.py", "detect/test_grid_virtual.py"),
    "the thesis's rig": ("workflows/test_thesis_rig.py", "workflows/test_artefacts.py"),
    "pages": ("cli/test_pages.py",),
    "the oblique rig": (
        "library/test_library.py",
        "workflows/test_angle.py",
        "workflows/test_camera_height.py",
        "workflows/test_oblique_rig.py",
        "workflows/test_reports.py",
    ),
    "audits": ("workflows/test_audit.py",),
    "workers": ("workflows/test_study.py",),
    "records": ("workflows/test_rerun.py",),
    "leaves": ("reconstruct/test_leaf.py",),
}
GROUPS = {f"tests/{file}": group for group, files in TOGETHER.items() for file in files}
RANKS = {group: rank for rank, group in enumerate(TOGETHER)}


@pytest.fixture(scope="session")
def oblique_commissioned(request):
    """The oblique rig, commissioned by itself: what it writes to disk is up to tests/cli."""
    from fringecal.session import load_session
    from fringecal.workflows.commission import commission

    return commission(load_session(request.config.rootpath / "tests" / "data" / "oblique"))


def group_of(nodeid: str) -> str:
    file = nodeid.partition("::")[0]
    return GROUPS.get(file, file)


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    if hasattr(config, "workerinput"):
        items.sort(key=lambda item: RANKS.get(group_of(item.nodeid), len(RANKS)))


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config: pytest.Config, log: object) -> object:
    """Groups by the files' names: the groups that tests may be marked with do not work with pytest 9.2."""
    from xdist.scheduler import LoadScopeScheduling

    class ByGroup(LoadScopeScheduling):
        def _split_scope(self, nodeid: str) -> str:
            return group_of(nodeid)

    config.option.loadscopereorder = False  # the order is that of the collection
    return ByGroup(config, log)
