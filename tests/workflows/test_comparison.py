"""Two calibrations compared: what cannot explain a difference is left out, and what can is not."""

import json
import math
from pathlib import Path

import numpy as np
import pytest
from scipy import stats

from fringecal.errors import RecordError
from fringecal.projector.angle.projection_angle import projection_angle
from fringecal.records.calibration_record import CALIBRATION_FILE, parse_calibration
from fringecal.report.html import render_html
from fringecal.uncertainty.influences import Influence
from fringecal.workflows.compare.report import comparison_report
from fringecal.workflows.compare.run import compare_calibrations, shared_influences
from fringecal.workflows.shared.stored_calibration import calibration_of

ARCHIVE = max((Path(__file__).parents[1] / "records" / "archive").glob("[0-9]*")) / CALIBRATION_FILE
DRAWS = 400


@pytest.fixture(scope="module")
def text():
    return ARCHIVE.read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def record(text):
    return parse_calibration(text)


def changed(text, change):
    """The record with some of it changed."""
    document = json.loads(text)
    change(document)
    return parse_calibration(json.dumps(document))


def another_sheet(document):
    (grid,) = [target for target in document["targets"].values() if target["kind"] == "line-grid"]
    grid["certificate"] = "another sheet"


def by_name(compared):
    return {one.name: one for one in compared}


@pytest.fixture(scope="module")
def itself(record):
    return by_name(compare_calibrations(record, record))


def test_a_calibration_agrees_with_itself(itself):
    assert len(itself) >= 11
    for one in itself.values():
        assert (one.difference.value, one.en, one.agrees) == (0, 0, True)


def test_estimates_are_those_of_the_record(itself, record):
    for name, stated in (
        ("scale, mean", record.scale.mean),
        ("scale, horizontal", record.scale.horizontal),
        ("projection angle", record.projection.angle),
        ("apparent angle", record.projection.apparent_angle),
    ):
        assert itself[name].first.value == pytest.approx(stated.value, rel=1e-9)
        # The record's u comes from derivatives, this one from finite changes of one standard uncertainty.
        assert itself[name].first.u == pytest.approx(stated.u, rel=0.01)
        assert itself[name].first.expanded().k == pytest.approx(stated.estimate().expanded().k, rel=1e-3)


@pytest.mark.parametrize(("quantity", "key"), [("scale, mean", "scale.mean"), ("projection angle", "projection.angle")])
def test_an_artefact_of_both_explains_no_difference(itself, record, quantity, key):
    budget = {row.label: row.contribution for row in record.budgets[key]}
    own = sum(c**2 for label, c in budget.items() if label not in ("grid pitch", "strip height"))
    assert itself[quantity].difference.u == pytest.approx(math.sqrt(2 * own), rel=0.01)


def test_another_sheet_explains_one(text, record):
    other = changed(text, another_sheet)
    assert shared_influences(record, other) == (Influence.STRIP_HEIGHT,)
    one = by_name(compare_calibrations(record, other))["scale, mean"]
    assert one.difference.u == pytest.approx(math.sqrt(2) * record.scale.mean.u, rel=0.01)


def test_the_scatter_of_repeated_calibrations_is_the_one_predicted(itself, record):
    """Pairs drawn from the covariance, their artefacts' errors in common: differences over u scatter by 1."""
    calibration, rng = calibration_of(record), np.random.default_rng(12)
    both = Influence.GRID_PITCH, Influence.STRIP_HEIGHT
    shared = np.array([component.influence in both for component in calibration.components])
    effects = np.stack([component.effect for component in calibration.components])

    def quantities(z):
        drawn = calibration.replaced(calibration.vector + z @ effects)
        rays = drawn.camera.rays(np.array([139.0, 140.0]), np.array([99.5, 99.5]))
        scale = np.hypot(np.diff(rays.ax), np.diff(rays.ay)).item()
        return scale, math.degrees(float(projection_angle(drawn.model, 0.0, 0.0)))

    first = rng.standard_normal((DRAWS, len(effects)))
    second = np.where(shared, first, rng.standard_normal(first.shape))
    differences = np.array([np.subtract(quantities(b), quantities(a)) for a, b in zip(first, second, strict=True)])
    scaled = differences / [itself[name].difference.u for name in ("scale, horizontal", "projection angle")]
    # The standard deviation of 400 normal values is known to 3.5 %: four of these.
    np.testing.assert_allclose(scaled.std(axis=0), 1.0, atol=0.14)


def test_a_change_has_the_sign_of_second_minus_first(text, record):
    def larger(document):
        document["camera"]["parameters"][document["camera"]["names"].index("scale_mm_per_px")] *= 1.002

    compared = by_name(compare_calibrations(record, changed(text, larger)))
    one = compared["scale, horizontal"]
    assert one.difference.value == pytest.approx(0.002 * record.scale.horizontal.value, rel=1e-3)
    expanded = stats.t.ppf(0.975, one.difference.dof) * one.difference.u
    assert one.en == pytest.approx(one.difference.value / expanded)
    assert one.en > 1
    assert not one.agrees
    assert compared["projection angle"].agrees


def test_a_moved_lamp_shows_in_heights_by_the_law_of_the_tangent(text, record):
    """A rig whose phase rises 1 % faster with height reads heights 1 % too high where the other one reads them."""

    def steeper(document):
        names = document["rig"]["parameter_names"]
        document["rig"]["parameters"][names.index("nz")] *= 1 / 1.01

    compared = by_name(compare_calibrations(record, changed(text, steeper)))
    (centre,) = [one for name, one in compared.items() if name.startswith("height") and name.endswith("centre")]
    ratio = calibration_ratio(record, 1 / 1.01)
    assert centre.second.value / centre.first.value == pytest.approx(ratio, rel=2e-3)


def calibration_ratio(record, factor):
    """Height read over height, to first order: phase per height before over phase per height after."""
    calibration = calibration_of(record)
    nx, ny, nz, n0, dx, dy, dz = calibration.model.parameters
    # d(phi)/dz of (n . X + n0) / (d . X + 1) at the origin, without the smooth residual.
    before, after = nz - n0 * dz, factor * nz - n0 * dz
    return before / after


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda d: d["session"].update(rig="another"), "one rig were needed, found those of thesis and another"),
        (lambda d: d["camera"].update(width=281), "280 x 200 px and 281 x 200 px"),
    ],
)
def test_what_cannot_be_compared_is_refused(text, record, change, words):
    with pytest.raises(RecordError, match=words):
        compare_calibrations(record, changed(text, change))


@pytest.mark.parametrize("broken", ["", "[]", '{"format": "fringecal-audit/1"}', "\x00"])
def test_what_is_no_calibration_is_refused(broken):
    with pytest.raises(RecordError, match="record abc"):
        parse_calibration(broken, name="record abc")


def test_the_report_says_which_quantities_differ(text, record):
    def larger(document):
        document["camera"]["parameters"][0] *= 1.002

    report = comparison_report(record, changed(text, larger))
    assert report.verdict.decision == "fail"
    assert "scale, mean (En +" in report.verdict.sentence
    table = report.sections[0].tables[0].frame.set_index("quantity")
    assert table.loc["scale, mean", "verdict"] == "fail"
    assert table.loc["projection angle", "verdict"] == "pass"
    assert table.loc["scale, mean", "U(difference)"] < table.loc["scale, mean", "U(first)"]
    page = render_html(report)
    assert page.count("<figure") == 3
    assert 'class="figures pairs"' in page
    assert comparison_report(record, record).verdict.decision == "pass"
