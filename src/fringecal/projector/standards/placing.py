"""Find where an artefact of known shape lies on the plate, from phase alone.

A rig that is known already, if not well, says what phase each facet of the artefact must show wherever it lay.
Pixels that show it vote for the place; the place with the best vote wins, and must win by far.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from fringecal.errors import FitError
from fringecal.numerics import wrap
from fringecal.projector.rig_calibration import RigCalibration
from fringecal.projector.standards.target_facets import Facet

Array = NDArray[np.float64]
Spectrum = NDArray[np.complex128]

_NODES = 160  # of the search lattice along the picture's longer side: 3 mm over the thesis's field
NEAR_RAD = 0.8
"""A pixel that agrees with a facet is this close, rad, to the phase which the facet must show: an eighth of a fringe,
so that one pixel in four agrees by chance. A rig that is known only roughly predicts no better."""
_TURNS_DEG = (6.0, 2.0, 0.5)  # steps of the search over directions, coarse to fine
_LEAST_VOTE = 0.6  # mean of all points under the facets that tell: four in five agree
_LEAST_TELLING = 0.3  # of the facets' area; the rest is in shadow or might as well be bare plate
_MISSING = -0.2  # vote of a point that shows no phase: shadow is expected, absence is not


@dataclass(frozen=True)
class ArtefactPlace:
    """Where an artefact lies: its centre in plate mm, its turn from +x in rad, and how sure the place is.

    `vote` is the share of the facets' telling points that show the phase they must, less those that do not.
    """

    x_mm: float
    y_mm: float
    turn_rad: float
    u_mm: float
    vote: float

    def inside(self, x_mm: Array, y_mm: Array) -> tuple[Array, Array]:
        """Return plate points in the artefact's own frame."""
        c, s = math.cos(self.turn_rad), math.sin(self.turn_rad)
        dx, dy = x_mm - self.x_mm, y_mm - self.y_mm
        return c * dx + s * dy, c * dy - s * dx


def place_artefact(
    facets: Sequence[Facet], wrapped_rad: Array, valid: NDArray[np.bool_], calibration: RigCalibration
) -> ArtefactPlace:
    """Find an artefact on the plate.

    Parameters
    ----------
    facets
        The artefact's rectangles of known height; one without edges fills the picture and needs no place.
    wrapped_rad, valid
        Phase of the capture, any multiple of 2 pi, and where it can be used; shape (H, W).
    calibration
        The rig as known from plate and strips.

    Raises
    ------
    FitError
        The artefact is not to be seen.
    """
    if not all(math.isfinite(f.low_mm) for f in facets):
        return ArtefactPlace(0.0, 0.0, 0.0, 0.0, 1.0)
    gz = abs(float(calibration.model.gradient(0.0, 0.0, 0.0)[2]))
    level = [piece for facet in facets for piece in facet.slices(NEAR_RAD / max(gz, 1e-9))]
    lattice = _Lattice.over(calibration)
    votes = [_votes(f, wrapped_rad, valid, calibration, lattice) for f in level]
    spectra: list[Spectrum] = [np.fft.rfft2(vote) for vote in votes]
    turns = np.arange(0.0, 360.0, _TURNS_DEG[0])
    best = max((_best_at(turn, level, spectra, lattice) for turn in turns), key=lambda p: p.vote)
    for before, step in zip(_TURNS_DEG, _TURNS_DEG[1:], strict=False):
        near = math.degrees(best.turn_rad) + np.arange(-before, before + step, step)
        best = max((_best_at(turn, level, spectra, lattice) for turn in near), key=lambda p: p.vote)
    best = replace(best, vote=_agreement(best, level, votes, lattice))
    if best.vote < _LEAST_VOTE:
        raise FitError(
            f"The artefact was not found: where it fits best, only {100 * max(best.vote, 0):.0f} % of its top "
            f"has the expected phase ({100 * _LEAST_VOTE:.0f} % are needed). Either its heights or those of the "
            "strips are stated wrongly, or it is not in the picture, or it lies in shadow."
        )
    return best


@dataclass(frozen=True)
class _Lattice:
    """Points of the plate at which votes are taken: x grows along columns, y along rows."""

    x: Array
    y: Array
    step_mm: float

    @classmethod
    def over(cls, calibration: RigCalibration) -> "_Lattice":
        camera = calibration.camera
        corners = camera.rays(
            np.array([0.0, camera.width_px, 0.0, camera.width_px]),
            np.array([0.0, 0.0, camera.height_px, camera.height_px]),
        )
        sides = [(float(c.min()), float(c.max())) for c in (corners.ax, corners.ay)]
        step = max(high - low for low, high in sides) / _NODES
        x, y = (np.arange(low, high, step) for low, high in sides)
        xx, yy = np.meshgrid(x, y)
        return cls(xx, yy, step)


def _votes(
    facet: Facet, wrapped: Array, valid: NDArray[np.bool_], calibration: RigCalibration, lattice: _Lattice
) -> Array:
    """+1 where the facet could lie, -1 where the phase contradicts it, in between without evidence."""
    z = facet.height.value
    u, v = calibration.camera.project(lattice.x, lattice.y, z)
    column, row = np.rint(np.nan_to_num(u, nan=-1.0)).astype(int), np.rint(np.nan_to_num(v, nan=-1.0)).astype(int)
    seen = (column >= 0) & (column < wrapped.shape[1]) & (row >= 0) & (row < wrapped.shape[0])
    column, row = np.where(seen, column, 0), np.where(seen, row, 0)
    seen &= valid[row, column]
    agrees = _near(wrapped[row, column] - calibration.model.phase(lattice.x, lattice.y, z))
    rays = calibration.camera.rays(column.astype(float), row.astype(float))
    plate = _near(wrapped[row, column] - calibration.model.phase(rays.ax, rays.ay, 0.0))
    # What might as well be bare plate speaks neither for the facet nor against it.
    votes = np.where(agrees, np.where(plate, 0.0, 1.0), -1.0)
    return np.where(seen, votes, _MISSING)


def _near(difference: Array) -> NDArray[np.bool_]:
    return np.abs(wrap(difference)) < NEAR_RAD


def _best_at(turn_deg: float, facets: Sequence[Facet], votes: Sequence[Spectrum], lattice: _Lattice) -> ArtefactPlace:
    """Correlate the votes with the facets turned so, and take the place where they add up best."""
    turn, shape = math.radians(turn_deg), lattice.x.shape
    # The stencil is centred on the lattice's middle, so that a place is a shift from there.
    dx, dy = lattice.x - lattice.x[0].mean(), lattice.y - lattice.y[:, 0].mean()
    s, t = math.cos(turn) * dx + math.sin(turn) * dy, math.cos(turn) * dy - math.sin(turn) * dx
    total, area = np.zeros((shape[0], shape[1] // 2 + 1), complex), 0.0
    for facet, vote in zip(facets, votes, strict=True):
        stencil = (s >= facet.low_mm) & (s < facet.high_mm) & (np.abs(t) <= facet.half_length_mm)
        total += vote * np.conj(np.fft.rfft2(stencil.astype(float)))
        area += (facet.high_mm - facet.low_mm) * 2 * facet.half_length_mm / lattice.step_mm**2
    score = np.fft.irfft2(total, shape) / area
    row, column = np.unravel_index(int(np.argmax(score)), shape)
    x = lattice.x[0].mean() + lattice.step_mm * _signed(int(column), shape[1])
    y = lattice.y[:, 0].mean() + lattice.step_mm * _signed(int(row), shape[0])
    return ArtefactPlace(float(x), float(y), turn, lattice.step_mm, float(score[row, column]))


def _agreement(place: ArtefactPlace, facets: Sequence[Facet], votes: Sequence[Array], lattice: _Lattice) -> float:
    """Mean vote under the facets, of lit points that tell; 0 where too few do."""
    s, t = place.inside(lattice.x, lattice.y)
    under = [
        vote[(s >= f.low_mm) & (s < f.high_mm) & (np.abs(t) <= f.half_length_mm)]
        for f, vote in zip(facets, votes, strict=True)
    ]
    together = np.concatenate(under)
    telling = np.abs(together) == 1
    return float(together[telling].mean()) if telling.mean() > _LEAST_TELLING else 0.0


def _signed(index: int, size: int) -> int:
    """Shift that an index of a circular correlation stands for."""
    return index - size if index > size // 2 else index
