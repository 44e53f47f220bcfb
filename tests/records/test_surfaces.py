import json
import xml.etree.ElementTree as ET
import zipfile
from types import SimpleNamespace

import cv2
import numpy as np
import pytest
import tifffile
import trimesh
from PIL import Image

from fringecal.errors import RecordError
from fringecal.records.exports.regular_grid import regular_grid
from fringecal.records.exports.surface_files import write_mesh, write_npz, write_surfaces, write_tif, write_x3p
from fringecal.records.exports.triangles import triangulate

# Half a sample: nearest-vertex lookups cannot be nearer.
HALF_SAMPLE_MM = 0.25
FLOAT32_MM = 1e-5  # coordinates below 64 mm carry 4e-6 mm in float32
MESHES = [".ply", ".stl", ".obj"]


def tower_of(points):
    """Where the highest points are: only the corner at +x +y is right for this surface."""
    top = points[points[:, 2] > 8.9]
    return top[:, 0].mean(), top[:, 1].mean()


def test_npz_opens_without_the_package(tmp_path, surface):
    with np.load(write_npz(tmp_path / "height.npz", surface)) as stored:
        assert set(stored) == {"x", "y", "z", "u_z", "mask"}
        np.testing.assert_array_equal(stored["z"], surface.z)
        assert stored["mask"].dtype == bool
        assert np.isnan(stored["x"][~surface.mask]).all()
        assert stored["y"][0, 0] > stored["y"][-1, -1]


def test_tif_opens_in_opencv_and_pillow_right_way_up_in_mm(tmp_path, surface):
    path = write_tif(tmp_path / "height.tif", surface)
    picture = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
    assert picture.dtype == np.float32
    np.testing.assert_allclose(picture, surface.z, atol=FLOAT32_MM)
    assert (picture[:10, -20:] == 9.0).all()
    with Image.open(path) as image:
        # 0.5 mm a pixel is 20 pixels a centimetre; 3 is the TIFF code of the centimetre.
        assert float(image.tag_v2[282]) == pytest.approx(20.0)
        assert image.tag_v2[296] == 3
    with tifffile.TiffFile(path) as file:
        assert json.loads(file.pages[0].description)["unit"] == "mm"


@pytest.mark.parametrize("suffix", MESHES)
def test_meshes_are_in_mm_right_way_up_and_face_the_camera(tmp_path, surface, suffix):
    mesh = trimesh.load(write_mesh(tmp_path / f"s{suffix}", surface), process=False)
    np.testing.assert_allclose(mesh.bounds[:, 0], (-19.75, 19.75), atol=FLOAT32_MM)
    np.testing.assert_allclose(mesh.bounds[:, 1], (-14.75, 14.75), atol=FLOAT32_MM)
    x, y = tower_of(mesh.vertices)
    assert x > 10
    assert y > 10
    assert (mesh.face_normals[:, 2] > 0).all()


def parse_ascii_obj(path):
    rows = [line.split() for line in path.read_text().splitlines()]
    vertices = np.array([row[1:4] for row in rows if row and row[0] == "v"], dtype=float)
    faces = np.array([[part.split("/")[0] for part in row[1:]] for row in rows if row and row[0] == "f"], dtype=int)
    return vertices, faces - 1


def test_the_projected_faces_cover_the_valid_area_once_and_nothing_else(tmp_path, surface):
    vertices, faces = parse_ascii_obj(write_mesh(tmp_path / "s.obj", surface, max_jump_mm=100))
    a, b, c = (vertices[faces[:, corner], :2] for corner in range(3))
    areas = ((b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0]) / 2
    assert (areas > 0).all()
    # 59 x 79 cells of 0.25 mm2, less 12 x 16 cells with a masked corner, of which the one at the
    # hole's inner corner keeps the half that touches three valid pixels.
    assert areas.sum() == pytest.approx((59 * 79 - 12 * 16 + 0.5) * 0.25)


def read_binary_stl(path):
    content = path.read_bytes()
    kind = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("spare", "<u2")])
    assert len(content) == 84 + int.from_bytes(content[80:84], "little") * kind.itemsize
    return content[:80], np.frombuffer(content, kind, offset=84)


def test_stl_states_unit_and_normals_of_its_own(tmp_path, surface):
    header, facets = read_binary_stl(write_mesh(tmp_path / "s.stl", surface))
    assert b"mm, z up" in header
    assert not header.startswith(b"solid")  # by that word readers take a file for text
    a, b, c = np.moveaxis(facets["corners"].astype(float), 1, 0)
    normals = np.cross(b - a, c - a)
    assert (normals[:, 2] > 0).all()
    assert (facets["normal"][:, 2] > 0).all()


def test_ply_carries_unit_and_uncertainty(tmp_path, surface):
    path = write_mesh(tmp_path / "s.ply", surface)
    header = path.read_bytes().split(b"end_header")[0].decode("ascii")
    assert "comment fringecal" in header
    assert "mm, z up, jumps over 2 mm left open" in header
    assert "property float u_z" in header


def test_no_triangle_crosses_a_jump_or_a_hole(surface):
    triangles = triangulate(surface, max_jump_mm=1.0)
    heights = triangles.vertices_mm[triangles.faces][:, :, 2]
    assert np.ptp(heights, axis=1).max() <= 1.0
    columns = np.round(triangles.vertices_mm[:, 0] / 0.5 + 39.5).astype(int)
    rows = np.round(29.5 - triangles.vertices_mm[:, 1] / 0.5).astype(int)
    assert surface.mask[rows, columns].all()
    joined = triangulate(surface, max_jump_mm=100.0)
    # The tower's foot runs along 10 + 20 samples: 9 + 19 cells at its sides and one at its corner,
    # of which the corner cell keeps a triangle among its three low pixels.
    assert len(joined.faces) - len(triangles.faces) == 2 * (9 + 19) + 1


def test_coordinates_that_are_nan_where_masked_change_nothing(surface):
    blank = {name: np.where(surface.mask, getattr(surface, name), np.nan) for name in ("x", "y", "u_z")}
    full, blanked = triangulate(surface), triangulate(SimpleNamespace(**vars(surface) | blank))
    np.testing.assert_array_equal(full.vertices_mm, blanked.vertices_mm)
    np.testing.assert_array_equal(full.faces, blanked.faces)


def test_a_ridge_stays_sharp_whatever_its_direction():
    row, column = np.mgrid[:20, :20].astype(float)
    for z in (-np.abs(column - row), -np.abs(column + row - 19)):
        surface = SimpleNamespace(x=column, y=-row, z=z, u_z=z * 0, mask=np.ones(z.shape, dtype=bool))
        corners = triangulate(surface).vertices_mm[triangulate(surface).faces]
        normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        # A cut across the ridge would make facets that tilt to neither side: horizontal normals zero.
        np.testing.assert_allclose(np.abs(normals / normals[:, 2:])[:, :2], 1.0, atol=1e-12)


def test_stride_thins_the_mesh_and_nothing_else(surface):
    coarse = triangulate(surface, stride=4, max_jump_mm=100)
    assert len(coarse.vertices_mm) == np.count_nonzero(surface.mask[::4, ::4])
    assert coarse.vertices_mm[:, 0].min() == surface.x[0, 0]


@pytest.mark.parametrize("case", ["all masked", "stride", "shapes", "jump"])
def test_a_mesh_that_cannot_be_made_is_refused(surface, case):
    changes = {"all masked": {"mask": surface.mask & False}, "shapes": {"x": surface.x[:-1]}}.get(case, {})
    options = {"stride": {"stride": 0}, "jump": {"max_jump_mm": -1.0}}.get(case, {})
    with pytest.raises(RecordError):
        triangulate(SimpleNamespace(**vars(surface) | changes), **options)


def test_an_unknown_mesh_format_is_refused_and_named(tmp_path, surface):
    with pytest.raises(RecordError, match="'.dwg'"):
        write_mesh(tmp_path / "s.dwg", surface)
    assert list(tmp_path.iterdir()) == []


def read_x3p_by_hand(path):
    """Read an x3p without the library that wrote it: a zip with XML and a binary matrix."""
    with zipfile.ZipFile(path) as archive:
        main = ET.fromstring(archive.read("main.xml"))
        number = {axis: main.find(f".//Axes/{axis}") for axis in ("CX", "CY", "CZ")}
        size = [int(main.find(f".//MatrixDimension/Size{axis}").text) for axis in "XYZ"]
        link = main.find(".//DataLink/PointDataLink").text
        z = np.frombuffer(archive.read(link), "<f8").reshape(size[1], size[0])
    step = [float(number[axis].find("Increment").text) for axis in ("CX", "CY")]
    offset = [float(number[axis].find("Offset").text) for axis in ("CX", "CY")]
    return z, step, offset


def test_x3p_is_in_metres_with_rows_toward_plus_y(tmp_path, surface):
    z, step, offset = read_x3p_by_hand(write_x3p(tmp_path / "s.x3p", surface))
    assert z.shape == (60, 80)
    np.testing.assert_allclose(step, 0.5e-3, rtol=1e-12)
    np.testing.assert_allclose(offset, (-19.75e-3, -14.75e-3), rtol=1e-12)
    np.testing.assert_allclose(z[-10:, -20:], 9e-3, rtol=1e-12)
    assert np.isnan(z[:12, :16]).all()
    # Everything outside hole and tower is on a node and comes back as it went in: 2 mm + 5 % of x.
    np.testing.assert_allclose(z[20, :60], 2e-3 + 0.05 * (offset[0] + step[0] * np.arange(60)), rtol=1e-9)


def test_a_plane_seen_in_perspective_is_resampled_exactly():
    # Pinhole camera 1500 mm up, plane z = 10 + 0.05 x + 0.1 y: each pixel's ray meets it in closed form.
    row, column = np.mgrid[:90, :120].astype(float)
    x0, y0 = (column - 59.5) * 2.0, -(row - 44.5) * 2.0
    t = (1 - 10 / 1500) / (1 + (0.05 * x0 + 0.1 * y0) / 1500)
    x, y = x0 * t, y0 * t
    z = 10 + 0.05 * x + 0.1 * y
    grid = regular_grid(x, y, z)
    found = np.isfinite(grid.z_mm)
    assert found.mean() > 0.9
    expected = 10 + 0.05 * grid.x_mm + 0.1 * grid.y_mm[:, None]
    # The pixel position settles to 1e-3 px = 2 um, times a slope of 0.11.
    np.testing.assert_allclose(grid.z_mm[found], expected[found], atol=3e-4)


def test_a_grid_has_no_values_across_a_jump_or_in_a_hole(surface):
    grid = regular_grid(surface.x, surface.y, surface.z, spacing_mm=0.23)
    values = grid.z_mm[np.isfinite(grid.z_mm)]
    assert (np.isclose(values, 9.0) | (values < 3.0)).all()
    hole = (grid.y_mm[:, None] < -9) & (grid.x_mm < -12)
    assert np.isnan(grid.z_mm[hole]).all()


def test_pixels_on_one_line_are_refused(surface):
    z = np.full_like(surface.z, np.nan)
    z[30] = 1.0
    with pytest.raises(RecordError, match="one line"):
        regular_grid(surface.x, surface.y, z)


def test_all_formats_at_once(tmp_path, surface):
    paths = write_surfaces(tmp_path, surface, stride=2)
    assert [path.name for path in paths] == [f"height{end}" for end in (".npz", ".tif", *MESHES, ".x3p")]
    z, step, _ = read_x3p_by_hand(tmp_path / "height.x3p")
    np.testing.assert_allclose(step, 1e-3, rtol=1e-9)
    assert z.shape == (30, 40)
