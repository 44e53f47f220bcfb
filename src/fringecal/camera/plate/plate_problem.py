"""What a camera on the plate is fitted to: crossings of a grid, and what is stated beside them, as residuals."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from fringecal.camera.distortion.crossing_scatter import CrossingNoise
from fringecal.camera.lens.brown_lens import Lens
from fringecal.camera.plate.plate_camera import CAMERA_NAMES, PlateCamera
from fringecal.detect import LineScatter
from fringecal.errors import FitError
from fringecal.uncertainty import Estimate

Array = NDArray[np.float64]

_EXACT = 1e-7  # relative u of a focal length whose file states none
#: Lines are placed in the picture with a common stretch below 5e-6 (`tests/detect`, pictures without noise); among
#: 460 virtual cameras 2e-6 made the 95 % interval of the scale hold where noise is least.
_PLACING_REL_U = 2e-6
#: Of the picture's diagonal: how far a lens's axis is off the image centre where no lens is stated. A square-on grid
#: hardly tells; left out, it would turn every line of sight by 1/4 deg unnoticed, and the projection angle with it.
_CENTRING_SHARE = 0.01
_CENTRING = ("cu_px", "cv_px")
#: How far parallel rays tilt from the plate's normal. Their picture of a grid is stretched and sheared by the square of
#: it, which says nothing of the direction: the camera counts as square on the plate, and heights are the same; but the
#: projection angle is measured from the normal.
TELECENTRIC_TILT_RAD = math.radians(1.0)
#: How far lines may be out of place at half a diagonal from the image centre: no paper lies flatter, and no ruling is
#: straighter. Left out, a long lens takes it for tilt.
_DEFORMATION_U_PX = 0.005
_DEFORMATIONS = 7  # a shear; u^2, uv, v^2 in either coordinate
_FREE_PX = (
    100.0  # the shear that parallel rays make where they are tilted: no observation beside crossings known to 0.05 px
)
_LEAST_HEIGHT_U_MM = 1e-6  # of a height that is stated as exact: a division needs one
_GUESS_HEIGHT_MM = 1000.0  # where the lens and the grid's scale tell it: only what the solver starts from
_WORST_START = 0.2  # of the crossings' spread: a similarity leaves less of any view that can be used (tilt, lens)


@dataclass(frozen=True)
class _Noticeable:
    """Changes that a solver's first derivatives are taken over: about a tenth of a pixel at the picture's rim.

    Parameters
    ----------
    px
        At the rim.
    centre_px
        Of the principal point, which tilt makes up for but for its higher terms.
    height
        Of the camera's height, which scale makes up for, relative.
    """

    px: float = 0.1
    centre_px: float = 1.0
    height: float = 1e-3


_NOTICEABLE = _Noticeable()


@dataclass(frozen=True)
class Problem:
    """Crossings in the picture (px) and on the sheet (mm), which parameters are free, and what is stated of them."""

    u: Array
    v: Array
    x: Array
    y: Array
    sigma: Array
    start: PlateCamera
    free: tuple[int, ...]
    stretch_u: float
    height: Estimate | None
    lens: Lens | None
    noise: CrossingNoise

    @property
    def stretch_place(self) -> int:
        """Place of the sheet's stretch in the vector."""
        return len(self.free) + 3

    @property
    def height_u_mm(self) -> float:
        """Standard uncertainty of the stated height; that of one that is stated as exact is next to none."""
        return _LEAST_HEIGHT_U_MM if self.height is None else max(self.height.u, _LEAST_HEIGHT_U_MM)

    @cached_property
    def deformed_px(self) -> Array:
        """What each deformation does to the crossings, along u and along v, (2, deformations, n).

        One pixel of the sheet's, and after these one standard uncertainty of what all crossings have in common.
        """
        (u0, v0), half = self.start.centre_px, math.hypot(self.start.width_px, self.start.height_px) / 2
        u, v = (self.u - u0) / half, (self.v - v0) / half
        squares, none = np.stack([u * u, u * v, v * v]), np.zeros((3, u.size))
        along_u, along_v = np.moveaxis(self.noise.common_px, 2, 0)
        return np.stack([np.vstack([v, squares, none, along_u]), np.vstack([u, none, squares, along_v])])

    @cached_property
    def deformation_u_px(self) -> Array:
        """Standard uncertainty of every deformation."""
        u = np.full(_DEFORMATIONS, _DEFORMATION_U_PX)
        u[0] = _FREE_PX if self.start.telecentric else _DEFORMATION_U_PX
        return np.concatenate([u, np.ones(len(self.noise.common_px))])

    @cached_property
    def u_of_zero(self) -> dict[int, float]:
        """Standard uncertainty of parameters that are taken to be zero, by place in the vector."""
        if self.lens is not None or self.start.telecentric:
            return {}
        u = _CENTRING_SHARE * math.hypot(self.start.width_px, self.start.height_px)
        return {self.free.index(CAMERA_NAMES.index(name)): u for name in _CENTRING}


def prepare(  # noqa: PLR0913, PLR0917 -- gathers what `fit_plate_camera` was given
    points_px: Array,
    points_mm: Array,
    shape: tuple[int, int],
    sigma_px: Array | float,
    telecentric: bool,
    distortion: tuple[str, ...],
    stretch_u: float,
    height: Estimate | None,
    lens: Lens | None,
    index: tuple[NDArray[np.int64], NDArray[np.int64]] | None,
    scatter: LineScatter | None,
) -> Problem:
    """Gather crossings and statements, and decide which parameters are free."""
    if lens is not None:
        _refuse_other_camera(lens, shape, telecentric=telecentric)
    values = {} if lens is None else lens_parameters(lens)
    guess = 1.0 if telecentric else (height.value if height else _GUESS_HEIGHT_MM)
    start = PlateCamera.from_values(
        {"height_mm": guess, "scale_mm_per_px": 1.0} | values, shape, telecentric=telecentric
    )
    names = ["scale_mm_per_px", "tilt_x_rad", "tilt_y_rad"]
    names += ["aspect", *distortion] if lens is None else _uncertain(lens)
    if telecentric:
        names = [name for name in names if not name.startswith("tilt")]
    else:
        names += ["height_mm", *(_CENTRING if lens is None else ())]
    free = tuple(i for i, n in enumerate(CAMERA_NAMES) if n in names)
    sigma = np.broadcast_to(np.asarray(sigma_px, float), (len(points_px),)).copy()
    u, v = np.asarray(points_px, float).T
    none = np.arange(len(u))
    noise = CrossingNoise(*(index or (none, none)), sigma, None if index is None else scatter)
    x, y = (np.asarray(points_mm, float) - np.mean(points_mm, axis=0)).T
    return Problem(u, v, x, y, sigma, start, free, math.hypot(stretch_u, _PLACING_REL_U), height, lens, noise)


def _refuse_other_camera(lens: Lens, shape: tuple[int, int], *, telecentric: bool) -> None:
    if telecentric:
        raise FitError("a telecentric camera has no focal length, but a pinhole's model is stated; keep one of the two")
    if (lens.height_px, lens.width_px) != tuple(shape):
        raise FitError(
            f"the camera model is for pictures of {lens.width_px} x {lens.height_px} px, the grid's picture has "
            f"{shape[1]} x {shape[0]}; state the model of this camera at this picture size"
        )


def lens_parameters(lens: Lens) -> dict[str, float]:
    """Give the lens in the names of `CAMERA_NAMES`; its focal length is scale and height there."""
    values = {name: lens[name] for name in ("k1", "k2", "p1", "p2", "k3")}
    centre = {"cu_px": lens["cx_px"] - (lens.width_px - 1) / 2, "cv_px": lens["cy_px"] - (lens.height_px - 1) / 2}
    return values | centre | {"aspect": lens["fx_px"] / lens["fy_px"]}


def _uncertain(lens: Lens) -> list[str]:
    """Parameters of the camera that the lens does not state exactly."""
    known = {"aspect": "fy_px", "cu_px": "cx_px", "cv_px": "cy_px"} | {n: n for n in ("k1", "k2", "p1", "p2", "k3")}
    return [name for name, own in known.items() if lens.estimate(own).u > 0]


def lens_of(camera: PlateCamera) -> Array:
    """Parameters of a camera in the order of `camera.lens.LENS_NAMES`."""
    (u0, v0), focal = camera.centre_px, camera.focal_px
    distortion = [camera[name] for name in ("k1", "k2", "p1", "p2", "k3")]
    return np.array([focal, focal / camera["aspect"], u0 + camera["cu_px"], v0 + camera["cv_px"], *distortion])


def lens_rows(lens: Lens) -> tuple[NDArray[np.int64], Array]:
    """Which lens parameters are observed, and the matrix that makes their differences unit normal."""
    observed = np.flatnonzero(np.diag(lens.covariance) > 0)
    if observed.size == 0:
        return np.array([0]), np.array([[1 / (_EXACT * lens.values[0])]])
    return observed, np.linalg.inv(np.linalg.cholesky(lens.covariance[np.ix_(observed, observed)]))


def first_guess(problem: Problem) -> Array:
    """Similarity from plate to picture: scale, turn and shift, everything else nothing.

    The vector holds the free parameters of the camera; turn, shift (two) and stretch of the sheet; deformations of its
    lines.
    """
    u0, v0 = problem.start.centre_px
    plate = problem.x + 1j * problem.y
    picture = (problem.u - u0) - 1j * (problem.v - v0)
    design = np.column_stack([plate, np.ones_like(plate)])
    (gain, shift), *_ = np.linalg.lstsq(design, picture, rcond=None)
    residual = picture - design @ np.array([gain, shift])
    if np.std(residual) > _WORST_START * np.std(picture):
        raise FitError(
            "The crossings and the sheet do not agree even roughly: the numbering of rows or columns has the "
            "wrong direction or skips a line."
        )
    scale = 1 / abs(gain)
    camera = problem.start.parameters.copy()
    camera[0] = scale
    if problem.lens is not None and problem.height is None:
        camera[-1] = problem.lens["fx_px"] * scale
    origin = shift * scale
    pose = [np.angle(gain), origin.real, origin.imag, 0.0]
    return np.concatenate([camera[list(problem.free)], pose, 0.0 * problem.deformation_u_px])


def camera_of(problem: Problem, vector: Array) -> PlateCamera:
    """Return the camera that a vector of free parameters and the sheet's pose describes."""
    parameters = problem.start.parameters.copy()
    parameters[list(problem.free)] = vector[: len(problem.free)]
    return problem.start.replaced(parameters)


def noticeable(problem: Problem, vector: Array) -> Array:
    """Return changes of the parameters that move crossings at the picture's rim by about a tenth of a pixel."""
    camera = camera_of(problem, vector)
    half = math.hypot(camera.width_px, camera.height_px) / 2
    share, slant = _NOTICEABLE.px / half, half / camera.focal_px
    size = {"k1": share / slant**2, "k2": share / slant**4, "k3": share / slant**6}
    size |= dict.fromkeys(("tilt_x_rad", "tilt_y_rad", "p1", "p2"), share / slant)
    size |= {"scale_mm_per_px": share * camera["scale_mm_per_px"], "aspect": share}
    size |= {"cu_px": _NOTICEABLE.centre_px, "cv_px": _NOTICEABLE.centre_px}
    size |= {"height_mm": _NOTICEABLE.height * camera["height_mm"]}
    shift = _NOTICEABLE.px * camera["scale_mm_per_px"]
    return np.array(
        [
            *(size[CAMERA_NAMES[i]] for i in problem.free),
            share,
            shift,
            shift,
            share,
            *[_DEFORMATION_U_PX] * _DEFORMATIONS,
            *[1.0] * len(problem.noise.common_px),
        ]
    )


def residual_px(problem: Problem, vector: Array) -> tuple[Array, Array]:
    """Return observed minus modelled crossings, along u and along v."""
    turn, x0, y0, stretch, *deformations = vector[len(problem.free) :]
    cosine, sine = (1 + stretch) * math.cos(turn), (1 + stretch) * math.sin(turn)
    x = cosine * problem.x - sine * problem.y + x0
    y = sine * problem.x + cosine * problem.y + y0
    u, v = camera_of(problem, vector).project(x, y)
    deformed_u, deformed_v = np.array(deformations) @ problem.deformed_px
    return problem.u - u - deformed_u, problem.v - v - deformed_v


def deformations_of(problem: Problem, vector: Array) -> Array:
    """Return the deformations of the sheet's lines over their standard uncertainties."""
    return np.asarray(vector[-len(problem.deformation_u_px) :] / problem.deformation_u_px)


def residuals(
    problem: Problem, vector: Array, keep: NDArray[np.bool_], factor: float, whitened: Callable[[Array], Array]
) -> Array:
    """Return residuals of crossings, and of all that is stated, each over its standard uncertainty.

    `whitened` makes shifts of the crossings that are kept independent, of variance 1 (`CrossingNoise.whitening`).
    """
    du, dv = residual_px(problem, vector)
    crossings = whitened(np.column_stack([du, dv])[keep]).ravel() / factor
    rows = [crossings, deformations_of(problem, vector)]
    rows.append(np.atleast_1d(vector[problem.stretch_place] / problem.stretch_u))
    rows += [np.atleast_1d(vector[i] / u) for i, u in problem.u_of_zero.items()]
    camera = camera_of(problem, vector)
    if problem.height is not None:
        rows.append(np.atleast_1d((camera["height_mm"] - problem.height.value) / problem.height_u_mm))
    if problem.lens is not None:
        observed, whitening = lens_rows(problem.lens)
        rows.append(whitening @ (lens_of(camera) - problem.lens.values)[observed])
    return np.concatenate(rows)
