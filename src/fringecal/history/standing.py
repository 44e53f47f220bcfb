"""How a rig stands by all its quantities: what is out, what drifts, what is in alarm, and when to look again."""

from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime, timedelta
from typing import Literal

from fringecal.history.drift import SIGNIFICANCE
from fringecal.history.due import rate_text
from fringecal.history.review import Review
from fringecal.history.run_lengths import cusum_run_length, ewma_run_length, shewhart_run_length
from fringecal.uncertainty import value_text

type State = Literal["out", "warning", "in control", "too few records"]


@dataclass(frozen=True)
class Standing:
    """The quantities of a rig, sorted by what they say; `next_review` is the one that is due first, if any is.

    `drifting` hold a rate that is significant among all that were tested (Bonferroni): of twenty steady quantities
    one would have one at 5 % by chance.
    """

    out: tuple[Review, ...]
    drifting: tuple[Review, ...]
    alarming: tuple[Review, ...]
    jumped: tuple[Review, ...]
    too_few: tuple[Review, ...]
    next_review: Review | None
    charts: int

    @property
    def state(self) -> State:
        """The worst of what was found."""
        if self.out:
            return "out"
        if self.alarming or self.drifting or self.jumped:
            return "warning"
        return "in control" if self.charts or self.next_review else "too few records"

    @property
    def due(self) -> datetime | None:
        """When to look at the rig again; None where its records do not say."""
        return None if self.next_review is None else due_date(self.next_review)

    @property
    def records_between_false_alarms(self) -> float:
        """After how many records chance alone raises one alarm on a rig in control with so many charts."""
        rate = sum(1 / length() for length in (shewhart_run_length, ewma_run_length, cusum_run_length)) / 3
        return 1 / (rate * max(self.charts, 1))


def due_date(review: Review) -> datetime | None:
    """Return the date on which a quantity is due, counted from its last record."""
    if review.due.days is None:
        return None
    return datetime.fromisoformat(review.series.captured[-1]) + timedelta(days=review.due.days)


def standing_of(reviews: Sequence[Review]) -> Standing:
    """Sort a rig's reviews by what they say.

    Parameters
    ----------
    reviews
        All of one rig.
    """
    tested = [one for one in reviews if one.drift is not None]
    dated = [(due, one) for one in reviews if (due := due_date(one)) is not None]
    return Standing(
        out=tuple(one for one in reviews if one.out),
        drifting=tuple(one for one in tested if one.drift and one.drift.p_value < SIGNIFICANCE / len(tested)),
        alarming=tuple(one for one in reviews if one.alarms),
        jumped=tuple(one for one in reviews if one.jumps),
        too_few=tuple(one for one in reviews if one.drift is None and not one.charts),
        next_review=min(dated, key=lambda pair: pair[0], default=(None, None))[1],
        charts=sum(len(one.charts) for one in reviews),
    )


def standing_sentences(standing: Standing) -> tuple[str, ...]:
    """Say in this order what is out, what is out of control, what jumped, what drifts, and what is due."""
    out = [f"{one.series.quantity}, {one.due.reason}" for one in standing.out]
    alarms = [f"{one.series.quantity} ({', '.join(one.alarms)})" for one in standing.alarming]
    jumps = [f"{one.series.quantity} ({', '.join(day[:10] for day in one.jumps)})" for one in standing.jumped]
    drifts = [f"{one.series.quantity}, {rate_text(one.drift)}" for one in standing.drifting if one.drift]
    lists = (
        ("Out of its limit", out),
        ("Out of control at the last record", alarms),
        ("Jumped", jumps),
        ("Drifts", drifts),
    )
    said = tuple(f"{head}: {'; '.join(items)}." for head, items in lists if items)
    return (*said, due_sentence(standing))


def due_sentence(standing: Standing) -> str:
    """Say when to look again, by which quantity and why, or that the records do not say."""
    review, due = standing.next_review, standing.due
    if review is None or due is None:
        return "When to calibrate next: not enough to say."
    when = "now" if review.due.days == 0 else f"by {due:%Y-%m-%d}"
    return f"Due {when}, by {review.series.quantity} ({review.due.method}): {review.due.reason}."


def last_text(review: Review) -> str:
    """Print the last value of a quantity to the second digit of its uncertainty, with its unit."""
    series = review.series
    u = float(series.U[-1]) / 2  # to the digits alone
    return f"{value_text(float(series.values[-1]), u, sign=series.change or series.certified)} {series.unit}".rstrip()
