"""Influences, findings, moves and causes are known by their members: what a reader sees of them steers nothing."""

import ast
from collections.abc import Iterator
from enum import Enum
from pathlib import Path

from fringecal.phase.diagnostics.finding_kinds import FindingKind
from fringecal.uncertainty.influences import Influence

PACKAGE = Path(__file__).parents[1] / "src" / "fringecal"
TEXT_ROOMS = {"uncertainty", "report"}
NAMES = {name for kind in (Influence, FindingKind) for one in kind for name in (one.value, one.text)}
#: Of one word: they name other things in the code as well.
NAMES = {name for name in NAMES if " " in name}
#: Headings of the lens report, whose numbers are the principal point's own; and the one table of the findings' texts.
ALLOWED = {
    "workflows/lens/report.py": {"principal point, u", "principal point, v"},
    "phase/diagnostics/finding_kinds.py": {one.text for one in FindingKind},
}


def left_aside(tree: ast.Module) -> set[int]:
    """Docstrings, the bodies of enumerations, and the tables of their texts."""
    found = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant):
            found.add(id(node.value))
        if isinstance(node, ast.ClassDef) and any(getattr(base, "id", "") == Enum.__name__ for base in node.bases):
            found |= {id(inside) for inside in ast.walk(node)}
        if isinstance(node, ast.AnnAssign) and getattr(node.target, "id", "").endswith("TEXTS"):
            found |= {id(inside) for inside in ast.walk(node)}
    return found


def named(source: str) -> Iterator[str]:
    """Names of influences and findings that stand as strings in a piece of source."""
    tree = ast.parse(source)
    aside = left_aside(tree)
    for node in ast.walk(tree):
        if isinstance(node, ast.Constant) and node.value in NAMES and id(node) not in aside:
            yield node.value


def compared(source: str) -> Iterator[str]:
    """Comparisons with what a reader sees, or with what files hold, in place of a member."""
    seen = ("text", "identifier", "label")
    for node in ast.walk(ast.parse(source)):
        operands = [node.left, *node.comparators] if isinstance(node, ast.Compare) else []
        strings = any(isinstance(one, ast.Constant) and isinstance(one.value, str) for one in operands)
        if strings and any(isinstance(one, ast.Attribute) and one.attr in seen for one in operands):
            yield ast.unparse(node)
        match node:
            case ast.Call(func=ast.Attribute(value=ast.Attribute(attr=attr), attr="startswith" | "endswith")):
                if attr in seen:
                    yield ast.unparse(node)


def sources() -> Iterator[tuple[str, str]]:
    for path in sorted(PACKAGE.rglob("*.py")):
        place = path.relative_to(PACKAGE).as_posix()
        if place.split("/")[0] not in TEXT_ROOMS:
            yield place, path.read_text(encoding="utf-8")


def test_no_string_names_an_influence_or_a_finding():
    found = {place: set(named(source)) - ALLOWED.get(place, set()) for place, source in sources()}
    assert {place: names for place, names in found.items() if names} == {}


def test_nothing_is_decided_by_what_a_reader_sees():
    found = {place: list(compared(source)) for place, source in sources()}
    assert {place: texts for place, texts in found.items() if texts} == {}


def test_these_tests_see_what_they_look_for():
    old = 'shared = [m for m in modes if m.label != "phase scatter" and not m.label.startswith(CAMERA)]'
    assert list(named(old)) == ["phase scatter"]
    assert list(compared(old)) == ["m.label != 'phase scatter'", "m.label.startswith(CAMERA)"]
    assert list(named('class A(Enum):\n    B = "strip height"\nA_TEXTS: dict[A, str] = {A.B: "grid pitch"}\n')) == []
