"""Heights over the plate in view in place of the calibration's: its plane taken off, with its uncertainty."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from fringecal.numerics import robust_sd, wrap
from fringecal.phase import PhaseMap
from fringecal.projector import RigCalibration
from fringecal.reconstruct.against_plate.plate_sample import PlateSample
from fringecal.reconstruct.height_map import HeightMap
from fringecal.reconstruct.object_phase import absolute_phase
from fringecal.reconstruct.phase_to_height import height_of_phase, reconstruct_height
from fringecal.reconstruct.plate_in_view import VisiblePlate
from fringecal.reconstruct.sensitivity import Sensitivities
from fringecal.uncertainty import Influence, Source

Array = NDArray[np.float64]

_ROUNDS = 4  # of the fit of the plate's phase, each without what lies off the one before
_KEPT_SIGMAS = 4.0  # robust standard deviations beyond which a pixel is the foot of an object

TIED = "plate in view, to which heights were tied"


def tied_to_plate(surface: HeightMap, plate: VisiblePlate, calibration: RigCalibration) -> HeightMap:
    """Take the plane of the plate in view off the heights.

    x and y follow along each pixel's ray. The plane's uncertainty is added as common parts, offset and both slopes: a
    mean does not lose them. What plate and object share of the rig's own uncertainty stays in u(z), which is too much
    rather than too little.

    Parameters
    ----------
    surface
        The measured surface.
    plate
        The plate beside the object, from `visible_plate`.
    calibration
        The rig that it was measured with.
    """
    taken = plate.plane_at(surface.x, surface.y)
    rays = calibration.camera.pixel_rays()
    parts = _parts(surface, plate)
    more = sum(part**2 for part in (plate.u_mm, *plate.u_slopes_at(surface.x, surface.y)))
    kind = surface.z.dtype
    return replace(
        surface,
        x=(surface.x - rays.bx * taken).astype(kind),
        y=(surface.y - rays.by * taken).astype(kind),
        z=(surface.z - taken).astype(kind),
        u_z=np.sqrt(surface.u_z**2 + more).astype(kind),
        systematic=_with_parts(surface.systematic, parts),
    )


def surface_over_plate(
    phase_map: PhaseMap,
    calibration: RigCalibration,
    sample: PlateSample,
    *,
    model: str = "projective",
    height_range_mm: tuple[float, float] | None = None,
) -> HeightMap:
    """Measure an object on a plate that lies elsewhere than at its calibration, orders decided over the plate in view.

    Heights are those over the calibration's plate, as of `reconstruct_height`; only what says which fringe is which
    starts from the plate where it is seen, up to a seventh of a fringe off. Further periods decide orders by
    themselves.

    Parameters
    ----------
    phase_map, calibration, model, height_range_mm
        As for `reconstruct_height`.
    sample
        The capture beside the plate's phase, from `capture_held`.
    """
    if phase_map.orders is not None or not sample.seen:
        return reconstruct_height(phase_map, calibration, model=model, height_range_mm=height_range_mm)
    lift = _lift(sample, phase_map.phase.shape)
    level = replace(phase_map, phase=wrap(phase_map.phase - lift).astype(np.float32))
    found = absolute_phase(level, calibration, height_range_mm=height_range_mm)
    found = replace(found, difference_rad=found.difference_rad + lift)
    return height_of_phase(found, calibration, model=model, height_range_mm=height_range_mm, dtype=np.float32)


def _lift(sample: PlateSample, shape: tuple[int, ...]) -> Array:
    """Return the phase by which the plate in view is off, as a quadratic over the picture, rad, (H, W)."""
    v, u = np.nonzero(sample.plate & np.isfinite(sample.step_rad))
    step = sample.step_rad[v, u]
    terms = _quadratic(2 * sample.u_px[u] / shape[1] - 1, 2 * sample.v_px[v] / shape[0] - 1)
    kept = np.ones(step.size, bool)
    fit = np.zeros(len(terms))
    for _ in range(_ROUNDS):
        fit = np.linalg.lstsq(terms[:, kept].T, step[kept], rcond=None)[0]
        left = np.abs(step - fit @ terms)
        kept = left <= _KEPT_SIGMAS * robust_sd(left[kept], about=0)
    across, down = (2 * np.arange(length) / length - 1 for length in shape[::-1])
    return np.tensordot(fit, _quadratic(*np.meshgrid(across, down)), axes=1)


def _quadratic(x: Array, y: Array) -> Array:
    """Return the terms of a quadratic of two variables, (6, ...)."""
    return np.stack([np.ones_like(x), x, y, x * x, x * y, y * y])


def _parts(surface: HeightMap, plate: VisiblePlate) -> list[Array]:
    """Return offset and slopes, one u each, as planes: constant, along v and along u from -1 to 1, (3, 3)."""
    v, u = np.nonzero(surface.mask)
    few = slice(None, None, max(1, v.size // 10_000))
    v, u = v[few], u[few]
    height, width = surface.mask.shape
    design = np.column_stack([np.ones(v.size), 2 * v / (height - 1) - 1, 2 * u / (width - 1) - 1])
    slopes = plate.u_slopes_at(surface.x[v, u].astype(float), surface.y[v, u].astype(float))
    return [np.array([plate.u_mm, 0.0, 0.0]), *(np.linalg.lstsq(design, part, rcond=None)[0] for part in slopes)]


def _with_parts(systematic: Sensitivities, parts: list[Array]) -> Sensitivities:
    """Add parts that are planes over the picture and the same at every height."""
    empty = np.zeros((len(parts), *systematic.coefficients.shape[1:]))
    for one, (constant, along_v, along_u) in zip(empty, parts, strict=True):
        one[0, 0, 0], one[0, 1, 0], one[0, 0, 1] = constant, along_v, along_u
    return replace(
        systematic,
        sources=(*systematic.sources, *(Source(Influence.INPUT, TIED) for _ in parts)),
        dof=(*systematic.dof, *(np.inf for _ in parts)),
        coefficients=np.concatenate([systematic.coefficients, empty]),
    )
