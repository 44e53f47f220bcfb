"""Do 95 % intervals hold with every influence drawn that a session may state?

Run: python benchmarks/budget_coverage.py [--rigs 250] [--seed 2015] [--first 1]. The rigs and their true artefacts are
those of `fringecal study`: strips with own and common errors, paint, gaps, depth of light, temperature, a plate that is
not flat. They are perturbed at the level of observations, by the simulator's own optics: crossings and phases come
from the true rig with noise, no picture is drawn, so that a rig takes a second. Rigs of every second number are taken:
odd ones were looked at by nobody while the budgets were made. Printed is the share of intervals that hold the truth,
with Wilson's band: scale, angle at the origin, heights of single pixels with their noise, and means over areas.
"""

import argparse
import math
from collections import defaultdict
from collections.abc import Callable, Iterator

import numpy as np
from numpy.typing import NDArray

from fringecal.calibration.plate_flatness import plate_form
from fringecal.camera import CameraFit, PlateCamera
from fringecal.camera.plate.plate_fit import fit_plate_camera
from fringecal.projector import Observations, RigCalibration, angles_at_origin, calibrate_rig, height_parts, total_u
from fringecal.projector.standards.strip_heights import seen_heights
from fringecal.simulate import build_camera, build_projector, phase_at, ray, stated_target, truth_of
from fringecal.targets import Flat, LineGrid, Strips, Target
from fringecal.uncertainty import Estimate, Influence, coverage_factor, effective_dof, wilson_interval
from fringecal.workflows.study.drawn_rigs import DrawnRig, draw_rig

Array = NDArray[np.float64]

CROSSING_PX = 0.01  # standard deviation of a crossing: what detection reaches
NOISE_RAD, WAVES_RAD = 0.02, 0.001  # of a pixel's phase: by itself, and of blocks of 24 px in common
HEIGHTS_MM = (5.0, 15.0, 30.0)
PLACES = ((0.5, 0.5), (0.05, 0.05), (0.95, 0.05), (0.05, 0.95), (0.95, 0.95))
AREA_PX = 6  # half side of an area
MEET_ROUNDS = 4  # of finding where a ray meets a plate that is not flat


class TrueRig:
    """A drawn rig's own optics over its own plate."""

    def __init__(self, drawn: DrawnRig) -> None:
        self.spec = drawn.spec
        self.camera, self.projector = build_camera(drawn.spec.camera), build_projector(drawn.spec.projector)

    def rays(self, u: Array, v: Array) -> Array:
        return np.array([ray(self.camera, float(a), float(b)) for a, b in zip(u, v, strict=True)]).T

    def form(self, x: Array, y: Array) -> Array:
        unit = self.spec.plate.unit_mm
        return sum((mm * (x / unit) ** i * (y / unit) ** j for i, j, mm in self.spec.plate.form), np.zeros_like(x))

    def on_plate(self, u: Array, v: Array, above_mm: Array | float) -> tuple[Array, Array, Array]:
        """Points that pixels see on what lies so high over the plate's own surface."""
        ax, ay, bx, by = self.rays(u, v)
        z = np.zeros_like(ax) + above_mm
        for _ in range(MEET_ROUNDS):
            z = above_mm + self.form(ax + bx * z, ay + by * z)
        return ax + bx * z, ay + by * z, z

    def phase(self, x: Array, y: Array, z: Array) -> Array:
        return np.array([phase_at(self.projector, *map(float, p)) for p in zip(x, y, z, strict=True)])


def lattice(columns: int, rows: int) -> tuple[Array, Array]:
    u, v = np.meshgrid(np.linspace(4, 315, columns), np.linspace(4, 235, rows))
    return u.ravel(), v.ravel()


def fitted_camera(rig: TrueRig, stated: LineGrid, true: Target, rng: np.random.Generator) -> CameraFit:
    """Fit the camera to crossings of the true sheet, with what is stated of it and of the camera's height."""
    u, v = lattice(16, 12)
    x, y, _ = rig.on_plate(u, v, 0.0)
    points = np.column_stack([x, y]) * stated.pitch_mm.value / true.pitch_mm.value
    seen = np.column_stack([u, v]) + CROSSING_PX * rng.standard_normal((u.size, 2))
    known = rig.spec.stated.camera_height_u_mm
    height = Estimate(rig.spec.camera.height_mm + known * rng.standard_normal(), known, "mm")
    rel_u = math.hypot(stated.pitch_mm.u / stated.pitch_mm.value, stated.thermal_rel_u)
    return fit_plate_camera(seen, points, (240, 320), pitch_rel_u=rel_u, sigma_px=CROSSING_PX, height_mm=height)


def observed(rig: TrueRig, strips: Strips, true: Target, flat: Flat, camera: PlateCamera, rng: np.random.Generator):
    """Phase of plate and strips as the true rig sends it, with what is stated of their heights."""
    u, v = lattice(60, 45)
    x, _, _ = rig.on_plate(u, v, 0.0)
    pitch, width = strips.width_mm.value + strips.gap_mm.value, strips.width_mm.value
    place = x + (strips.count * pitch - strips.gap_mm.value) / 2
    item = np.clip(np.floor(place / pitch).astype(np.intp), 0, strips.count - 1)
    on = (place > 0) & (place - item * pitch < width) & (place < strips.count * pitch)
    above = true.height_mm.array(strips.count)[item]
    shifts = [phased(rig, u, v, 0.0, rng), phased(rig, u[on], v[on], above[on], rng)]
    (phase, cluster), heights = zip(*shifts, strict=True), seen_heights(strips)
    rays = camera.rays(u[on], v[on])
    parts = height_parts(strips, heights, item[on], rays.ax, rays.ay)
    stated = Estimate(heights[0].value, total_u(strips, heights[0]), "mm", "strips", influence=Influence.STRIP_HEIGHT)
    return Observations(
        (u, u[on]), (v, v[on]), phase, cluster, (Estimate(0.0, 0.0, "mm", "plate"), stated),
        form=plate_form(flat, camera), parts=(None, parts),
    )  # fmt: skip


def phased(rig: TrueRig, u: Array, v: Array, above: Array | float, rng: np.random.Generator) -> tuple[Array, Array]:
    cluster = (v // 24 * 100 + u // 24).astype(np.intp)
    _, block = np.unique(cluster, return_inverse=True)
    waves = WAVES_RAD * rng.standard_normal(block.max() + 1)[block]
    return rig.phase(*rig.on_plate(u, v, above)) + waves + NOISE_RAD * rng.standard_normal(u.size), cluster


def scores(number: int, seed: int) -> Iterator[tuple[str, float]]:
    """Yield errors over their expanded uncertainties of one rig, by quantity."""
    drawn = draw_rig(number, seed=seed)
    rng = np.random.default_rng([seed, number, 7])
    stated = {c.kind: stated_target(c).warmed(None, 0.0) for c in drawn.spec.capture}
    rig = TrueRig(drawn)
    fit = fitted_camera(rig, stated["grid"], drawn.targets["grid"], rng)
    surfaces = observed(rig, stated["strips"], drawn.targets["strips"], stated["reference"], fit.camera, rng)
    near = np.array(drawn.spec.projector.position_mm)
    calibration, _ = calibrate_rig(surfaces, fit, projector_near=near, phase_sigma_rad=NOISE_RAD)
    truth = truth_of(drawn.spec)
    scale = calibration.budget(lambda c: c.camera.scale("mean").value, unit="mm/px", label="scale").result
    yield "scale", (scale.value - (truth.scale_h + truth.scale_v) / 2) / scale.expanded().U
    angle = angles_at_origin(calibration, None).angle
    yield "angle at the origin", (angle.value - truth.angle_origin_deg) / angle.expanded().U
    for z in HEIGHTS_MM:
        yield from of_heights(calibration, rig, z, rng)


def of_heights(
    calibration: RigCalibration, rig: TrueRig, z: float, rng: np.random.Generator
) -> Iterator[tuple[str, float]]:
    """Yield scores of one pixel and of an area's mean at five places, for surfaces at a true height."""
    side = np.arange(-AREA_PX, AREA_PX + 1, 3.0)
    across, along = (c.ravel() for c in np.meshgrid(side, side))
    u, v = (np.concatenate([p[k] * size + c for p in PLACES]) for k, size, c in ((0, 319, across), (1, 239, along)))
    ax, ay, bx, by = rig.rays(u, v)
    exact = rig.phase(ax + bx * z, ay + by * z, np.full(u.size, z))
    noisy = exact + NOISE_RAD * rng.standard_normal(u.size)

    def reading(phase: Array) -> Callable[[RigCalibration], Array]:
        return lambda c: c.model.height(phase, c.camera.rays(u, v))

    changes = calibration.changes(reading(exact))
    dof = np.array([c.dof for c in calibration.components])
    noise_mm = np.abs(reading(exact + NOISE_RAD)(calibration) - reading(exact)(calibration))
    error = (reading(noisy)(calibration) - z).reshape(len(PLACES), -1)
    shared = changes.reshape(len(dof), len(PLACES), -1)
    own = noise_mm.reshape(len(PLACES), -1)
    middle = error.shape[1] // 2
    for k in range(len(PLACES)):
        where = "centre" if k == 0 else "corner"
        pixel = np.append(shared[:, k, middle], own[k, middle])
        mean = np.append(shared[:, k].mean(axis=1), math.sqrt(np.sum(own[k] ** 2)) / own[k].size)
        for name, effects, off in (("pixel", pixel, error[k, middle]), ("area mean", mean, error[k].mean())):
            factor = coverage_factor(effective_dof(effects, np.append(dof, math.inf)))
            yield f"{name}, {z:g} mm, {where}", float(off / (factor * np.linalg.norm(effects)))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rigs", type=int, default=250)
    parser.add_argument("--seed", type=int, default=2015)
    parser.add_argument("--first", type=int, default=1)
    options = parser.parse_args()
    found: dict[str, list[float]] = defaultdict(list)
    for number in range(options.first, options.first + 2 * options.rigs, 2):
        for name, score in scores(number, options.seed):
            found[name].append(score)
            if "mm" in name:
                found[name.split(",")[0] + "s, all"].append(score)
    print(f"{options.rigs} rigs")
    for name, values in found.items():
        hits, spread = sum(abs(s) <= 1 for s in values), float(np.sqrt(np.mean(np.square(values))))
        low, high = wilson_interval(hits, len(values))
        share = f"{100 * hits / len(values):5.1f} % ({100 * low:.1f}..{100 * high:.1f})"
        print(f"{name:28s} {len(values):5d}  {share}  rms of error / U {spread:.2f}")


if __name__ == "__main__":
    main()
