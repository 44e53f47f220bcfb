"""A slanting rig with a bent lens and wrong steps, drawn by a ray tracer that shares no code with fringecal."""

import numpy as np
import pytest
from scipy import ndimage

from fringecal.projector.angle.projection_angle import projection_angle


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
