"""Components of an uncertainty: names that files keep, what they combine to, and draws of them against closed forms."""

import json
import math
from pathlib import Path

import numpy as np
import pytest
from scipy import stats

from fringecal.uncertainty.budgets import Budget, combined
from fringecal.uncertainty.components import UncertaintyComponent, contributions
from fringecal.uncertainty.estimates import Estimate
from fringecal.uncertainty.influences import TEXTS, Influence, Source
from fringecal.uncertainty.sampling.first_order import check_first_order, draw_deviates
from fringecal.uncertainty.sampling.monte_carlo import summarise_draws

ARCHIVE = Path(__file__).parents[1] / "records" / "archive"
#: What the versions before the enumeration wrote as the label of a component, by which they open for ever.
WRITTEN = {
    "phase scatter": Source(Influence.PHASE_SCATTER),
    "grid pitch": Source(Influence.GRID_PITCH),
    "grid crossings": Source(Influence.GRID_CROSSINGS),
    "camera height": Source(Influence.CAMERA_HEIGHT),
    "principal point, u": Source(Influence.PRINCIPAL_POINT_U),
    "principal point, v": Source(Influence.PRINCIPAL_POINT_V),
    "camera tilt, x": Source(Influence.CAMERA_TILT_X),
    "camera tilt, y": Source(Influence.CAMERA_TILT_Y),
    "lens 1": Source(Influence.LENS, "1"),
    "lens 12": Source(Influence.LENS, "12"),
    "strip height": Source(Influence.STRIP_HEIGHT),
    "step height": Source(Influence.STEP_HEIGHT),
    "box height": Source(Influence.BOX_HEIGHT),
    "flat height": Source(Influence.FLAT_HEIGHT),
    "wedge angle": Source(Influence.WEDGE_ANGLE),
    "wedge position": Source(Influence.WEDGE_POSITION),
    "added height": Source(Influence.ADDED_HEIGHT),
    "scatter over the artefact": Source(Influence.ARTEFACT_SCATTER),
    "phase of one pixel": Source(Influence.PIXEL_PHASE),
    "extrapolation beyond 3 mm": Source(Influence.EXTRAPOLATION, "3 mm"),
}


# ---- names ----------------------------------------------------------------------------------------
@pytest.mark.parametrize("label", WRITTEN)
def test_labels_of_old_records_are_read_and_written_as_they_were(label):
    assert Source.parse(label) == WRITTEN[label]
    assert WRITTEN[label].identifier == label


@pytest.mark.parametrize("file", sorted(ARCHIVE.glob("*/calibration.json")), ids=lambda file: file.parent.name)
def test_every_label_of_the_archive_is_known(file):
    record = json.loads(file.read_text(encoding="utf-8"))
    labels = {mode["label"] for mode in record["rig"]["modes"]}
    labels |= {row["label"] for rows in record["budgets"].values() for row in rows}
    assert labels <= set(WRITTEN)


@pytest.mark.parametrize("label", ["strip hieght", "lens1", "", "camera"])
def test_a_label_that_names_no_influence_is_refused(label):
    with pytest.raises(ValueError, match="names no influence; known: 'phase scatter'"):
        Source.parse(label)


def test_an_instance_stands_beside_its_influence():
    second = Source(Influence.STRIP_HEIGHT, "glass-strips-b")
    assert Source.parse(second.identifier) == second != Source(Influence.STRIP_HEIGHT)
    assert second.text == "strip height glass-strips-b"


def test_every_influence_has_a_text():
    assert set(TEXTS) == set(Influence)


# ---- what components combine to -------------------------------------------------------------------
def test_axes_of_one_covariance_are_one_contribution():
    axes = [UncertaintyComponent(Influence.PHASE_SCATTER, effect, dof=9) for effect in (2.0, -3.0, 6.0)]
    lens = [UncertaintyComponent(Influence.LENS, 1.0, detail=str(k)) for k in (1, 2)]
    assert contributions([*lens, *axes]) == {
        Source(Influence.PHASE_SCATTER): 7.0,  # 4 + 9 + 36 = 49
        Source(Influence.LENS, "1"): 1.0,
        Source(Influence.LENS, "2"): 1.0,
    }


def test_an_inputs_component_is_its_sensitivity_times_u():
    """GUM 5.1.3: u_i = c_i u(x_i); an estimate that is no influence of the rig goes by its label."""
    strip = Estimate(3.0, 0.005, "mm", dof=12, influence=Influence.STRIP_HEIGHT)
    one, own = UncertaintyComponent.of(strip, -4.0), UncertaintyComponent.of(Estimate(1.0, 0.5, label="l_s"), 2.0)
    assert (one.influence, one.effect, one.dof) == (Influence.STRIP_HEIGHT, -0.02, 12)
    assert (own.source, own.effect, own.dof) == (Source(Influence.INPUT, "l_s"), 1.0, math.inf)
    assert own.source.text == "l_s"


def test_correlated_components_share_their_covariance():
    """Two fully correlated components add (JCGM 100:2008, 5.2.2, note 1): 3 + 4 = 7, shares 3 * 7 and 4 * 7 of 49."""
    parts = [UncertaintyComponent(Influence.INPUT, effect, detail=name) for name, effect in (("a", 3.0), ("b", 4.0))]
    together = combined(0.0, parts, correlation=np.ones((2, 2)))
    assert together.result.u == pytest.approx(7.0)
    percents = {source.detail: percent for source, percent in together.percents().items()}
    assert percents == {"a": pytest.approx(100 * 21 / 49), "b": pytest.approx(100 * 28 / 49)}
    against = combined(0.0, parts, correlation=[[1.0, -1.0], [-1.0, 1.0]])
    assert against.result.u == pytest.approx(1.0)


# ---- draws ----------------------------------------------------------------------------------------
def test_deviates_of_a_common_scatter_are_multivariate_t():
    """Any linear combination of a multivariate t is Student's t with the same dof and the combined scale."""
    axes = [UncertaintyComponent(Influence.PHASE_SCATTER, e, dof=5) for e in (0.6, 0.8)]
    drawn = draw_deviates(axes, np.random.default_rng(3), 20_000) @ [0.6, 0.8]
    assert stats.kstest(drawn, "t", args=(5,)).pvalue > 0.01
    # Two independent t would have tails that are too short.
    apart = [UncertaintyComponent(Influence.LENS, e, dof=5, detail=str(e)) for e in (0.6, 0.8)]
    independent = draw_deviates(apart, np.random.default_rng(3), 20_000) @ [0.6, 0.8]
    assert stats.kstest(independent, "t", args=(5,)).pvalue < 0.01


def test_deviates_are_normal_where_u_is_exactly_known():
    drawn = draw_deviates([UncertaintyComponent(Influence.GRID_PITCH, 1.0)] * 2, np.random.default_rng(4), 20_000)
    assert stats.kstest(drawn[:, 0], "norm").pvalue > 0.01
    assert abs(np.corrcoef(drawn.T)[0, 1]) < 0.03  # 4 / sqrt(20 000)


def test_a_linear_model_passes_the_check_and_a_curved_one_fails():
    """JCGM 101:2008, 9.4.2.3: at x1 = 0.010 the comparison loss is no longer what first order says it is."""
    inputs = [UncertaintyComponent(Influence.INPUT, 0.005, detail=name) for name in ("x1", "x2")]
    deviates = draw_deviates(inputs, np.random.default_rng(9), 100_000) * 0.005
    straight = combined(0.010, inputs)
    assert check_first_order(straight, 0.010 + deviates.sum(axis=1), digits=1).validation.valid
    slope = [UncertaintyComponent(Influence.INPUT, 1e6 * 2 * 0.010 * 0.005, detail="x1")]
    loss = check_first_order(Budget(combined(100.0, slope).result, tuple(slope)), 1e6 * loss_of(deviates), digits=1)
    assert not loss.validation.valid
    assert loss.budget.result.u == pytest.approx(100)
    # By the published closed form y = 150, u = 111.8: first order states 11 % too little.
    assert (loss.monte_carlo.value, loss.monte_carlo.u) == (pytest.approx(150, abs=1.5), pytest.approx(111.8, abs=1.5))
    assert loss.u_ratio == pytest.approx(100 / 111.8, abs=0.015)


def loss_of(deviates):
    return (0.010 + deviates[:, 0]) ** 2 + deviates[:, 1] ** 2


def test_the_draws_say_how_far_they_are_to_be_trusted():
    """Over many Monte Carlos of one size, twice the standard deviation of their ends is what each says of itself."""
    rng = np.random.default_rng(6)
    runs = [summarise_draws(rng.normal(0.0, 1.0, 4_000)) for _ in range(60)]
    spread = 2 * np.std([run.symmetric[1] for run in runs], ddof=1)
    # The shortest interval's width wanders more than the ends do, and the tolerance is that of the worst result.
    assert 0.8 * spread < np.median([run.tolerance for run in runs]) < 3 * spread
