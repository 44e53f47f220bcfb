"""A virtual leaf seen by a rig like the thesis's: its folds, area and volume against its own formula."""

from types import SimpleNamespace

import numpy as np
import pytest

from fringecal.camera.plate.plate_camera import CAMERA_NAMES, PlateCamera
from fringecal.errors import FitError
from fringecal.phase.demodulation.demodulate import PhaseMap
from fringecal.phase.demodulation.noise import Noise
from fringecal.projector.rig_calibration import RigCalibration
from fringecal.projector.rig_model import PlateResidual, RigModel, projector_point
from fringecal.reconstruct.extent import extent_of
from fringecal.reconstruct.phase_to_height import reconstruct_height
from fringecal.reconstruct.sections import row_section
from fringecal.simulate import Leaf, leaf_scene
from fringecal.uncertainty.components import UncertaintyComponent
from fringecal.uncertainty.influences import Influence
from fringecal.verification.forms.folds import folds_of, folds_table
from fringecal.workflows.reconstruct.relief_section import relief_section
from fringecal.workflows.shared.sections.surface_items import readable_surface

SHAPE = (600, 640)
NOISE_RAD = 0.01  # of the thesis rig: one grey level at a modulation of 80
LEAF = Leaf()
ROWS = (220, 300, 380)


def rig():
    values = {"scale_mm_per_px": 0.734, "height_mm": 1500.0}
    ratio = np.array([0.0, 0.785, -0.9594, 0.0, 0.0, -4e-4, -5.11e-4])
    model = RigModel(ratio, projector_point(ratio, near=np.array([0.0, 1222.0, 1000.0])), PlateResidual())
    camera = PlateCamera.from_values(values, SHAPE)
    effects = np.zeros((2, camera.parameters.size + 7 + 1))
    effects[0, CAMERA_NAMES.index("scale_mm_per_px")] = 1e-3 * 0.734
    effects[1, camera.parameters.size + 2] = 1e-3 * ratio[2]
    influences = Influence.GRID_PITCH, Influence.STRIP_HEIGHT
    return RigCalibration(camera, model, tuple(map(UncertaintyComponent, influences, effects)))


@pytest.fixture(scope="module")
def field():
    return leaf_scene(LEAF).height_field


def height_at(field, x, y):
    """Bilinear height of the leaf's own height field, whose middle node lies at the origin."""
    from scipy.ndimage import map_coordinates

    rows, columns = field.z_mm.shape
    at = [y / field.step_mm + (rows - 1) / 2, x / field.step_mm + (columns - 1) / 2]
    return map_coordinates(field.z_mm, at, order=1, mode="constant")


@pytest.fixture(scope="module")
def measured(field):
    calibration = rig()
    rays = calibration.camera.pixel_rays()
    z = np.zeros(SHAPE)
    for _ in range(30):  # slopes of 1 times rays of 1/6 converge by a factor of 6 each time
        z = height_at(field, *rays.at(z))
    noise = NOISE_RAD * np.random.default_rng(5).standard_normal(SHAPE)
    wrapped = np.angle(np.exp(1j * (calibration.model.phase(*rays.at(z), z) + noise))).astype(np.float32)
    ones = np.ones(SHAPE, np.float32)
    seen = PhaseMap(wrapped, 80 * ones, 120 * ones, NOISE_RAD * ones, np.zeros(SHAPE, np.uint8), Noise(1.0))
    surface = reconstruct_height(seen, calibration)
    assert surface.mask.all()
    np.testing.assert_allclose(surface.z, z, atol=8 * NOISE_RAD)
    return calibration, surface


def true_fold(field, x, y, pleat):
    """Depth and angle of the ridge at x by dense sampling: flanks are straight lines through their middle halves."""
    s = np.linspace(-pleat / 2, pleat / 2, 2001)
    z = height_at(field, x + s, np.full(s.size, y))
    depth = z[1000] - (z[0] + z[-1]) / 2
    slopes = [np.polyfit(s[part], z[part], 1)[0] for part in (slice(250, 751), slice(1250, 1751))]
    return depth, 180 - np.degrees(np.arctan(slopes[0]) - np.arctan(slopes[1]))


@pytest.mark.parametrize("row", ROWS)
def test_folds_of_the_leaf_agree_with_its_formula(field, measured, row):
    calibration, surface = measured
    folds = [f for f in folds_of(row_section(surface, calibration, row)) if abs(f.x_mm.value) < 60]
    y = folds[0].y_mm
    pleat = LEAF.pleat_mm * (1 - LEAF.fan * (2 * y / LEAF.length_mm) ** 2)
    assert len(folds) == 2 * int(60 / pleat) + 1
    for fold in folds:
        # A picture row is no line of constant y where heights differ, by 1/1500 of x: 0.05 mm on pleats of 25 mm.
        assert fold.spacing_mm.value == pytest.approx(pleat, rel=0.01)
        depth, angle = true_fold(field, fold.x_mm.value, fold.y_mm, pleat)
        assert fold.depth_mm.value == pytest.approx(depth, abs=0.1)
        assert fold.angle_deg.value == pytest.approx(angle, abs=0.5)
        assert fold.along_mm.value > fold.spacing_mm.value


def test_uncertainty_of_folds_names_scale_and_height(measured):
    calibration, surface = measured
    folds = folds_of(row_section(surface, calibration, 300))
    # One part in a thousand of scale is one of spacing, and one of the angle's lever is one of depth; noise adds.
    assert all(f.spacing_mm.u >= 0.9e-3 * f.spacing_mm.value for f in folds[:-1])
    assert all(f.depth_mm.u >= 0.5e-3 * f.depth_mm.value for f in folds)
    assert all(f.spacing_mm.u < 0.25 for f in folds[:-1])


def test_table_of_folds_has_a_row_for_every_ridge(measured):
    calibration, surface = measured
    folds = {row: folds_of(row_section(surface, calibration, row)) for row in ROWS}
    table = folds_table(folds)
    assert len(table) == sum(map(len, folds.values()))
    assert {"row / px", "spacing / mm", "u(spacing) / mm", "depth / mm", "angle / deg", "u(angle) / deg"} <= set(table)
    assert table["spacing / mm"].isna().sum() == len(ROWS)


@pytest.mark.parametrize("row", [-1, 600, 5])
def test_a_row_without_folds_is_refused(measured, row):
    calibration, surface = measured
    with pytest.raises(FitError, match=f"row {row}"):
        folds_of(row_section(surface, calibration, row))


def test_area_and_volume_of_the_leaf(field, measured):
    calibration, surface = measured
    found = extent_of(surface, calibration, above_mm=0.5)
    inside = field.z_mm > 0.5
    slope_y, slope_x = np.gradient(field.z_mm, field.step_mm)
    cell = field.step_mm**2
    # The rim at 0.5 mm has a slope of 0.1: its noise of 0.01 mm moves it by 0.1 mm of some 100 mm radius, 0.2 %.
    assert found.volume_mm3 == pytest.approx(field.z_mm[inside].sum() * cell, rel=2e-3)
    assert found.projected_mm2 == pytest.approx(inside.sum() * cell, rel=3e-3)
    # Pixels of 0.73 mm cut the crests of a curved sheet: chords are shorter than arcs by some 1e-3.
    area = np.sqrt(1 + slope_x**2 + slope_y**2)[inside].sum() * cell
    assert found.area_mm2 == pytest.approx(area, rel=5e-3)


def test_uncertainty_of_the_volume_keeps_its_systematic_parts(measured):
    calibration, surface = measured
    found = extent_of(surface, calibration, above_mm=0.5)
    # Scale 1e-3 counts twice on the plate and, through the phase kept, in the height as well: at least 2e-3 in all.
    assert 2e-3 < found.u_volume_mm3 / found.volume_mm3 < 5e-3
    assert found.u_projected_mm2 / found.projected_mm2 == pytest.approx(2e-3, rel=0.1)


def test_nothing_so_high_has_no_volume(measured):
    calibration, surface = measured
    with pytest.raises(FitError, match="stands 50 mm"):
        extent_of(surface, calibration, above_mm=50.0)


def test_the_report_tabulates_folds_area_and_volume_and_draws_contours(measured):
    calibration, surface = measured
    found = SimpleNamespace(surface=surface, calibration=calibration, model="projective")
    values = readable_surface(surface)
    section = relief_section(found, ROWS, values)
    extent, folds = (table.frame for table in section.tables)
    assert extent["unit"].tolist() == ["mm2", "mm2", "mm3"]
    assert set(folds["row / px"]) == set(ROWS)
    assert [item.caption for item in section.figures] == ["Lines of equal height"]
    assert relief_section(found, (2,), values).sentences[0].endswith("no ridge between two valleys.")
