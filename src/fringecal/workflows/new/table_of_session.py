"""The content of `session.toml` that proposals make."""

from collections.abc import Mapping, Sequence
from datetime import datetime
from typing import Any

from fringecal.workflows.new.picture_series import Series
from fringecal.workflows.new.proposal import Proposal


def session_table(
    rig: str, captured: datetime, camera: Mapping[str, Any], projector: Mapping[str, Any], found: Sequence[Proposal]
) -> dict[str, Any]:
    """Return the content of `session.toml`.

    Parameters
    ----------
    rig, captured
        Of the session.
    camera, projector
        What is known of both.
    found
        The captures, each of a known kind.
    """
    shifted = [tuple(one.table["steps_deg"]) for one in found if one.table.get("steps_deg")]
    usual = max(dict.fromkeys(shifted), key=shifted.count) if shifted else None
    table: dict[str, Any] = {"format": 1, "rig": rig, "captured": captured}
    table |= {"camera": dict(camera)} if camera else {}
    table |= {"projector": dict(projector)} if projector else {}
    table |= {"phase": {"steps_deg": list(usual)}} if usual else {}
    return table | {"capture": [_capture(one, usual) for one in found]}


def _capture(one: Proposal, usual: tuple[float, ...] | None) -> dict[str, Any]:
    """Return one capture's keys; phase shifts only where they differ from the session's."""
    rest = dict(one.table)
    if usual is not None and tuple(rest.get("steps_deg", ())) == usual:
        del rest["steps_deg"]
    if usual is None or one.kind in ("grid", "board"):
        rest = {key: value for key, value in rest.items() if key != "steps_deg" or value}
    return {"name": one.name, "kind": one.kind, "target": one.target} | rest


def captured_at(series: Sequence[Series]) -> datetime:
    """Return when the last picture's file was written, to the second, with the local time zone."""
    last = max(still.modified for one in series for still in one.stills)
    return datetime.fromtimestamp(last).astimezone().replace(microsecond=0)
