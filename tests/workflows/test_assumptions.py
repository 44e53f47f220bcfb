"""What a calibration takes for granted is said, with what measuring it would bring."""

import re

import numpy as np

from fringecal.camera import CAMERA_NAMES, PlateCamera
from fringecal.projector import NOT_STATED, RIG_NAMES, RigCalibration, RigModel, angle_budget
from fringecal.uncertainty import Influence, UncertaintyComponent
from fringecal.workflows.shared import assumption_sentences

CAMERA = PlateCamera.from_values({"scale_mm_per_px": 0.5, "height_mm": 1000.0}, (480, 640))
MODEL = RigModel(np.array([0, 0.8, -0.9, 0, 0, 5e-4, -4e-4]), np.array([0, 1000.0, 1000.0]))
NZ = len(CAMERA_NAMES) + RIG_NAMES.index("nz")


def component(influence, u, detail=""):
    """A component that changes how phase rises with height, by so much."""
    effect = np.zeros(len(CAMERA_NAMES) + len(RIG_NAMES) + 1)
    effect[NZ] = u
    return UncertaintyComponent(influence, effect, detail=detail)


def rig(*components):
    return RigCalibration(CAMERA, MODEL, components)


def test_an_assumed_axis_is_weighed_by_its_share_of_the_variance():
    """Effects of 4 and 3: the assumption has 16 of 25 parts, and without it u is 3 fifths."""
    both = rig(component(Influence.PRINCIPAL_POINT_V, 4e-4), component(Influence.STRIP_HEIGHT, 3e-4))
    (sentence,) = assumption_sentences(both)
    assert sentence.startswith("64 % of the variance")
    before, after = map(float, re.findall(r"from (\S+) to (\S+) deg", sentence)[0])
    assert abs(after / before - 0.6) < 0.02  # printed to two digits
    assert before == float(f"{angle_budget(both).result.u:.2g}")


def test_a_stated_lens_and_a_stated_flatness_leave_nothing_to_say():
    stated = rig(component(Influence.LENS, 4e-4, "1"), component(Influence.PLATE_FLATNESS, 1e-4))
    assert assumption_sentences(stated) == ()


def test_a_plate_without_statement_is_said_to_count_as_a_plane():
    (sentence,) = assumption_sentences(rig(component(Influence.PLATE_FLATNESS, 0.0, NOT_STATED)))
    assert "flatness is not stated" in sentence
