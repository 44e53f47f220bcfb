"""The row kernels against the rig model evaluated pixel by pixel, for every kind of camera and projector."""

import numpy as np
import pytest

from fringecal.camera.plate.plate_camera import PlateCamera
from fringecal.phase import Reason as NoPhase
from fringecal.phase.demodulation.demodulate import PhaseMap, demodulate
from fringecal.phase.demodulation.noise import Noise
from fringecal.projector.height_models import height_changes
from fringecal.projector.rig_calibration import RigCalibration
from fringecal.projector.rig_model import PlateResidual, RigModel, projector_point
from fringecal.reconstruct import phase_to_height as height_module
from fringecal.reconstruct.object_phase import ObjectPhase
from fringecal.reconstruct.phase_to_height import Reason, height_of_phase, reconstruct_height
from fringecal.reconstruct.row_rays import row_rays
from fringecal.uncertainty.components import UncertaintyComponent
from fringecal.uncertainty.influences import Influence

SHAPE = (150, 200)
NEAR = np.array([0.0, 1222.0, 1000.0])
# A pinhole at (0, 1222, 1000) mm ruled along x: 8 mm pitch at the origin, as on the thesis's rig.
DIVERGING = np.array([0.0, 0.785, -0.9594, 0.0, 0.0, -4e-4, -5.11e-4])
RESIDUAL = PlateResidual(3, 0.02 * np.array([1.0, -0.7, 0.4, 0.9, -0.5, 0.3, 0.2, -0.1, 0.6, 0.4]), (-60, 70, -50, 55))


def calibration(*, lens=0.0, telecentric=False, residual=RESIDUAL, ratio=DIVERGING):
    values = {"scale_mm_per_px": 0.734, "height_mm": 1500.0, "tilt_x_rad": 0.02, "tilt_y_rad": -0.01, "k1": lens}
    camera = PlateCamera.from_values(values, SHAPE, telecentric=telecentric)
    model = RigModel(ratio, projector_point(ratio, near=NEAR), residual)
    size = camera.parameters.size + 7 + residual.coefficients.size
    effects = np.zeros((2, size))
    effects[0, 11], effects[1, camera.parameters.size + 2] = 2.0, 1e-4
    influences = Influence.CAMERA_HEIGHT, Influence.PHASE_SCATTER
    return RigCalibration(camera, model, tuple(map(UncertaintyComponent, influences, effects)), 0.004)


def surface_of(rig):
    """A hill of 25 mm and the phase that it shows."""
    v, u = np.mgrid[: SHAPE[0], : SHAPE[1]]
    z = 25 * np.exp(-((u - 90) ** 2 + (v - 70) ** 2) / 40**2)
    rays = rig.camera.pixel_rays()
    step = rig.model.phase(*rays.at(z), z) - rig.model.phase(rays.ax, rays.ay, 0.0)
    sigma = np.full(SHAPE, 0.02, np.float32)
    return z, ObjectPhase(step, sigma, np.zeros(SHAPE, np.uint8), 0)


RIGS = {
    "pinhole": {},
    "barrel": {"lens": -0.15},
    "telecentric": {"telecentric": True},
    "no residual": {"residual": PlateResidual()},
    "collimated": {"ratio": np.array([0.01, 0.785, -0.9594, 0.3, 0, 0, 0])},
}


@pytest.mark.parametrize("name", RIGS)
def test_rows_give_the_heights_that_made_the_phase(name):
    rig = calibration(**RIGS[name])
    true, phase = surface_of(rig)
    found = height_of_phase(phase, rig)
    assert found.mask.all()
    # Two rounds of lifting a residual of 0.02 rad, of which each leaves under 1e-2 of the error before.
    np.testing.assert_allclose(found.z, true, atol=1e-5)
    x, y = rig.camera.pixel_rays().at(true)
    np.testing.assert_allclose(found.x, x, atol=2e-5)
    np.testing.assert_allclose(found.y, y, atol=2e-5)


@pytest.mark.parametrize("name", RIGS)
def test_rows_equal_whole_maps_in_every_output(name, monkeypatch):
    rig = calibration(**RIGS[name])
    _, phase = surface_of(rig)
    rows = height_of_phase(phase, rig, dtype=np.float32)
    assert rows.z.dtype == np.float32
    monkeypatch.setattr(height_module, "rig_rows", lambda _: None)
    maps = height_of_phase(phase, rig)
    for part in ("x", "y", "z"):
        np.testing.assert_allclose(getattr(rows, part), getattr(maps, part), atol=1e-4)
    # The rows leave the slope of the plate residual out of dz/dphi: some 1e-3 of it.
    np.testing.assert_allclose(rows.u_random, maps.u_random, rtol=3e-3)
    np.testing.assert_allclose(rows.u_z, maps.u_z, rtol=3e-3)


def test_systematic_uncertainty_is_the_change_under_each_cause():
    rig = calibration(lens=-0.1)
    true, phase = surface_of(rig)
    found = height_of_phase(phase, rig)
    v, u = np.mgrid[: SHAPE[0] : 37, : SHAPE[1] : 41]
    changes = height_changes(rig, true[v, u], u, v)
    systematic = np.sqrt(found.u_z**2 - found.u_random**2)[v, u]
    # The polynomial of degree 7 over picture and 5 over height holds to far below an uncertainty's own digits.
    np.testing.assert_allclose(systematic, np.sqrt((changes**2).sum(axis=0)), rtol=1e-2, atol=1e-6)


def phase_map(rig, z):
    rays = rig.camera.pixel_rays()
    wrapped = np.angle(np.exp(1j * rig.model.phase(*rays.at(z), z))).astype(np.float32)
    ones = np.ones(SHAPE, np.float32)
    return PhaseMap(wrapped, 80 * ones, 120 * ones, 0.01 * ones, np.zeros(SHAPE, np.uint8), Noise(1.0))


def test_wrapped_phase_of_a_hill_on_the_plate_gives_its_heights():
    rig = calibration(lens=-0.1)
    true, _ = surface_of(rig)
    found = reconstruct_height(phase_map(rig, true), rig)
    assert found.mask.all()
    # Wrapped phase in float32 carries 2e-7 rad, its sum over the fringes less than 1e-5 rad, 1 mm each.
    np.testing.assert_allclose(found.z, true, atol=1e-4)


def test_reasons_say_why_a_pixel_has_no_height():
    rig = calibration()
    true, _ = surface_of(rig)
    seen = phase_map(rig, true)
    seen.reasons[:10], seen.reasons[10:20] = NoPhase.LOW_MODULATION, NoPhase.SATURATED | NoPhase.LOW_MODULATION
    seen.phase[:20] = np.nan
    found = reconstruct_height(seen, rig, height_range_mm=(-1.0, 20.0))
    assert (found.reasons[:10] == Reason.SHADOW).all()
    assert (found.reasons[10:20] == Reason.NO_PHASE).all()
    assert (found.reasons[20:] == np.where(true[20:] > 20.0, Reason.OUT_OF_RANGE, 0)).mean() > 0.999
    assert np.isnan(found.z[found.reasons > 0]).all()
    assert np.isnan(found.u_z[found.reasons > 0]).all()
    assert np.isfinite(found.z[found.mask]).all()


@pytest.mark.parametrize("lens", [-0.3, 0.0, 0.3])
def test_row_polynomials_meet_the_rays_of_every_pixel(lens):
    camera = calibration(lens=lens).camera
    rows, exact = row_rays(camera), camera.pixel_rays()
    powers = rows.position[:, None] ** np.arange(rows.coefficients.shape[2])
    found = np.einsum("hik,wk->ihw", rows.coefficients, powers)
    for i, part in enumerate((exact.ax, exact.ay, exact.bx, exact.by)):
        np.testing.assert_allclose(found[i], part, atol=2e-7 * np.abs(part).max() + 1e-12)


def test_a_lens_that_folds_back_is_no_polynomial():
    values = {"scale_mm_per_px": 5.0, "height_mm": 300.0, "k1": -0.5}
    assert row_rays(PlateCamera.from_values(values, SHAPE)) is None


def test_maps_may_lie_in_files(tmp_path):
    # For pictures beyond memory: nothing but who holds the bytes may differ.
    rig = calibration()
    _, phase = surface_of(rig)
    files = iter(tmp_path / f"map-{k}.bin" for k in range(5))

    def on_disk(shape, dtype):
        return np.memmap(next(files), dtype, "w+", shape=shape)

    here, there = (height_of_phase(phase, rig, dtype=np.float32, **how) for how in ({}, {"allocate": on_disk}))
    for name in ("x", "y", "z", "u_z", "u_random"):
        np.testing.assert_array_equal(getattr(here, name), getattr(there, name))
        assert isinstance(getattr(there, name), np.memmap)


def test_phase_maps_may_lie_in_files(tmp_path):
    frames = np.rint(
        120 + 80 * np.cos(np.arange(900).reshape(1, 30, 30) / 3 + np.deg2rad([0, 120, 240])[:, None, None])
    )
    frames, steps = frames.astype(np.uint8), np.deg2rad([0, 120, 240])
    kinds = {"phase": "f4", "modulation": "f4", "background": "f4", "sigma": "f4", "reasons": "u1"}
    maps = {name: np.memmap(tmp_path / name, kind, "w+", shape=(30, 30)) for name, kind in kinds.items()}
    there = demodulate(frames, steps, noise=Noise(1.0), out=PhaseMap(**maps, noise=Noise(1.0)))
    here = demodulate(frames, steps, noise=Noise(1.0))
    for name in kinds:
        np.testing.assert_array_equal(getattr(here, name), np.fromfile(tmp_path / name, kinds[name]).reshape(30, 30))
        assert getattr(there, name) is maps[name]
