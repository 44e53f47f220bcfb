"""Faults of a board rig's captures, each told by what it would explain of the residuals; named, never fitted away."""

import enum
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtri

from fringecal.projector.board_rig.board_fit import BoardRigFit, PoseFit
from fringecal.projector.board_rig.board_problem import POSE, RIG, Rows, observation_rows, residuals, subset
from fringecal.projector.board_rig.board_solve import Expected, minimise, of_points
from fringecal.projector.board_rig.board_start import pose_start

Array = NDArray[np.float64]

_RARE = 1e-7
"""Probability of a sum of squares by chance from which on a cause is named: of clean rigs, with a dozen
tests each, one in a million is named falsely."""
_STRETCH = RIG + 1  # number of the board's stretch among the shared parameters
_CAMERA_ASPECT_U, _PROJECTOR_ASPECT_U = 5e-4, 2e-3
"""Standard deviation of a device's aspect about the stated one: camera pixels are square to parts in ten thousand, a
projector's optics and raster to a part in a thousand."""
_LEAST_STRETCH = 5e-4  # below it no measurement on a print of paper would be surprised
_LEAST_ASPECT = 4e-3  # of a frame that was scaled: the nearest rasters differ by more, a lens by less
_LEAST_SKEW = 2e-3  # rad: of a frame that was turned into a trapezium; a raster's own is a tenth of it
_LEAST_FOCUS = 5e-4  # relative change of a focal length between poses that is worth a word
_PER_TERM = 2.0  # fall of the sum of squares for each pose that counts as structure and not as a rough model
_OF_STATED = 3.0  # times the stretch's stated u, up to which it is none but that
_SCALED = {
    "projector": "a scaler or keystone correction stands between the frame and the raster; switch it off and set the "
    "projector to its own resolution",
    "camera": "the picture was scaled; use the camera's own pixels",
}
_FOCAL_REL_U = 5e-3  # of a focal length that the poses hardly determine
_FEW_POSES = 4  # with so few no pose can be told to disagree with the others
_ALIKE_DEG = 10.0  # spread of the boards' normals about their mean: below it focal length and distance stay mixed
_AGREES = 0.5  # least share of a pose's points that must agree with all others
_MUCH_BETTER = 0.3  # of the residuals as they are numbered: a wrong numbering is off by whole pitches
_SCATTERS = 2.5  # times the median scatter of the poses: of 60 coordinates alike, one pose in 10^9 is beyond 1.6
_LIKE_OTHERS = 4.0  # standard deviations, rms, within which a renumbered pose agrees


class RigFaultKind(enum.Enum):
    """What can be wrong with the captures of a board rig; the value names it in files."""

    STRETCHED_PRINT = "stretched print"
    FRAME_SCALED = "frame scaled or keystoned"
    PICTURE_SCALED = "picture scaled"
    FOCUS_CHANGED = "focus changed between poses"
    NUMBERED_OTHERWISE = "points numbered otherwise"
    POSE_DISAGREES = "pose disagrees"
    POSE_SCATTERS = "pose scatters"
    POSES_TOO_FEW = "poses too few"
    POSES_ALIKE = "poses too alike"


@dataclass(frozen=True)
class RigFault:
    """One fault.

    Parameters
    ----------
    kind
        Which.
    message
        What was found, and what to do.
    poses
        Names of the poses concerned; empty where all are.
    size
        Stretch or aspect (relative), skew (rad), change of focus (relative), or relative u of a focal length.
    """

    kind: RigFaultKind
    message: str
    poses: tuple[str, ...] = ()
    size: float = math.nan


@dataclass(frozen=True)
class _Evidence:
    """What further parameters would explain: fall of the sum of squares, their number, values and covariance."""

    fall: float
    count: int
    values: Array

    @property
    def is_rare(self) -> bool:
        """Whether chance would hardly explain as much."""
        return self.fall > float(chdtri(max(self.count, 1), _RARE))


def rig_faults(
    fit: BoardRigFit, *, camera_aspect: float = 1.0, projector_aspect: float | None = 1.0
) -> tuple[RigFault, ...]:
    """Name what is wrong with the captures behind a fit.

    Parameters
    ----------
    fit
        A fitted rig.
    camera_aspect
        fy / fx of the camera by its data sheet: 1 for square pixels.
    projector_aspect
        The same of the projector's raster: 1, or 2 for half-width diamond rasters; None: not known.

    Notes
    -----
    A cause is named where its parameters, added to those of the fit, would lower the weighted sum of squares by more
    than chance does once in ten million, and where its size matters (docs/theory/board-rig.md). Of several the one that
    explains most is named: what is left when it is mended shows then. Poses that disagree are then its consequence.
    """
    poses = _of_poses(fit)
    wrong = {name for one in poses for name in one.poses}
    alike = _of_geometry(fit)
    if alike and _spread_deg(fit.poses) < _ALIKE_DEG:
        return (*poses, *alike)  # such poses tell no cause from another
    rows = _weighted_rows(fit)
    causes = [_of_aspects(fit, camera_aspect, projector_aspect), _of_skew(fit, rows), *_of_focus(fit, rows)]
    known = [cause for cause in causes if cause is not None]
    if known:
        poses = [one for one in poses if one.kind is not RigFaultKind.POSE_DISAGREES]
        return (*poses, max(known, key=lambda cause: cause[0])[1])
    return (*poses, *_of_scatter(fit, wrong), *alike)


type _Cause = tuple[float, RigFault] | None
"""A fault with the fall of the sum of squares that it explains, or None."""


def _weighted_rows(fit: BoardRigFit) -> Rows:
    """Equations at the solution over their standard deviations, 0 where not used."""
    rows = observation_rows(fit.solution.state, fit.data)
    over = np.hstack([fit.data.camera_u, fit.data.projector_u]) * of_points(fit.solution.s_px, fit.data)
    weights = np.where(fit.solution.used, 1 / over, 0.0)
    return Rows(rows.rest * weights, rows.derivatives * weights[..., None])


def _explained(fit: BoardRigFit, rows: Rows, further: Array) -> _Evidence:
    """What weighted columns (n, 4, q) beside the fit's own would explain, its parameters and poses set free again."""
    m = rows.derivatives.shape[2] - POSE
    q = further.shape[2]
    shared = np.concatenate([rows.derivatives[..., :m][..., fit.expected.free], further], axis=2)
    left, right = np.zeros((shared.shape[2],) * 2), np.zeros(shared.shape[2])
    for part in fit.data.slices():
        basis = np.linalg.qr(rows.derivatives[part][..., m:].reshape(-1, POSE))[0]
        flat, rest = shared[part].reshape(-1, shared.shape[2]), rows.rest[part].ravel()
        flat, rest = flat - basis @ (basis.T @ flat), rest - basis @ (basis.T @ rest)
        left += flat.T @ flat
        right += flat.T @ rest
    free = left.shape[0] - q
    left[:free, :free] += np.diag(fit.expected.weight[fit.expected.free])
    scale = np.sqrt(np.maximum(np.diag(left), 1e-300))
    left, right = left / np.outer(scale, scale), right / scale
    across = np.linalg.solve(left[:free, :free] + 1e-12 * np.eye(free), left[:free])
    own = left[free:, free:] - left[free:, :free] @ across[:, free:]
    rest = right[free:] - across[:, free:].T @ right[:free]
    sizes, vectors = np.linalg.eigh(own)
    told = sizes > 1e-7 * max(sizes[-1], 1e-300)
    along = vectors[:, told].T @ rest
    values = vectors[:, told] @ (along / sizes[told]) / scale[free:]
    return _Evidence(float((along**2 / sizes[told]).sum()), int(told.sum()), values)


def _of_focus(fit: BoardRigFit, rows: Rows) -> list[_Cause]:
    """A focal length of its own in every pose, of either device."""
    pose_of, found = fit.data.pose_of, []
    for device, first in (("camera", 0), ("projector", 9)):
        values = fit.solution.state.shared[first : first + 2]
        zoom = rows.derivatives[..., first : first + 2] @ (values * fit.expected.free[first : first + 2])
        each = np.zeros((*zoom.shape, len(fit.poses)))
        each[np.arange(len(pose_of)), :, pose_of] = zoom
        evidence = _explained(fit, rows, each)
        size = float(evidence.values.std())
        if evidence.is_rare and size > _LEAST_FOCUS and evidence.fall > _PER_TERM * evidence.count:
            text = (
                f"the {device}'s focal length differs from pose to pose by {size:.2%} (standard deviation): its focus "
                "moved; switch autofocus off, fix the lens, and capture all poses anew"
            )
            found.append((evidence.fall, RigFault(RigFaultKind.FOCUS_CHANGED, text, size=size)))
    return list(found)


def _of_skew(fit: BoardRigFit, rows: Rows) -> _Cause:
    """Columns of the projector that are not at right angles to its rows."""
    if len(fit.rig.axes) < 2:
        return None
    height = fit.data.projector[:, 1] - fit.rig.projector["cy_px"]
    leaned = np.zeros((*rows.rest.shape, 1))
    over = fit.data.projector_u[:, 0] * of_points(fit.solution.s_px, fit.data)[:, 2]
    leaned[:, 2, 0] = np.where(fit.solution.used[:, 2], height / over, 0.0)
    evidence = _explained(fit, rows, leaned)
    size = abs(float(evidence.values[0]) * fit.rig.projector["fy_px"] / fit.rig.projector["fx_px"])
    if not evidence.is_rare or size < _LEAST_SKEW:
        return None
    text = (
        f"the projector's columns lean by {size:.4f} rad: its frame is turned into a trapezium before it is shown; "
        "switch the keystone correction off, set the projector to its own resolution, and capture anew"
    )
    return evidence.fall, RigFault(RigFaultKind.FRAME_SCALED, text, size=size)


def _of_aspects(fit: BoardRigFit, camera_aspect: float, projector_aspect: float | None) -> _Cause:
    """Stretch of the print, or pixels of another aspect than stated: whichever explains both devices' focal lengths."""
    known = {"camera": (0, camera_aspect, _CAMERA_ASPECT_U)}
    if projector_aspect is not None and len(fit.rig.axes) == 2:
        known["projector"] = (9, projector_aspect, _PROJECTOR_ASPECT_U)
    none = _aspect_squares(fit, known, stretched=False)[0]
    causes = {RigFaultKind.STRETCHED_PRINT: _aspect_squares(fit, known, stretched=True)}
    for device, kind in (("projector", RigFaultKind.FRAME_SCALED), ("camera", RigFaultKind.PICTURE_SCALED)):
        if device in known:
            rest = {name: value for name, value in known.items() if name != device}
            causes[kind] = _aspect_squares(fit, rest, stretched=False)
    kind = min(causes, key=lambda one: causes[one][0])
    fall, change = none - causes[kind][0], causes[kind][1]
    fault = _named_aspect(fit, kind, change, known)
    return (fall, fault) if fault is not None and fall > float(chdtri(1, _RARE)) else None


def _aspect_squares(
    fit: BoardRigFit, known: dict[str, tuple[int, float, float]], *, stretched: bool
) -> tuple[float, Array]:
    """Least sum of squares of the fit and the devices' stated aspects, and the change of parameters that gives it.

    The fit's own sum of squares counts from its least; with `stretched` the expectation of the stretch is taken away.
    """
    free, values, normal = fit.expected.free.copy(), fit.solution.state.shared, fit.solution.normal
    matrix, right, constant = normal.matrix.copy(), normal.right.copy(), 0.0
    if stretched:
        weight, free[_STRETCH] = fit.expected.weight[_STRETCH], True
        matrix[_STRETCH, _STRETCH] -= weight
        right[_STRETCH] += weight * values[_STRETCH]
        constant -= weight * values[_STRETCH] ** 2
    for first, aspect, u in known.values():
        slope = np.zeros(len(values))
        slope[first], slope[first + 1] = -1 / values[first], 1 / values[first + 1]
        off = math.log(values[first + 1] / values[first] / aspect)
        matrix += np.outer(slope, slope) / u**2
        right -= slope * off / u**2
        constant += (off / u) ** 2
    change, inner = np.zeros(len(values)), matrix[np.ix_(free, free)]
    scale = np.sqrt(np.maximum(np.diag(inner), 1e-300))
    unit = inner / np.outer(scale, scale) + 1e-14 * np.eye(len(scale))
    change[free] = np.linalg.solve(unit, right[free] / scale) / scale
    return constant - float(right[free] @ change[free]), change


def _named_aspect(
    fit: BoardRigFit, kind: RigFaultKind, change: Array, known: dict[str, tuple[int, float, float]]
) -> RigFault | None:
    """Say what the stretch or the aspect would be, where it is large enough to matter."""
    values = fit.solution.state.shared + change
    if kind is RigFaultKind.STRETCHED_PRINT:
        size = float(values[_STRETCH])
        text = (
            f"the print's lengths along x are off by {size:+.2%} against those along y: it was scaled when it was "
            "printed, or the paper grew; measure both pitches and state them, or print anew without fitting to the page"
        )
        least = max(_LEAST_STRETCH, _OF_STATED * fit.form.stretch_u_rel)
    else:
        device = "projector" if kind is RigFaultKind.FRAME_SCALED else "camera"
        first, aspect, _ = known[device]
        size, least = float(values[first + 1] / values[first] / aspect - 1), _LEAST_ASPECT
        text = f"the {device}'s focal lengths are {size:+.2%} off the stated aspect of {aspect:g}: {_SCALED[device]}"
    return RigFault(kind, text, size=abs(size)) if abs(size) > least else None


def _of_geometry(fit: BoardRigFit) -> list[RigFault]:
    """Poses that do not determine the focal lengths, or say nothing of one another: too few, or too alike."""
    names = ("camera.fx_px", *(f"projector.f{'xy'['uv'.index(axis)]}_px" for axis in fit.rig.axes))
    relative = max(fit.rig.estimate(name).u / abs(fit.rig.estimate(name).value) for name in names)
    spread = _spread_deg(fit.poses)
    do = "; add poses tilted 20 to 40 degrees to different sides, near and far"
    if len(fit.poses) <= _FEW_POSES:
        text = f"{len(fit.poses)} poses: no pose can be told to disagree with the others{do}"
        return [RigFault(RigFaultKind.POSES_TOO_FEW, text, size=relative)]
    if relative < _FOCAL_REL_U and spread > _ALIKE_DEG:
        return []
    text = f"poses within {spread:.0f} deg of one another leave a focal length known to {relative:.2%}{do}"
    return [RigFault(RigFaultKind.POSES_ALIKE, text, size=relative)]


def _spread_deg(poses: Sequence[PoseFit]) -> float:
    """Standard deviation of the boards' normals about their mean, deg."""
    normals = np.stack([pose.rotation[:, 2] for pose in poses])
    mean = normals.mean(axis=0) / max(float(np.linalg.norm(normals.mean(axis=0))), 1e-12)
    angles = np.degrees(np.arccos(np.clip(normals @ mean, -1, 1)))
    return float(np.sqrt((angles**2).mean()))


def _of_scatter(fit: BoardRigFit, wrong: set[str]) -> list[RigFault]:
    """Poses, not wrong ones, whose points scatter much more than those of the others do, in either device."""
    found = []
    for k, device in enumerate(("camera", "projector")):
        s = fit.solution.s_px[:, k]
        ratios = s / np.median(s)
        pairs = [(p.name, float(r)) for p, r in zip(fit.poses, ratios, strict=True) if p.name not in wrong]
        names = tuple(name for name, ratio in pairs if ratio > _SCATTERS)
        if names:
            largest = max(ratio for _, ratio in pairs)
            text = (
                f"pose {', '.join(names)}: in the {device} the points scatter up to {largest:.1f} times as much as "
                "those of most poses, by glare, defocus or too little light, and count the less for it; tilt the board "
                "out of the glare and capture them anew"
            )
            found.append(RigFault(RigFaultKind.POSE_SCATTERS, text, names, largest))
    return found


def _of_poses(fit: BoardRigFit) -> list[RigFault]:
    """Poses most of whose points disagree, and whether another numbering of them would agree."""
    found = []
    for number, (pose, part) in enumerate(zip(fit.poses, fit.data.slices(), strict=True)):
        for device, columns in (("camera", slice(0, 2)), ("projector", slice(2, 4))):
            seen = (fit.data.in_camera if device == "camera" else fit.data.in_projector)[part]
            if seen.any() and (pose.used[:, columns] & seen).sum() < _AGREES * seen.sum():
                found.append(_numbering(fit, number, device))
                break
    return found


def _numbering(fit: BoardRigFit, number: int, device: str) -> RigFault:
    """Say how a pose's points would have to be numbered to agree, if any way does."""
    name = fit.poses[number].name
    tries = [
        (_rms_renumbered(fit, number, order, which), how, which)
        for how, order in _renumberings(fit.data.board[fit.data.slices()[number]])
        for which in ("projector", "camera", "both")
    ]
    rms, how, which = min(tries, default=(math.inf, "", ""))
    same = np.arange(np.diff(fit.data.starts)[number])
    if rms < min(_LIKE_OTHERS, _MUCH_BETTER * _rms_renumbered(fit, number, same, "both")):
        lists = "its points" if which == "both" else f"the {which}'s points"
        text = (
            f"pose {name}: {lists} are numbered otherwise than in the other poses ({how}); number them alike, or use a "
            "board that tells its ends apart (ChArUco)"
        )
        return RigFault(RigFaultKind.NUMBERED_OTHERWISE, text, (name,))
    text = (
        f"pose {name}: most of its points in the {device} disagree with the others; was the board or the rig moved "
        "while it was captured, or the focus? capture it anew or leave it out"
    )
    return RigFault(RigFaultKind.POSE_DISAGREES, text, (name,))


def _renumberings(board: Array) -> list[tuple[str, NDArray[np.intp]]]:
    """Other ways to number a grid's points, as the new number of each; only whole rearrangements of what is there."""
    low, high = board[:, :2].min(axis=0), board[:, :2].max(axis=0)
    turned = low + high - board[:, :2]
    ways = {
        "turned by 180 degrees": turned,
        "mirrored left to right": np.column_stack([turned[:, 0], board[:, 1]]),
        "mirrored top to bottom": np.column_stack([board[:, 0], turned[:, 1]]),
        "rows and columns exchanged": (board[:, :2] - low)[:, ::-1] + low,
        "rows and columns exchanged, turned by 180 degrees": (turned - low)[:, ::-1] + low,
        "turned by 90 degrees": np.column_stack([turned[:, 1] - low[1] + low[0], board[:, 0] - low[0] + low[1]]),
        "turned by 270 degrees": np.column_stack([board[:, 1] - low[1] + low[0], turned[:, 0] - low[0] + low[1]]),
    }
    ways |= {"numbered along columns": _by_columns(board)}
    found = []
    for how, wanted in ways.items():
        distance = np.linalg.norm(wanted[:, None] - board[None, :, :2], axis=2)
        order = distance.argmin(axis=1)
        if len(set(order.tolist())) == len(board) and distance.min(axis=1).max() < 1e-3 * float((high - low).max()):
            found.append((how, order))
    return found


def _by_columns(board: Array) -> Array:
    """Places of the points if they had been listed column by column."""
    order = np.lexsort((board[:, 1], board[:, 0]))
    back = np.lexsort((board[:, 0], board[:, 1]))
    found = np.empty((len(board), 2))
    found[back] = board[order, :2]
    return found


def _rms_renumbered(fit: BoardRigFit, number: int, order: NDArray[np.intp], which: str) -> float:
    """Root mean square of a pose's residuals over their standard deviations, its points numbered anew, the rig held."""
    data = subset(fit.data, [number])
    camera = data.camera[order] if which != "projector" else data.camera
    projector = data.projector[order] if which != "camera" else data.projector
    seen_c = data.in_camera[order] if which != "projector" else data.in_camera
    seen_p = data.in_projector[order] if which != "camera" else data.in_projector
    apart = np.zeros_like(data.coupled)
    data = replace(data, camera=camera, projector=projector, in_camera=seen_c, in_projector=seen_p, coupled=apart)
    known = seen_c.all(axis=1)
    if known.sum() < POSE:
        return math.inf
    state = fit.solution.state
    rotation, shift = pose_start(data.board[known, :2], camera[known], state.shared[:4])
    state = replace(state, pose_rotations=rotation[None], pose_shifts=shift[None])
    s = np.median(fit.solution.s_px, axis=0)
    weights = np.hstack([seen_c / (data.camera_u * s[0]), seen_p / (data.projector_u * s[1])])
    held = Expected(state.shared, np.zeros(len(state.shared)))
    state, _ = minimise(state, data, weights, held)
    rest = residuals(state, data) * weights
    # Where the phase was read at the corner, the corner's own error is in the projector's coordinate too.
    dof = max(int((weights > 0).sum()) - POSE, 1)
    return math.sqrt(float((rest**2).sum()) / dof) / max(1.0, _corner_share(fit))


def _corner_share(fit: BoardRigFit) -> float:
    """By how much a projector's raw residual is larger than its own standard deviation: by the corners' errors."""
    raw = residuals(fit.solution.state, fit.data)[:, 2:] / (
        fit.data.projector_u * of_points(fit.solution.s_px, fit.data)[:, 2:]
    )
    used = fit.solution.used[:, 2:]
    return float(np.sqrt((raw[used] ** 2).mean())) if used.any() else 1.0
