"""Written procedures as a walk: which steps a session folder shows to be done, which not, and what is wrong."""

import re
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

from fringecal.errors import FringecalError
from fringecal.session import Fault, SessionCheck

State = Literal["done", "missing", "wrong", "optional", "by hand"]


@dataclass(frozen=True)
class Page:
    """A written procedure.

    Parameters
    ----------
    name, title, purpose
        Name of its file, and what its page says first.
    function, verb
        The function that evaluates it, ``"module:name"``, and the verb that runs it.
    steps
        Its steps in words, as on the page.
    needs, helps
        Kind of the capture that a step puts into the session, by the step's number from 1: needed, or of use.
    takes_part
        Steps whose capture counts only where it takes part in the calibration.
    calibration
        Whether it needs a calibration record.
    command
        The command line that the page ends with.
    """

    name: str
    title: str
    purpose: str
    function: str
    verb: str
    steps: tuple[str, ...]
    command: str
    needs: Mapping[int, str] = field(default_factory=dict)
    helps: Mapping[int, str] = field(default_factory=dict)
    takes_part: tuple[int, ...] = ()
    calibration: bool = False


@dataclass(frozen=True)
class StepState:
    """One step, and what the folder shows of it; "by hand" leaves no trace in a folder.

    `captures` are those of the step's kind that count for it, `beside` those that stay out of the calibration.
    """

    number: int
    text: str
    state: State
    kind: str = ""
    faults: tuple[str, ...] = ()
    captures: tuple[str, ...] = ()
    beside: tuple[str, ...] = ()


@dataclass(frozen=True)
class Walk:
    """A procedure held against a session folder.

    Parameters
    ----------
    page, steps
        The procedure, and its steps one by one.
    faults
        What is wrong with the folder beside its captures.
    """

    page: Page
    steps: tuple[StepState, ...]
    faults: tuple[str, ...]

    @property
    def missing(self) -> tuple[str, ...]:
        """Kinds of capture that are needed and not there."""
        return tuple(dict.fromkeys(step.kind for step in self.steps if step.state == "missing"))

    @property
    def ready(self) -> bool:
        """Whether all that is needed is there, and nothing is wrong with it."""
        return not self.missing and not self.faults and all(step.state != "wrong" for step in self.steps)

    @property
    def next_step(self) -> StepState | None:
        """The first step that is missing or wrong."""
        return next((step for step in self.steps if step.state in ("missing", "wrong")), None)


def parse_page(name: str, text: str) -> Page:
    """Read a page: front matter between lines of ``+++``, a title, and the sections that all pages have.

    Raises
    ------
    FringecalError
        The page has no such form.
    """
    try:
        _, front, body = text.split("+++\n", 2)
        stated = tomllib.loads(front)
        (command,) = re.findall(r"```sh\n(.+?)\n```", body)
        return Page(
            name=name,
            title=_first(r"^# (.+)$", body),
            purpose=_one_line(_section(body, "Purpose")),
            function=stated["function"],
            verb=stated["verb"],
            steps=_steps(_section(body, "Procedure")),
            command=command,
            needs={int(step): kind for step, kind in stated.get("needs", {}).items()},
            helps={int(step): kind for step, kind in stated.get("helps", {}).items()},
            takes_part=tuple(stated.get("takes_part", ())),
            calibration=bool(stated.get("calibration", False)),
        )
    except (ValueError, KeyError) as error:
        raise FringecalError(f"procedure {name}: its page cannot be read ({error}); install fringecal again") from error


def _first(pattern: str, text: str) -> str:
    found = re.search(pattern, text, flags=re.MULTILINE)
    if found is None:
        raise ValueError(f"nothing fits {pattern!r}")
    return found[1]


def _section(body: str, heading: str) -> str:
    return _first(rf"(?s:^## {heading}\n(.*?)(?=^## |\Z))", body)


def _steps(section: str) -> tuple[str, ...]:
    """Split a numbered list; pictures and the command below it are no steps."""
    listed = section.partition("```")[0]
    items = re.split(r"^\d+\. ", listed, flags=re.MULTILINE)[1:]
    return tuple(_one_line(re.sub(r"!\[.*?\]\(.*?\)", "", item)) for item in items)


def _one_line(text: str) -> str:
    plain = re.sub(r"\[([^\]]*)\]\([^)]*\)", r"\1", text.replace("**", "").replace("`", ""))
    return " ".join(plain.split())


def walk(page: Page, check: SessionCheck) -> Walk:
    """Hold a procedure against a session folder.

    Parameters
    ----------
    page
        The procedure.
    check
        Outcome of `check_session` for the folder.
    """
    named = {name: _faults_of(name, check.faults) for name, _ in check.kinds}
    steps = tuple(_state(page, number, check, named) for number in range(1, len(page.steps) + 1))
    of_captures = {fault for faults in named.values() for fault in faults}
    return Walk(page, steps, tuple(str(fault) for fault in check.faults if str(fault) not in of_captures))


def _faults_of(capture: str, faults: tuple[Fault, ...]) -> tuple[str, ...]:
    return tuple(str(fault) for fault in faults if fault.where.startswith(f'capture "{capture}"'))


def _state(page: Page, number: int, check: SessionCheck, named: Mapping[str, tuple[str, ...]]) -> StepState:
    text = page.steps[number - 1]
    kind = page.needs.get(number) or page.helps.get(number) or ""
    if not kind:
        return StepState(number, text, "by hand")
    there = tuple(name for name, found in check.kinds if found == kind)
    beside = tuple(name for name in there if number in page.takes_part and name not in check.taking_part)
    captures = tuple(name for name in there if name not in beside)
    faults = tuple(fault for name in captures for fault in named[name])
    if not captures:
        return StepState(number, text, "missing" if number in page.needs else "optional", kind, beside=beside)
    return StepState(number, text, "wrong" if faults else "done", kind, faults, captures, beside)
