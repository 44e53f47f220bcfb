import numpy as np
import pytest

from fringecal.thesis import ANGLES_DEG, analytic_cases
from fringecal.workflows.demo.analytic_section import analytic_section


@pytest.fixture(scope="module")
def cases():
    return tuple(analytic_cases())


def test_both_objects_are_read_at_both_angles(cases):
    assert {(case.name, case.angle_deg) for case in cases} == {
        (name, angle) for name in ("rectangle", "zig-zag") for angle in ANGLES_DEG
    }
    for case in cases:
        # Three frames rounded to 8 bits: u(phi) = sqrt(2/3) * 0.289 / 127.5 rad, as a height; 6 of them bound a map.
        u_px = np.sqrt(2 / 3) * 0.289 / 127.5 * case.pitch_px / (2 * np.pi * np.tan(np.radians(case.angle_deg)))
        off = np.abs(case.height_px - case.true_px) > 6 * np.sqrt(2) * u_px
        # Only upright ends, 40 px long on either side of every row of the zig-zag's edge, may take another order.
        assert off.sum() <= (0 if case.name == "rectangle" else 240)


def test_the_section_counts_what_is_off(cases):
    frame = analytic_section(cases).tables[0].frame
    for case, counted in zip(cases, frame["pixels with an error over 1 px"], strict=True):
        assert counted == (np.abs(case.height_px - case.true_px) > 1).sum()
