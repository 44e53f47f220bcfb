"""Values that a page lets its reader take off a map: the right pixel's, or the reason why there is none."""

import base64
import json

import numpy as np
import pytest

from fringecal.errors import RecordError
from fringecal.records.exports.regular_grid import pixels_of_nodes
from fringecal.report.readable import Layer, readable_picture, readable_plate

ROWS, COLUMNS = 120, 160
PITCH_MM = 0.5


def plate(turn_deg=0.0):
    """Plate coordinates of a camera turned about its axis, y up: closed form."""
    column, row = np.meshgrid(np.arange(COLUMNS), np.arange(ROWS))
    u, v = PITCH_MM * (column - 79.5), -PITCH_MM * (row - 59.5)
    c, s = np.cos(np.radians(turn_deg)), np.sin(np.radians(turn_deg))
    return c * u - s * v, s * u + c * v


def slope(x, y):
    """A plane without symmetry: what is flipped, swapped or shifted is wrong at once."""
    return 3.0 + 0.02 * x - 0.05 * y


def coordinates(found):
    rows, columns = found.layers[0].values.shape
    return np.meshgrid(
        found.start[0] + found.step[0] * np.arange(columns), found.start[1] + found.step[1] * np.arange(rows)
    )


@pytest.mark.parametrize("turn_deg", [0.0, 20.0])
@pytest.mark.parametrize("longest_side", [50, 200])
def test_a_node_shows_its_nearest_pixel(turn_deg, longest_side):
    x, y = plate(turn_deg)
    found = readable_plate(x, y, (Layer("z", "mm", slope(x, y)),), longest_side=longest_side)
    values = found.layers[0].values
    assert max(values.shape) <= longest_side
    seen = np.isfinite(values)
    assert seen.mean() > (0.99 if turn_deg == 0 else 0.5)  # a turned field fills less of its box
    # The nearest pixel's centre lies at most half a diagonal away.
    furthest = np.hypot(0.02, 0.05) * PITCH_MM / np.sqrt(2)
    assert np.abs(values - slope(*coordinates(found)))[seen].max() <= furthest * (1 + 1e-6)


def test_what_is_masked_tells_the_first_reason_that_holds():
    x, y = plate()
    left, low = x < -20, y < -15
    masked = left | low
    x, y, z = (np.where(masked, np.nan, part) for part in (x, y, slope(x, y)))
    # Coordinates of a corner stay, so that the box of the map holds the masked pixels.
    x[-1, 0], y[-1, 0] = plate()[0][-1, 0], plate()[1][-1, 0]
    found = readable_plate(x, y, (Layer("z", "mm", z),), masks={"too dark": left, "order undecided": low})
    nodes_x, nodes_y = coordinates(found)
    inside = (np.abs(nodes_x + 20) > 1) & (np.abs(nodes_y + 15) > 1)  # a border belongs to either side
    expected = np.where(nodes_x < -20, 1, np.where(nodes_y < -15, 2, 0))
    np.testing.assert_array_equal(found.reasons[inside], expected[inside])
    np.testing.assert_array_equal(np.isnan(found.layers[0].values)[inside], expected[inside] > 0)
    assert found.reason_names == ("too dark", "order undecided")


def test_a_picture_is_thinned_from_the_middle_of_its_cells():
    cells = np.add.outer(10.0 * np.arange(30), np.arange(40))  # 10 row + column, cells of 4 px
    found = readable_picture(Layer("residual", "rad", cells), step_px=4, longest_side=20)
    assert (found.coordinates, found.unit) == (("u", "v"), "px")
    assert found.start == (1.5, 1.5)  # the middle of px 0..3
    assert found.step == (8.0, 8.0)
    u, v = coordinates(found)
    np.testing.assert_array_equal(found.layers[0].values, 10 * (v - 1.5) / 4 + (u - 1.5) / 4)


def test_the_text_holds_every_value_and_cannot_end_its_element():
    x, y = plate()
    nasty = "</script><b>"
    found = readable_plate(x, y, (Layer(nasty, "mm", slope(x, y), 2),), masks={nasty: x > 0}, longest_side=30)
    text = found.text()
    assert "<" not in text
    content = json.loads(text)
    (layer,) = content["layers"]
    assert (layer["name"], layer["digits"], content["reasonNames"]) == (nasty, 2, [nasty])
    columns, rows = content["size"]
    values = np.frombuffer(base64.b64decode(layer["values"]), "<f4").reshape(rows, columns)
    np.testing.assert_array_equal(values, found.layers[0].values.astype(np.float32))
    reasons = np.frombuffer(base64.b64decode(content["reasons"]), "u1").reshape(rows, columns)
    np.testing.assert_array_equal(reasons, found.reasons)


def test_a_value_without_end_is_none():
    cells = np.array([[1.0, np.inf], [-np.inf, np.nan]])
    content = json.loads(readable_picture(Layer("r", "rad", cells)).text())
    values = np.frombuffer(base64.b64decode(content["layers"][0]["values"]), "<f4")
    np.testing.assert_array_equal(values, np.array([1, np.nan, np.nan, np.nan], np.float32))


def test_nodes_that_no_pixel_sees_have_none():
    x, y = plate()
    rows, columns = pixels_of_nodes(x, y, np.array([-100.0, 0.25, 100.0]), np.array([0.25, 100.0]))
    # x = 0.25 mm is column 80, y = 0.25 mm is row 59; 100 mm lies outside the field.
    assert columns.tolist() == [[-1, 80, -1], [-1, -1, -1]]
    assert rows.tolist() == [[-1, 59, -1], [-1, -1, -1]]


def test_maps_of_other_shapes_are_refused():
    x, y = plate()
    with pytest.raises(RecordError, match="one shape"):
        readable_plate(x, y, (Layer("z", "mm", x[1:]),))
    with pytest.raises(RecordError, match="one shape"):
        readable_plate(x, y, (Layer("z", "mm", x),), masks={"dark": x[:, 1:] > 0})


@pytest.mark.parametrize("valid", [0, 1])
def test_too_few_pixels_are_refused(valid):
    x, y = (np.full((4, 5), np.nan) for _ in range(2))
    x[0, :valid], y[0, :valid] = 1.0, 2.0
    with pytest.raises(RecordError, match="check its mask"):
        readable_plate(x, y, (Layer("z", "mm", x),))
