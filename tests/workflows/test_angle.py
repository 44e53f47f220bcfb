"""The projection angle by three estimators on rigs drawn by others, and what each refuses."""

from dataclasses import replace

import numpy as np
import pytest

from fringecal.errors import DetectionError, FringecalError, PhaseError, SessionError
from fringecal.projector.angle.angle_theory import projector_estimates
from fringecal.report.report_files import tables_of
from fringecal.workflows.angle.report import angle_report
from fringecal.workflows.angle.run import break_angles, picture_angles
from fringecal.workflows.commission.angle_findings import angles_of
from fringecal.workflows.shared.stated_projector import projector_of

# Worst error of a column's mean and of the mean over columns, deg: the bars for the phase, ridge and skeleton.
BARS = {"phase": (0.05, 0.02), "ridge": (0.3, 0.1), "skeleton": (1.5, 0.4)}


@pytest.fixture(scope="module")
def estimated(oblique):
    pictures = {
        name: picture_angles(oblique.session, oblique.found.result.camera, estimator=name)
        for name in ("ridge", "skeleton")
    }
    return {"phase": angles_of(oblique.found)} | pictures


@pytest.fixture(params=list(BARS))
def measured(request, estimated):
    return estimated[request.param]


def true_angle(rig, axis, place_mm):
    """Pinhole above the plate: linear between the places that the truth lists, 40 mm apart, errs by 0.002 deg."""
    table = rig.truth[f"angle_{axis}"]
    places = [float(key) for key in table]
    return float(np.interp(place_mm, places, list(table.values())))


def test_every_column_is_within_the_bar(measured, oblique):
    worst, mean = BARS[measured.estimator]
    errors = [c.angle.value - true_angle(oblique, "x", c.place_mm) for c in measured.columns]
    assert len(errors) == 8
    assert np.abs(errors).max() < worst
    # The strips' common height, 3 mm to 0.003 mm, is 0.03 deg for all: allowed besides.
    assert abs(np.mean(errors)) < mean + 2 * 0.03


def test_rows_show_the_slope_of_the_diverging_light(measured, oblique):
    rows = [r for r in measured.rows if abs(r.place_mm) <= 80]
    errors = [r.angle.value - true_angle(oblique, "y", r.place_mm) for r in rows]
    # A row holds a tenth of the fringes: the skeleton's few whole rows of pixels do not average out.
    assert np.abs(errors).max() < (2 * BARS[measured.estimator][0] if measured.estimator != "phase" else 0.1)


def test_intervals_hold_the_truth(measured, oblique):
    low, high = measured.angle.interval_95
    assert low < oblique.truth["angle_origin_deg"] < high
    held = [abs(c.angle.value - true_angle(oblique, "x", c.place_mm)) < c.angle.expanded().U for c in measured.columns]
    assert sum(held) >= 7  # of 8, each with 95 %: two or more outside have a chance of 6 %, and share one height


def test_apparent_angle_is_another_number(measured):
    row = max(measured.rows, key=lambda r: r.place_mm)
    # 100 mm up, the camera 1100 mm above looks back by 5.2 deg: tan of the apparent angle is less by 0.09.
    lower = np.degrees(np.arctan(np.tan(np.radians(row.angle.value)) - row.place_mm / 1100))
    assert abs(row.apparent_deg - row.angle.value) > 2
    assert row.apparent_deg == pytest.approx(lower, abs=0.5)


def test_breaks_carry_place_shift_sigma_and_status(measured):
    frame = measured.breaks_frame()
    assert set(frame["strip"]) == set(range(1, 9))
    assert {"u_px", "v_px", "shift_px", "sigma_px", "shift_mm", "angle_deg", "status"} <= set(frame.columns)
    used = frame[frame["status"] != "off"]
    # 3 mm of glass at 44.2 deg apparent: 2.92 mm, 5.84 px of 0.5 mm.
    assert used["shift_mm"].mean() == pytest.approx(2.92, abs=0.03)
    assert abs(used["shift_px"].mean()) == pytest.approx(5.84, abs=0.06)
    assert (frame["sigma_px"] > 0).all()


def test_stated_sigma_of_a_break_is_its_scatter(estimated):
    breaks = estimated["ridge"].breaks
    trend = np.polynomial.polynomial.polyfit(breaks.v_px, breaks.shift_px, 1)
    left = (breaks.shift_px - np.polynomial.polynomial.polyval(breaks.v_px, trend))[breaks.used]
    assert 0.6 < np.median(breaks.sigma_px) / (1.4826 * np.median(np.abs(left))) < 1.6


def test_the_lamp_is_where_it_is_said_to_be(measured, oblique):
    assert measured.displacement.agrees
    found = projector_estimates(measured.calibration, projector_of(oblique.session))
    for estimate, true in zip(found, oblique.truth["projector"], strict=True):
        assert abs(estimate.value - true) < 3 * estimate.u
        # 0.06 deg at 1350 mm is 1.4 mm; the camera's height, to 3 of 1102 mm, is as much of the lamp's distance.
        assert estimate.u < 5


def test_the_report_holds_both_tables_and_the_convention(estimated):
    report = angle_report(estimated["ridge"])
    tables = tables_of(report)
    assert {"angle / deg", "theory / deg", "En", "dof"} <= set(tables["projection-angle-by-column.csv"].columns)
    assert "projection-angle-by-row.csv" in tables
    notes = [t.header_note for s in report.sections for t in s.tables if "angle" in t.caption.lower()]
    assert sum("normal" in note for note in notes) >= 3
    assert "agrees" in report.verdict.sentence


def one_picture(rig, picture):
    """The oblique session with another picture of the strips."""
    capture = rig.session.one("strips")
    fake = replace(capture)
    object.__setattr__(fake, "_frames", np.repeat(picture[None], 3, axis=0))
    captures = dict(rig.session.captures) | {capture.name: fake}
    return replace(rig.session, captures=captures)


@pytest.mark.parametrize(
    ("spoil", "message"),
    [
        (lambda p: np.full_like(p, 90), "no fringes"),
        (lambda p: np.zeros_like(p), "no fringes"),
        (lambda p: np.random.default_rng(1).integers(0, 255, p.shape, dtype=np.uint8), "no fringes"),
    ],
    ids=["flat", "black", "noise"],
)
def test_pictures_without_fringes_are_named(oblique, spoil, message):
    picture = oblique.session.one("strips").read()[0]
    session = one_picture(oblique, spoil(picture))
    with pytest.raises((PhaseError, DetectionError), match=message):
        picture_angles(session, oblique.found.result.camera, estimator="ridge")


def test_a_bare_plate_has_no_strips(oblique):
    session = one_picture(oblique, oblique.session.one("reference").read()[0])
    with pytest.raises(DetectionError, match="strips"):
        picture_angles(session, oblique.found.result.camera, estimator="ridge")


def test_a_wrong_strip_height_is_seen_against_theory(oblique):
    capture = oblique.session.one("strips")
    height = capture.target.height_mm.model_copy(update={"value": 3.2})
    wrong = replace(capture, target=capture.target.model_copy(update={"height_mm": height}))
    session = replace(oblique.session, captures=dict(oblique.session.captures) | {capture.name: wrong})
    found = picture_angles(session, oblique.found.result.camera, estimator="ridge")
    assert not found.displacement.agrees
    assert "strips' height" in found.displacement.sentence()
    assert all(abs(c.en) > 1 for c in found.columns)


def test_an_unknown_estimator_is_refused(oblique):
    with pytest.raises(SessionError, match="skeleton"):
        break_angles(oblique.session, estimator="spline")  # type: ignore[arg-type]
    assert issubclass(SessionError, FringecalError)
