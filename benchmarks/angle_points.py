"""Does the angle's uncertainty hold over random rigs, pictures left out? A second a rig, where pictures take ten.

Run: python benchmarks/angle_points.py [--rigs 300] [--seed 1] [--centred]. The rigs of `angle_campaign.py`; crossings
of the grid and phases of plate and strips come from the simulator's optics with noise, and camera and rig are fitted as
in a commissioning. It judges what all breaks share (strip height, camera, grid), which is nearly all of u.
"""

import argparse
import math

import numpy as np

from angle_campaign import SIZE_PX, draw_rig, share
from fringecal.camera.plate.plate_fit import CameraFit, fit_plate_camera
from fringecal.projector.angle.projection_angle import angle_budget
from fringecal.projector.rig_calibration import Observations, calibrate_rig
from fringecal.simulate import RigSpec
from fringecal.simulate.rig.drawn_camera import Camera, build_camera, project, ray
from fringecal.simulate.rig.drawn_projector import build_projector, phase_at
from fringecal.simulate.rig.truth import projection_angle_deg
from fringecal.targets import Target
from fringecal.uncertainty.estimates import Estimate

CROSSING_PX, NOISE_RAD, POINTS = 0.003, 0.01, 600
ALONG = (-0.4, 0.0, 0.4)  # of the field: places on both axes at which the angle is asked for


def camera_fit(spec: RigSpec, camera: Camera, grid: Target, rng: np.random.Generator) -> CameraFit:
    """Fit the camera to a grid of true pitch `grid`, which is stated as in the rig's capture."""
    stated = spec.capture_named("grid").target["pitch_mm"]  # type: ignore[index]
    reach = int(0.9 * SIZE_PX[0] * spec.camera.scale_mm_per_px / stated["value"] / 2)
    i, j = (k.ravel() for k in np.meshgrid(np.arange(-reach, reach + 1), np.arange(-reach, reach + 1)))
    turn = math.radians(rng.uniform(-1, 1))
    x, y = grid.pitch_mm.value * (math.cos(turn) * i - math.sin(turn) * j), grid.pitch_mm.value * (
        math.sin(turn) * i + math.cos(turn) * j
    )  # fmt: skip
    seen = project(camera, np.column_stack([x, y, np.zeros(x.size)]))
    inside = np.all((seen > 5) & (seen < np.array(SIZE_PX) - 6), axis=1)
    seen = seen[inside] + CROSSING_PX * rng.standard_normal((np.count_nonzero(inside), 2))
    telecentric = spec.camera.kind == "telecentric"
    u_height = spec.stated.camera_height_u_mm
    height = Estimate(spec.camera.height_mm + u_height * rng.standard_normal(), u_height, "mm", "camera height")
    return fit_plate_camera(
        seen, stated["value"] * np.column_stack([i, j])[inside], SIZE_PX[::-1], sigma_px=CROSSING_PX,
        pitch_rel_u=stated["u"] / stated["value"], height_mm=None if telecentric else height, telecentric=telecentric,
    )  # fmt: skip


def observed(spec: RigSpec, camera: Camera, strips: Target, rng: np.random.Generator) -> Observations:
    """Draw pixels of the plate and of tops at the strips' true height, with the phase that reaches them."""
    projector = build_projector(spec.projector)
    u, v = rng.uniform(0, SIZE_PX[0] - 1, (2, POINTS)), rng.uniform(0, SIZE_PX[1] - 1, (2, POINTS))
    phase = np.empty_like(u)
    for surface, z in enumerate((0.0, float(strips.height_mm.array(strips.count)[0]))):
        for k in range(POINTS):
            ax, ay, bx, by = ray(camera, u[surface, k], v[surface, k])
            phase[surface, k] = phase_at(projector, ax + bx * z, ay + by * z, z)
    phase += NOISE_RAD * rng.standard_normal(phase.shape)
    cluster = (v // 24 * 100 + u // 24).astype(np.intp)
    stated = spec.capture_named("strips").target["height_mm"]  # type: ignore[index]
    heights = Estimate(0.0, 0.0, "mm", "plate"), Estimate(stated["value"], stated["u"], "mm", "strip height")
    return Observations(tuple(u), tuple(v), tuple(phase), tuple(cluster), heights)


def ratios(seed: int, number: int, *, centred: bool) -> tuple[np.ndarray, np.ndarray]:
    """Return errors over U at places of both axes (the first is the origin), and U in deg."""
    spec, targets = draw_rig(seed, number, centred=centred)
    rng, camera = np.random.default_rng([seed, number, 1]), build_camera(spec.camera)
    fitted = camera_fit(spec, camera, targets["grid"], rng)
    calibration, _ = calibrate_rig(observed(spec, camera, targets["strips"], rng), fitted)
    size = np.array(SIZE_PX) * spec.camera.scale_mm_per_px
    places = [(0.0, 0.0)] + [(a * size[0], 0.0) for a in ALONG if a] + [(0.0, a * size[1]) for a in ALONG if a]
    found = [angle_budget(calibration, *place).result for place in places]
    expanded = np.array([estimate.expanded().U for estimate in found])
    error = np.array([estimate.value for estimate in found]) - projection_angle_deg(spec, np.array(places))
    return error / expanded, expanded


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rigs", type=int, default=300)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--centred", action="store_true")
    options = parser.parse_args()
    rows = [ratios(options.seed, number, centred=options.centred) for number in range(options.rigs)]
    off, expanded = (np.array(part) for part in zip(*rows, strict=True))
    print(f"origin: {share(np.abs(off[:, 0]) <= 1)}; 2 error / U rms {2 * np.sqrt(np.mean(off[:, 0] ** 2)):.2f}")
    print(f"places on both axes: {share(np.abs(off[:, 1:]).ravel() <= 1)}; U median {np.median(expanded):.3f} deg")


if __name__ == "__main__":
    main()
