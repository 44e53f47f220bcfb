"""Judge every option and argument of every verb by its kind: no verb has to think of what is senseless everywhere."""

import inspect
import math
import os
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any, get_args

import typer

# Lengths, tolerances and factors are above zero unless a verb states `min`, or their name stands here.
SIGNED = {
    "reference": "a value of any sign, and zero",
    "lowest": "a height below the plate",
    "highest": "a height below the plate",
}
_LONGEST_NAME = 255  # bytes of one name in a path, on every file system in use


def judge_options(app: typer.Typer) -> None:
    """Have every parameter of an application refused that is empty, not finite, or of a sign that makes no sense.

    Parameters
    ----------
    app
        With its verbs registered; those in groups are judged too.
    """
    for _, name, kinds, stated in parameters_of(app):
        if Path in kinds:
            stated.parser = _path
        elif stated.callback is None and {int, float, str} & set(kinds):
            stated.callback = _judge(name, kinds, stated)


def parameters_of(app: typer.Typer, verb: tuple[str, ...] = ()) -> Iterator[tuple[tuple[str, ...], str, tuple, Any]]:
    """Yield words of the verb, name, kinds and Typer's statement of every parameter that takes a value.

    Kinds are the types that one value may have: of ``list[Path] | None`` it is ``(Path,)``.
    """
    for command in app.registered_commands:
        callback = command.callback
        assert callback is not None
        words = (*verb, command.name or callback.__name__)
        for name, one in inspect.signature(callback, eval_str=True).parameters.items():
            if one.annotation is not bool:
                yield words, name, _kinds(one.annotation), one.default
    for group in app.registered_groups:
        assert group.typer_instance is not None
        yield from parameters_of(group.typer_instance, (*verb, str(group.name)))


def _kinds(annotation: Any) -> tuple[Any, ...]:
    inner = [kind for kind in get_args(annotation) if kind is not type(None)]
    return tuple(found for kind in inner for found in _kinds(kind)) if inner else (annotation,)


def _path(text: str) -> Path:
    """Read a path, before an empty one turns into the folder where the command runs."""
    if not text:
        raise typer.BadParameter("an empty path; name a file or a folder, '.' for the one that you are in")
    longest = max(len(os.fsencode(part)) for part in text.split(os.sep))
    if longest > _LONGEST_NAME:
        raise typer.BadParameter(f"a name of {longest} bytes in a path, at most {_LONGEST_NAME} are possible")
    return Path(text)


def _judge(name: str, kinds: tuple[Any, ...], stated: Any) -> Callable[..., Any]:
    demand = _demand_text if str in kinds else _demand_number

    def judge(context: typer.Context, value: Any) -> Any:
        source = context.get_parameter_source(name)
        is_given = source is not None and source.name not in ("DEFAULT", "DEFAULT_MAP")
        for one in (value if isinstance(value, list | tuple) else (value,)) if is_given else ():
            demand(one, {"name": name, "min": stated.min, "max": stated.max})
        return value

    return judge


def _demand_text(value: str | None, _: Mapping[str, Any]) -> None:
    if value is not None and not value.strip():
        raise typer.BadParameter("empty; leave it out, or state what is meant")


def _demand_number(value: float | None, rule: Mapping[str, Any]) -> None:
    if value is None:
        return
    if not math.isfinite(value):
        raise typer.BadParameter(f"{value} is no finite number")
    is_free = rule["name"] in SIGNED or rule["min"] is not None
    if not is_free and (value < 0 or (value == 0 and isinstance(value, float))):
        raise typer.BadParameter(f"{value:g} makes no sense here; a number above zero was needed")
