"""The sheets are read back by other means: an XML parser, the PDF's own operators, and OpenCV's detectors."""

import re
import xml.etree.ElementTree as ET

import cv2
import numpy as np
import pytest

from fringecal.errors import TargetError
from fringecal.targets import Charuco, Dots, LineGrid, Scalar, load_target
from fringecal.targets.geometry import asymmetric_dots_mm, board_points_mm
from fringecal.targets.printable_sheet import page_size_mm, sheet
from fringecal.targets.vector import Disc, Drawing, Label, Rectangle, pdf, svg

# Coordinates are written to 1e-4 mm, so differences of two are right to that.
WRITTEN_MM = 1e-4
PX_PER_MM = 8
SAID = {"name": "a target", "certificate": "test"}


def mm(value):
    return Scalar(value=value, u=0.01)


def svg_elements(drawing):
    root = ET.fromstring(svg(drawing))
    return root, [(element.tag.rpartition("}")[2], element.attrib) for element in root]


def svg_rectangles(drawing):
    """Rectangles of an SVG except the paper: x, y, width, height in mm, shape (n, 4), and their inks."""
    found = [attributes for tag, attributes in svg_elements(drawing)[1] if tag == "rect"][1:]
    boxes = np.array([[float(item[key]) for key in ("x", "y", "width", "height")] for item in found])
    return boxes, np.array([item["fill"] for item in found])


def rasterise(drawing):
    """Paint the SVG's rectangles and circles on pixels whose centres lie at (k + 0.5) / PX_PER_MM."""
    root, elements = svg_elements(drawing)
    width, height = (round(float(root.get(side).removesuffix("mm")) * PX_PER_MM) for side in ("width", "height"))
    picture = np.full((height, width), 255, np.uint8)
    u, v = (np.arange(width) + 0.5) / PX_PER_MM, (np.arange(height) + 0.5) / PX_PER_MM
    for tag, item in elements:
        grey = 255 if item.get("fill") == "white" else 0
        if tag == "rect":
            x, y, w, h = (float(item[key]) for key in ("x", "y", "width", "height"))
            columns, rows = np.searchsorted(u, [x, x + w]), np.searchsorted(v, [y, y + h])
            picture[slice(*rows), slice(*columns)] = grey
        elif tag == "circle":
            cx, cy, r = (float(item[key]) for key in ("cx", "cy", "r"))
            columns, rows = (slice(*np.searchsorted(axis, [c - r, c + r])) for axis, c in ((u, cx), (v, cy)))
            inside = (u[columns] - cx) ** 2 + (v[rows, None] - cy) ** 2 <= r**2
            picture[rows, columns][inside] = grey
    return picture


def to_mm(corners):
    """Pixel coordinates of a detector, (0, 0) the centre of the first pixel, on the page in mm."""
    return (np.asarray(corners).reshape(-1, 2) + 0.5) / PX_PER_MM


def pdf_rectangles(content):
    """Every rectangle a PDF fills, in points on the page: x, y, width, height, shape (n, 4)."""
    stream = re.search(rb"stream\n(.*)\nendstream", content, re.DOTALL).group(1).decode("cp1252")
    a, b, c, d, e, f = (float(item) for item in re.search(r"^(.+) cm$", stream, re.MULTILINE).group(1).split())
    assert (b, c) == (0, 0)
    boxes = re.findall(r"([-\d.]+) ([-\d.]+) ([-\d.]+) ([-\d.]+) re f", stream)
    return np.array([[a * float(x) + e, d * float(y) + f, a * float(w), d * float(h)] for x, y, w, h in boxes])


def centres_of_ruler_marks(boxes, axis):
    """Centres, along one axis, of the marks 0, 10 ... 100: 0.2 wide and 5 long; other lines are longer."""
    wide, long = np.abs(boxes[:, 2 + axis]), np.abs(boxes[:, 3 - axis])
    marks = boxes[np.isclose(wide, 0.2, atol=1e-3) & np.isclose(long, 5.0, atol=1e-3)]
    return np.sort(marks[:, axis] + marks[:, 2 + axis] / 2)


PRINTABLE = ["grid-10mm", "chessboard-9x6-25mm", "charuco", "dots"]


@pytest.mark.parametrize("name", PRINTABLE)
@pytest.mark.parametrize("page", ["A4", "A3", "letter", "350x360"])
def test_rulers_are_100_mm_in_svg_and_pdf(name, page):
    drawing = sheet(load_target(name), page=page)
    in_pdf_mm = pdf_rectangles(pdf(drawing)) * 25.4 / 72
    for boxes in (svg_rectangles(drawing)[0], in_pdf_mm):
        for axis in (0, 1):
            marks = centres_of_ruler_marks(boxes, axis)
            np.testing.assert_allclose(np.diff(marks), 10.0, atol=2 * WRITTEN_MM)
            assert len(marks) == 11
            assert marks[-1] - marks[0] == pytest.approx(100.0, abs=2 * WRITTEN_MM)


@pytest.mark.parametrize(("page", "size"), [("A4", (210, 297)), ("a3", (297, 420)), ("Letter", (215.9, 279.4))])
def test_page_size_in_svg_and_pdf(page, size):
    drawing = sheet(load_target("charuco"), page=page)
    root = svg_elements(drawing)[0]
    assert (root.get("width"), root.get("height")) == (f"{size[0]}mm", f"{size[1]}mm")
    assert root.get("viewBox") == f"0 0 {size[0]} {size[1]}"
    box = re.search(rb"/MediaBox \[0 0 ([\d.]+) ([\d.]+)\]", pdf(drawing))
    # A PDF counts in points of 25.4 / 72 mm.
    assert [float(side) * 25.4 / 72 for side in box.groups()] == pytest.approx(size, abs=WRITTEN_MM)


def test_everything_lies_inside_the_margins():
    for name in PRINTABLE:
        drawing = sheet(load_target(name), margin_mm=6.0)
        boxes, _ = svg_rectangles(drawing)
        assert boxes[:, :2].min() >= 6.0 - 0.2
        assert np.all(boxes[:, :2] + boxes[:, 2:] <= [drawing.width_mm - 6.0 + 0.2, drawing.height_mm - 6.0 + 0.2])
        for label in (shape for shape in drawing.shapes if isinstance(shape, Label)):
            ends = label.x + label.width_mm * {"start": 1, "middle": 0.5, "end": 0}[label.anchor]
            assert ends <= drawing.width_mm - 6.0
            assert 0 < label.y <= drawing.height_mm - 6.0 + 0.3


def test_lines_of_a_grid_lie_at_its_pitch():
    grid = LineGrid(**SAID, pitch_mm=mm(12.5), line_width_mm=mm(0.7), lines=(9, 12))
    boxes, _ = svg_rectangles(sheet(grid))
    for axis, count in ((0, 9), (1, 12)):
        lines = boxes[np.isclose(boxes[:, 2 + axis], 0.7)]
        centres = np.sort(lines[:, axis] + lines[:, 2 + axis] / 2)
        assert len(centres) == count
        np.testing.assert_allclose(np.diff(centres), 12.5, atol=2 * WRITTEN_MM)


def test_a_grid_without_count_fills_the_page():
    boxes, _ = svg_rectangles(sheet(load_target("grid-10mm"), page="A4"))
    # 210 - 29 and 297 - 29 mm of room, a line every 10 mm and 3 mm beyond the outer crossings.
    assert (np.isclose(boxes[:, 2], 0.9).sum(), np.isclose(boxes[:, 3], 0.9).sum()) == (18, 27)


def test_light_lines_stand_on_a_dark_field_and_heavy_ones_are_heavier():
    grid = LineGrid(
        **SAID,
        pitch_mm=mm(5.0),
        line_width_mm=mm(0.3),
        lines=(21, 31),
        polarity="light",
        heavy_every=10,
        heavy_width_mm=mm(0.8),
    )
    boxes, inks = svg_rectangles(sheet(grid))
    field, lines = boxes[0], boxes[inks == "white"]
    assert inks[0] == "black"
    assert field[2:].tolist() == [103.0, 153.0]
    heavy = np.sort(lines[np.isclose(lines[:, 2], 0.8), 0])
    np.testing.assert_allclose(np.diff(heavy), 50.0, atol=2 * WRITTEN_MM)
    assert len(lines) == 21 + 31


def test_opencv_finds_every_charuco_corner_in_its_place():
    target = load_target("charuco")
    picture = rasterise(sheet(target))
    dictionary = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, target.dictionary))
    board = cv2.aruco.CharucoBoard(target.squares, target.square_mm.value, target.marker_mm.value, dictionary)
    corners, ids, _, markers = cv2.aruco.CharucoDetector(board).detectBoard(picture)
    assert np.sort(markers.ravel()).tolist() == list(range(35))
    assert np.sort(ids.ravel()).tolist() == list(range(54))
    found = to_mm(corners)[np.argsort(ids.ravel())]
    expected = board_points_mm(6, 9, 25.0)[:, :2] * [1, -1]
    # The picture is sampled every 0.125 mm; a corner detector does better than half of that.
    np.testing.assert_allclose(found - found.mean(axis=0), expected, atol=0.06)


def test_opencv_finds_the_chessboard():
    picture = rasterise(sheet(load_target("chessboard-9x6-25mm")))
    found, corners = cv2.findChessboardCornersSB(picture, (9, 6))
    assert found
    steps = np.diff(to_mm(corners).reshape(6, 9, 2), axis=1)
    np.testing.assert_allclose(np.abs(steps[..., 0]), 25.0, atol=0.06)


@pytest.mark.parametrize("asymmetric", [False, True])
def test_opencv_finds_the_dots(asymmetric):
    columns, rows = (4, 11) if asymmetric else (8, 11)
    dots = Dots(**SAID, columns=columns, rows=rows, pitch_mm=mm(20.0), diameter_mm=mm(10.0), asymmetric=asymmetric)
    picture = cv2.resize(rasterise(sheet(dots)), None, fx=0.25, fy=0.25, interpolation=cv2.INTER_AREA)
    # Rulers have marks that are no dots; they are outside the pattern and painted over as a hand would.
    picture[:, : 20 * PX_PER_MM // 4] = 255
    picture[-20 * PX_PER_MM // 4 :] = 255
    kind = cv2.CALIB_CB_ASYMMETRIC_GRID if asymmetric else cv2.CALIB_CB_SYMMETRIC_GRID
    found, centres = cv2.findCirclesGrid(picture, (columns, rows), flags=kind)
    assert found
    points = (asymmetric_dots_mm if asymmetric else board_points_mm)(columns, rows, 20.0)[:, :2]
    seen = (centres.reshape(-1, 2) + 0.5) * 4 / PX_PER_MM
    # As sets: OpenCV may start from the other end of a pattern that looks alike from both.
    order = [np.lexsort(np.round(p - p.mean(axis=0)).T) for p in (seen, points)]
    np.testing.assert_allclose((seen - seen.mean(axis=0))[order[0]], (points - points.mean(axis=0))[order[1]], atol=0.1)


def test_the_table_of_a_pdf_points_at_its_objects():
    content = pdf(sheet(load_target("dots")))
    assert content.startswith(b"%PDF-1.6\n")
    start = int(re.search(rb"startxref\n(\d+)\n%%EOF\n$", content).group(1))
    assert content[start:].startswith(b"xref\n0 7\n")
    for number, place in enumerate(re.findall(rb"(\d{10}) 00000 n ", content), start=1):
        assert content[int(place) :].startswith(b"%d 0 obj\n" % number)
    length = int(re.search(rb"/Length (\d+)", content).group(1))
    assert len(re.search(rb"stream\n(.*)\nendstream", content, re.DOTALL).group(1)) == length
    assert b"/PrintScaling /None" in content


def test_a_disc_is_round_in_the_pdf():
    content = pdf(Drawing(100, 100, "disc", (Disc(50.0, 40.0, 10.0),))).decode("cp1252")
    path = re.search(r"0 g (.*) f\n", content).group(1)
    numbers = np.array([float(item) for item in re.findall(r"-?[\d.]+", path)]).reshape(-1, 2)
    t = np.linspace(0, 1, 101)[:, None]
    start, radii = numbers[0], []
    for one, two, end in numbers[1:].reshape(4, 3, 2):
        curve = (1 - t) ** 3 * start + 3 * (1 - t) ** 2 * t * one + 3 * (1 - t) * t**2 * two + t**3 * end
        radii.append(np.hypot(*(curve - [50.0, 40.0]).T))
        start = end
    # The known error of the four-arc circle is 2.7e-4 of the radius.
    np.testing.assert_allclose(radii, 10.0, atol=10.0 * 2.8e-4)
    np.testing.assert_allclose(start, numbers[0])


def test_names_with_awkward_letters_are_carried():
    drawing = Drawing(50, 20, "a (b) \\ <c> & µ 漢", (Label(5, 5, 2, "a (b) \\ <c> & µ 漢"),))
    assert ET.fromstring(svg(drawing))[0].text == "a (b) \\ <c> & µ 漢"
    # Helvetica has no Chinese: that letter becomes a question mark, the rest stands.
    assert b"(a \\(b\\) \\\\ <c> & \xb5 ?) Tj" in pdf(drawing)


def test_equal_drawings_are_equal_bytes():
    assert pdf(sheet(load_target("charuco"))) == pdf(sheet(load_target("charuco")))


def test_a_rectangle_stands_where_it_was_put():
    boxes = pdf_rectangles(pdf(Drawing(100, 200, "box", (Rectangle(25.4, 50.8, 12.7, 2.54),))))
    # 1 inch is 72 points; y is measured from the lower edge in a PDF.
    np.testing.assert_allclose(boxes, [[72, 200 / 25.4 * 72 - 144, 36, -7.2]], atol=1e-4)


@pytest.mark.parametrize(
    ("name", "options", "message"),
    [
        ("glass-strips", {}, "not a printed pattern"),
        ("charuco", {"page": "A5"}, "needs 175 x 250 mm.*leaves 119 x 181 mm upright or 181 x 119 mm lying"),
        ("charuco", {"margin_mm": 40.0}, "larger page or smaller margins"),
        ("charuco", {"margin_mm": -1.0}, "margin must be zero or more"),
        ("charuco", {"margin_mm": float("nan")}, "margin must be zero or more"),
        ("charuco", {"page": "B4"}, 'unknown page "B4"'),
        ("charuco", {"page": "0x100"}, "unknown page"),
        ("charuco", {"page": "nanx100"}, "unknown page"),
        ("charuco", {"page": "100x200x300"}, "unknown page"),
        ("grid-10mm", {"page": "60x60"}, "rulers and text 179 x 100 mm"),
    ],
)
def test_what_cannot_be_drawn_is_refused(name, options, message):
    with pytest.raises(TargetError, match=message):
        sheet(load_target(name), **options)


def test_a_grid_without_line_width_is_refused():
    with pytest.raises(TargetError, match="no line_width_mm"):
        sheet(LineGrid(**SAID, pitch_mm=mm(10.0)))


def test_page_sizes():
    assert page_size_mm("A4") == (210.0, 297.0)
    assert page_size_mm("420X600.5") == (420.0, 600.5)


def test_pdf_as_another_program_paints_it():
    pdfium = pytest.importorskip("pypdfium2")
    target = load_target("charuco")
    drawing = sheet(target)
    page = pdfium.PdfDocument(pdf(drawing))[0]
    picture = page.render(scale=PX_PER_MM * 25.4 / 72, grayscale=True).to_numpy().squeeze()
    ours = rasterise(drawing)
    # The renderer rounds a page that ends inside a pixel up by one row.
    np.testing.assert_allclose(picture.shape, ours.shape, atol=1)
    pattern = np.s_[: 275 * PX_PER_MM, 24 * PX_PER_MM : 210 * PX_PER_MM]
    # Both paint the same squares; only pixels on an edge may differ, by anti-aliasing.
    assert np.mean((picture[pattern] > 127) != (ours[pattern] > 127)) < 0.02
    dictionary = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, target.dictionary))
    board = cv2.aruco.CharucoBoard(target.squares, 25.0, 18.0, dictionary)
    _, ids, _, _ = cv2.aruco.CharucoDetector(board).detectBoard(np.ascontiguousarray(picture))
    assert np.sort(ids.ravel()).tolist() == list(range(54))


def test_a_small_charuco_of_another_dictionary():
    target = Charuco(**SAID, squares=(4, 3), square_mm=mm(40.0), marker_mm=mm(30.0), dictionary="DICT_APRILTAG_36h11")
    dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_APRILTAG_36h11)
    board = cv2.aruco.CharucoBoard((4, 3), 40.0, 30.0, dictionary)
    _, ids, _, _ = cv2.aruco.CharucoDetector(board).detectBoard(rasterise(sheet(target)))
    assert np.sort(ids.ravel()).tolist() == list(range(6))
