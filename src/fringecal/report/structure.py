"""The content of a report, apart from its layout."""

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from datetime import datetime
from typing import Literal

import pandas as pd
from matplotlib.figure import Figure

from fringecal.report.readable import ReadableMap

AS_U = "an uncertainty"  # two significant digits
DOF = "degrees of freedom"

_LONGEST_SLUG = 60  # letters of a file's name, so that a folder of results fits every file system

Decision = Literal["pass", "conditionalPass", "conditionalFail", "fail", "info"]


def slug(caption: str) -> str:
    """Turn a caption into the stem of a file name.

    Examples
    --------
    >>> slug("Profiles, edge zones left out / mm")
    'profiles-edge-zones-left-out-mm'
    """
    return re.sub(r"[^a-z0-9]+", "-", caption.lower()).strip("-")[:_LONGEST_SLUG].strip("-") or "untitled"


@dataclass(frozen=True)
class Verdict:
    """The answer of the whole report: a decision and the sentence that defends it."""

    decision: Decision
    sentence: str


@dataclass(frozen=True)
class Fact:
    """One headline number as text, for example ``Fact("Mean scale", "0.7340(2) mm/px")``."""

    name: str
    value: str
    note: str = ""


@dataclass(frozen=True)
class Table:
    """A table with its caption; numbers stay numbers so that the download keeps every digit.

    Parameters
    ----------
    caption
        What the table shows; also names the file it is downloaded as.
    frame
        The rows; column names carry their unit (``"angle / deg"``).
    header_note
        Convention that the numbers follow, printed with the caption.
    formats
        Format specification by column (``{"angle / deg": ".2f"}``), `AS_U` for uncertainties, or `DOF`; others get
        4 digits.
    uncertainties
        By column, the one that holds its uncertainty: each value is printed to the second digit of its own.
    row_header
        Whether the first column names its row, as it mostly does.
    """

    caption: str
    frame: pd.DataFrame
    header_note: str = ""
    formats: Mapping[str, str] = field(default_factory=dict)
    uncertainties: Mapping[str, str] = field(default_factory=dict)
    row_header: bool = True


@dataclass(frozen=True)
class FigureItem:
    """A figure with its caption and what it shows in words, for a reader who cannot see it.

    `encoding` is ``"svg"`` for lines and small maps, ``"png"`` for dense maps and 3-D views. `live` lets the
    reader of the page take values off the figure's first axes; on paper the figure is the same without it.
    """

    caption: str
    figure: Figure
    alt: str
    encoding: Literal["svg", "png"] = "svg"
    live: "Live | None" = None


@dataclass(frozen=True)
class Live:
    """What a figure shows, as numbers: read under the pointer, or turned in three dimensions.

    `stretch` is the factor by which heights are stretched against x and y where the figure is a surface that can be
    turned, and None where it is a flat map.
    """

    values: ReadableMap
    stretch: float | None = None


@dataclass(frozen=True)
class Section:
    """A part of the report: plain sentences first, then tables, then figures.

    `side_by_side` sets the figures beside one another where a page is wide enough for two.
    """

    title: str
    sentences: tuple[str, ...] = ()
    tables: tuple[Table, ...] = ()
    figures: tuple[FigureItem, ...] = ()
    side_by_side: bool = False


@dataclass(frozen=True)
class InputFile:
    """A file that the results were computed from, with its hash."""

    capture: str
    file: str
    sha256: str


@dataclass(frozen=True)
class Report:
    """The content of a report, in its order.

    Parameters
    ----------
    title, subtitle
        What was done, and to which rig and when.
    verdict
        Decision and sentence; printed first.
    facts
        Headline numbers as text.
    sections
        The body.
    inputs
        Files with hashes.
    versions
        Software by name.
    command
        Command line that made the report.
    created
        Time of writing, with its zone.
    """

    title: str
    verdict: Verdict
    facts: tuple[Fact, ...] = ()
    sections: tuple[Section, ...] = ()
    inputs: tuple[InputFile, ...] = ()
    versions: Mapping[str, str] = field(default_factory=dict)
    subtitle: str = ""
    command: str = ""
    created: datetime | None = None
