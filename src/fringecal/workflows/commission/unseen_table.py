"""What a wrong statement could have done to heights without showing, as a table of the report."""

import pandas as pd

from fringecal.records import Limits
from fringecal.report import Table
from fringecal.workflows.commission.run import Commissioning
from fringecal.workflows.commission.testability import MOST_OFF, statements_tested

_NOTE = (
    "smallest error of each statement that this session shows with a probability of 95 %, each check by itself, and "
    "the largest height error over the field by it"
)


def unseen_tables(found: Commissioning, limits: Limits) -> tuple[Table, ...]:
    """Tabulate each statement with the smallest error of it that would have shown."""
    rows = [
        {
            "stated": one.name,
            "value": f"{one.stated.value:.6g} {one.stated.unit}",
            "smallest error that shows / %": f"{100 * one.error_rel:.2g}"
            if one.error_rel <= MOST_OFF
            else f"> {100 * MOST_OFF:g}",
            "height error by it / %": one.height_percent,
            "limit / %": limits.commission.height_percent,
            "shown by": one.shown_by or "no check",
            "heights rest on it": "yes" if one.carries else "no",
        }
        for one in statements_tested(found, limits)
    ]
    if not rows:
        return ()
    formats = {"height error by it / %": ".2g", "limit / %": ".2g"}
    return (Table("What a wrong statement would have shown", pd.DataFrame(rows), _NOTE, formats),)
