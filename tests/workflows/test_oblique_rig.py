"""A slanting rig with a bent lens and wrong steps, drawn by a ray tracer that shares no code with fringecal."""

import math

import numpy as np
import pytest
from scipy import ndimage

from fringecal.camera import local_scale
from fringecal.projector.angle.projection_angle import projection_angle
from fringecal.projector.rig_monte_carlo import check_by_monte_carlo
from fringecal.workflows.commission.checks import evenness_check, spacing_check


def test_scale_and_angle(oblique):
    # Uncorrected, lens and steps would cost some 0.3 % and 0.3 deg; they are corrected, and little of it may be left.
    assert abs(oblique.scale_error) < 0.03 / 100
    assert abs(oblique.angle_error_deg) < 0.05


def test_their_uncertainties_cover_the_errors(oblique):
    scale = oblique.found.result.camera.scales["mean"]
    assert abs(oblique.scale_error) * scale.value < scale.expanded().U
    assert abs(oblique.angle_error_deg) < oblique.found.result.origin.angle.expanded().U


def test_wrong_steps_are_noticed_and_replaced(oblique):
    assert oblique.found.reference.used == "estimated"
    assert "do not fit the stated model" in oblique.found.reference.sentence()


def test_the_lens_is_said_to_bend_as_it_does(oblique):
    verdict = oblique.found.result.camera.distortion
    assert verdict.verdict == "barrel"
    # Truth holds for the printed grid's corner, 0.497 px; how far out crossings are found is up to the detector, and
    # one pitch of 20 px less along the diagonal is a sixth less of a displacement that goes with the cube.
    assert abs(verdict.max_px.value) == pytest.approx(oblique.truth["distortion_at_corner_px"], rel=1 / 6)


def test_camera_rays_meet_the_plate_where_they_should(oblique):
    """Truth states the plate point under every pixel: in the plate frame, so up to its origin and turn."""
    rays = oblique.found.result.rig.camera.pixel_rays()
    inside = (slice(40, -40, 20), slice(40, -40, 20))
    shape = oblique.maps["x"].shape
    found = np.stack([np.reshape(rays.ax, shape)[inside], np.reshape(rays.ay, shape)[inside]], axis=-1)
    true = np.stack([oblique.maps["x"][inside], oblique.maps["y"][inside]], axis=-1)
    # x along +u at the origin is the frame of both. A tenth of a pixel is 0.05 mm.
    np.testing.assert_allclose(found, true, atol=0.05)


@pytest.mark.parametrize("axis", ["x", "y"])
def test_the_angle_over_the_field(oblique, axis):
    model = oblique.found.result.rig.model
    for at, true in oblique.truth[f"angle_{axis}"].items():
        x, y = (float(at), 0.0) if axis == "x" else (0.0, float(at))
        # u of the angle is 0.03 deg, from the strips' height, the same everywhere.
        assert np.degrees(projection_angle(model, x, y)) == pytest.approx(true, abs=0.06)


def test_zigzag_errors(oblique):
    errors = oblique.bars.errors
    # Uncorrected, steps and lens would cost some 0.6 %.
    for profile in errors.profiles:
        assert abs(profile.mean_percent) <= 0.1
    assert abs(errors.pooled.mean_percent) <= 0.05


def test_heights_against_the_true_ones_pixel_by_pixel(oblique):
    """No registration in between: this judges frame, lens, steps, rig and heights together."""
    error = _flank_error(oblique)
    # A twentieth of the noise of one pixel, 0.03 mm, would show a common error; strips are known to 0.003 of 3 mm,
    # which is 0.011 mm on the flanks' mean height of 10.6 mm.
    assert abs(np.mean(error)) < 0.015
    assert np.std(error) < 0.006 * 21.2


def test_stated_uncertainty_covers_95_percent(oblique):
    surface = oblique.bars.surface
    error, u = _flank_error(oblique), surface.u_z[_flanks(oblique)]
    covered = np.mean(np.abs(error) <= 1.96 * u)
    assert 0.90 <= covered <= 0.98


def test_uncertainty_grows_where_the_noise_does(oblique):
    """u(z) is no constant: pixels with the larger stated u have the larger errors."""
    surface = oblique.bars.surface
    error, u = _flank_error(oblique), surface.u_z[_flanks(oblique)]
    low, high = np.quantile(u, [0.25, 0.75])
    ratio = np.std(error[u >= high]) / np.std(error[u <= low])
    expected = np.mean(u[u >= high]) / np.mean(u[u <= low])
    assert ratio == pytest.approx(expected, rel=0.25)


def _flanks(judged):
    """Lit flank pixels at least 4 px from every ridge, valley, end and shadow."""
    height, lit = judged.maps["bars"], judged.maps["lit"]
    bent = np.abs(ndimage.laplace(ndimage.uniform_filter(height, 3))) > 0.02
    good = lit & (height > 0.5) & ~bent
    return ndimage.binary_erosion(good, iterations=4) & judged.bars.surface.mask


def _flank_error(judged):
    flanks = _flanks(judged)
    assert flanks.sum() > 50_000
    return judged.bars.surface.z[flanks] - judged.maps["bars"][flanks]


# ---- the check of first order ---------------------------------------------------------------------
RIGS = 2000


def quantities_of(rig):
    """Angle at the origin, mean scale, and a height of 20 mm at the centre and in a corner."""

    def height_at(pixel):
        rays = rig.camera.rays(*pixel)
        phase = rig.model.phase(*rays.at(20.0), 20.0)
        return lambda other: float(other.model.height(phase, other.camera.rays(*pixel)))

    corner = 0.05 * rig.camera.width_px, 0.05 * rig.camera.height_px
    return {
        "projection angle / deg": lambda other: math.degrees(float(projection_angle(other.model, 0.0, 0.0))),
        "scale / (mm/px)": lambda other: local_scale(other.camera, "mean"),
        "height at the centre / mm": height_at(rig.camera.centre_px),
        "height in a corner / mm": height_at(corner),
    }


@pytest.fixture(scope="module")
def drawn(oblique):
    rig = oblique.found.result.rig
    return check_by_monte_carlo(rig, quantities_of(rig), np.random.default_rng(2008), trials=RIGS)


def test_first_order_is_what_drawn_rigs_show(drawn):
    assert len(drawn) == 4
    for name, check in drawn.items():
        # A standard deviation of 2000 draws has itself 1.6 %; three of it.
        assert check.u_ratio == pytest.approx(1.0, abs=3 / math.sqrt(2 * RIGS)), name
        # One digit of u (JCGM 101:2008, 8.1), and what the draws themselves do not decide.
        off = max(check.validation.d_low, check.validation.d_high)
        assert off <= check.validation.tolerance + check.monte_carlo.tolerance, name


def test_the_checked_budgets_are_those_of_the_record(drawn, oblique):
    angle = oblique.found.result.origin
    checked = drawn["projection angle / deg"].budget
    assert checked.result.u == pytest.approx(angle.angle.u, rel=1e-12)
    assert checked.contributions() == pytest.approx(angle.budget.contributions())


def test_strips_and_lines_of_the_grid_are_as_far_apart_as_stated(oblique):
    result = oblique.found.result
    (spacing,) = spacing_check(result)
    assert (spacing.decision, evenness_check(result.camera.tables).decision) == ("pass", "pass")
