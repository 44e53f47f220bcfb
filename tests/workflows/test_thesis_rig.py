"""The thesis's rig end to end: commissioned from its own artefacts, judged on bars that it never saw."""

import math

import numpy as np
import pytest
import trimesh

from fringecal.errors import SessionError
from fringecal.reconstruct.phase_to_height import reconstruct_height
from fringecal.records.calibration_record import read_calibration, write_calibration
from fringecal.records.exports.surface_files import write_surfaces
from fringecal.session import load_session
from fringecal.workflows.commission.record import calibration_record
from fringecal.workflows.commission.run import commission
from fringecal.workflows.reconstruct.run import reconstruct
from fringecal.workflows.shared.stored_calibration import calibration_of

RIGS = ("thesis", "thesis_7")


@pytest.fixture(params=RIGS)
def rig(request):
    return request.getfixturevalue(request.param)


def test_scale_and_angle_are_the_true_ones(rig):
    # 0.02 % is 0.08 mm over 400 mm. The angle's own u is 0.05 deg, from a strip height known to 0.17 %: two of them.
    assert abs(rig.scale_error) < 0.02 / 100
    assert abs(rig.angle_error_deg) < 0.1


def test_their_stated_uncertainties_cover_the_errors(rig):
    scale = rig.found.result.camera.scales["mean"]
    assert abs(rig.scale_error) * scale.value < scale.expanded().U
    assert abs(rig.angle_error_deg) < rig.found.result.origin.angle.expanded().U


def test_zigzag_errors_keep_the_bars_on_every_profile(rig):
    errors = rig.bars.errors
    assert [p.name for p in errors.profiles] == list("ABCDE")
    assert errors.full_height_mm == pytest.approx(40 / math.sqrt(2), abs=1e-9)
    for profile in errors.profiles:
        assert abs(profile.mean_percent) <= 0.1
        assert 100 * profile.sd_mm / errors.full_height_mm <= 0.4
        # One pixel of noise is 0.02 rad of phase, 0.02 mm or 0.07 %: nothing may lie beyond ten times that.
        assert profile.max_percent < 0.7


def test_ridges_and_valleys_are_also_reported(rig):
    errors = rig.bars.errors
    for without, with_edges in zip(errors.profiles, errors.profiles_with_edges, strict=True):
        assert with_edges.n > without.n
        assert with_edges.max_abs_mm >= without.max_abs_mm
        # A pixel of 0.734 mm that straddles a ridge sees at most half of it lower: 0.37 mm of 28.3 is 1.3 %.
        assert with_edges.max_percent < 1.3
    assert errors.edge_zone_mm > 0


def test_one_constant_angle_fails_as_the_thesis_did(rig):
    profiles = rig.bars.models["constant-angle"].profiles
    # An independent calculation of this rig: means from +10.4 % on the lamp's side to -7.9 % on the other, 150 mm from
    # the origin, on the ridges; 12.3 % at most. Profiles A..E run from the lamp's side (top, +y) to the other, and
    # their means are over flanks, which are half as high as the ridges.
    assert 6 < max(p.max_percent for p in profiles) < 15
    means = [p.mean_percent for p in profiles]
    assert means == sorted(means, reverse=True)
    assert means[0] > 4
    assert means[-1] < -3
    assert abs(means[2]) < 1.5


def test_the_fringe_order_beyond_pi_is_decided(thesis, thesis_7):
    # By hand: 3 mm tan(50.7 deg) / pitch is 0.458 of a fringe at 8 mm: inside half a fringe. At 7 mm it is 0.524,
    # so that the wrapped step is 0.524 - 1 = -0.476 and the order that makes it right is one away from the naive one.
    step_8 = _median_step(thesis)
    step_7 = _median_step(thesis_7)
    true_8, true_7 = (2 * math.pi * 3 * math.tan(math.radians(50.71)) / pitch for pitch in (8, 7))
    # 0.1 rad: the strips' middle is not the origin.
    assert abs(step_8) == pytest.approx(true_8, abs=0.1)
    assert abs(step_7) == pytest.approx(true_7, abs=0.1)
    assert true_7 > math.pi > true_8
    assert np.sign(step_7) == np.sign(step_8)
    assert abs(thesis_7.found.result.origin.angle.value - thesis.found.result.origin.angle.value) < 0.05


def _median_step(judged):
    """Phase step of the strips as it went into the fit, order decided."""
    seen = judged.found.result.observations
    u, v = seen.u_px[1].astype(int), seen.v_px[1].astype(int)
    return float(np.nanmedian(seen.phase_rad[1] - judged.found.result.plate.unwrapped_rad[v, u]))


def test_a_record_gives_the_same_heights(thesis, tmp_path):
    write_calibration(calibration_record(thesis.commissioned), tmp_path)
    again = calibration_of(read_calibration(tmp_path))
    heights = (-10.0, 40.0)
    first, second = (
        reconstruct_height(thesis.bars.phase.map, rig, height_range_mm=heights)
        for rig in (thesis.found.result.rig, again)
    )
    for name in ("x", "y", "z", "u_z", "reasons"):
        np.testing.assert_array_equal(getattr(first, name), getattr(second, name))


@pytest.fixture(scope="module")
def box(thesis):
    told = []
    low = (-1.0, 4.0)  # a fringe is 6.5 mm high: one order fits
    measured = reconstruct(thesis.session, "box", thesis.found.result.rig, height_range_mm=low, progress=told.append)
    assert told
    return measured


EDGE_PX = 5  # beside an edge, where pixels that may see two surfaces are masked, and no face of a mesh ends


def demand_box(points_mm):
    """Expect the top of a box of 80 x 40 x 2 mm about (110, 95) among points (n, 3) of plate and box."""
    top = points_mm[points_mm[:, 2] > 1.0]
    # A pixel is 0.73 mm; half a percent of the pixels on each side may lie on the walls.
    np.testing.assert_allclose(np.median(top, axis=0)[:2], [110, 95], atol=1)
    low, high = np.percentile(top, [0.5, 99.5], axis=0)
    lost = np.array([80, 40]) - (high - low)[:2]
    assert (lost > -2).all()
    assert (lost < 2 * EDGE_PX * 0.734).all()
    # The strips' height stands for 0.17 % of it; noise averages out.
    assert np.median(top[:, 2]) == pytest.approx(2.0, abs=0.01)


def test_a_box_in_the_upper_right_is_found_there(box):
    surface = box.surface
    demand_box(np.stack([surface.x, surface.y, surface.z], axis=-1)[surface.mask])
    rows, columns = np.nonzero(surface.mask & (surface.z > 1.0))
    assert np.median(rows) < surface.z.shape[0] / 2
    assert np.median(columns) > surface.z.shape[1] / 2


def test_the_shadow_of_an_upright_rim_says_how_high_a_top_is(thesis):
    """Phase says 2 mm, or 8.5, or -4.5; a shadow of 2.4 mm on the plate says which."""
    surface = reconstruct(thesis.session, "box", thesis.found.result.rig).surface
    top = surface.mask & (np.abs(surface.z) > 1.0)
    assert top.sum() == pytest.approx(80 * 40 / 0.734**2, rel=0.2)
    assert np.abs(surface.z[top] - 2.0).max() < 1.0


def test_exports_are_not_mirrored(box, tmp_path):
    write_surfaces(tmp_path, box.surface)
    with np.load(tmp_path / "height.npz") as maps:
        assert set(maps) == {"x", "y", "z", "u_z", "mask"}
        assert maps["mask"].dtype == bool
        demand_box(np.stack([maps["x"], maps["y"], maps["z"]], axis=-1)[maps["mask"]])
        assert np.isnan(maps["z"][~maps["mask"]]).all()
    for suffix in ("ply", "stl", "obj"):
        mesh = trimesh.load(tmp_path / f"height.{suffix}", process=False)
        demand_box(np.asarray(mesh.vertices))
        # Faces of a surface seen from above turn counter-clockwise: their normals point to the camera.
        assert np.mean(mesh.face_normals[:, 2] > 0) > 0.999


def test_a_mean_over_the_box_is_as_uncertain_as_the_strips(box):
    """Noise averages out over thousands of pixels; the strips' 0.005 mm of 3 mm does not."""
    top = (box.surface.mask & (box.surface.z > 1.9)).astype(float)
    assert box.surface.mean_uncertainty(top) == pytest.approx(2.0 * 0.005 / 3.0, rel=0.3)


def test_a_session_without_strips_or_plate_says_so(request):
    session = load_session(request.config.rootpath / "tests" / "data" / "fpp_tools_lens")
    with pytest.raises(SessionError) as refused:
        commission(session)
    assert {kind for kind in ("grid", "reference", "strips") if kind in str(refused.value)} == {
        "grid",
        "reference",
        "strips",
    }
