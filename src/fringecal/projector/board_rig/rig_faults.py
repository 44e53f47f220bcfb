"""Faults of a board rig's captures, each told by what it would explain of the residuals; named, never fitted away."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtri

from fringecal.projector.board_rig.board_fit import BoardRigFit, PoseFit
from fringecal.projector.board_rig.board_problem import (
    POSE,
    RIG,
    SHIFT_OF,
    TURN_OF,
    Rows,
    observation_rows,
)
from fringecal.projector.board_rig.board_solve import of_points
from fringecal.projector.board_rig.fault_kinds import RigFault, RigFaultKind
from fringecal.projector.board_rig.pose_arrangements import pose_arrangement

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
_SCATTERS = 2.5  # times the median scatter of the poses: of 60 coordinates alike, one pose in 10^9 is beyond 1.6
_LEAST_EFFECT = 5.0
"""Times the scatter of corners, as the projector has it, by which what moved must displace the light, rms: corners that
are all drawn aside by a third of their scatter tilt a level board by as much as twice that."""
_LEAST_SIDE = 2  # poses on either side of a knock: a single one that disagrees is named itself
_RASTER_ASPECTS = (0.5, 1.0, 2.0)  # of square pixels, and of diamond ones counted along either axis
_SIDEWAYS = math.sqrt(0.5)  # cosine beyond which rows of the frame lie nearer to the picture's columns


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
        The same of the projector's raster: 1, or 2 for half-width diamond rasters; None: not known, whichever of these
        (or 1/2) is nearest.

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
    causes = [
        _of_exchange(fit) or _of_aspects(fit, camera_aspect, projector_aspect),
        _of_skew(fit, rows),
        *_of_focus(fit, rows),
        _of_move(fit, rows),
    ]
    known = [cause for cause in causes if cause is not None]
    if known:
        poses = [one for one in poses if one.kind is not RigFaultKind.POSE_DISAGREES]
        return (*poses, max(known, key=lambda cause: cause[0])[1])
    moved = _of_boards(fit, rows, wrong)
    wrong |= {name for one in moved for name in one.poses}
    return (*poses, *moved, *_of_scatter(fit, wrong), *alike)


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
    if len(fit.rig.axes) == 2:
        aspect = _nearest_aspect(fit) if projector_aspect is None else projector_aspect
        known["projector"] = (9, aspect, _PROJECTOR_ASPECT_U)
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


def _nearest_aspect(fit: BoardRigFit) -> float:
    """Return the aspect of a raster that is nearest to the one found."""
    found = math.log(fit.rig.projector["fy_px"] / fit.rig.projector["fx_px"])
    return min(_RASTER_ASPECTS, key=lambda one: abs(math.log(one) - found))


def _of_exchange(fit: BoardRigFit) -> _Cause:
    """Frames along v that were taken for those along u: a projector on its side, with the frame's aspect squared."""
    if len(fit.rig.axes) < 2 or abs(float(fit.rig.rotation[0, 1])) < _SIDEWAYS:
        return None
    projector = fit.rig.projector
    squared = (projector.height_px / projector.width_px) ** 2
    found = projector["fy_px"] / projector["fx_px"]
    if min(abs(math.log(found / (one * squared))) for one in _RASTER_ASPECTS) > abs(math.log(squared)) / 4:
        return None
    text = (
        f"the projector stands on its side, with pixels of aspect {found:.3g}: fringes along u are stated as those "
        "along v, and the other way round; exchange `axes`"
    )
    return math.inf, RigFault(RigFaultKind.AXES_EXCHANGED, text, size=found)


def _of_move(fit: BoardRigFit, rows: Rows) -> _Cause:
    """Camera and projector that stand otherwise against one another from some pose on."""
    best: _Cause = None
    for first in range(_LEAST_SIDE, len(fit.poses) - _LEAST_SIDE + 1):
        later = (fit.data.pose_of >= first)[:, None, None]
        evidence = _explained(fit, rows, rows.derivatives[..., TURN_OF.start : SHIFT_OF.stop] * later)
        named = evidence.is_rare and _displaces(fit, rows, evidence, later[:, 0, 0])
        if named and (best is None or evidence.fall > best[0]):
            best = evidence.fall, _moved(fit, first, evidence)
    return best


def _displaces(fit: BoardRigFit, rows: Rows, evidence: _Evidence, which: NDArray[np.bool_]) -> bool:
    """Tell whether a move of the projector displaces the light on some points by enough to be none of the corners'."""
    over = fit.data.projector_u * of_points(fit.solution.s_px, fit.data)[:, 2:]
    change = rows.derivatives[:, 2:, TURN_OF.start : SHIFT_OF.stop] @ evidence.values * over
    used = fit.solution.used[:, 2:] & which[:, None]
    in_projector = fit.rig.camera_s_px * fit.rig.projector["fx_px"] / fit.rig.camera["fx_px"]
    return bool(used.any()) and float(np.sqrt((change[used] ** 2).mean())) > _LEAST_EFFECT * in_projector


def _of_boards(fit: BoardRigFit, rows: Rows, wrong: set[str]) -> list[RigFault]:
    """Poses, not wrong ones, that the projector lights elsewhere than the camera sees them."""
    found = []
    for number, pose in enumerate(fit.poses):
        own = (fit.data.pose_of == number)[:, None, None]
        evidence = _explained(fit, rows, rows.derivatives[..., TURN_OF.start : SHIFT_OF.stop] * own)
        if pose.name not in wrong and evidence.is_rare and _displaces(fit, rows, evidence, own[:, 0, 0]):
            text = (
                f"pose {pose.name}: its picture and its fringes disagree on where the board is, more than chance does "
                f"({math.sqrt(evidence.fall):.0f} standard deviations): the board or the rig moved while it was "
                "captured; capture it anew or leave it out"
            )
            found.append((evidence.fall, RigFault(RigFaultKind.POSE_DISAGREES, text, (pose.name,))))
    # One such pose draws the others with it: the worst is named, and what is left shows once it is mended.
    return [max(found, key=lambda one: one[0])[1]] if found else []


def _moved(fit: BoardRigFit, first: int, evidence: _Evidence) -> RigFault:
    turn_deg = math.degrees(float(np.linalg.norm(evidence.values[:3])))
    name = fit.poses[first].name
    text = (
        f"from pose {name} on the projector stands otherwise before the camera (turned by about {turn_deg:.2g} deg): "
        "one of them was moved; fix both, and capture the poses before it, or those from it on, anew"
    )
    return RigFault(RigFaultKind.RIG_MOVED, text, (name,), turn_deg)


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
    """Say how a pose's points would have to be arranged to agree, if any way does."""
    name = fit.poses[number].name
    known = pose_arrangement(fit, number)
    if known is not None:
        return known
    text = (
        f"pose {name}: most of its points in the {device} disagree with the others; was the board or the rig moved "
        "while it was captured, or the focus? capture it anew or leave it out"
    )
    return RigFault(RigFaultKind.POSE_DISAGREES, text, (name,))
