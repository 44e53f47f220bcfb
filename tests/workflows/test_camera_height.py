"""A camera height that cannot be is refused by its name; one that is not stated costs what it costs."""

from dataclasses import replace

import numpy as np
import pytest

from fringecal.calibration import demand_possible_height
from fringecal.errors import FitError
from fringecal.projector.angle.angle_theory import projector_estimates
from fringecal.workflows.angle.run import picture_angles
from fringecal.workflows.commission import measure_camera


def test_110_for_1100_mm_is_asked_about():
    with pytest.raises(FitError, match=r"height of 110 mm is impossible.*470 mm wide.*is it 1100\?"):
        demand_possible_height(110.0, 470.0)


def test_a_lens_of_90_deg_is_possible():
    # 90 deg of view: the field is twice the height.
    demand_possible_height(235.0, 470.0)


def test_without_a_height_the_angle_is_told_with_what_it_costs(oblique):
    """A usual lens is assumed, 1.7 diagonals of the field up, within 60 %; the true one stands at 1100 mm."""
    session = replace(oblique.session, camera=replace(oblique.session.camera, height_mm=None))
    camera = measure_camera(session)
    assert camera.scales["mean"].value == pytest.approx(oblique.truth["scale_h"], rel=5e-4)
    assert abs(camera.fit.camera["height_mm"] - 1100) < 2 * np.sqrt(camera.fit.camera.covariance[-1, -1])
    found = picture_angles(session, camera, estimator="ridge")
    assert any("camera.height_mm" in sentence for sentence in found.sentences)
    assert abs(found.angle.value - oblique.truth["angle_origin_deg"]) < 2 * found.angle.u
    assert found.apparent.u < 0.1
    for estimate, true in zip(projector_estimates(found.calibration), oblique.truth["projector"], strict=True):
        assert abs(estimate.value - true) < 2 * estimate.u
    assert found.columns[0].angle.u > 0.06  # beside the middle the line of sight leans by what nobody stated
