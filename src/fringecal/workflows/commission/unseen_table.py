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
            "quantity": one.name,
            "stated value": f"{one.stated.value:.6g} {one.stated.unit}",
            "detection limit / %": f"{100 * one.error_rel:.2g}"
            if one.error_rel <= MOST_OFF
            else f"> {100 * MOST_OFF:g}",
            "as height error / %": one.height_percent,
            "limit / %": limits.commission.height_percent,
            "check": one.shown_by or "no check",
            "use": "calibration" if one.carries else "verification",
        }
        for one in statements_tested(found, limits)
    ]
    if not rows:
        return ()
    formats = {"as height error / %": ".2g", "limit / %": ".2g"}
    return (Table("Detection limits of stated quantities", pd.DataFrame(rows), _NOTE, formats),)
