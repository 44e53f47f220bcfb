"""Lay out the pages of the site: `python docs/stage.py`, before `mkdocs build`; see `make docs`.

The pages keep their places, so that their links hold on the site as they do in the source tree; one page per room lists
its modules for the reference, and one shows the help of every verb.
"""

import re
import shutil
import tomllib
from pathlib import Path

import typer

from fringecal.cli.app import VERBS, build_app

ROOT = Path(__file__).parents[1]
PAGES = ROOT / "build" / "pages"
PATTERNS = (
    *("README.md", "CHANGELOG.md", "LICENSE"),
    *("docs/**/*.md", "docs/*.toml", "docs/notebooks/*.py", "docs/images/*", "procedures/**/*", "targets/*"),
)

COMMANDS = """# Commands

Every verb with its arguments and options, as `--help` shows them; this page is made from the program itself.
`fringecal --version` prints the version, `fringecal VERB --help` (or `-h`) what stands here.

| exit code | |
|---|---|
| 0 | pass, or conditional: nothing fails |
| 1 | error: the job could not be done; the message says what was found, what was needed and what to do |
| 2 | usage: an unknown verb or option, or a value that it cannot take |
| 3 | done, and out of tolerance: a check fails, the doctor finds a fault, a chart is in alarm, a rerun differs |
"""


def main() -> None:
    shutil.rmtree(PAGES, ignore_errors=True)
    for pattern in PATTERNS:
        for file in filter(Path.is_file, ROOT.glob(pattern)):
            place = PAGES / file.relative_to(ROOT)
            place.parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(file, place)
            if file.parent.name == "procedures" and file.name != "README.md":
                place.write_text(procedure_page(file.read_text(encoding="utf-8")), encoding="utf-8")
    reference = PAGES / "reference"
    reference.mkdir()
    for room in sorted(path.parent for path in (ROOT / "src" / "fringecal").glob("*/__init__.py")):
        (reference / f"{room.name}.md").write_text(room_page(room), encoding="utf-8")
    (reference / "errors.md").write_text("# errors\n\n::: fringecal.errors\n", encoding="utf-8")
    (reference / "commands.md").write_text(commands_page(), encoding="utf-8")


def procedure_page(text: str) -> str:
    """A bench page with its front matter as a sentence below the title."""
    _, front, body = text.split("+++\n", 2)
    stated = tomllib.loads(front)
    function = stated["function"].replace(":", ".")
    pairing = f"Run by `fringecal {stated['verb']}`, evaluated by `{function}`; walked by `fringecal procedure run`.\n"
    title, _, rest = body.partition("\n")
    return f"{title}\n\n{pairing}\n{rest}"


def room_page(room: Path) -> str:
    """One section per module of a room and of its folders, from its docstrings."""
    files = sorted(path for path in room.rglob("*.py") if path.stem != "__init__" and not path.stem.endswith("kernels"))
    modules = (".".join(path.relative_to(room.parent).with_suffix("").parts) for path in files)
    return f"# {room.name}\n\n" + "\n".join(f"::: fringecal.{module}\n" for module in modules)


def commands_page() -> str:
    """The help of every verb, as the command prints it."""
    group = typer.main.get_command(build_app())
    parts = [COMMANDS]
    for verb in VERBS:
        command = group.commands[verb]
        for name, one in getattr(command, "commands", {"": command}).items():
            words = f"fringecal {verb} {name}".strip()
            context = typer.Context(one, info_name=words, max_content_width=100)
            told = "\n\n".join(filter(None, (one.help, one.epilog)))
            parts.append(f"## {words}\n\n{as_page(told)}\n\n{options_of(one, context)}\n")
    return "\n".join(parts)


def as_page(text: str) -> str:
    """Help in paragraphs, its examples as commands."""
    return re.sub(r"^ *Example: (.+)$", r"```sh\n\1\n```", text.strip(), flags=re.MULTILINE)


def options_of(command: typer.core.TyperCommand, context: typer.Context) -> str:
    """A table of arguments and options: what each takes, its default, and whether it is needed."""
    rows = [one.get_help_record(context) for one in command.params]
    return "\n".join(
        ("| argument or option | |", "|---|---|", *(f"| `{name}` | {' '.join(text.split())} |" for name, text in rows))
    )


if __name__ == "__main__":
    main()
