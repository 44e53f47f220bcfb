"""Random rigs with random objects on the plate, for everything that is claimed of heights of unknown objects.

Wider than what the tests hold: blocks, steps, wedges, cones, balls, pleats, piles, rims with a hole, low hills and dark
stripes, 0.2 to 6 fringes high, turned by any angle, seen by three families of rigs (a slide projector and a camera
above; a camera turned away from the normal; a projector in any direction). Rigs are known exactly, so that what is
judged is the order and the height and not the calibration.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy import ndimage, optimize

from fringecal.camera import PlateCamera
from fringecal.projector import PlateResidual, RigCalibration, RigModel
from fringecal.simulate import HeightField, RigSpec, build_camera, build_projector, render
from fringecal.simulate.rig.drawn_camera import ray
from fringecal.simulate.rig.drawn_projector import rational_form
from fringecal.simulate.scene.objects import box, prism
from fringecal.simulate.scene.scene import Scene, Solid
from fringecal.simulate.tracing.ray_tracer import Frames

type Draw = np.random.Generator
type Array = np.ndarray

PICTURE_PX = (480, 360)
HEIGHTS_FRINGES = (0.2, 6.0)
CONTINUOUS_RAD = 0.4  # second difference of the true step up to which a surface is continuous from pixel to pixel
FOLD_SHARE = 0.5  # of the slopes on both sides, by which a fold may bend the step within a pixel
STEPS_DEG = ((0, 120, 240), (0, 90, 180, 270), (0, 72, 144, 216, 288), tuple(np.arange(8) * 45))


@dataclass(frozen=True)
class Case:
    """One rig with one object: frames, the truth behind them, and the exact calibration."""

    number: int
    kind: str
    spec: RigSpec
    calibration: RigCalibration
    frames: Frames
    height_fringes: float
    periods: tuple[float, ...] = ()

    @property
    def phase_shifts_rad(self) -> Array:
        return np.radians(self.spec.steps.nominal_deg)

    def true_step_rad(self) -> Array:
        """True phase over the plate's at every pixel, (H, W)."""
        rays = self.calibration.camera.pixel_rays()
        f, model = self.frames, self.calibration.model
        return model.phase(f.x, f.y, f.z) - model.phase(rays.ax, rays.ay, 0.0)

    def decidable(self) -> Array:
        """Where the surface hangs together with the largest bare part of the plate, pixel by pixel, all lit."""
        step, lit = self.true_step_rad(), self.frames.lit
        links = ndimage.label(np.kron(lit, np.ones((2, 2), bool)) & _open_links(step, lit))[0][::2, ::2]
        plate = lit & (np.abs(self.frames.z) < 1e-6)
        if not plate.any():
            return plate
        sizes = np.bincount(links[plate])
        return (links == int(np.argmax(sizes))) & lit


def _open_links(step: Array, lit: Array) -> Array:
    """Pixels at even places, links between them at odd ones: true where a surface goes on without a break."""
    height, width = step.shape
    out = np.zeros((2 * height, 2 * width), bool)
    out[::2, ::2] = lit
    out[::2, 1:-1:2] = _continuous(step)
    out[1:-1:2, ::2] = _continuous(step.T).T
    return out


def _continuous(step: Array) -> Array:
    """Whether neighbours along a row belong to one surface: their step is what the slope to one side foretells."""
    change = np.diff(step, axis=1)
    before, after = np.roll(change, 1, axis=1), np.roll(change, -1, axis=1)
    off = np.minimum(np.abs(change - before), np.abs(change - after))
    return (np.abs(change) < CONTINUOUS_RAD) | (off < CONTINUOUS_RAD)


def draw_case(number: int, *, seed: int = 0, second: bool = False) -> Case:
    """Draw one rig and one object on it; the number and the seed decide all of it.

    With a second period the frames of a longer one follow those of the first: both agree again after 8 to 14 fringes.
    """
    rng = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(number,)))
    spec = _spec(rng, number)
    calibration = exact_calibration(spec)
    kind = tuple(OBJECTS)[number % len(OBJECTS)]
    height = float(rng.uniform(*HEIGHTS_FRINGES)) * fringe_height_mm(calibration)
    size = spec.camera.scale_mm_per_px * min(PICTURE_PX)
    scene = OBJECTS[kind](rng, height, size)
    place = rng.uniform(-0.12, 0.12, 2) * size
    scene = scene.placed(float(place[0]), float(place[1]), float(rng.uniform(-180, 180)))
    frames = render(spec, scene, seed=int(rng.integers(2**31)))
    case = Case(number, kind, spec, calibration, frames, height / fringe_height_mm(calibration))
    return _with_second_period(case, scene, rng) if second else case


def _with_second_period(case: Case, scene: Scene, rng: Draw) -> Case:
    """Add the frames of a longer period, whose phase is zero where that of the first is."""
    ratio = 1 + 1 / int(rng.integers(8, 15))
    pattern = case.spec.projector
    longer = pattern.model_copy(
        update={
            "pitch_mm": pattern.pitch_mm * ratio,
            "phase_at_origin_rad": pattern.phase_at_origin_rad / ratio,
        }
    )
    spec = case.spec.model_copy(update={"projector": longer})
    further = render(spec, scene, seed=int(rng.integers(2**31)))
    frames = replace(case.frames, frames=np.concatenate([case.frames.frames, further.frames]))
    return replace(case, frames=frames, periods=(1.0, ratio))


def fringe_height_mm(calibration: RigCalibration) -> float:
    """Height that shifts the fringes by one in the middle of the picture, mm."""
    rays = calibration.camera.rays(*(np.array([c]) for c in calibration.camera.centre_px))
    dz = 0.1
    change = calibration.model.phase(*rays.at(dz), dz) - calibration.model.phase(rays.ax, rays.ay, 0.0)
    return float(2 * np.pi * dz / abs(change[0]))


def exact_calibration(spec: RigSpec) -> RigCalibration:
    """The rig as it is: camera fitted to its true rays, projector in closed form (no lens distortion)."""
    parameters = rational_form(build_projector(spec.projector))
    model = RigModel(parameters, np.array(spec.projector.position_mm), PlateResidual())
    return RigCalibration(_exact_camera(spec), model, (), 0.0)


def _exact_camera(spec: RigSpec) -> PlateCamera:
    camera, shape = build_camera(spec.camera), (spec.camera.height_px, spec.camera.width_px)
    u, v = (g.ravel() for g in np.meshgrid(np.linspace(0, shape[1] - 1, 9), np.linspace(0, shape[0] - 1, 9)))
    true = np.array([ray(camera, a, b) for a, b in zip(u, v, strict=True)])
    tilt = np.tan(np.radians(spec.camera.tilt_deg))
    names = ("scale_mm_per_px", "tilt_x_rad", "tilt_y_rad", "k1", "cu_px", "cv_px", "height_mm")
    start = [spec.camera.scale_mm_per_px, 0, 0, spec.camera.distortion[0], *spec.camera.principal_offset_px]
    start.append(spec.camera.height_mm)

    def off(values: Array) -> Array:
        rays = PlateCamera.from_values(dict(zip(names, values, strict=True)), shape).rays(u, v)
        found = np.stack([rays.ax, rays.ay, 500 * rays.bx, 500 * rays.by], axis=1)
        return (found - true * (1, 1, 500, 500)).ravel()

    fits = []
    for signs in ((1, 1), (-1, 1), (1, -1), (-1, -1)):
        start[1:3] = [float(np.arctan(signs[0] * tilt[0])), float(np.arctan(signs[1] * tilt[1]))]
        fits.append(optimize.least_squares(off, start, x_scale=np.maximum(np.abs(start), 1e-2)))
    best = min(fits, key=lambda f: f.cost)
    assert np.abs(best.fun).max() < 0.02, (np.abs(best.fun).max(), spec.camera)
    return PlateCamera.from_values(dict(zip(names, best.x, strict=True)), shape)


def _spec(rng: Draw, number: int) -> RigSpec:
    family = ("slide", "turned camera", "any direction")[number // len(OBJECTS) % 3]
    scale, height = rng.uniform(0.6, 1.1), rng.uniform(900.0, 1700.0)
    camera_tilt = rng.uniform(-1.2, 1.2, 2)
    angle, azimuth = rng.uniform(38, 52), math.radians(rng.choice([-90, 90]) + rng.uniform(-8, 8))
    if family == "turned camera":
        azimuth = math.radians(rng.choice([0, 90, 180, 270]) + rng.uniform(-10, 10))
        away, angle = rng.uniform(15, 28), rng.uniform(-3, 8)
        camera_tilt = -away * np.array([math.cos(azimuth), math.sin(azimuth)])
    elif family == "any direction":
        azimuth, angle = rng.uniform(-math.pi, math.pi), rng.uniform(22, 50)
    high = rng.uniform(800.0, 1300.0)
    out = high * math.tan(math.radians(angle))
    return RigSpec.model_validate(
        {
            "name": f"case {number} ({family})",
            "camera": {
                "width_px": PICTURE_PX[0],
                "height_px": PICTURE_PX[1],
                "scale_mm_per_px": scale,
                "height_mm": height,
                "tilt_deg": camera_tilt.tolist(),
                "distortion": [rng.uniform(-0.12, 0.08), 0.0, 0.0, 0.0, 0.0],
                "vignetting": 0.05,
                "defocus_px": rng.uniform(0.3, 0.9),
            },
            "projector": {
                "position_mm": [out * math.cos(azimuth), out * math.sin(azimuth), high],
                "across_deg": math.degrees(azimuth) + rng.uniform(-4, 4),
                "pitch_mm": rng.uniform(7.5, 22.0) * scale,
                "phase_at_origin_rad": rng.uniform(-math.pi, math.pi),
                "contrast": rng.uniform(0.6, 0.95),
                "gamma": 1.0,
                "defocus_mm": rng.uniform(0.2, 0.6),
            },
            "steps": {"nominal_deg": STEPS_DEG[int(rng.integers(len(STEPS_DEG)))]},
            "light": {"mid_grey": rng.uniform(0.3, 0.48), "ambient": rng.uniform(0.05, 0.25)},
            "noise": {"read_levels": rng.uniform(0.5, 2.0), "gain": rng.uniform(0.0, 0.01)},
            "surface": {
                "seed": int(rng.integers(2**31)),
                "smooth": 0.02,
                "speckle": rng.uniform(0.0, 0.03),
                "speckle_mm": scale,
            },
        }
    )


def _block(rng: Draw, height: float, size: float) -> Scene:
    a, b = rng.uniform(0.08, 0.25, 2) * size
    return Scene(solids=(box((-a, a), (-b, b), height),))


def _steps(rng: Draw, height: float, size: float) -> Scene:
    widths = rng.uniform(0.07, 0.14, 3) * size
    edges = np.concatenate([[0.0], np.cumsum(widths)]) - widths.sum() / 2
    heights = height * np.sort(rng.uniform(0.1, 1.0, 3))
    length = rng.uniform(0.1, 0.25) * size
    pairs = zip(edges, edges[1:], heights, strict=False)
    return Scene(solids=tuple(box((a, b), (-length, length), float(h)) for a, b, h in pairs))


def _wedge(rng: Draw, height: float, size: float) -> Scene:
    half, length = rng.uniform(0.12, 0.3) * size, rng.uniform(0.08, 0.22) * size
    return Scene(solids=(prism(np.array([(-half, 0.0), (half, 0.0), (half, height)]), (-length, length)),))


def _field(size: float, height_of: Callable[[Array, Array], Array], albedo: float = 1.0) -> Scene:
    step = size / 900
    nodes = np.arange(-360, 361) * step
    z = np.maximum(height_of(*np.meshgrid(nodes, nodes)), 0.0)
    return Scene(height_field=HeightField(z, step, np.full(z.shape, albedo)))


def _cone(rng: Draw, height: float, size: float) -> Scene:
    radius = rng.uniform(0.12, 0.3) * size
    return _field(size, lambda x, y: height * (1 - np.hypot(x, y) / radius))


def _hill(rng: Draw, height: float, size: float) -> Scene:
    radius = rng.uniform(0.15, 0.33) * size
    return _field(size, lambda x, y: height * np.cos(np.minimum(np.hypot(x, y) / radius, 1) * np.pi / 2) ** 2)


def _ball(_: Draw, height: float, size: float) -> Scene:
    radius = float(np.clip(height / 2, 0.04 * size, 0.2 * size))
    return Scene(spheres=((0.0, 0.0, radius, radius, 1.0),))


def _pleats(rng: Draw, height: float, size: float) -> Scene:
    period, reach = rng.uniform(0.1, 0.25) * size, rng.uniform(0.15, 0.35) * size
    ends = rng.uniform(0.15, 0.35) * size

    def pleated(x: Array, y: Array) -> Array:
        ridge = height * np.abs((x / period + 0.5) % 1 * 2 - 1)
        return ridge * (np.abs(x) < reach // period * period + period / 2) * (np.abs(y) < ends)

    return _field(size, pleated)


def _pile(rng: Draw, height: float, size: float) -> Scene:
    solids: list[Solid] = []
    for _ in range(int(rng.integers(2, 5))):
        a, b = rng.uniform(0.05, 0.16, 2) * size
        at = rng.uniform(-0.18, 0.18, 2) * size
        one = box((-a, a), (-b, b), height * rng.uniform(0.1, 1.0), albedo=float(rng.uniform(0.5, 1.0)))
        solids.append(one.placed(float(at[0]), float(at[1]), float(rng.uniform(0, np.pi))))
    return Scene(solids=tuple(solids))


def _hole(rng: Draw, height: float, size: float) -> Scene:
    outer, inner = rng.uniform(0.22, 0.32) * size, rng.uniform(0.08, 0.18) * size
    sides = (((-outer, -inner), (-outer, outer)), ((inner, outer), (-outer, outer)),
             ((-inner, inner), (-outer, -inner)), ((-inner, inner), (inner, outer)))  # fmt: skip
    return Scene(solids=tuple(box(x, y, height) for x, y in sides))


def _stripe(rng: Draw, height: float, size: float) -> Scene:
    """A block beside a dark stripe that is only paint."""
    scene = _block(rng, height, 0.7 * size)
    dark = box(
        (0.24 * size, 0.24 * size + rng.uniform(0.01, 0.06) * size), (-0.3 * size, 0.3 * size), 0.02, albedo=0.02
    )
    return Scene(solids=(*scene.solids, dark))


OBJECTS: dict[str, Callable[[Draw, float, float], Scene]] = {
    "block": _block,
    "steps": _steps,
    "wedge": _wedge,
    "cone": _cone,
    "hill": _hill,
    "ball": _ball,
    "pleats": _pleats,
    "pile": _pile,
    "hole": _hole,
    "stripe": _stripe,
}


def facts(case: Case) -> dict[str, Any]:
    """What a case is, for a table."""
    return {"number": case.number, "kind": case.kind, "rig": case.spec.name, "fringes": round(case.height_fringes, 2)}
