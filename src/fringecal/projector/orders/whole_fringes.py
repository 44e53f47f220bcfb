"""Strips that shift the fringes by whole periods look like bare plate: said so where the stated rig predicts it."""

import numpy as np
from numpy.polynomial import polynomial
from numpy.typing import NDArray

from fringecal.camera import PlateCamera
from fringecal.errors import DetectionError
from fringecal.numerics import products_up_to
from fringecal.projector.rig_model import foot_on_plate

Array = NDArray[np.float64]

_NEAR_TURNS = 0.12  # fringes; a step nearer to whole ones drowns in noise and in the strips' own tolerance
_SHARE = 0.25  # of the field; over less of it the strips still show
_SIDE = 40  # samples along each side of the field: closer than strips
_DEGREE = 2  # of the polynomial in x and y that stands for the plate's phase: a pitch that changes over the field
_LEAST_SAMPLES = 12  # two for each of its six terms


def explained(
    error: DetectionError, plate_phase: Array, camera: PlateCamera, height_mm: float, projector_mm: Array | None
) -> DetectionError:
    """Return the error with its true reason: strips were not found because their step is whole fringes.

    Parameters
    ----------
    error
        What was said of the strips.
    plate_phase
        Map of the bare plate's unwrapped phase, rad, NaN where unknown.
    camera
        The camera on the plate.
    height_mm
        Height of the strips.
    projector_mm
        The stated position of the projector; without it nothing is predicted, and the error returned as it is.
    """
    if projector_mm is None:
        return error
    turns = predicted_turns(plate_phase, camera, height_mm, projector_mm)
    whole = np.rint(turns)
    hidden = (np.abs(turns - whole) < _NEAR_TURNS) & (whole != 0)
    if turns.size == 0 or np.mean(hidden) < _SHARE:
        return error
    shift = abs(float(np.median(turns)))
    half = max(round(shift), 1) - 0.5
    return DetectionError(
        f"the strips' {height_mm:g} mm shift the fringes by {shift:.2f} periods if the projector stands where it is "
        f"stated: over {100 * np.mean(hidden):.0f} % of the field that is whole fringes, and tops look like "
        f"plate. Use a fringe pitch {shift / half:.2g} times as wide, or strips of about "
        f"{height_mm * half / shift:.2g} mm."
    )


def predicted_turns(plate_phase: Array, camera: PlateCamera, height_mm: float, projector_mm: Array) -> Array:
    """Return by how many periods strips of a height shift the fringes, at samples of the field.

    Along a ray of the projector the phase does not change: on a top it is the plate's at the ray's foot. The plate's
    phase is taken as a polynomial of degree 2 in x and y.
    """
    height, width = plate_phase.shape
    v, u = (a.ravel() for a in np.mgrid[0 : height - 1 : _SIDE * 1j, 0 : width - 1 : _SIDE * 1j])
    phase = plate_phase[np.rint(v).astype(np.intp), np.rint(u).astype(np.intp)]
    good = np.isfinite(phase)
    if np.count_nonzero(good) < _LEAST_SAMPLES:
        return np.zeros(0)
    rays = camera.rays(u[good], v[good])
    foot = _terms(*foot_on_plate(*rays.at(height_mm), height_mm, projector_mm))
    plate = _terms(rays.ax, rays.ay)
    solution, *_ = np.linalg.lstsq(plate, phase[good], rcond=None)
    return np.asarray((foot - plate) @ solution / (2 * np.pi))


def _terms(x: Array, y: Array) -> Array:
    return products_up_to(polynomial.polyvander(x, _DEGREE), polynomial.polyvander(y, _DEGREE))
