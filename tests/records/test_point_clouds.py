"""Point clouds and Gwyddion's height maps: read back by the libraries of their own communities."""

import numpy as np
import pytest
import trimesh

from fringecal.errors import FitError, RecordError
from fringecal.reconstruct import CAMERA_FRAME, PointCloud, cloud_of_map
from fringecal.records import write_cloud, write_further
from fringecal.records.exports.gwy_file import write_gwy

RNG = np.random.default_rng(3)
POINTS = RNG.uniform(-300, 300, (500, 3))
U = RNG.uniform(1e-3, 2e-2, (500, 3))
CLOUD = PointCloud(POINTS, U, CAMERA_FRAME)
FLOAT32 = 1e-6  # relative


def test_a_height_map_is_a_list_of_its_valid_pixels(surface):
    cloud = cloud_of_map(surface)
    assert len(cloud) == int(surface.mask.sum())
    np.testing.assert_array_equal(cloud.points_mm[:, 2], surface.z[surface.mask])
    assert set(cloud.known_u) == {"u_z"}
    assert cloud.frame == "plate"


@pytest.mark.parametrize("form", ["ply", "ply-text"])
def test_ply_is_read_by_trimesh(tmp_path, form):
    path = write_cloud(tmp_path / "a.ply", CLOUD, form)
    read = trimesh.load(path)
    np.testing.assert_allclose(read.vertices, POINTS, atol=1e-6)
    data = read.metadata["_ply_raw"]["vertex"]["data"]
    found = data["u_y"] if form == "ply" else np.asarray(data["u_y"])
    np.testing.assert_allclose(np.ravel(found), U[:, 1], rtol=1e-5)
    head = path.read_bytes().split(b"end_header")[0].decode()
    assert "mm, camera frame" in head


def test_las_is_read_by_laspy(tmp_path):
    laspy = pytest.importorskip("laspy")
    read = laspy.read(write_cloud(tmp_path / "a.las", CLOUD, "las"))
    # Steps of 1e-5 mm: at most half of one is off.
    np.testing.assert_allclose(read.xyz, POINTS, atol=0.501e-5)
    assert list(read.point_format.extra_dimension_names) == ["u_x", "u_y", "u_z"]
    for k, name in enumerate(("u_x", "u_y", "u_z")):
        np.testing.assert_allclose(read[name], U[:, k], rtol=FLOAT32)
    assert read.header.system_identifier == "camera frame, mm"


def test_las_refuses_what_it_cannot_count(tmp_path):
    pytest.importorskip("laspy")
    with pytest.raises(RecordError, match="reaches 21 m; write E57"):
        write_cloud(tmp_path / "a.las", PointCloud(POINTS * 1e3, U), "las")
    assert not (tmp_path / "a.las").exists()


@pytest.mark.filterwarnings("ignore::SyntaxWarning", "ignore::DeprecationWarning")
def test_e57_is_read_by_pye57_in_metres(tmp_path):
    pye57 = pytest.importorskip("pye57")
    file = pye57.E57(str(write_cloud(tmp_path / "a.e57", CLOUD, "e57")))
    read = file.read_scan_raw(0, ignore_unsupported_fields=True)
    for axis, column in zip("XYZ", POINTS.T, strict=True):
        np.testing.assert_allclose(1000 * read[f"cartesian{axis}"], column, rtol=1e-14)
    assert file.get_header(0).point_fields[3:] == [f"fringecal:u_{axis}" for axis in "xyz"]
    np.testing.assert_allclose(1000 * extension(pye57, file, "fringecal:u_z"), U[:, 2], rtol=1e-14)
    file.close()


def extension(pye57, file, name):
    """A column that the standard does not know, by the library's own calls."""
    points = file.data3d[0]["points"]
    column = np.zeros(len(POINTS))
    buffers = pye57.libe57.VectorSourceDestBuffer()
    buffers.append(pye57.libe57.SourceDestBuffer(file.image_file, name, column, len(column), True, True))
    reader = points.reader(buffers)
    reader.read()
    reader.close()
    return column


def test_gwy_is_read_by_gwyfile_in_metres_and_the_right_way_up(tmp_path, surface):
    gwyfile = pytest.importorskip("gwyfile")
    read = gwyfile.load(str(write_gwy(tmp_path / "a.gwy", surface)))
    channels = gwyfile.util.get_datafields(read)
    height = channels["height above the plate"]
    assert height.si_unit_xy.unitstr == "m"
    assert height.si_unit_z.unitstr == "m"
    step = height.xreal / height.data.shape[1]
    assert step == pytest.approx(0.5e-3)
    # The tower stands at +x +y: right, and up, which is the top of a picture.
    rows, columns = np.nonzero(height.data > 8.9e-3)
    assert columns.mean() > height.data.shape[1] / 2
    assert rows.mean() < height.data.shape[0] / 2
    masked = read["/0/mask"].data > 0.5
    assert masked.any()
    assert height.data.max() == pytest.approx(9e-3, rel=1e-6)
    x = height.xoff + (np.arange(height.data.shape[1]) + 0.5) * step
    assert x[columns].mean() > 10e-3
    u = channels["u of the height"]
    assert np.isfinite(u.data).all()
    assert u.data[~masked].max() == pytest.approx(np.nanmax(surface.u_z[surface.mask]) * 1e-3, rel=0.2)


@pytest.mark.filterwarnings("ignore::SyntaxWarning", "ignore::DeprecationWarning")
def test_all_that_is_asked_for_is_written_once(tmp_path, surface):
    for package in ("laspy", "pye57", "gwyfile"):
        pytest.importorskip(package)
    paths = write_further(tmp_path, surface, ["las", "e57", "gwy", "ply", "ply-text", "las"])
    assert sorted(path.name for path in paths) == sorted(
        ["height.las", "height.e57", "height.gwy", "height-cloud.ply", "height-cloud-text.ply"]
    )
    assert all(path.stat().st_size > 1000 for path in paths)
    assert {path.name for path in tmp_path.iterdir()} == {path.name for path in paths}


def test_what_is_none_or_missing_is_refused_before_any_work(tmp_path, surface, monkeypatch):
    with pytest.raises(RecordError, match="one of ply, ply-text, las, e57, gwy, found 'stl'"):
        write_further(tmp_path, surface, ["ply", "stl"])
    monkeypatch.setattr("importlib.util.find_spec", lambda _: None)
    for form, package in (("las", "laspy"), ("e57", "pye57"), ("gwy", "gwyfile")):
        with pytest.raises(RecordError, match=rf"{form} is written by {package}.*fringecal\[clouds\]"):
            write_further(tmp_path, surface, [form])
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("points", "u"),
    [
        (np.zeros((0, 3)), np.zeros((0, 3))),
        (np.full((2, 3), np.nan), np.zeros((2, 3))),
        (np.zeros((2, 2)), np.zeros((2, 2))),
        (np.zeros((2, 3)), np.zeros((3, 3))),
    ],
)
def test_what_is_no_cloud_is_refused(points, u):
    with pytest.raises(FitError):
        PointCloud(points, u)
