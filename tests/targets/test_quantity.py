import math

import numpy as np
import pytest
from pydantic import ValidationError

from fringecal.targets import Quantity, Scalar


@pytest.mark.parametrize(
    ("distribution", "u"),
    # JCGM 100:2008, 4.4.5 and 4.4.6: bounds 96 to 104 degC give 2.3 degC and 1.6 degC, as printed there.
    [("rectangular", 2.3), ("triangular", 1.6)],
)
def test_half_width_becomes_the_standard_uncertainty_of_the_gum(distribution, u):
    quantity = Quantity.model_validate({"value": 100.0, "half_width": 4.0, "distribution": distribution})
    assert round(quantity.u, 1) == u


def test_half_widths_of_a_list():
    quantity = Quantity(value=[1, 2], **{"half_width": [0.3, 0.6], "distribution": "rectangular"})
    np.testing.assert_allclose(quantity.us, [0.3 / math.sqrt(3), 0.6 / math.sqrt(3)])


def test_one_number_stands_for_all_items():
    quantity = Quantity(value=3.0, u=0.005)
    assert quantity.array(3).tolist() == [3.0, 3.0, 3.0]
    assert quantity.u_array(2).tolist() == [0.005, 0.005]
    assert quantity.estimate("h", "mm", item=7).value == 3.0


def test_items_of_a_list_keep_their_own_numbers():
    quantity = Quantity(value=[3.001, 2.998], u=[0.001, 0.002])
    second = quantity.estimate("height of strip 2", "mm", item=1)
    assert (second.value, second.u, second.unit, second.label) == (2.998, 0.002, "mm", "height of strip 2")
    assert quantity.array(2).tolist() == [3.001, 2.998]
    with pytest.raises(ValueError, match="broadcast"):
        quantity.array(3)


def test_values_cannot_be_changed():
    with pytest.raises(ValidationError, match="frozen"):
        Quantity(value=1.0, u=0.1).value = 2.0


@pytest.mark.parametrize("model", [Quantity, Scalar])
@pytest.mark.parametrize(
    ("given", "message"),
    [
        (10.0, "without its uncertainty"),
        ([1.0, 2.0], "without its uncertainty"),
        ("10 mm", "without its uncertainty"),
        ({"value": 1.0, "u": -0.1}, "cannot be negative"),
        ({"value": 1.0, "u": 0.1, "half_width": 0.1, "distribution": "rectangular"}, "one thing twice"),
        ({"value": 1.0, "half_width": 0.1}, "half_width needs distribution"),
        ({"value": 1.0, "half_width": 0.1, "distribution": "normal"}, "half_width needs distribution"),
        ({"value": 1.0, "u": 0.1, "distribution": "rectangular"}, "belongs to half_width"),
        ({"value": math.nan, "u": 0.1}, "finite number"),
        ({"value": math.inf, "u": 0.1}, "finite number"),
        ({"value": True, "u": 0.1}, "finite number"),
        ({"value": "1.0", "u": 0.1}, "finite number"),
        ({"value": 1.0, "half_width": "wide", "distribution": "rectangular"}, "finite number"),
    ],
)
def test_doubtful_quantities_are_refused(model, given, message):
    with pytest.raises(ValidationError, match=message):
        model.model_validate(given)


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"value": [], "u": 0.1}, "list is empty"),
        ({"value": [1.0, math.nan], "u": 0.1}, "finite numbers"),
        ({"value": [1.0, [2.0]], "u": 0.1}, "finite numbers"),
        ({"value": [1.0, 2.0], "u": [0.1, 0.1, 0.1]}, "3 uncertainties for 2"),
        ({"value": 1.0, "u": [0.1, 0.1]}, "2 uncertainties for 1"),
    ],
)
def test_doubtful_lists_are_refused(given, message):
    with pytest.raises(ValidationError, match=message):
        Quantity.model_validate(given)


def test_a_scalar_takes_no_list():
    with pytest.raises(ValidationError, match="one finite number"):
        Scalar.model_validate({"value": [1.0, 2.0], "u": 0.1})
