"""A page of vector shapes in millimetres, and its text as SVG and as PDF.

Both are written by hand: a sheet is only rectangles, discs and lines of text, and nothing may round, hint or
rescale a millimetre on the way. The PDF asks the viewer not to fit the page to the paper.
"""

import math
from dataclasses import dataclass
from typing import Literal
from xml.sax.saxutils import escape

POINTS_PER_MM = 72 / 25.4  # points of 1/72 inch, as PDF counts them
DIGIT_WIDTH = 0.556  # of the font size, Helvetica
# Control points of a quarter circle as a cubic; the curve leaves the circle by at most 2.8e-4 of the radius.
QUARTER_ARC = 4 / 3 * (math.sqrt(2) - 1)

type Ink = Literal["black", "white"]


@dataclass(frozen=True)
class Rectangle:
    """A filled rectangle with its low corner at (x, y), mm."""

    x: float
    y: float
    width: float
    height: float
    ink: Ink = "black"


@dataclass(frozen=True)
class Disc:
    """A filled circle about (x, y), mm."""

    x: float
    y: float
    radius: float
    ink: Ink = "black"


@dataclass(frozen=True)
class Label:
    """One line of text with its baseline through (x, y); `size` is the font size, mm."""

    x: float
    y: float
    size: float
    text: str
    anchor: Literal["start", "middle", "end"] = "start"

    @property
    def width_mm(self) -> float:
        """Width in Helvetica, estimated: digits are 0.556 of the size, and text is narrower on average."""
        return DIGIT_WIDTH * self.size * len(self.text)


type Shape = Rectangle | Disc | Label


@dataclass(frozen=True)
class Drawing:
    """Shapes on a page, mm, x to the right and y down from the page's top left corner, drawn in order."""

    width_mm: float
    height_mm: float
    title: str
    shapes: tuple[Shape, ...]


def svg(drawing: Drawing) -> str:
    """Write a drawing as SVG with both size and coordinates in millimetres.

    Examples
    --------
    >>> print(svg(Drawing(20, 10, "one square", (Rectangle(5, 2, 4, 4),))))
    <?xml version="1.0" encoding="UTF-8"?>
    <svg xmlns="http://www.w3.org/2000/svg" width="20mm" height="10mm" viewBox="0 0 20 10">
    <title>one square</title>
    <rect x="0" y="0" width="20" height="10" fill="white"/>
    <rect x="5" y="2" width="4" height="4" fill="black"/>
    </svg>
    <BLANKLINE>
    """
    width, height = _mm(drawing.width_mm), _mm(drawing.height_mm)
    paper = Rectangle(0, 0, drawing.width_mm, drawing.height_mm, "white")
    lines = [
        '<?xml version="1.0" encoding="UTF-8"?>',
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{width}mm" height="{height}mm" '
        f'viewBox="0 0 {width} {height}">',
        f"<title>{escape(drawing.title)}</title>",
        *(_svg_shape(shape) for shape in (paper, *drawing.shapes)),
        "</svg>",
    ]
    return "\n".join(lines) + "\n"


def pdf(drawing: Drawing) -> bytes:
    """Write a drawing as a one-page PDF of exact size; it holds no date: equal drawings, equal bytes."""
    box = f"0 0 {drawing.width_mm * POINTS_PER_MM:.6f} {drawing.height_mm * POINTS_PER_MM:.6f}"
    content = _pdf_content(drawing)
    objects = (
        b"<< /Type /Catalog /Pages 2 0 R /ViewerPreferences << /PrintScaling /None >> >>",
        b"<< /Type /Pages /Kids [3 0 R] /Count 1 >>",
        b"<< /Type /Page /Parent 2 0 R /MediaBox [%s] /Contents 4 0 R "
        b"/Resources << /Font << /F 5 0 R >> >> >>" % box.encode(),
        b"<< /Length %d >>\nstream\n%s\nendstream" % (len(content), content),
        b"<< /Type /Font /Subtype /Type1 /BaseFont /Helvetica /Encoding /WinAnsiEncoding >>",
        b"<< /Title %s /Producer (fringecal) >>" % _pdf_string(drawing.title),
    )
    return _pdf_file(objects)


def _mm(length: float) -> str:
    return f"{length:.4f}".rstrip("0").rstrip(".")


def _svg_shape(shape: Shape) -> str:
    x, y = _mm(shape.x), _mm(shape.y)
    match shape:
        case Rectangle():
            size = f'width="{_mm(shape.width)}" height="{_mm(shape.height)}"'
            return f'<rect x="{x}" y="{y}" {size} fill="{shape.ink}"/>'
        case Disc():
            return f'<circle cx="{x}" cy="{y}" r="{_mm(shape.radius)}" fill="{shape.ink}"/>'
        case Label():
            font = f'font-family="Helvetica, Arial, sans-serif" font-size="{_mm(shape.size)}"'
            return f'<text x="{x}" y="{y}" {font} text-anchor="{shape.anchor}">{escape(shape.text)}</text>'


def _pdf_content(drawing: Drawing) -> bytes:
    # One matrix turns points, y up, into millimetres, y down: every number after it is the drawing's own.
    scale, top = POINTS_PER_MM, drawing.height_mm * POINTS_PER_MM
    lines = [f"{scale:.9f} 0 0 {-scale:.9f} 0 {top:.6f} cm".encode()]
    return b"\n".join([*lines, *(_pdf_shape(shape) for shape in drawing.shapes)])


def _pdf_shape(shape: Shape) -> bytes:
    if isinstance(shape, Label):
        x = shape.x - {"start": 0.0, "middle": 0.5, "end": 1.0}[shape.anchor] * shape.width_mm
        place = f"BT 0 g /F {_mm(shape.size)} Tf 1 0 0 -1 {_mm(x)} {_mm(shape.y)} Tm "
        return place.encode() + _pdf_string(shape.text) + b" Tj ET"
    ink = "0 g" if shape.ink == "black" else "1 g"
    if isinstance(shape, Rectangle):
        return f"{ink} {_mm(shape.x)} {_mm(shape.y)} {_mm(shape.width)} {_mm(shape.height)} re f".encode()
    return f"{ink} {_pdf_circle(shape)} f".encode()


def _pdf_circle(disc: Disc) -> str:
    r, c = disc.radius, QUARTER_ARC * disc.radius
    quarters = ((r, c, c, r, 0, r), (-c, r, -r, c, -r, 0), (-r, -c, -c, -r, 0, -r), (c, -r, r, -c, r, 0))
    curves = (" ".join(_around(disc, quarter)) + " c" for quarter in quarters)
    return f"{_mm(disc.x + r)} {_mm(disc.y)} m {' '.join(curves)}"


def _around(disc: Disc, offsets: tuple[float, ...]) -> list[str]:
    return [_mm((disc.x, disc.y)[k % 2] + offset) for k, offset in enumerate(offsets)]


def _pdf_string(text: str) -> bytes:
    raw = text.encode("cp1252", errors="replace")
    for special in (b"\\", b"(", b")"):
        raw = raw.replace(special, b"\\" + special)
    return b"(" + raw + b")"


def _pdf_file(objects: tuple[bytes, ...]) -> bytes:
    """Join objects into a file with the table of their places; the catalog is first, the information last."""
    written = b"%PDF-1.6\n%\xe2\xe3\xcf\xd3\n"
    places = []
    for number, body in enumerate(objects, start=1):
        places.append(len(written))
        written += b"%d 0 obj\n%s\nendobj\n" % (number, body)
    table = b"".join(b"%010d 00000 n \n" % place for place in places)
    count = len(objects) + 1
    return written + (
        b"xref\n0 %d\n0000000000 65535 f \n%strailer\n<< /Size %d /Root 1 0 R /Info %d 0 R >>\n"
        b"startxref\n%d\n%%%%EOF\n" % (count, table, count, len(objects), len(written))
    )
