"""How many functions of the faces have an example that runs (the doctests are run with the sources)."""

import ast
from collections.abc import Iterator
from pathlib import Path

PACKAGE = Path(__file__).parents[1] / "src" / "fringecal"
#: Functions with an example when last counted: raise it with each new one.
WITH_EXAMPLE = 137


def face_of(module: Path) -> Path:
    return module / "__init__.pyi"


def named(face: Path) -> Iterator[tuple[Path, str]]:
    """Yield module and name of everything that a face hands out."""
    for node in ast.parse(face.read_text(encoding="utf-8")).body:
        if isinstance(node, ast.ImportFrom):
            for alias in node.names:
                yield face.parent.joinpath(*(node.module or "").split(".")), alias.name


def definition(module: Path, name: str) -> ast.stmt | None:
    """Find where a name is defined, through the faces of rooms within rooms."""
    if face_of(module).is_file():
        return next((definition(inner, name) for inner, one in named(face_of(module)) if one == name), None)
    body = ast.parse(module.with_suffix(".py").read_text(encoding="utf-8")).body
    return next((node for node in body if getattr(node, "name", None) == name), None)


def test_the_number_of_functions_with_an_example_does_not_fall():
    found = {
        (face.parent.name, name): definition(module, name)
        for face in PACKAGE.rglob("__init__.pyi")
        for module, name in named(face)
    }
    functions = {key: node for key, node in found.items() if isinstance(node, ast.FunctionDef)}
    shown = [key for key, node in functions.items() if ">>>" in (ast.get_docstring(node) or "")]
    assert len(shown) >= WITH_EXAMPLE, f"{len(shown)} of {len(functions)} functions of the faces have an example"
