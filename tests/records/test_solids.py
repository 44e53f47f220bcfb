import numpy as np
import pytest
import trimesh

from fringecal.errors import RecordError
from fringecal.records.exports.solids import closed_body, thinned
from fringecal.records.exports.surface_files import write_profiles, write_surfaces
from fringecal.records.exports.triangles import Triangles, triangulate


def sheet(columns, rows, hidden=(), height=2.0):
    """A level sheet of unit cells at z = height, cells of `hidden` cut out."""
    x, y = np.meshgrid(np.arange(columns + 1.0), np.arange(rows + 1.0))
    vertices = np.column_stack([x.ravel(), y.ravel(), np.full(x.size, height)])
    faces = []
    for i in range(rows):
        for j in range(columns):
            if (j, i) in hidden:
                continue
            a = i * (columns + 1) + j
            b, c, d = a + 1, a + columns + 1, a + columns + 2
            faces += [(a, b, d), (a, d, c)]
    return Triangles(vertices, np.array(faces), np.full(x.size, 0.01), 4.0)


def body_of(triangles):
    return trimesh.Trimesh(triangles.vertices_mm, triangles.faces, process=False)


@pytest.mark.parametrize(
    ("hidden", "cells"),
    [((), 12), (((1, 1),), 11), (((1, 1), (2, 1)), 10), (((0, 0), (1, 1)), 10), (((1, 0), (0, 1)), 10)],
    ids=["whole", "a hole", "a wide hole", "two holes at a point", "a cell on a point"],
)
def test_a_closed_body_is_watertight_and_has_its_volume(hidden, cells):
    body = body_of(closed_body(sheet(4, 3, hidden), base_mm=-1.0))
    assert body.is_watertight
    assert body.is_winding_consistent
    # Unit cells, 3 mm from the base to the sheet; positive: all faces look outwards.
    assert body.volume == pytest.approx(3.0 * cells)


def test_the_base_lies_below_the_surface():
    with pytest.raises(RecordError, match="must lie below the lowest point"):
        closed_body(sheet(2, 2), base_mm=2.0)


def test_thinning_keeps_a_level_sheet_level_and_whole():
    sheets = sheet(30, 20)
    few = thinned(sheets, 250)
    assert len(few.faces) <= 250
    # A plane has no quadric error, and the rim is held.
    np.testing.assert_allclose(few.vertices_mm[:, 2], 2.0, atol=1e-9)
    assert body_of(few).area == pytest.approx(600.0)
    np.testing.assert_array_equal(few.u_z_mm, 0.01)
    assert thinned(few, 10_000) is few
    with pytest.raises(RecordError, match="ask for 4 or more"):
        thinned(sheets, 3)


def test_surfaces_are_written_thin_and_closed(tmp_path, surface):
    write_surfaces(tmp_path, surface, faces=800, watertight=True)
    for suffix in ("ply", "stl", "obj"):
        mesh = trimesh.load(tmp_path / f"height.{suffix}")
        assert mesh.is_watertight
        # 800 above, as many below, and the walls: a fraction of the 9000 of the whole map.
        assert len(mesh.faces) < 3 * 800
    whole = triangulate(surface)
    assert mesh.bounds[1, 2] == pytest.approx(whole.vertices_mm[:, 2].max(), abs=0.05)


def test_profiles_hold_the_measured_points_of_their_rows(tmp_path, surface):
    path = write_profiles(tmp_path / "profiles.csv", surface, (5, 20))
    table = np.genfromtxt(path, delimiter=",", skip_header=1)
    assert path.read_text().splitlines()[0] == "row / px,x / mm,y / mm,z / mm,u(z) / mm"
    assert set(table[:, 0]) == {5, 20}
    row = table[table[:, 0] == 20]
    measured = np.asarray(surface.mask)[20]
    np.testing.assert_allclose(row[:, 3], np.asarray(surface.z)[20, measured], atol=1e-6)
    assert len(row) == measured.sum()
