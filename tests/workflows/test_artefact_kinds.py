"""Artefacts of every kind, turned and beside other things: their numbers agree with what was drawn, wrong ones fail."""

import numpy as np
import pytest

from fringecal.errors import FitError
from fringecal.session import capture_of_arrays
from fringecal.simulate import load_rig, render, scene_of
from fringecal.simulate.scene.objects import box
from fringecal.simulate.scene.scene import Scene, together
from fringecal.targets import parse_target
from fringecal.workflows.verify import artefact_checks, verify_artefact

SEED = 15
STRIP_HEIGHTS_MM = [4.000, 4.012, 3.991, 4.006]
NEIGHBOUR = Scene(solids=(box((-15.0, 15.0), (-10.0, 10.0), 18.0, albedo=0.8),))


def q(value, u):
    return {"value": value, "u": u}


def target(kind, **dimensions):
    return parse_target({"format": 1, "kind": kind, "name": kind, "certificate": "drawn", **dimensions})


BALL = target("sphere", diameter_mm=q(60.0, 0.002))
BAR = target("ball-bar", diameters_mm=q([30.0, 44.0], [0.002, 0.002]), spacing_mm=q(110.0, 0.005))
WEDGE = target("wedge", angle_deg=q(10.0, 0.005), width_mm=q(150.0, 0.05), length_mm=q(90.0, 0.05))
BLOCK = target("box", height_mm=q(33.0, 0.003), width_mm=q(60.0, 0.02), length_mm=q(45.0, 0.02))
STRIPS = target(
    "strips",
    count=4,
    width_mm=q(18.0, 0.05),
    gap_mm=q(15.0, 0.05),
    height_mm=q(STRIP_HEIGHTS_MM, [0.002] * 4),
    length_mm=q(120.0, 0.1),
)
ARTEFACTS = {one.kind: one for one in (BALL, BAR, WEDGE, BLOCK, STRIPS)}


def frames(shown, *, at=(20.0, -30.0), turn_deg=37.0, beside=True) -> np.ndarray:
    """Draw an artefact on the thesis's rig, something else standing 140 mm from it."""
    scene = scene_of(shown).placed(*at, turn_deg)
    scenes = [scene, NEIGHBOUR.placed(at[0] - 150.0, at[1] + 60.0, 20.0)] if beside else [scene]
    return render(load_rig("thesis").at(light={"mid_grey": 0.3}), together(scenes), seed=SEED).frames


def verified(thesis, pictures, stated):
    capture = capture_of_arrays("shown", "artefact", pictures, target=stated, phase_shifts_deg=(0.0, 120.0, 240.0))
    return verify_artefact(capture, thesis.found.result.rig)


@pytest.mark.parametrize("kind", sorted(ARTEFACTS))
def test_an_artefact_is_found_and_agrees(thesis, kind) -> None:
    stated = ARTEFACTS[kind]
    found = verified(thesis, frames(stated), stated)
    assert {check.name: check.decision for check in artefact_checks(found) if check.decision != "pass"} == {}
    judged = [reading for reading in found.readings if reading.en is not None]
    assert judged
    # Lengths to a tenth of a millimetre, the angle to a twentieth of a degree: a wrong fringe is 6.5 mm.
    assert max(abs(reading.error) for reading in judged) < 0.1


def test_strips_turned_round_keep_their_own_heights(thesis) -> None:
    found = verified(thesis, frames(STRIPS, turn_deg=37.0 + 180.0), STRIPS)
    assert max(abs(reading.error) for reading in found.readings) < 0.02


def test_a_block_one_fringe_higher_does_not_pass(thesis) -> None:
    """Under the thesis's lamp a fringe is 8 mm / tan(50.7 deg) = 6.5 mm high, a little less further up."""
    for higher in (6.2, 6.4, 6.6):
        taller = target("box", height_mm=q(33.0 + higher, 0.003), width_mm=q(60.0, 0.02), length_mm=q(45.0, 0.02))
        try:
            found = verified(thesis, frames(taller), BLOCK)
        except FitError:
            continue
        assert "fail" in {check.decision for check in artefact_checks(found)}


def test_a_frame_that_moved_shows_in_the_scatter(thesis) -> None:
    pictures = frames(WEDGE)
    pictures[1] = np.roll(pictures[1], 2, axis=0)
    try:
        found = verified(thesis, pictures, WEDGE)
    except FitError:
        return
    failed = {check.name for check in artefact_checks(found) if check.decision == "fail"}
    assert failed & {"scatter of pixels", "largest error of a pixel"}


def test_bare_plate_shows_no_artefact(thesis) -> None:
    plate = render(load_rig("thesis"), Scene(), seed=SEED).frames
    with pytest.raises(FitError, match="no sphere in the picture"):
        verified(thesis, plate, BALL)
