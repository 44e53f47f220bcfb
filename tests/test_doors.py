"""The doors between the rooms, read from the source and held against docs/house.md."""

import ast
import graphlib
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PACKAGE = ROOT / "src" / "fringecal"

EVERYONE = {"errors", "uncertainty"}
MEASURING = {"session", "targets", "detect", "phase", "camera", "projection", "reconstruct", "verify"}
ALLOWED = {
    "uncertainty": {"errors"},
    "targets": EVERYONE,
    "session": EVERYONE | {"targets"},
    "detect": EVERYONE,
    "phase": EVERYONE,
    "camera": EVERYONE | {"detect", "targets"},
    "projection": EVERYONE | {"detect", "phase", "camera", "targets"},
    "reconstruct": EVERYONE | {"phase", "camera", "projection"},
    "verify": EVERYONE | {"targets", "reconstruct"},
    "records": EVERYONE | {"targets", "camera", "projection", "reconstruct", "verify"},
    "history": EVERYONE | {"records"},
    "report": EVERYONE | MEASURING | {"records", "history"},
    "simulate": {"errors", "targets"},  # shares no estimate with the code that it tests
    "procedures": EVERYONE | MEASURING | {"records", "history", "report", "simulate"},
    "cli": EVERYONE | MEASURING | {"records", "history", "report", "simulate", "procedures"},
}

AT_THE_DISK = {"session", "records", "history", "report", "cli"}
READERS = {"targets.library", "simulate.library"}  # each reads the TOML files of its own room
DISK_CALLS = {
    "open", "mkdir", "makedirs", "rmdir", "unlink", "rename", "touch",
    "read_text", "read_bytes", "write_text", "write_bytes",
    "imread", "imreadmulti", "imdecode", "imwrite", "FileStorage", "savefig",
    "loadtxt", "genfromtxt", "fromfile", "savetxt", "tofile", "savez", "savez_compressed", "memmap",
    "read_csv", "to_csv", "to_parquet",
}  # fmt: skip
DISK_FUNCTIONS_OF = {
    "np": {"load", "save"},
    "os": {"remove", "replace", "stat", "scandir", "listdir", "walk"},
}
DISK_MODULES = {"sqlalchemy", "fastparquet", "tifffile", "shutil", "tempfile", "sqlite3", "x3pio", "imageio"}
WRITES = {"mkdir", "makedirs", "rmdir", "unlink", "rename", "touch", "write_text", "write_bytes", "imwrite"}

OPENCV_ROOMS = {"session", "detect", "phase", "camera"}
OPENCV_MODULES = {"targets.aruco"}  # the ArUco dictionaries are OpenCV's


def module_name(path: Path) -> str:
    parts = path.relative_to(PACKAGE).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


SOURCES = {module_name(path): path for path in sorted(PACKAGE.rglob("*.py"))}
TREES = {name: ast.parse(path.read_text(encoding="utf-8")) for name, path in SOURCES.items()}
ROOMS = {path.parent.name for path in PACKAGE.glob("*/__init__.py")}


def imports_of(tree: ast.AST) -> Iterator[str]:
    """Every module a file imports, wherever in the file the import stands."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"line {node.lineno}: imports are written in full, from fringecal"
            if node.module == "fringecal":
                yield from (f"fringecal.{alias.name}" for alias in node.names)
            else:
                yield str(node.module)


def rooms_entered(name: str) -> set[str]:
    """Rooms (and `errors`) that a module imports, its own left out."""
    entered = {module.split(".")[1] for module in imports_of(TREES[name]) if module.startswith("fringecal.")}
    return entered - {name.split(".")[0], "__version__"}


def calls_of(tree: ast.AST) -> Iterator[tuple[str, str, ast.Call]]:
    """Owner and name of every call: `np.load(...)` is ("np", "load"), `open(...)` is ("", "open")."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute):
            owner = node.func.value
            yield (owner.id if isinstance(owner, ast.Name) else "?", node.func.attr, node)
        elif isinstance(node, ast.Call) and isinstance(node.func, ast.Name):
            yield "", node.func.id, node


def memory_streams(tree: ast.AST) -> set[str]:
    """Names that hold an `io.BytesIO()`: writing to one touches no disk."""
    return {
        target.id
        for node in ast.walk(tree)
        if isinstance(node, ast.Assign) and ast.unparse(node.value).startswith("io.BytesIO(")
        for target in node.targets
        if isinstance(target, ast.Name)
    }


def disk_touches(tree: ast.AST) -> set[str]:
    streams = memory_streams(tree)
    calls = {
        f"{owner}.{name}()"
        for owner, name, call in calls_of(tree)
        if name in DISK_CALLS or name in DISK_FUNCTIONS_OF.get(owner, set())
        if not (call.args and ast.unparse(call.args[0]) in streams)
    }
    return calls | {f"import {module}" for module in imports_of(tree) if module.split(".")[0] in DISK_MODULES}


def rows_of_house() -> dict[str, str]:
    """Room -> what the table of docs/house.md lets it import."""
    text = (ROOT / "docs" / "house.md").read_text(encoding="utf-8")
    return dict(re.findall(r"^\| `(\w+)` \|[^|]*\|([^|]*)\|$", text, flags=re.MULTILINE))


def test_every_room_stands_in_the_table_and_the_other_way_round():
    assert ROOMS == set(ALLOWED) == set(rows_of_house())


@pytest.mark.parametrize("room", sorted(ALLOWED))
def test_the_table_of_the_house_says_what_is_enforced_here(room):
    stated = rows_of_house()[room]
    named = set(re.findall(r"`(\w+)`", stated))
    enforced = ALLOWED[room] - EVERYONE
    if "all but" in stated:
        assert enforced == set(ALLOWED) - EVERYONE - named - {room}
    elif "all" in stated.split():
        assert enforced == set(ALLOWED) - EVERYONE - {room}
    elif "everything it draws" in stated:
        assert enforced == named | MEASURING
    else:
        assert enforced == named


def test_every_module_stands_in_a_room():
    assert {name.split(".")[0] for name in SOURCES} - {"", "errors", "__main__"} == ROOMS


@pytest.mark.parametrize("room", sorted(ALLOWED))
def test_imports_go_through_the_doors(room):
    entered = {name: rooms_entered(name) - ALLOWED[room] for name in SOURCES if name.split(".")[0] == room}
    assert {name: rooms for name, rooms in entered.items() if rooms} == {}


def test_the_package_itself_and_its_errors_import_no_room():
    assert rooms_entered("") == set()
    assert rooms_entered("errors") == set()


def test_no_two_rooms_import_each_other():
    entered: dict[str, set[str]] = {room: set() for room in ROOMS}
    for name in SOURCES:
        if name.split(".")[0] in ROOMS:
            entered[name.split(".")[0]] |= rooms_entered(name) & ROOMS
    graphlib.TopologicalSorter(entered).prepare()  # raises CycleError


def test_only_rooms_at_the_disk_touch_it():
    touches = {name: disk_touches(tree) for name, tree in TREES.items()}
    inside = {name for name, calls in touches.items() if calls and name.split(".")[0] not in AT_THE_DISK}
    assert inside <= READERS, {name: touches[name] for name in inside - READERS}


@pytest.mark.parametrize("name", sorted(READERS))
def test_the_readers_of_shipped_files_only_read(name):
    assert WRITES.isdisjoint(call for _, call, _ in calls_of(TREES[name]))


@pytest.mark.parametrize(
    ("code", "found"),
    [
        ("open('a')", {".open()"}),
        ("path.open('rb')", {"path.open()"}),
        ("(folder / 'a').write_text('b')", {"?.write_text()"}),
        ("np.load('a.npz')", {"np.load()"}),
        ("cv2.imread('a.png')", {"cv2.imread()"}),
        ("def f():\n    import tifffile", {"import tifffile"}),
        ("from shutil import rmtree", {"import shutil"}),
        ("os.replace('a', 'b')", {"os.replace()"}),
        ("stream = io.BytesIO()\nnp.savez(stream, a=1)", set()),
        ("stream = io.BytesIO()\nnp.savez(path, a=1)", {"np.savez()"}),
        ("name.replace('a', 'b')\ndataclasses.replace(rig)", set()),
    ],
)
def test_the_reader_of_disk_calls_sees_them(code, found):
    assert disk_touches(ast.parse(code)) == found


def users_of(library: str) -> set[str]:
    return {name for name, tree in TREES.items() if library in {m.split(".")[0] for m in imports_of(tree)}}


def test_opencv_is_met_only_where_pixels_are():
    outside = {name for name in users_of("cv2") if name.split(".")[0] not in OPENCV_ROOMS}
    assert outside <= OPENCV_MODULES


def test_mrcal_sits_behind_one_wall():
    assert len(users_of("mrcal")) <= 1, users_of("mrcal")
