"""The reports of a rig that was commissioned, verified and used: what they say, and that every picture is one."""

import io
import math
import re
from dataclasses import replace
from datetime import UTC, datetime

import numpy as np
import pytest
from PIL import Image
from scipy import stats

from fringecal.reconstruct.phase_to_height import Reason
from fringecal.records import CalibrationUsed, Laboratory, read_calibration, sha256_of, write_calibration
from fringecal.report.html import render_html
from fringecal.report.report_files import figures_of, tables_of
from fringecal.verification.zigzag.filters import FilterResult
from fringecal.workflows.certificate.run import certificate_of
from fringecal.workflows.commission.angle_findings import angles_of
from fringecal.workflows.commission.angle_tables import angle_section, heights_table
from fringecal.workflows.commission.record import calibration_record
from fringecal.workflows.commission.report import commission_report
from fringecal.workflows.commission.residual_section import residual_maps
from fringecal.workflows.commission.rig_section import rig_section
from fringecal.workflows.reconstruct.report import measurement_report
from fringecal.workflows.reconstruct.run import reconstruct
from fringecal.workflows.verify.record import verification_record
from fringecal.workflows.verify.report import verdict_of, verification_report

CREATED = datetime(2026, 11, 22, 10, tzinfo=UTC)
MOST_MEGABYTES = 10  # what every mailbox takes


@pytest.fixture(scope="module")
def commissioned(oblique):
    return commission_report(oblique.commissioned, command="fringecal commission rig --out out", created=CREATED)


@pytest.fixture(scope="module")
def verified(oblique):
    errors = oblique.bars.errors
    filters = (FilterResult("mean", "none", errors, 1), FilterResult("none", "none", errors, 2))
    return verification_report(replace(oblique.bars, filters=filters), created=CREATED)


@pytest.fixture(scope="module")
def measured(oblique):
    return measurement_report(reconstruct(oblique.session, "bars", oblique.found.result.rig), created=CREATED)


@pytest.mark.parametrize("name", ["commissioned", "verified", "measured"])
def test_every_figure_is_a_picture_with_words_beside_it(name, request):
    report = request.getfixturevalue(name)
    items = [item for section in report.sections for item in section.figures]
    for item, content in zip(items, figures_of(report).values(), strict=True):
        assert len(item.alt) > 30, item.caption
        assert "nan" not in item.alt, item.alt
        if item.encoding == "png":
            # A picture of one colour would be an empty one.
            assert len(Image.open(io.BytesIO(content)).convert("RGB").getcolors(1 << 24)) > 20
        else:
            assert b"</svg>" in content


@pytest.mark.parametrize("name", ["commissioned", "verified", "measured"])
def test_the_page_is_small_enough_to_send_and_says_no_nan(name, request):
    page = render_html(request.getfixturevalue(name))
    assert len(page) < MOST_MEGABYTES * 1e6
    text = re.sub(r'(src|href)="data:[^"]*"', "", page)
    assert not re.search(r"\bnan\b|\binf mm\b", text)
    assert "2026-11-22" in text


def fact(report, name):
    return next(f.value for f in report.facts if f.name == name)


def test_headline_numbers_are_the_true_ones(commissioned, oblique):
    scale = float(fact(commissioned, "Mean scale").split("(")[0])
    angle = float(fact(commissioned, "Projection angle").split("(")[0])
    # The tolerances that the independent rig is judged by: 0.3 % and 0.3 deg.
    assert scale == pytest.approx((oblique.truth["scale_h"] + oblique.truth["scale_v"]) / 2, rel=3e-3)
    assert angle == pytest.approx(oblique.truth["angle_origin_deg"], abs=0.3)


def test_every_picture_used_is_listed_with_its_hash(commissioned, oblique):
    listed = {entry.file: entry.sha256 for entry in commissioned.inputs}
    for capture in (oblique.session.one(kind) for kind in ("grid", "reference", "strips", "artefact")):
        for path, digest in zip(capture.paths, capture.sha256, strict=True):
            assert listed[path.name] == digest
    assert "session.toml" in listed


def test_the_angle_table_can_be_checked_by_hand(commissioned):
    table = tables_of(commissioned)["projection-angle-by-column.csv"]
    difference = table["angle / deg"] - table["theory / deg"]
    assert np.allclose(table["difference / deg"], difference, atol=1e-12)
    # U by Student's t for the dof printed beside it; theory, from stated positions, by the normal distribution.
    assert np.allclose(table["U / deg"], stats.t.ppf(0.975, table["dof"]) * table["u / deg"])
    both = np.hypot(table["U / deg"], stats.norm.ppf(0.975) * table["u(theory) / deg"])
    assert np.allclose(table["En"], difference / both)


@pytest.mark.parametrize("name", ["commissioned", "verified", "measured"])
def test_every_table_with_en_says_how_it_is_formed(name, request):
    tables = [table for section in request.getfixturevalue(name).sections for table in section.tables]
    formed = [table for table in tables if "En" in table.frame or "U (95 %)" in table.frame]
    assert formed or name == "measured"
    for table in formed:
        assert "U: 95 % coverage, k from the effective degrees of freedom" in table.header_note, table.caption


@pytest.fixture(scope="module")
def recorded(oblique, tmp_path_factory):
    """The records of commissioning and verification, and the certificate of both."""
    calibration = calibration_record(oblique.commissioned)
    file = write_calibration(calibration, tmp_path_factory.mktemp("recorded"))
    used = CalibrationUsed.of(read_calibration(file), file)
    bars = verification_record(oblique.bars, oblique.session, used)
    certificate = certificate_of(calibration, sha256_of(file), Laboratory(), verification=bars, draft=True)
    return calibration, bars, certificate


def certified(certificate, name):
    """Return the column of a certificate that has expanded uncertainties: U and k of every row."""
    tables = (table for group in certificate.groups for table in group.tables if table.name == name)
    column = next(column for table in tables for column in table.columns if column.expanded)
    return [float(text) for text in column.expanded], column.k


def test_record_table_and_certificate_hold_one_en_and_one_k(recorded, commissioned, verified):
    """U = k u with k by Student's t of the record's dof, and En by that U, wherever one of them stands."""
    calibration, bars, certificate = recorded
    judged = {one.judged.name: float(one.judged.value) for one in certificate.conformities}
    profiles = tables_of(verified)["errors-per-profile-edge-zones-left-out.csv"].set_index("profile")
    columns = tables_of(commissioned)["projection-angle-by-column.csv"]
    rows = [(p.u_mm, p.dof) for p in bars.profiles], [(c.u_deg, c.dof) for c in calibration.projection.columns]
    for stated, name in zip(rows, ("Height errors along profiles", "Projection angle along x"), strict=True):
        k = [stats.t.ppf(0.975, np.inf if dof is None else dof) for _, dof in stated]
        expanded, factors = certified(certificate, name)
        assert factors == pytest.approx(k)
        assert expanded == pytest.approx([factor * u for factor, (u, _) in zip(k, stated, strict=True)], rel=0.05)
    for profile in bars.profiles:
        by_hand = profile.mean_mm / (stats.t.ppf(0.975, profile.dof) * profile.u_mm)
        printed = judged[f"Mean error, profile {profile.name} (En)"]
        assert profile.en == pytest.approx(by_hand) == profiles.loc[profile.name, "En"]
        assert printed == pytest.approx(by_hand, rel=5e-3)  # three digits
        assert profiles.loc[profile.name, "dof"] == pytest.approx(profile.dof)
    assert [c.en for c in calibration.projection.columns] == pytest.approx(list(columns["En"]))
    theory, angle = calibration.projection.theory, calibration.projection.angle
    both = math.hypot(stats.t.ppf(0.975, angle.dof) * angle.u, stats.norm.ppf(0.975) * theory.angle.u)
    assert theory.en == pytest.approx((angle.value - theory.angle.value) / both)
    assert judged["Angle against theory (En)"] == pytest.approx(theory.en, rel=5e-3)
    for record in (calibration, bars):
        assert "U: 95 % coverage, k from the effective degrees of freedom" in record.en_definition
    assert any("both expanded uncertainties" in method.description for method in certificate.methods)


def test_budgets_add_up_to_the_uncertainties_they_explain(commissioned, oblique):
    tables = tables_of(commissioned)
    angle = tables["budget-of-the-projection-angle.csv"]["contribution / deg"]
    scale = tables["budget-of-the-mean-scale.csv"]["contribution / (mm/px)"]
    assert math.sqrt((angle**2).sum()) == pytest.approx(oblique.found.result.origin.angle.u)
    # 1 %: effects on the scale are finite differences.
    assert math.sqrt((scale**2).sum()) == pytest.approx(oblique.found.result.camera.scales["mean"].u, rel=0.01)


def test_a_height_is_less_well_known_the_higher_it_is(oblique):
    frame = heights_table(oblique.found.result.rig, 0.01).frame
    assert list(frame["height / mm"].unique()) == [5, 20, 50]
    parts = frame.drop(columns=["height / mm", "place", "combined"])
    assert np.allclose(frame["combined"], np.sqrt((parts**2).sum(axis=1)))
    # A strip that is higher by a share makes every height so: u grows as the height.
    centre = frame[frame["place"] == "centre"].set_index("height / mm")["strip height"]
    assert centre[20] / centre[5] == pytest.approx(4, rel=0.05)


def test_strips_of_one_height_leave_no_residual_of_their_own(commissioned):
    # Five strip uncertainties would be 25 um; noise of some thousand points is far less.
    assert tables_of(commissioned)["strips.csv"]["as height / mm"].abs().max() < 0.01


def test_without_a_stated_projector_there_is_no_theory(oblique):
    result = oblique.found.result
    unstated = replace(result, stated_projector=None, origin=replace(result.origin, theory=None))
    session = replace(oblique.session, projector=None)
    calibrated = replace(oblique.found, session=session, result=unstated)
    report = commission_report(replace(oblique.commissioned, calibrated=calibrated, angles=angles_of(calibrated)))
    tables = tables_of(report)
    assert "Angle in theory" not in {f.name for f in report.facts}
    assert "En" not in tables["projection-angle-by-column.csv"]
    assert list(tables["position-of-the-projector.csv"]) == ["axis", "fitted / mm", "u / mm", "from"]
    assert "cannot be compared with" in report.verdict.sentence


def test_parallel_light_has_no_position(oblique):
    calibration = oblique.found.result.rig
    model = replace(calibration.model, projector_mm=np.full(3, np.inf))
    result = replace(oblique.found.result, rig=replace(calibration, model=model))
    rig = rig_section(replace(oblique.found, result=result), residual_maps(result))
    assert "Position of the projector" not in {table.caption for table in rig.tables}
    assert any("no position" in sentence for sentence in rig.sentences)
    assert "The rig to scale" not in {item.caption for item in rig.figures}


def test_no_columns_is_said_not_drawn(oblique):
    angle = angle_section(replace(angles_of(oblique.found), columns=(), rows=()))
    assert angle.figures == ()
    assert "No column" in angle.sentences[-1]


def test_the_error_tables_hold_every_profile_and_all_together(verified, oblique):
    tables = tables_of(verified)
    without = tables["errors-per-profile-edge-zones-left-out.csv"]
    edges = tables["errors-per-profile-edge-zones-included.csv"]
    assert list(without["profile"]) == [*"ABCDE", "pooled"] == list(edges["profile"])
    full = oblique.bars.errors.full_height_mm
    assert np.allclose(without["mean / %"], 100 * without["mean / mm"] / full)
    expanded = stats.t.ppf(0.975, without["dof"]) * without["u(mean) / mm"]
    assert np.allclose(without["En"], without["mean / mm"] / expanded)
    assert (edges["n"] > without["n"]).all()
    assert len(tables["flank-angles.csv"]) == 2 * oblique.bars.target.count


def test_the_constant_angle_is_explained(verified, oblique):
    section = next(s for s in verified.sections if s.title == "Height models")
    assert "one constant angle" in section.sentences[0]
    assert "diverges" in section.sentences[1]
    table = tables_of(verified)["height-models.csv"].set_index("model")
    assert set(table.index[table["fitted to"] == "virtual flats of the rig model"]) == {
        "cubic", "pixelwise", "pixelwise-three-term"
    }  # fmt: skip
    assert "virtual flats of the rig model itself" in section.sentences[2]
    worst = table["worst band / %"]
    assert worst["constant-angle"] == pytest.approx(oblique.bars.models["constant-angle"].worst_band_percent)


def test_filters_are_there_only_where_they_were_tried(verified, oblique):
    assert "Filters" in {s.title for s in verified.sections}
    assert "Filters" not in {s.title for s in verification_report(oblique.bars).sections}


def test_errors_beyond_the_uncertainties_fail_and_none_known_informs(oblique):
    errors = oblique.bars.errors
    off = replace(errors.profiles[2], name="C", en=-1.3)
    failed = verdict_of(replace(errors, profiles=(*errors.profiles[:2], off, *errors.profiles[3:])))
    assert failed.decision == "fail"
    assert "1.30 (profile C)" in failed.sentence
    unknown = tuple(replace(p, en=None) for p in errors.profiles)
    informed = verdict_of(replace(errors, profiles=unknown, pooled=replace(errors.pooled, en=None)))
    assert informed.decision == "info"


def test_masked_pixels_are_shown_with_their_reasons(measured, oblique):
    table = tables_of(measured)["valid-and-masked-pixels.csv"].set_index("pixels")["share of the picture / %"]
    assert set(table.index) == {"valid", *(str(r.name).lower().replace("_", " ") for r in Reason)}
    masked = next(s for s in measured.sections if s.title == "Masked pixels")
    assert bool(masked.figures) == (table["valid"] < 100)


def test_a_measurement_judges_its_capture_and_not_the_object(measured):
    assert measured.verdict.decision == "pass"
    assert "not on the object" in measured.verdict.sentence
    causes = tables_of(measured)["uncertainty-budget-of-the-height.csv"]["share of the variance / %"]
    assert causes.sum() == pytest.approx(100)
    assert causes.is_monotonic_decreasing
