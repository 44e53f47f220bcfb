"""True-to-scale sheets of the printable targets, each with a 100 mm check ruler on both axes."""

import math
import textwrap
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from fringecal.errors import TargetError
from fringecal.targets.aruco import marker_bits
from fringecal.targets.geometry import Floats, asymmetric_dots_mm, board_points_mm
from fringecal.targets.kinds_of_target import Artefact, Charuco, Chessboard, Dots, LineGrid
from fringecal.targets.target_surface import footprint_mm
from fringecal.targets.vector import Disc, Drawing, Label, Rectangle, Shape

PAGES_MM = {
    "A5": (148.0, 210.0),
    "A4": (210.0, 297.0),
    "A3": (297.0, 420.0),
    "A2": (420.0, 594.0),
    "A1": (594.0, 841.0),
    "A0": (841.0, 1189.0),
    "letter": (215.9, 279.4),
    "legal": (215.9, 355.6),
    "tabloid": (279.4, 431.8),
}
PRINTABLE = (LineGrid, Chessboard, Charuco, Dots)

RULER_MM = 100.0  # long enough to show a scale that is off by 0.2 %, and short enough for every page
ROUNDING_MM = 1e-9  # of sums of millimetres: what just fits is let in
MARGIN_MM = 8.0  # that most printers can keep
# The band along the left and lower edge that holds ruler and text, and its distance from the pattern.
BAND_MM, CLEAR_MM = 10.0, 3.0
TEXT_AWAY_MM, TEXT_MM, FONT_MM, LINE_SPACING = 7.0, 72.0, 2.0, 1.15
# Marks of a ruler at every ten, five and one mm: length; width at every ten and else; size of the numbers, and how far
# they stand below the marks, left of them, and under their middle.
MARK_10_MM, MARK_5_MM, MARK_1_MM = 5.0, 3.5, 2.2
MARK_WIDTH_10_MM, MARK_WIDTH_MM = 0.2, 0.12
NUMBER_MM, NUMBER_BELOW_MM, NUMBER_LEFT_MM, NUMBER_MIDDLE_MM = 2.2, 7.4, 5.4, 0.8
INSTRUCTION = (
    "Print at actual size (100 %). Measure both rulers: 100.0 mm between the centres of marks 0 "
    "and 100. If not, discard the sheet, or measure the pattern and state its size in your own target file."
)
# Lines of a grid end this part of a pitch beyond the last crossing, so that every crossing is a whole one.
OVERHANG = 0.3
HEAVIER = 2.0  # times the width of the others, for heavy lines whose width is not stated


@dataclass(frozen=True)
class Page:
    """Paper and margin, mm."""

    width_mm: float
    height_mm: float
    margin_mm: float

    @property
    def room_mm(self) -> tuple[float, float]:
        """Width and height left for the pattern."""
        used = 2 * self.margin_mm + BAND_MM + CLEAR_MM
        return self.width_mm - used, self.height_mm - used

    @property
    def centre_mm(self) -> tuple[float, float]:
        """Centre of the room for the pattern, from the page's top left corner."""
        width, height = self.room_mm
        return self.width_mm - self.margin_mm - width / 2, self.margin_mm + height / 2


def page_size_mm(page: str) -> tuple[float, float]:
    """Width and height of a named page, or of a custom one written as ``"420x600"`` in mm.

    Examples
    --------
    >>> page_size_mm("a4"), page_size_mm("420x600")
    ((210.0, 297.0), (420.0, 600.0))
    """
    named = {name.lower(): size for name, size in PAGES_MM.items()}
    if page.lower() in named:
        return named[page.lower()]
    try:
        width, height = (float(side) for side in page.lower().split("x"))
    except ValueError:
        width = height = math.nan
    if not (0 < width < math.inf and 0 < height < math.inf):
        raise TargetError(f'unknown page "{page}"; take {", ".join(PAGES_MM)}, or a size in mm such as 420x600')
    return width, height


def sheet(target: Artefact, *, page: str = "A4", margin_mm: float = MARGIN_MM) -> Drawing:
    """Lay a printable target out on a page, upright or lying, whichever it fits.

    Parameters
    ----------
    target
        A line-grid, chessboard, charuco or dots. A line-grid without `lines` fills the page.
    page
        A name in `PAGES_MM`, or ``"WIDTHxHEIGHT"`` in mm.
    margin_mm
        What the printer leaves white at each edge, mm.

    Returns
    -------
    The drawing; `fringecal.targets.vector.svg` and `pdf` turn it into a file's content.

    Raises
    ------
    TargetError
        The target is not printable or does not fit the page; the message says by how much.
    """
    if not isinstance(target, PRINTABLE):
        raise TargetError(f'"{target.name}" is not a printed pattern; only line-grid, chessboard, charuco and dots are')
    needed = _extent_mm(target)
    paper = _choose_page(needed, page, margin_mm)
    pattern = _pattern(target, paper)
    return Drawing(paper.width_mm, paper.height_mm, target.name, (*pattern, *_rulers(paper), *_text(target, paper)))


def _choose_page(needed: tuple[float, float], page: str, margin_mm: float) -> Page:
    if not (0 <= margin_mm < math.inf):
        raise TargetError(f"the margin must be zero or more mm, found {margin_mm:g}")
    width, height = page_size_mm(page)
    papers = Page(width, height, margin_mm), Page(height, width, margin_mm)
    least = (RULER_MM + TEXT_AWAY_MM + TEXT_MM, RULER_MM)
    for paper in papers:
        if all(
            max(need, low) <= room + ROUNDING_MM for need, low, room in zip(needed, least, paper.room_mm, strict=True)
        ):
            return paper
    upright, lying = (f"{max(0, paper.room_mm[0]):g} x {max(0, paper.room_mm[1]):g} mm" for paper in papers)
    raise TargetError(
        f"the pattern needs {needed[0]:g} x {needed[1]:g} mm, "
        f"rulers and text {least[0]:g} x {least[1]:g} mm; page {page} with {margin_mm:g} mm margins leaves "
        f"{upright} upright or {lying} lying; take a larger page or smaller margins"
    )


def _extent_mm(target: Artefact) -> tuple[float, float]:
    if not isinstance(target, LineGrid):
        return footprint_mm(target)
    if target.line_width_mm is None:
        raise TargetError(f'"{target.name}" has no line_width_mm; a sheet cannot be drawn without it')
    lines = target.lines or (2, 2)
    return _grid_extent(target, lines[0]), _grid_extent(target, lines[1])


def _grid_extent(target: LineGrid, lines: int) -> float:
    return (lines - 1 + 2 * OVERHANG) * target.pitch_mm.value


def _pattern(target: Artefact, paper: Page) -> list[Shape]:
    match target:
        case LineGrid():
            return _line_grid(target, paper)
        case Chessboard():
            return _squares(target.columns + 1, target.rows + 1, target.square_mm.value, paper)
        case Charuco():
            board = _squares(*target.squares, target.square_mm.value, paper)
            return board + _markers(target, paper)
        case Dots():
            return _dots(target, paper)
    raise AssertionError(type(target))


def _line_grid(target: LineGrid, paper: Page) -> list[Shape]:
    pitch = target.pitch_mm.value
    fill = (int((room / pitch) - 2 * OVERHANG + ROUNDING_MM) + 1 for room in paper.room_mm)
    nu, nv = target.lines or fill
    ink, shapes = "black", list[Shape]()
    if target.polarity == "light":
        ink = "white"
        shapes.append(_centred(paper, 0, 0, _grid_extent(target, nu), _grid_extent(target, nv), "black"))
    for k, weight in enumerate(_line_widths(target, nu)):
        shapes.append(_centred(paper, (k - (nu - 1) / 2) * pitch, 0, weight, _grid_extent(target, nv), ink))
    for k, weight in enumerate(_line_widths(target, nv)):
        shapes.append(_centred(paper, 0, (k - (nv - 1) / 2) * pitch, _grid_extent(target, nu), weight, ink))
    return shapes


def _line_widths(target: LineGrid, lines: int) -> np.ndarray:
    """Width of each line, mm; the middle line is heavy, and heavy is twice the width if not stated."""
    assert target.line_width_mm is not None
    width = np.full(lines, target.line_width_mm.value)
    if target.heavy_every:
        heavy = target.heavy_width_mm.value if target.heavy_width_mm else HEAVIER * width[0]
        width[(lines // 2) % target.heavy_every :: target.heavy_every] = heavy
    return width


def _centred(paper: Page, x: float, y: float, width: float, height: float, ink: str) -> Rectangle:
    """Rectangle about a point given from the pattern's centre, y down."""
    cx, cy = paper.centre_mm
    return Rectangle(cx + x - width / 2, cy + y - height / 2, width, height, "white" if ink == "white" else "black")


def _cells(columns: int, rows: int, square: float, paper: Page) -> tuple[Floats, Floats]:
    """Low corner of every square on the page, mm, each of shape (rows, columns)."""
    cx, cy = paper.centre_mm
    row, column = np.mgrid[:rows, :columns]
    return cx + (column - columns / 2) * square, cy + (row - rows / 2) * square


def _squares(columns: int, rows: int, square: float, paper: Page) -> list[Shape]:
    x, y = _cells(columns, rows, square, paper)
    black = np.add.outer(np.arange(rows), np.arange(columns)) % 2 == 0
    return [Rectangle(*corner, square, square) for corner in zip(x[black], y[black], strict=True)]


def _markers(target: Charuco, paper: Page) -> list[Shape]:
    """Markers in the white squares, numbered row by row from the top left as OpenCV numbers them."""
    columns, rows = target.squares
    x, y = _cells(columns, rows, target.square_mm.value, paper)
    white = np.add.outer(np.arange(rows), np.arange(columns)) % 2 == 1
    inset = (target.square_mm.value - target.marker_mm.value) / 2
    shapes: list[Shape] = []
    for marker, corner in enumerate(zip(x[white] + inset, y[white] + inset, strict=True)):
        shapes += _marker(marker_bits(target.dictionary, marker), *corner, target.marker_mm.value)
    return shapes


def _marker(bits: np.ndarray, x: float, y: float, size: float) -> list[Shape]:
    """One black square and its white bits, joined along rows and columns so that no hairline parts them."""
    bit = size / len(bits)
    shapes: list[Shape] = [Rectangle(x, y, size, size)]
    for row, low, high in _white_runs(bits):
        shapes.append(Rectangle(x + low * bit, y + row * bit, (high - low) * bit, bit, "white"))
    for column, low, high in _white_runs(bits.T):
        shapes.append(Rectangle(x + column * bit, y + low * bit, bit, (high - low) * bit, "white"))
    return shapes


def _white_runs(bits: np.ndarray) -> Iterator[tuple[int, int, int]]:
    """Line, first bit and end of each run of white bits."""
    for line, black in enumerate(bits):
        changes = np.flatnonzero(np.diff(np.concatenate([[True], black, [True]]).astype(int)))
        for low, high in changes.reshape(-1, 2):
            yield line, int(low), int(high)


def _dots(target: Dots, paper: Page) -> list[Shape]:
    place = asymmetric_dots_mm if target.asymmetric else board_points_mm
    cx, cy = paper.centre_mm
    points = place(target.columns, target.rows, target.pitch_mm.value)
    return [Disc(cx + x, cy - y, target.diameter_mm.value / 2) for x, y, _ in points]


def _rulers(paper: Page) -> list[Shape]:
    """Draw a ruler along the lower and the left edge: the centres of marks 0 and 100 are 100 mm apart."""
    left, low = paper.margin_mm, paper.height_mm - paper.margin_mm
    x0, y0 = left + BAND_MM + CLEAR_MM, low - BAND_MM - CLEAR_MM
    shapes: list[Shape] = []
    for mm in range(int(RULER_MM) + 1):
        length = MARK_10_MM if mm % 10 == 0 else MARK_5_MM if mm % 5 == 0 else MARK_1_MM
        weight = MARK_WIDTH_10_MM if mm % 10 == 0 else MARK_WIDTH_MM
        shapes.append(Rectangle(x0 + mm - weight / 2, low - BAND_MM, weight, length))
        shapes.append(Rectangle(left + BAND_MM - length, y0 - mm - weight / 2, length, weight))
        if mm % 10 == 0:
            shapes.append(Label(x0 + mm, low - BAND_MM + NUMBER_BELOW_MM, NUMBER_MM, str(mm), "middle"))
            beside = left + BAND_MM - NUMBER_LEFT_MM
            shapes.append(Label(beside, y0 - mm + NUMBER_MIDDLE_MM, NUMBER_MM, str(mm), "end"))
    return shapes


def _text(target: Artefact, paper: Page) -> list[Shape]:
    """Name and instructions, to the right of the lower ruler."""
    x = paper.margin_mm + BAND_MM + CLEAR_MM + RULER_MM + TEXT_AWAY_MM
    room = paper.width_mm - paper.margin_mm - x
    fits = int(room / Label(0, 0, FONT_MM, "0").width_mm)
    lines = [textwrap.shorten(target.name, fits, placeholder=" ..."), *textwrap.wrap(INSTRUCTION, fits)]
    top = paper.height_mm - paper.margin_mm - BAND_MM + FONT_MM
    return [Label(x, top + k * LINE_SPACING * FONT_MM, FONT_MM, line) for k, line in enumerate(lines)]
