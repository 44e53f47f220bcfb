"""The doors between the rooms, read from the source and held against docs/house.md."""

import ast
import graphlib
import importlib
import inspect
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PACKAGE = ROOT / "src" / "fringecal"

EVERYONE = {"errors", "guarded", "guarded_arrays", "numerics", "replacement", "uncertainty"}
MEASURING = {
    "session", "targets", "detect", "phase", "camera", "projector", "calibration", "reconstruct", "verification",
}  # fmt: skip
TELLING = {"records", "history", "report"}
ALLOWED = {
    "uncertainty": {"errors", "numerics"},
    "targets": EVERYONE,
    "session": EVERYONE | {"targets"},
    "detect": EVERYONE,
    "phase": EVERYONE,
    "camera": EVERYONE | {"detect", "targets"},
    "projector": EVERYONE | {"detect", "phase", "camera", "targets"},
    "calibration": EVERYONE | {"detect", "phase", "camera", "projector", "targets"},
    "reconstruct": EVERYONE | {"phase", "camera", "projector"},
    "verification": EVERYONE | {"targets", "reconstruct"},
    "records": EVERYONE | {"targets", "camera", "projector", "reconstruct", "verification"},
    "history": EVERYONE | {"records"},
    "report": EVERYONE | MEASURING | {"records", "history"},
    "patterns": EVERYONE,
    "simulate": {"errors", "guarded", "targets"},  # shares no estimate with the code that it tests
    "thesis": EVERYONE | {"phase", "simulate"},
    "workflows": EVERYONE | MEASURING | TELLING | {"simulate", "patterns", "thesis"},
    "library": EVERYONE | MEASURING | TELLING | {"workflows"},
    "serve": EVERYONE | {"session"} | TELLING | {"workflows"},
    "cli": EVERYONE | MEASURING | TELLING | {"simulate", "patterns", "thesis", "workflows", "library", "serve"},
}
# Of the folders of `workflows`, which may call which: all may use `shared`.
WORKFLOWS = {
    "shared": set(),
    "grid": set(),
    "lens": set(),
    "new": set(),
    "verify": set(),
    "reconstruct": set(),
    "procedure": set(),
    "history": set(),
    "certificate": set(),
    "compare": set(),
    "commission": {"grid", "lens", "verify"},
    "angle": {"commission"},
    "study": {"commission"},
    "audit": {"commission", "lens", "verify"},
    "rerun": {"audit", "commission", "verify"},
    "demo": {"commission", "reconstruct", "verify"},
}

AT_THE_DISK = {"session", "records", "history", "report", "serve", "cli"}
READERS = {"targets.target_files", "simulate.rig.rig_files", "guarded"}  # TOML files of a room; text within limits
WRITERS = {"replacement"}  # puts in place what session and records have written
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
DISK_MODULES = {"sqlalchemy", "pyarrow", "tifffile", "shutil", "tempfile", "sqlite3", "x3pio", "imageio"}
WRITES = {"mkdir", "makedirs", "rmdir", "unlink", "rename", "touch", "write_text", "write_bytes", "imwrite"}

OPENCV_ROOMS = {"session", "detect", "phase", "camera", "reconstruct"}
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


def face_of(module: str) -> str:
    """The face that others meet: of the room, or of the folder of a verb in `workflows`."""
    parts = module.split(".")
    return ".".join(parts[: 2 if parts[0] == "workflows" else 1])


def past_a_face(name: str) -> set[str]:
    """Modules of other rooms that a module imports by their own path instead of their room's."""
    met = {module.removeprefix("fringecal.") for module in imports_of(TREES[name]) if module.startswith("fringecal.")}
    return {module for module in met if face_of(module) != face_of(name) and module != face_of(module)}


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
    table = text.partition("| may import")[2].partition("\n\n")[0]
    return dict(re.findall(r"^\| `(\w+)` \|[^|]*\|([^|]*)\|$", table, flags=re.MULTILINE))


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
    assert {name.split(".")[0] for name in SOURCES} - {
        "",
        "errors",
        "guarded",
        "guarded_arrays",
        "numerics",
        "replacement",
        "__main__",
    } == ROOMS


@pytest.mark.parametrize("room", sorted(ALLOWED))
def test_imports_go_through_the_doors(room):
    entered = {name: rooms_entered(name) - ALLOWED[room] for name in SOURCES if name.split(".")[0] == room}
    assert {name: rooms for name, rooms in entered.items() if rooms} == {}


def test_errors_and_numerics_import_no_room():
    assert rooms_entered("errors") == set()
    assert rooms_entered("numerics") <= {"errors"}
    assert rooms_entered("guarded") == rooms_entered("replacement") == set()
    assert rooms_entered("guarded_arrays") <= {"guarded"}


def test_rooms_are_entered_by_their_faces():
    """So that files can move behind them. `python -m fringecal` is the command itself."""
    past = {name: past_a_face(name) for name in SOURCES if name != "__main__"}
    assert {name: modules for name, modules in past.items() if modules} == {}


@pytest.mark.parametrize("folder", sorted(WORKFLOWS))
def test_workflows_call_one_another_one_way(folder):
    mine = f"workflows.{folder}"
    called = {
        face_of(module.removeprefix("fringecal.")).removeprefix("workflows.")
        for name in SOURCES
        if face_of(name) == mine
        for module in imports_of(TREES[name])
        if module.startswith("fringecal.workflows.")
    }
    assert called - {folder, "shared"} <= WORKFLOWS[folder]


def test_every_workflow_stands_in_the_plan():
    assert {path.parent.name for path in (PACKAGE / "workflows").glob("*/__init__.py")} == set(WORKFLOWS)
    graphlib.TopologicalSorter(WORKFLOWS).prepare()  # raises CycleError


FACES = sorted(path.parent.relative_to(PACKAGE).as_posix() for path in PACKAGE.rglob("*/__init__.pyi"))


@pytest.mark.parametrize("folder", FACES)
def test_a_face_shows_what_it_names(folder):
    """Every name leads somewhere, has a docstring of its own if it is a function or class, and is no file's name."""
    face = importlib.import_module("fringecal." + folder.replace("/", "."))
    assert face.__doc__
    inside = {path.stem for path in (PACKAGE / folder).iterdir()}
    assert inside.isdisjoint(face.__all__), "a submodule would hide the name once it is imported"
    for name in face.__all__:
        value = getattr(face, name)
        if inspect.isfunction(value) or inspect.isclass(value):
            assert value.__doc__, f"{folder}: {name}"


# Files that mean the same wherever they stand: a workflow's stages.
STAGES = {"__init__", "run", "checks", "record", "report"}
MOST_MODULES = 15


def test_no_file_name_stands_in_two_rooms():
    """A verb's module in `cli` has the verb's name, as its folder in `workflows` has."""
    places: dict[str, list[str]] = {}
    for name, path in SOURCES.items():
        if path.stem not in STAGES and name.rpartition(".")[0] != "cli":
            places.setdefault(path.stem, []).append(name)
    assert {stem: names for stem, names in places.items() if len(names) > 1} == {}


def test_a_large_folder_has_its_reason_in_the_house():
    page = (ROOT / "docs" / "house.md").read_text(encoding="utf-8")
    counts: dict[str, int] = {}
    for path in SOURCES.values():
        if path.stem != "__init__":
            folder = path.parent.relative_to(PACKAGE).as_posix()
            counts[folder] = counts.get(folder, 0) + 1
    large = {folder for folder, count in counts.items() if count > MOST_MODULES}
    assert {folder for folder in large if f"`{folder}/` holds" not in page} == set()


def test_no_two_rooms_import_each_other():
    entered: dict[str, set[str]] = {room: set() for room in ROOMS}
    for name in SOURCES:
        if name.split(".")[0] in ROOMS:
            entered[name.split(".")[0]] |= rooms_entered(name) & ROOMS
    graphlib.TopologicalSorter(entered).prepare()  # raises CycleError


def test_only_rooms_at_the_disk_touch_it():
    touches = {name: disk_touches(tree) for name, tree in TREES.items()}
    inside = {name for name, calls in touches.items() if calls and name.split(".")[0] not in AT_THE_DISK}
    assert inside - WRITERS <= READERS, {name: touches[name] for name in inside - READERS - WRITERS}


def test_what_replaces_folders_is_used_at_the_disk_alone():
    users = {name.split(".")[0] for name in SOURCES if "replacement" in rooms_entered(name)}
    assert users <= {"session", "records", "cli"}


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
