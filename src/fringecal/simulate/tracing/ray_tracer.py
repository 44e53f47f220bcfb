"""Draw a scene with a virtual rig: frames as its camera would deliver them, and the truth behind them."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy import integrate, ndimage, special

from fringecal.errors import FringecalError
from fringecal.simulate.rig.drawn_camera import Camera, build_camera, image_centre
from fringecal.simulate.rig.drawn_projector import Projector, build_projector, harmonics
from fringecal.simulate.rig.rig_spec import RigSpec, StepsSpec, SurfaceSpec
from fringecal.simulate.scene.printed_patterns import PatternTable, pattern_table
from fringecal.simulate.scene.scene import Scene
from fringecal.simulate.tracing.compiled import over_rows
from fringecal.simulate.tracing.ray_kernels import World, build_world
from fringecal.simulate.tracing.sensor import exposed, lamp_factors
from fringecal.simulate.tracing.shading import Light, Samples, Texture, collect_fringes, collect_room, trace_centres

TEXTURE_CELLS = 256  # along each side of the texture, before it repeats
GRAZING = 10  # times its height that a projector may stand off its aim: 6 deg above the plate
BLUR_REACH = 3  # standard deviations of blur from which a pixel collects light
EDGE_REACH = 1.3  # times a pixel's reach, for tilt and distortion, which stretch pixels off the centre
# Optics this sharp pass 0.7 % of what pixels would alias (exp(-2 pi^2 0.5^2) at one line per px).
OPTICAL_BLUR_PX = 0.5
# Points of a pixel where an edge may pass; where ink may end too, whose lines are located to a thousandth of a pixel.
EDGE_SAMPLES = 34
PRINT_SAMPLES = 89
# Ink ends over a quarter of a pixel: it keeps the few samples' error of a line's centre in any one row
# near 0.004 px, and adds 0.005 px^2 to a variance of 0.08 px^2 of the pixel alone.
INK_EDGE_PX = 0.25
# Generators of the Fibonacci lattice with so many points: the Fibonacci number before.
FIBONACCI = {34: 21, 89: 55}


@dataclass(frozen=True)
class Frames:
    """Frames of one capture and the truth at every pixel's centre.

    Parameters
    ----------
    frames
        Shape (N, H, W), uint8 for 8 bits, else uint16, grey levels.
    x, y, z
        Shape (H, W): the surface point seen, mm in the plate frame.
    phase
        Shape (H, W): true unwrapped phase there, rad, at step 0.
    lit
        Shape (H, W): whether the projector reaches that point.
    modulation
        Shape (H, W): amplitude of the fringes in grey levels before texture and sensor response.
    surface
        Shape (H, W): number of the face seen; 0 is the flat.
    """

    frames: np.ndarray
    x: np.ndarray
    y: np.ndarray
    z: np.ndarray
    phase: np.ndarray
    lit: np.ndarray
    modulation: np.ndarray
    surface: np.ndarray


def render(
    rig: RigSpec,
    scene: Scene,
    *,
    seed: int | Sequence[int] = 0,
    light: Literal["fringes", "room"] = "fringes",
    noise: bool = True,
) -> Frames:
    """Render one capture of a scene.

    Parameters
    ----------
    rig, scene
        The rig, and what lies under it.
    seed
        Seeds lamp flicker and sensor noise; the surfaces' texture has its own seed in the rig.
    light
        One frame per phase shift under projected fringes, or one picture by room light.
    noise
        Switch flicker, noise and rounding off: frames are then float64 grey levels, clipped at the
        white level.

    Returns
    -------
    Frames
        Pictures and truth. Inside a surface the light is integrated over the pixel by 2 x 2 points
        (error of a fringe's modulation below 1e-4 at 8 px per period, 2e-3 with blur); at edges by 34
        points of a Fibonacci lattice, 89 for printed patterns.
    """
    camera, projector = build_camera(rig.camera), build_projector(rig.projector)
    world, table = build_world(scene), pattern_table(scene.pattern)
    maps, keys = _centres(rig, camera, projector, world, table)
    samples, texture = _samples(rig, scene, keys, maps[5]), texture_tables(rig.surface)
    if light == "fringes":
        _refuse_grazing(rig)
        exposure = _fringe_light(rig, lamp_factors(rig, seed, len(rig.steps.nominal_deg), noise=noise))
        levels = np.empty((len(exposure.steps), *keys.shape))
        optics = camera, projector, world, table, texture, exposure
        over_rows(collect_fringes, len(keys), *optics, samples, levels)
    else:
        exposure = _room_light(rig)
        levels = np.empty((1, *keys.shape))
        over_rows(collect_room, len(keys), camera, world, table, texture, exposure, samples, levels[0])
    return _frames(rig, exposed(rig, _blurred(levels, rig), seed, noise=noise), maps, keys, exposure)


def plate_points(rig: RigSpec) -> tuple[np.ndarray, np.ndarray]:
    """Plate coordinates x, y in mm under every pixel centre, each of shape (H, W)."""
    camera, projector = build_camera(rig.camera), build_projector(rig.projector)
    maps, _ = _centres(rig, camera, projector, build_world(Scene()), pattern_table(Scene().pattern))
    return maps[0], maps[1]


def true_phase_shifts_rad(steps: StepsSpec, width_px: int, height_px: int) -> np.ndarray:
    """Give true steps per frame in rad: at the image centre, and per px along u and v; shape (N, 3)."""
    n = len(steps.nominal_deg)
    step = np.array(steps.nominal_deg) + (np.array(steps.error_deg) if steps.error_deg else np.zeros(n))
    tilt = np.array(steps.tilt_deg) if steps.tilt_deg else np.zeros((n, 2))
    return np.radians(np.column_stack([step, tilt[:, 0] / width_px, tilt[:, 1] / height_px]))


def _centres(
    rig: RigSpec, camera: Camera, projector: Projector, world: World, table: PatternTable
) -> tuple[np.ndarray, np.ndarray]:
    shape = (rig.camera.height_px, rig.camera.width_px)
    maps, keys = np.empty((6, *shape)), np.empty(shape, np.int64)
    over_rows(trace_centres, shape[0], camera, projector, world, table, maps, keys)
    return maps, keys


def _refuse_grazing(rig: RigSpec) -> None:
    aim, position = np.array(rig.projector.aim_mm), np.array(rig.projector.position_mm)
    if math.hypot(*(aim - position[:2])) > GRAZING * position[2]:
        raise FringecalError(f"the projector at {rig.projector.position_mm} mm grazes the plate; raise it above 6 deg")


def _fringe_light(rig: RigSpec, brightness: np.ndarray) -> Light:
    light = rig.light
    steps = true_phase_shifts_rad(rig.steps, rig.camera.width_px, rig.camera.height_px)
    r2 = float(np.sum(np.square(rig.projector.position_mm)))
    return _room_light(rig)._replace(
        steps=np.column_stack([steps, brightness]),
        irradiance=rig.projector.position_mm[2] / r2**1.5,
        scale=_linear_level(rig, light.mid_grey) / (1 + light.ambient),
    )


def _room_light(rig: RigSpec) -> Light:
    camera, light = rig.camera, rig.light
    per_px = light.room_gradient[0] / camera.width_px, light.room_gradient[1] / camera.height_px
    vignetting = camera.vignetting / (math.hypot(camera.width_px, camera.height_px) / 2) ** 2
    level = _linear_level(rig, light.room_grey)
    return Light(
        harmonics(rig), np.zeros((1, 4)), light.ambient, light.shading, 1.0,
        level, per_px, vignetting, image_centre(camera),
    )  # fmt: skip


def _linear_level(rig: RigSpec, grey: float) -> float:
    """Level on a linear sensor that the camera's response turns into the stated share of white."""
    return rig.camera.white_level * grey ** (1 / rig.camera.gamma)


def _samples(rig: RigSpec, scene: Scene, keys: np.ndarray, print_mm: np.ndarray) -> Samples:
    """Sample more where an edge may pass: a neighbour sees another face or light, or ink ends near."""
    outer = lattice(PRINT_SAMPLES if scene.pattern.kind else EDGE_SAMPLES)
    blur_px = _optical_blur_px(rig)
    # A pixel collects light from half of its side and three standard deviations of blur around it.
    reach_px = 0.5 + BLUR_REACH * blur_px
    window = 2 * math.ceil(reach_px) + 1
    same = ndimage.minimum_filter(keys, window) == ndimage.maximum_filter(keys, window)
    # The reach along a diagonal.
    edges = ~same | (print_mm < EDGE_REACH * math.sqrt(2) * reach_px * rig.camera.scale_mm_per_px)
    soft_mm = INK_EDGE_PX * rig.camera.scale_mm_per_px
    return Samples(edges, two_points(blur_px), aperture(outer, blur_px), soft_mm)


def _optical_blur_px(rig: RigSpec) -> float:
    """Blur applied before pixels collect; what is left of a larger one is a filter on the picture."""
    return min(rig.camera.defocus_px, OPTICAL_BLUR_PX)


def two_points(blur_px: float) -> np.ndarray:
    """2 x 2 points with the variance of a pixel's square and blur: Gauss-Legendre's where it is sharp."""
    t = math.sqrt(1 / 12 + blur_px**2)
    return np.array([(a, b) for a in (-t, t) for b in (-t, t)])


def lattice(n: int) -> np.ndarray:
    """Fibonacci lattice over the unit square: each axis sees `n` evenly spaced points."""
    i = np.arange(n)
    return np.column_stack([(i + 0.5) / n, ((i * FIBONACCI[n]) % n + 0.5) / n])


def aperture(lattice: np.ndarray, blur_px: float) -> np.ndarray:
    """Spread a lattice over a pixel and its blur, so that every point stands for the same share of light.

    Along either axis the light's density is a square of 1 px convolved with a Gaussian; its quantiles
    at the lattice's coordinates are the offsets in px.
    """
    if blur_px == 0:
        return lattice - 0.5
    t = np.linspace(-0.5 - 5 * blur_px, 0.5 + 5 * blur_px, 4001)
    density = special.ndtr((t + 0.5) / blur_px) - special.ndtr((t - 0.5) / blur_px)
    share = integrate.cumulative_trapezoid(density, t, initial=0)
    return np.interp(lattice, share / share[-1], t)


def texture_tables(surface: SurfaceSpec) -> Texture:
    """Draw the tables of a surface's uneven paint, smooth and fine."""
    rng = np.random.default_rng([surface.seed, TEXTURE_CELLS])
    tables = rng.standard_normal((2, TEXTURE_CELLS, TEXTURE_CELLS))
    # Spline smoothing over one cell rounds the corners of bilinear interpolation; unit variance after it.
    tables[0] = ndimage.gaussian_filter(tables[0], 1.0, mode="wrap")
    tables[0] /= tables[0].std()
    tables *= np.array([surface.smooth, surface.speckle])[:, None, None]
    return Texture(np.pad(tables, ((0, 0), (0, 1), (0, 1)), mode="wrap"), surface.smooth_mm, surface.speckle_mm)


def _blurred(levels: np.ndarray, rig: RigSpec) -> np.ndarray:
    rest_px = math.sqrt(rig.camera.defocus_px**2 - _optical_blur_px(rig) ** 2)
    return ndimage.gaussian_filter(levels, (0, rest_px, rest_px), mode="nearest") if rest_px > 0 else levels


def _frames(rig: RigSpec, frames: np.ndarray, maps: np.ndarray, keys: np.ndarray, light: Light) -> Frames:
    x, y, z, phase, cosine, _ = maps
    lit = keys % 2 == 1
    received = lit.astype(float)
    if light.shading:
        source = rig.projector.position_mm
        received = cosine / ((source[0] - x) ** 2 + (source[1] - y) ** 2 + (source[2] - z) ** 2) / light.irradiance
    modulation = light.scale * received * abs(light.harmonics[1])
    return Frames(frames, x, y, z, phase, lit, modulation, keys // 2)
