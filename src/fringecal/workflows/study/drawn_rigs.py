"""Random virtual rigs for a study: every source of uncertainty drawn; stated values apart from true values."""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fringecal.simulate import PlateSpec, RigSpec, SimulatedSession, StepsSpec, simulate_session, stated_target
from fringecal.targets import REFERENCE_DEGC, LineGrid, Strips, Target

PICTURE_PX = (320, 240)  # small, so that a rig takes seconds
STEP_ERROR_DEG = 1.5  # standard deviation: a mirror turned by hand

type Range = tuple[float, float]


@dataclass(frozen=True)
class Population:
    """From what a study draws its rigs, evenly between two ends (`docs/coverage.md`): what benches with a slide have.

    Parameters
    ----------
    scale_mm_per_px, camera_height_mm, tilt_deg, camera_k1, defocus_px
        The camera, its tilt over each axis.
    principal_share
        Standard deviation of the principal point's place, of the picture's diagonal: what is taken for it where no lens
        is stated.
    vignetting
        Loss of light at the picture's corner, the same for all.
    projector_height_mm, angle_deg, azimuth_deg, aim_mm, across_deg, pitch_mm, contrast, gamma, projector_k1, blur_mm
        The projector: place, by angle from the normal and by azimuth off the rows' normal; what it aims at; direction
        of its fringes off the azimuth; their pitch and shape on the plate.
    mid_grey, ambient, room_grey, room_gradient, flicker
        Light, of full scale, and over the field.
    read_levels, gain
        Noise in grey levels, and its growth with the light.
    texture
        Of the paint, relative: smooth and in speckles, the same for all.
    camera_height_u_mm, projector_u_mm, grid_pitch_u_mm, strip_height_u_mm
        What is stated with an error of that standard uncertainty.
    strip_height_mm
        Stated height of the strips.
    instrument_u_mm, paint_u_mm, paint_dof, seating_u_mm, depth_mm, depth_u_mm
        What else the heights of strips hang on: the micrometer's calibration, paint measured some times over, the gap
        under each strip, the depth of light.
    temperature_degC, temperature_u_degC, expansion_per_K
        Of the artefacts while the session is taken: far from 20 degC, and of plastics as well as steel.
    flatness_mm
        Largest distance of the plate from its best plane, known from its certificate.
    place_mm, rotation_deg
        How grid and strips lie off the middle.
    """

    scale_mm_per_px: Range = (0.85, 1.1)
    camera_height_mm: Range = (1000.0, 1800.0)
    tilt_deg: Range = (-1.2, 1.2)
    camera_k1: Range = (-0.15, 0.1)
    defocus_px: Range = (0.3, 0.6)
    principal_share: float = 0.01
    vignetting: float = 0.05
    projector_height_mm: Range = (850.0, 1300.0)
    angle_deg: Range = (40.0, 52.0)
    azimuth_deg: Range = (-8.0, 8.0)
    aim_mm: Range = (-15.0, 15.0)
    across_deg: Range = (-3.0, 3.0)
    pitch_mm: Range = (7.5, 10.0)
    contrast: Range = (0.7, 0.95)
    gamma: Range = (0.95, 1.1)
    projector_k1: Range = (-0.05, 0.05)
    blur_mm: Range = (0.2, 0.6)
    mid_grey: Range = (0.35, 0.48)
    ambient: Range = (0.05, 0.25)
    room_grey: Range = (0.6, 0.8)
    room_gradient: Range = (-0.06, 0.06)
    flicker: Range = (0.0, 0.004)
    read_levels: Range = (0.5, 1.5)
    gain: Range = (0.0, 0.01)
    texture: float = 0.01
    camera_height_u_mm: Range = (2.0, 8.0)
    projector_u_mm: float = 3.0
    grid_pitch_u_mm: Range = (0.002, 0.006)
    strip_height_u_mm: Range = (0.003, 0.01)
    strip_height_mm: Range = (2.5, 4.0)
    instrument_u_mm: Range = (0.001, 0.004)
    paint_u_mm: Range = (0.001, 0.005)
    paint_dof: tuple[int, int] = (4, 15)
    seating_u_mm: Range = (0.002, 0.01)
    depth_mm: Range = (0.0, 0.05)
    depth_u_mm: Range = (0.001, 0.006)
    temperature_degC: Range = (15.0, 35.0)  # noqa: N815 -- the unit is written so
    temperature_u_degC: float = 1.0  # noqa: N815
    expansion_per_K: Range = (5e-6, 8e-5)  # noqa: N815
    flatness_mm: Range = (0.0, 0.2)
    place_mm: Range = (-3.0, 3.0)
    rotation_deg: Range = (-0.6, 0.6)


POPULATION = Population()

_LEAST_STRIPS = 8  # a row of fewer does not span the field
_LIT_SHARE = 0.8  # of the picture's width that the row of strips covers
_STRIP_MM = 10.0  # width of a strip, and of the gap to the next
_CERTIFICATE = "virtual: the true size is off by a normal error of the stated u"
_STEPS_DEG = ((0.0, 120.0, 240.0), (0.0, 90.0, 180.0, 270.0))

_BOWS = 0.5  # share of the plates that bend about one direction, as what lies on two bearings does
_ALPHA_REL_U = 0.1  # of a coefficient of expansion from a table
_FORM_UNIT_MM, _FORM_NODES = 100.0, 41

type Draw = np.random.Generator
type Array = NDArray[np.float64]
type Terms = tuple[tuple[int, int, float], ...]


@dataclass(frozen=True)
class DrawnRig:
    """A rig of a study with what is true of it and of its artefacts.

    Parameters
    ----------
    number
        Its number in the study.
    spec
        The true rig; its captures name the artefacts as the session states them.
    targets
        The artefacts as they are, by capture name.
    steps
        What the mirror did, by capture name: every capture has errors of its own.
    seed
        Of noise, and of what was measured by hand.
    """

    number: int
    spec: RigSpec
    targets: dict[str, Target]
    steps: dict[str, StepsSpec]
    seed: int

    def session(self) -> SimulatedSession:
        """Take all captures; the session states what somebody at this rig could know."""
        return simulate_session(self.spec, seed=self.seed, targets=self.targets, steps=self.steps, with_truth=False)


def draw_rig(number: int, *, seed: int = 0, spec: RigSpec | None = None) -> DrawnRig:
    """Draw one rig of a study; its number and the study's seed decide all of it.

    Drawn are camera (height, scale, tilt, principal point, distortion), projector (place, direction, pitch, lens,
    gamma, contrast, focus), steps (an error for every frame of every capture), light, noise and artefacts. True sizes
    of grid and strips are normal about the stated ones; the stated height of the camera and place of the projector
    are normal about the true ones.

    Parameters
    ----------
    number
        Number of the rig.
    seed
        Seed of the study.
    spec
        One rig for the whole study, of which only the errors are drawn; every rig another by default.
    """
    rng = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(number,)))
    if spec is None:
        spec = _random_spec(rng, number)
    captures = tuple(c for c in spec.capture if c.kind in ("grid", "reference", "strips"))
    spec = _bent(rng, spec.model_copy(update={"capture": captures}))
    stated = {c.name: stated_target(c) for c in captures}
    targets = {
        name: _true_target(rng, target) for name, target in stated.items() if isinstance(target, LineGrid | Strips)
    }
    steps = {c.name: _true_steps(rng, spec.steps) for c in captures if c.kind != "grid"}
    return DrawnRig(number, spec, targets, steps, int(rng.integers(2**31)))


def _random_spec(rng: Draw, number: int) -> RigSpec:
    of, scale = POPULATION, rng.uniform(*POPULATION.scale_mm_per_px)
    steps_deg = _STEPS_DEG[int(rng.integers(len(_STEPS_DEG)))]
    return RigSpec.model_validate(
        {
            "name": f"drawn {number}",
            "camera": _camera(rng, scale),
            "projector": _projector(rng),
            "steps": {"nominal_deg": steps_deg},
            "light": {
                "mid_grey": rng.uniform(*of.mid_grey),
                "ambient": rng.uniform(*of.ambient),
                "room_grey": rng.uniform(*of.room_grey),
                "room_gradient": rng.uniform(*of.room_gradient, 2).tolist(),
                "flicker": rng.uniform(*of.flicker),
            },
            "noise": {"read_levels": rng.uniform(*of.read_levels), "gain": rng.uniform(*of.gain)},
            "surface": {
                "seed": int(rng.integers(2**31)),
                "smooth": of.texture,
                "speckle": of.texture,
                "speckle_mm": scale,
            },
            "stated": {
                "camera_height_u_mm": rng.uniform(*of.camera_height_u_mm),
                "projector_position_u_mm": of.projector_u_mm,
            },
            "capture": _captures(rng, scale),
        }
    )


def _bent(rng: Draw, spec: RigSpec) -> RigSpec:
    """Lay a plate under a rig that is as far from flat as its certificate says, in one way or another."""
    flatness = rng.uniform(*POPULATION.flatness_mm)
    half = spec.camera.scale_mm_per_px * np.array(PICTURE_PX) / 2
    captures = tuple(
        c.model_copy(update={"target": _plate(flatness)}) if c.kind == "reference" else c for c in spec.capture
    )
    form = _bow(rng, flatness, half) if rng.random() < _BOWS else _warp(rng, flatness, half)
    return spec.model_copy(update={"plate": PlateSpec(form=form, unit_mm=_FORM_UNIT_MM), "capture": captures})


def _plate(flatness_mm: float) -> dict[str, Any]:
    return {
        "format": 1,
        "kind": "flat",
        "name": "plate",
        "certificate": "virtual: as far from flat as is stated",
        "flatness_mm": {"value": flatness_mm, "u": 0.0},
    }


def _bow(rng: Draw, flatness_mm: float, half_mm: Array) -> Terms:
    """Bend a plate about one direction: a parabola across it, whose ends and middle are equally far from its plane."""
    angle, sign = rng.uniform(0, math.pi), rng.choice([-1.0, 1.0])
    c, s = math.cos(angle), math.sin(angle)
    terms = ((2, 0, c * c), (1, 1, 2 * c * s), (0, 2, s * s))
    return _scaled(tuple((i, j, sign * mm) for i, j, mm in terms), flatness_mm, half_mm)


def _warp(rng: Draw, flatness_mm: float, half_mm: Array) -> Terms:
    """Bend and twist a plate in all ways of second and third order, the third half as much."""
    x, y = half_mm / _FORM_UNIT_MM
    orders = [(i, j) for i in range(4) for j in range(4) if 2 <= i + j <= 3]
    sizes = [rng.standard_normal() * (1.0 if i + j == 2 else 0.5) / x**i / y**j for i, j in orders]
    return _scaled(tuple((i, j, mm) for (i, j), mm in zip(orders, sizes, strict=True)), flatness_mm, half_mm)


def _scaled(terms: Terms, flatness_mm: float, half_mm: Array) -> Terms:
    """Take a form's best plane off and give it its size: the largest distance from that plane over the picture."""
    x, y = (c.ravel() for c in np.meshgrid(*(np.linspace(-h, h, _FORM_NODES) / _FORM_UNIT_MM for h in half_mm)))
    height = sum((mm * x**i * y**j for i, j, mm in terms), np.zeros(x.size))
    design = np.column_stack([np.ones_like(x), x, y])
    plane = np.linalg.lstsq(design, height, rcond=None)[0]
    size = flatness_mm / float(np.abs(height - design @ plane).max())
    level = ((0, 0, -plane[0]), (1, 0, -plane[1]), (0, 1, -plane[2]))
    return tuple((i, j, float(size * mm)) for i, j, mm in (*terms, *level))


def _camera(rng: Draw, scale: float) -> dict[str, Any]:
    (width, height), of = PICTURE_PX, POPULATION
    return {
        "width_px": width,
        "height_px": height,
        "scale_mm_per_px": scale,
        "height_mm": rng.uniform(*of.camera_height_mm),
        "tilt_deg": rng.uniform(*of.tilt_deg, 2).tolist(),
        "principal_offset_px": rng.normal(0.0, of.principal_share * math.hypot(width, height), 2).tolist(),
        "distortion": [rng.uniform(*of.camera_k1), 0.0, 0.0, 0.0, 0.0],
        "vignetting": of.vignetting,
        "defocus_px": rng.uniform(*of.defocus_px),
    }


def _projector(rng: Draw) -> dict[str, Any]:
    """Place the projector above or below the picture, its fringes about along the rows."""
    of = POPULATION
    height_mm, angle = rng.uniform(*of.projector_height_mm), math.radians(rng.uniform(*of.angle_deg))
    azimuth_deg = rng.choice([-90.0, 90.0]) + rng.uniform(*of.azimuth_deg)
    out, azimuth = height_mm * math.tan(angle), math.radians(azimuth_deg)
    return {
        "position_mm": [out * math.cos(azimuth), out * math.sin(azimuth), height_mm],
        "aim_mm": rng.uniform(*of.aim_mm, 2).tolist(),
        "across_deg": azimuth_deg + rng.uniform(*of.across_deg),
        "pitch_mm": rng.uniform(*of.pitch_mm),
        "phase_at_origin_rad": rng.uniform(-math.pi, math.pi),
        "contrast": rng.uniform(*of.contrast),
        "gamma": rng.uniform(*of.gamma),
        "distortion": [rng.uniform(*of.projector_k1), 0.0],
        "defocus_mm": rng.uniform(*of.blur_mm),
    }


def _captures(rng: Draw, scale: float) -> list[dict[str, Any]]:
    of = POPULATION
    grid: dict[str, Any] = {
        "kind": "line-grid",
        "name": "grid",
        "polarity": "dark",
        "pitch_mm": {"value": 10.0, "u": rng.uniform(*of.grid_pitch_u_mm)},
        "line_width_mm": {"value": 0.9, "u": 0.05},
    }
    strips: dict[str, Any] = {
        "kind": "strips",
        "name": "strips",
        "count": max(_LEAST_STRIPS, int(_LIT_SHARE * PICTURE_PX[0] * scale / (2 * _STRIP_MM))),
        "width_mm": {"value": _STRIP_MM, "u": 0.05},
        "gap_mm": {"value": _STRIP_MM, "u": 0.05},
        "height_mm": {"value": round(rng.uniform(*of.strip_height_mm), 2), "u": rng.uniform(*of.strip_height_u_mm)},
        "length_mm": {"value": 400.0, "u": 0.5},
    }
    common = {"format": 1, "certificate": _CERTIFICATE}
    room = {"value": rng.uniform(*of.temperature_degC), "u": of.temperature_u_degC}
    grid, strips = (one | _thermal(rng, room) for one in (grid, strips | _further(rng)))
    return [
        {"name": "grid", "kind": "grid", "target": common | grid} | _place(rng),
        {"name": "reference", "kind": "reference"},
        {"name": "strips", "kind": "strips", "target": common | strips} | _place(rng),
    ]


def _thermal(rng: Draw, room: dict[str, float]) -> dict[str, Any]:
    alpha = rng.uniform(*POPULATION.expansion_per_K)
    return {"expansion_per_K": {"value": alpha, "u": _ALPHA_REL_U * alpha}, "temperature_degC": room}


def _further(rng: Draw) -> dict[str, Any]:
    """State what else the heights of strips hang on."""
    of = POPULATION
    return {
        "instrument": "micrometer",
        "instrument_u_mm": rng.uniform(*of.instrument_u_mm),
        "paint_mm": {
            "value": 0.0,
            "u": rng.uniform(*of.paint_u_mm),
            "degrees_of_freedom": float(rng.integers(*of.paint_dof)),
        },
        "seating_mm": {"value": 0.0, "u": rng.uniform(*of.seating_u_mm)},
        "depth_mm": {"value": rng.uniform(*of.depth_mm), "u": rng.uniform(*of.depth_u_mm)},
    }


def _place(rng: Draw) -> dict[str, Any]:
    of = POPULATION
    return {"position_mm": rng.uniform(*of.place_mm, 2).tolist(), "rotation_deg": rng.uniform(*of.rotation_deg)}


def _true_target(rng: Draw, stated: LineGrid | Strips) -> Target:
    """Return the artefact as it is: what the rig hangs on is off by normal errors of its stated u."""
    if isinstance(stated, LineGrid):
        pitch = stated.pitch_mm.value + stated.pitch_mm.us[0] * rng.standard_normal()
        return _sized(stated, "pitch_mm", (pitch * (1 + _expanded(rng, stated)),))
    return _sized(stated, "height_mm", _true_heights(rng, stated))


def _true_heights(rng: Draw, stated: Strips) -> tuple[float, ...]:
    """Draw the height at which each strip is seen: its own errors, and those that all of them have in common."""
    number = stated.count
    own = stated.height_mm.array(number) + stated.height_mm.u_array(number) * (
        rng.standard_normal(number) if stated.instrument_u_mm else rng.standard_normal()
    )
    seating = 0.0 if stated.seating_mm is None else stated.seating_mm.us[0]
    common = (one for one in (stated.paint_mm, stated.depth_mm) if one is not None)
    added = sum(one.us[0] * _deviate(rng, one.dof) for one in common) + stated.added_mm
    added += stated.instrument_u_mm * rng.standard_normal()
    heights = own * (1 + _expanded(rng, stated)) + added + seating * rng.standard_normal(number)
    return tuple(float(one) for one in heights)


def _deviate(rng: Draw, dof: float) -> float:
    """Draw an error over its stated u, which itself rests on so many degrees of freedom: Student's t."""
    return float(rng.standard_t(dof) if math.isfinite(dof) else rng.standard_normal())


def _expanded(rng: Draw, stated: LineGrid | Strips) -> float:
    """Draw by how much an artefact is longer than at 20 degC, relative."""
    alpha, degrees = stated.expansion_per_K, stated.temperature_degC
    if alpha is None or degrees is None:
        return 0.0
    true_alpha, true_degrees = (one.value + one.us[0] * rng.standard_normal() for one in (alpha, degrees))
    return float(true_alpha * (true_degrees - REFERENCE_DEGC))


def _sized[T: (LineGrid, Strips)](stated: T, name: str, sizes: tuple[float, ...]) -> T:
    size = getattr(stated, name)
    value = sizes[0] if len(set(sizes)) == 1 else sizes
    return stated.model_copy(update={name: size.model_copy(update={"value": value})})


def _true_steps(rng: Draw, steps: StepsSpec) -> StepsSpec:
    errors = rng.normal(0.0, STEP_ERROR_DEG, len(steps.nominal_deg))
    return steps.model_copy(update={"error_deg": tuple(errors.tolist())})
