"""Error tables must return the error put in, in closed form."""

# ruff: noqa: ARG005  # errors are functions of x, y and height, whichever they use

import math
from dataclasses import replace

import numpy as np
import pytest

from fringecal.errors import FitError
from fringecal.verification import (
    FILTERS,
    InCommon,
    ZigzagPose,
    filter_study,
    filtered,
    models_table,
    ranking_table,
    register_zigzag,
    zigzag_errors,
    zigzag_shape,
)

FULL = 40 / math.sqrt(2)  # height of a bar with legs of 40 mm at 90 deg
AT_ORIGIN = ZigzagPose(0.0, 0.0, 0.0)


def judged(surface, target, **options):
    return zigzag_errors(surface, target, register_zigzag(surface, target), **options)


def test_scale_error_of_one_percent(make_scene, make_bars):
    errors = judged(make_scene(error=lambda x, y, z: 0.01 * z), make_bars())
    for profile in errors.profiles:
        # the mean height over flanks is H/2, so 1 % of it is 0.5 % of full height; pixels step 2.6 % of H
        assert profile.mean_percent == pytest.approx(0.5, abs=0.01)
        assert profile.sd_mm == pytest.approx(0.01 * FULL * (1 - 6 * 0.734 / FULL) / math.sqrt(12), rel=0.03)
        assert profile.max_percent <= 1.0
    assert all(p.max_percent == pytest.approx(1.0, abs=0.03) for p in errors.profiles_with_edges)
    assert errors.terms[0].name == "scale"
    assert errors.terms[0].size == pytest.approx(1.0, abs=0.01)
    # a 45 deg flank scaled by 1.01 stands at atan(1.01)
    expected = math.degrees(math.atan(1.01)) - 45
    assert [f.error_deg for c in errors.curves for f in c.flanks] == pytest.approx([expected] * 40, abs=0.01)


def test_offset_and_its_en(make_scene, make_bars):
    surface = make_scene(error=lambda x, y, z: 0.1 + 0 * z)
    errors = judged(surface, make_bars())
    for profile in (*errors.profiles, errors.pooled, errors.area):
        assert profile.mean_mm == pytest.approx(0.1, abs=1e-4)
        assert profile.sd_mm < 1e-3
        assert profile.u_mm == pytest.approx(0.05, rel=1e-6)  # u_z taken as common to all pixels
        assert profile.en == pytest.approx(1.0204, abs=1e-3)  # 0.1 / (1.960 x 0.05)
    assert errors.terms[0].name == "offset"
    assert errors.worst_band_mm == pytest.approx(0.1, abs=1e-3)
    assert "same height error everywhere" in errors.sentence


def test_en_of_a_mean_by_the_degrees_of_freedom_of_what_is_common(make_scene, make_bars):
    """One influence of 5 degrees of freedom raises all heights by 0.02 mm: k is 2.571 where nothing else counts."""
    surface = make_scene(error=lambda x, y, z: 0.1 + 0 * z)
    common, exact = np.full(surface.z.shape, 0.02), np.full(surface.z.shape, 0.03)
    alone = judged(replace(surface, u_z=common), make_bars(), sensitivities=[common], dof=(5,)).pooled
    assert (alone.u_mm, alone.dof) == (pytest.approx(0.02), pytest.approx(5.0, rel=1e-6))
    assert alone.en == pytest.approx(alone.mean_mm / (2.571 * 0.02), rel=2e-4)
    both = np.hypot(common, exact)
    joined = judged(replace(surface, u_z=both), make_bars(), sensitivities=[common, exact], dof=(5, np.inf)).pooled
    # JCGM 100:2008, G.2b: 0.000 4 + 0.000 9 squared, over 0.02^4 / 5
    assert joined.dof == pytest.approx(0.0013**2 / (0.02**4 / 5), rel=1e-6)
    noisy = judged(replace(surface, u_z=both), make_bars(), sensitivities=[common], dof=(5,)).pooled
    assert 5 < noisy.dof < 5.2  # the noise of a thousand pixels averages out
    assert judged(surface, make_bars()).pooled.dof == np.inf


def test_tilt_along_the_bars(make_scene, make_bars):
    errors = judged(make_scene(error=lambda x, y, z: 0.002 * y), make_bars())
    for profile in errors.profiles:
        assert profile.mean_mm == pytest.approx(0.002 * profile.y_mm, abs=1e-3)
    assert errors.terms[0].name == "tilt_y"
    assert errors.terms[0].size == pytest.approx(2.0, abs=0.02)  # mrad
    # the outermost tenth of 240 mm is centred 108 mm out, 1.5 mm less where the zone at the end is left out
    assert errors.worst_band_mm == pytest.approx(0.002 * 108, abs=4e-3)


def test_scale_that_changes_over_the_field(make_scene, make_bars):
    errors = judged(make_scene(error=lambda x, y, z: -0.0006 * y * z), make_bars())
    assert errors.terms[0].name == "scale_over_y"
    assert errors.terms[0].size == pytest.approx(-6.0, abs=0.05)  # % per 100 mm
    assert "changes along y" in errors.sentence


def test_noise_and_outliers(make_scene, make_bars):
    errors = judged(make_scene(noise=0.2), make_bars())
    assert errors.pooled.sd_mm == pytest.approx(0.2, rel=0.06)  # 1500 pixels: sd known to 1.8 %, three of them
    assert errors.terms[0].name == "noise"
    wrong = judged(make_scene(noise=0.02, outliers=0.05), make_bars())
    assert wrong.terms[0].name == "outliers"
    assert wrong.terms[0].size == pytest.approx(5.0, abs=0.3)  # % of the pixels


def test_thesis_rows_where_they_cross(make_scene, make_bars):
    surface = make_scene(length=345.0, size=(470, 480))
    errors = judged(surface, make_bars(length=345.0))
    assert [p.row_px for p in errors.profiles] == [10, 121, 232, 343, 444]
    assert [p.name for p in errors.profiles] == list("ABCDE")
    assert errors.axis == "row"
    # y up: row 10 of 470 at 0.734 mm/px
    assert errors.profiles[0].y_mm == pytest.approx((234.5 - 10) * 0.734, abs=1e-6)
    short = judged(make_scene(length=200.0), make_bars(length=200.0))
    rows = [p.row_px for p in short.profiles]
    # 200 mm = 272 px about row 219.5: 10 % and 90 % of it
    assert rows[0] == pytest.approx(219.5 - 0.4 * 272.5, abs=2)
    assert rows[4] == pytest.approx(219.5 + 0.4 * 272.5, abs=2)


def test_ridges_along_rows_give_columns(make_scene, make_bars):
    surface = make_scene(rotation_deg=90.0, length=200.0, error=lambda x, y, z: 0.01 * z)
    errors = judged(surface, make_bars(length=200.0))
    assert errors.axis == "column"
    assert errors.pooled.mean_percent == pytest.approx(0.5, abs=0.01)


def test_chosen_rows_and_zone(make_scene, make_bars):
    errors = judged(make_scene(), make_bars(), rows_px=[200, 220], edge_zone_mm=5.0)
    assert [p.row_px for p in errors.profiles] == [200, 220]
    assert errors.edge_zone_mm == 5.0
    # 4 bars of 56.57 mm less 16 half zones of 5 mm, at 0.734 mm/px
    assert errors.profiles[0].n == pytest.approx((4 * 56.5685 - 16 * 5.0) / 0.734, abs=8)
    curve = errors.curves[0]
    distance = np.abs((curve.across_mm + 14.1421) % 28.2843 - 14.1421)
    assert distance[~curve.edge].min() >= 5.0
    with pytest.raises(FitError, match="outside the picture"):
        judged(make_scene(), make_bars(), rows_px=[9999])
    with pytest.raises(FitError, match="valid pixels"):
        judged(make_scene(length=200.0), make_bars(length=200.0), rows_px=[3])


def test_missing_share(make_scene, make_bars):
    surface = make_scene(count=4)
    mask = surface.mask & (np.random.default_rng(5).random(surface.mask.shape) > 0.3)
    hidden = {name: np.where(mask, getattr(surface, name), np.nan) for name in ("x", "y", "z", "u_z")}
    errors = judged(replace(surface, mask=mask, **hidden), make_bars())
    assert errors.area.missing_share == pytest.approx(0.3, abs=0.01)


def test_random_part_averages_and_systematic_part_stays(make_scene, make_bars):
    surface = make_scene()
    scale = surface.truth[None]  # height error per unit of scale
    u_scale, u_random = 0.004, 0.05
    u_z = np.hypot(u_random, u_scale * surface.truth)
    errors = judged(replace(surface, u_z=u_z), make_bars(), sensitivities=scale, covariance=[u_scale])
    profile = errors.profiles[2]
    expected = math.hypot(u_random / math.sqrt(profile.n), u_scale * FULL / 2)
    assert profile.u_mm == pytest.approx(expected, rel=0.01)  # mean height of the pixels is H/2 within 1 %


def test_uncertainty_of_the_target(make_scene, make_bars):
    surface = replace(make_scene(), u_z=np.zeros((440, 480)))
    errors = judged(surface, make_bars(u_leg=0.1, u_apex=0.0))
    # legs longer by d lift the surface over a fixed point by d cos 45 on average: the shifts of the ridges
    # move left and right flanks by opposite amounts, equal but for a pixel in 32 on flanks of the outer bars
    assert errors.area.u_mm == pytest.approx(0.1 * math.cos(math.pi / 4), rel=0.05)
    assert judged(surface, make_bars()).area.en is None


@pytest.mark.parametrize(("instrument", "temperature"), [(0.1, 0.0), (0.0, 0.1)])
def test_what_measured_rig_and_bars_alike_cancels(make_scene, make_bars, instrument, temperature):
    # Strips and bars measured with one micrometer, or in one warm room: read high, both lift heights and bars by
    # cos 45 of it, and what is left is nothing. Told apart they add up in squares.
    lift = 0.1 * math.cos(math.pi / 4)
    surface = replace(make_scene(), u_z=np.full((440, 480), lift))
    bars = make_bars().model_copy(update={"instrument_u_mm": instrument, "thermal_rel_u": temperature / 40})
    maps = np.full((1, 440, 480), lift)
    apart = judged(surface, bars, sensitivities=maps)
    alike = judged(surface, bars, sensitivities=maps, common=InCommon((0,), (0,)))
    assert apart.area.u_mm == pytest.approx(lift * math.sqrt(2), rel=0.05)
    assert alike.area.u_mm < 0.05 * lift
    # Correlated by 0.5: variances 1 + 1 - 2 x 0.5.
    halves = np.stack([0.5 * maps[0], math.sqrt(0.75) * maps[0]])
    half = judged(surface, bars, sensitivities=halves, common=InCommon((0,), (0,)))
    assert half.area.u_mm == pytest.approx(lift * math.sqrt(1 + 1 - 2 * 0.5), rel=0.05)


def test_rounded_ridge(make_scene, make_bars):
    shape = zigzag_shape(make_bars(radius=3.0))
    # 3 mm about a right-angled ridge take 3 (sqrt 2 - 1) mm off its top
    assert shape.height_mm == pytest.approx(FULL - 3 * (math.sqrt(2) - 1))
    errors = zigzag_errors(make_scene(), make_bars(radius=3.0), AT_ORIGIN)
    assert errors.profiles[0].mean_mm == pytest.approx(0.0, abs=0.02)
    assert errors.profiles_with_edges[0].max_abs_mm == pytest.approx(3 * (math.sqrt(2) - 1), abs=0.4)


def test_tables(make_scene, make_bars):
    errors = judged(make_scene(noise=0.05), make_bars())
    table = errors.table()
    assert list(table["name"]) == [*"ABCDE", "pooled"]
    assert table["n"].iloc[:5].sum() == table["n"].iloc[5]
    assert (errors.table(edges=True)["n"] > table["n"]).all()
    assert len(errors.flank_table()) == 5 * 8
    models = models_table({"one": errors, "two": errors})
    assert list(models["model"]) == ["one", "two"]


def test_filters_by_closed_form():
    ramp = np.arange(7.0)[None, :] * np.ones((5, 1))
    assert filtered(ramp, "median")[1:-1, 1:-1] == pytest.approx(ramp[1:-1, 1:-1])
    assert filtered(ramp, "mean")[1:-1, 1:-1] == pytest.approx(ramp[1:-1, 1:-1])
    holed = ramp.copy()
    holed[2, 3] = np.nan
    result = filtered(holed, "median+mean")
    assert np.isnan(result[2, 3])
    assert np.isfinite(np.delete(result.ravel(), 2 * 7 + 3)).all()
    corner = filtered(np.array([[1.0, 2.0], [3.0, 10.0]]), "median")
    assert corner.tolist() == [[2.5, 2.5], [2.5, 2.5]]  # median of four
    with pytest.raises(ValueError, match="not one of"):
        filtered(ramp, "gauss")


def test_filters_are_ranked(make_scene, make_bars):
    surface = make_scene(noise=0.1, outliers=0.03)
    pose = register_zigzag(surface, make_bars())
    study = filter_study({"none": surface, "median": replace(surface, z=filtered(surface.z, "median"))},
                         make_bars(), pose)  # fmt: skip
    assert len(study) == 2 * len(FILTERS)
    assert [r.rank for r in study] == list(range(1, 9))
    table = ranking_table(study)
    assert (table["rms_mm"].diff().dropna() >= 0).all()
    # a spike survives a mean and no filter at all, not a median
    assert (study[-1].before, study[-1].after) == ("none", "none")
    assert "median" in study[0].before + study[0].after


def test_no_pixel_on_the_bars(make_scene, make_bars):
    with pytest.raises(FitError, match="no valid pixel"):
        zigzag_errors(make_scene(), make_bars(), ZigzagPose(5000.0, 0.0, 0.0))
