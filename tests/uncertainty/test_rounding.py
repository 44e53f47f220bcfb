"""Values to the second digit of their uncertainty, as JCGM 100:2008, 7.2.6 prints them."""

import math

import pytest

from fringecal.uncertainty.rounding import dof_text, uncertainty_text, value_text


def test_the_guides_own_example():
    """JCGM 100:2008, 7.2.6: y = 10.057 62 ohm with u_c = 27 milliohm is rounded to 10.058 ohm."""
    assert value_text(10.05762, 0.027) == "10.058"


@pytest.mark.parametrize(
    ("value", "u", "text"),
    [
        (1.0, 0.0996, "1.00"),  # u rounds to 0.10: its second digit is the second decimal
        (987.4, 99.6, "990"),  # and here to 100: its second digit are the tens
        (-3.2e-9, 1.4e-3, "0.0000"),  # nothing has no sign
        (6.62607e-34, 5.1e-38, "6.62607e-34"),
        (2.0, None, "2"),
        (2.0, math.inf, "2"),
    ],
)
def test_no_digit_beyond_the_doubt(value, u, text):
    assert value_text(value, u) == text


def test_signs_are_printed_where_asked_for():
    assert [value_text(v, 0.1, sign=True) for v in (0.5, -0.5, 1e-6)] == ["+0.50", "-0.50", "0.00"]


def test_value_and_doubt_end_at_the_same_place():
    for u in (0.00123, 0.0234, 0.345, 4.56):
        assert len(uncertainty_text(u).partition(".")[2]) == len(value_text(7.123456789, u).partition(".")[2])


def test_degrees_of_freedom_beyond_counting_are_no_number():
    assert [dof_text(dof) for dof in (29.6, 1.55e9, math.inf)] == ["30", "> 1000", "∞"]
