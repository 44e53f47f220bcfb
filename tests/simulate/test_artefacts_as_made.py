"""Artefacts drawn about what is stated of them, and the time that a virtual session states."""

from datetime import UTC, datetime

import numpy as np
import pytest
from scipy import stats

from fringecal.simulate.rig.rig_files import load_rig
from fringecal.simulate.scene.artefacts_as_made import as_made, true_target
from fringecal.simulate.sessions import session_document
from fringecal.targets import load_target

MANY = 400


def errors_of(name, size, target=None):
    """Errors of a size in units of its u, for many seeds, (seeds, values)."""
    stated = target or load_target(name)
    quantity = getattr(stated, size)
    made = [getattr(as_made(stated, seed), size).values for seed in range(MANY)]
    return (np.array(made) - quantity.values) / np.array(quantity.us)


@pytest.mark.parametrize(("name", "size"), [("grid-10mm", "pitch_mm"), ("angle-bars", "apex_deg")])
def test_sizes_are_off_by_what_their_u_says(name, size):
    """Standard normal errors: a test at 0.1 % of 400 draws."""
    assert stats.kstest(errors_of(name, size)[:, 0], "norm").pvalue > 1e-3


def test_heights_of_strips_are_off_together_unless_an_instrument_is_named():
    strips = load_target("glass-strips")
    height = strips.height_mm.model_copy(update={"value": (3.0,) * 12})
    alike = strips.model_copy(update={"height_mm": height})
    assert np.ptp(errors_of("", "height_mm", alike), axis=1).max() < 1e-9
    measured = alike.model_copy(update={"instrument": "micrometer", "instrument_u_mm": 0.002})
    apart = errors_of("", "height_mm", measured)
    assert np.ptp(apart, axis=1).min() > 0.1
    # The instrument's error is one for all strips, 0.4 u of each: variances add.
    assert apart.mean(axis=1).std() == pytest.approx(np.hypot(0.4, 1 / np.sqrt(12)), rel=0.12)
    assert apart.std() == pytest.approx(np.hypot(0.4, 1.0), rel=0.12)


def test_an_instrument_is_wrong_by_one_amount_on_all_that_it_measured():
    bars, strips = (
        load_target(name).model_copy(update={"instrument": "micrometer", "instrument_u_mm": 1.0})
        for name in ("angle-bars", "glass-strips")
    )
    exact = [
        (one, size, getattr(one, size).model_copy(update={"u": 0.0}))
        for one, size in ((bars, "leg_mm"), (strips, "height_mm"))
    ]
    off = [getattr(as_made(t.model_copy(update={s: q}), 3), s).values[0] - q.values[0] for t, s, q in exact]
    assert off[0] == pytest.approx(off[1])
    assert off[0] != 0


def test_the_rig_says_whether_artefacts_are_drawn_and_its_sessions_share_them():
    rig = load_rig("thesis")
    grid = rig.capture_named("grid")
    assert true_target(rig, grid) == load_target("grid-10mm")
    drawn = rig.at(stated={"artefact_seed": 5})
    true = true_target(drawn, grid)
    assert true.pitch_mm.value != 10.0
    assert true == true_target(drawn, grid)
    assert true != true_target(rig.at(stated={"artefact_seed": 6}), grid)


def test_a_session_states_the_rigs_time():
    rig = load_rig("thesis")
    assert session_document(rig, ())["captured"] == datetime(2008, 1, 1, 12, tzinfo=UTC)
    later = rig.at(captured="2026-10-01T09:00:00Z")
    assert session_document(later, ())["captured"] == datetime(2026, 10, 1, 9, tzinfo=UTC)
