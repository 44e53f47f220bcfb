"""A camera height that cannot be is refused by its name."""

import pytest

from fringecal.errors import FitError
from fringecal.procedures.camera import demand_possible_height


def test_110_for_1100_mm_is_asked_about():
    with pytest.raises(FitError, match=r"height of 110 mm cannot be.*470 mm wide.*is it 1100\?"):
        demand_possible_height(110.0, 470.0)


def test_a_lens_of_90_deg_is_possible():
    # 90 deg of view: the field is twice the height.
    demand_possible_height(235.0, 470.0)
