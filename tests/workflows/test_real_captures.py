"""Real pictures of two rigs that others built: what their makers or our own ruler say of them must be found."""

import math

import numpy as np
import pytest

from fringecal.phase import fringe_period
from fringecal.session import load_session
from fringecal.workflows.demo.run import read_real


@pytest.fixture(scope="module")
def captures(request):
    data = request.config.rootpath / "tests" / "data"
    names = ("fpp_tools_lens", "kamino_object1")
    return {capture.name: capture for name in names for capture in read_real(load_session(data / name))}


def test_every_set_is_read(captures):
    assert list(captures) == ["fpp_tools lens", "kamino s1", "kamino s2"]


def test_period_on_the_board_of_the_lens(captures):
    phase = captures["fpp_tools lens"].phase.map
    board = (slice(200, 276), slice(100, 701))
    period = fringe_period(phase.phase[board], phase.valid[board])
    # Known: 22.3 px as the mean over columns 100 to 700 of row 270, where it grows from 17.8 to 28.5 px. The median
    # block of a period that grows evenly is its middle; half a pixel is what its bend and the other rows may add.
    assert period.period_px == pytest.approx(22.3, abs=0.5)
    # The phase falls with growing column: it rises toward -u, within the few degrees of a camera held by hand.
    assert abs(abs(period.direction_deg) - 180) < 10


@pytest.mark.parametrize("row", [205, 240])
def test_mean_period_by_counting_fringes(captures, row):
    """From column 100 to column 700: columns over the turns of the unwrapped phase."""
    phase = captures["fpp_tools lens"].phase.map
    assert phase.valid[row, 100:701].all()
    line = np.unwrap(phase.phase[row, 100:701].astype(float))
    assert 600 * 2 * math.pi / abs(line[-1] - line[0]) == pytest.approx(22.3, abs=0.05)  # known to its last digit


@pytest.mark.parametrize(("name", "period_px"), [("kamino s1", 75.5), ("kamino s2", 115)])
def test_periods_of_the_camera_at_the_wall(captures, name, period_px):
    found = captures[name].period
    # "About 75 (76) and 115 px in the middle", by our ruler on the picture: two in a hundred.
    assert found.period_px == pytest.approx(period_px, rel=0.02)
    assert abs(found.direction_deg) < 3  # vertical fringes, phase rising to the right


def test_the_two_periods_stand_in_the_projectors_ratio(captures):
    wall = (slice(40, 200), slice(700, 1200))
    maps = [captures[name].phase.map for name in ("kamino s1", "kamino s2")]
    short, long = (fringe_period(m.phase[wall], m.valid[wall]).period_px for m in maps)
    # 100 against 66.67 projector px, seen in the same place; the projector's gamma ripples the phase by 0.3 rad,
    # which is a hundredth of the 30 rad of the longer one's five fringes there, and twice that at the block's borders.
    assert long / short == pytest.approx(1.5, rel=0.03)


def test_steps_of_the_lens_are_those_that_its_author_found(captures):
    estimate = captures["fpp_tools lens"].phase.estimated
    # The author's own fit, to a tenth of a degree; a gamma ripple of 0.039 rad rms shifts both by some tenths.
    np.testing.assert_allclose(np.degrees(estimate.phase_shifts_rad), [0, 90.4, 180.3, 270.1], atol=0.5)


def test_the_valid_shares_are_what_the_eye_sees(captures):
    # Lens: board and dome fill half of the picture, the rest is black. Box: shadows fill much of the right half.
    shares = {name: capture.phase.map.valid.mean() for name, capture in captures.items()}
    assert 0.45 < shares["fpp_tools lens"] < 0.6
    assert 0.5 < shares["kamino s1"] < 0.95
    assert shares["kamino s2"] == pytest.approx(shares["kamino s1"], abs=0.05)  # same scene, same light
