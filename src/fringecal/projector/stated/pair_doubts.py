"""Whether a stated camera and projector can stand as their file says, and what pairs of their places say of it."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fringecal.camera import Doubt, lens_doubts
from fringecal.projector.stated.stated_pair import StatedPair

Array = NDArray[np.float64]

BASELINES_MM = (5.0, 20_000.0)
"""Distances of the two centres outside which lengths are probably in another unit: metres read as mm, um read as mm."""
ANGLE_DOUBTED_DEG = 5.0  # below it an error of a pixel moves a point by ten times as much in depth
PROJECTOR_ERROR_DOUBTED, PROJECTOR_LEAST_PX = 3.0, 0.5
"""Projector's over camera's reprojection error, and px from which it counts: both see the same corners, and what the
projector's phase adds is less than a pixel unless it ripples."""
ERROR_REFUSED_PX = 2.0  # a corner is found to 0.1 px: a fit that leaves twenty times that describes another device
PAIRS_DOUBTED_PX, PAIRS_REFUSED_PX = 1.0, 3.0  # rms by which a pair's two rays miss, seen in either picture
SCALE_DOUBTED, SCALE_REFUSED = 1e-3, 1e-2  # relative: a printed board is true to 1e-3 at least
_DEPTHS = np.geomspace(0.5, 50.0, 60)  # baselines before the camera, where its field is looked for in the projector's
_LEAST_MM = 1e-9  # of a distance of the centres, so that depths of none are finite
_GRID = 9  # places across the picture, whose rays are followed


@dataclass(frozen=True)
class PairsFound:
    """What pairs of places (camera, projector) say of a stated calibration.

    Parameters
    ----------
    poses, points
        How many were judged.
    camera_rms_px, projector_rms_px
        Root mean square distance by which the point nearest to both rays is seen beside each place.
    scale
        Distances that the board's points show over those that the board states; NaN where it states none.
    scale_u
        Standard deviation of that over the poses, over the root of their number; NaN with fewer than two.
    form_rms_mm
        Root mean square of the points about the board, moved and scaled to fit them; NaN where no board is stated.
    """

    poses: int
    points: int
    camera_rms_px: float
    projector_rms_px: float
    scale: float
    scale_u: float
    form_rms_mm: float


@dataclass(frozen=True)
class PointPairs:
    """Places of one pose that belong together: camera_px, projector_px (n, 2), px; board_mm (n, 3) or None."""

    camera_px: Array
    projector_px: Array
    board_mm: Array | None = None


def pair_doubts(pair: StatedPair, *, pixel_aspect: float | None = None) -> tuple[Doubt, ...]:
    """What speaks against a stated pair: either lens, how they stand to each other, and what the file says of its fit.

    Parameters
    ----------
    pair
        As it is stated.
    pixel_aspect
        Of the projector (distance of rows over that of columns), where it is known.
    """
    found = [*lens_doubts(pair.camera, "camera"), *lens_doubts(pair.projector, "projector", pixel_aspect=pixel_aspect)]
    return (*found, *_stated_errors(pair), *_baseline(pair), *_fields(pair))


def judge_pairs(pair: StatedPair, poses: Sequence[PointPairs]) -> PairsFound:
    """Return what pairs of places say of a calibration.

    Parameters
    ----------
    pair
        The calibration.
    poses
        Places that belong together, with the board's points where they are known.
    """
    rests, scales, forms, points = [], [], [], 0
    for pose in poses:
        met = pair.meet(pose.camera_px, pose.projector_px)
        good = np.isfinite(met).all(axis=1)
        points += int(good.sum())
        rests.append(
            np.column_stack([pair.camera.project(met) - pose.camera_px, pair.light(met) - pose.projector_px])[good]
        )
        if pose.board_mm is not None and good.sum() > 3:
            scale, form = _against_board(met[good], pose.board_mm[good])
            scales.append(scale)
            forms.append(form)
    rest = np.concatenate(rests) if rests else np.zeros((0, 4))
    squares = np.nanmean(rest**2, axis=0) if len(rest) else np.full(4, np.nan)
    return PairsFound(
        len(poses),
        points,
        math.sqrt(squares[0] + squares[1]),
        math.sqrt(squares[2] + squares[3]),
        float(np.mean(scales)) if scales else math.nan,
        float(np.std(scales, ddof=1) / math.sqrt(len(scales))) if len(scales) > 1 else math.nan,
        float(np.sqrt(np.mean(np.square(forms)))) if forms else math.nan,
    )


def doubts_by_pairs(found: PairsFound) -> tuple[Doubt, ...]:
    """What pairs of places say against a calibration."""
    doubts = []
    if not found.points:
        sentence = (
            "at none of the given places do both lenses see a ray; are sizes, units and the order of files right?"
        )
        return (Doubt("pair", "given places", True, sentence),)
    for who, rms in (("camera", found.camera_rms_px), ("projector", found.projector_rms_px)):
        if rms > PAIRS_DOUBTED_PX:
            sentence = (
                f"at {found.points} given places of {found.poses} pose(s) the two rays miss each other by {rms:.2g} px "
                f"rms in the {who}'s picture"
            )
            doubts.append(Doubt("pair", f"given places in the {who}", rms > PAIRS_REFUSED_PX, sentence))
    off = abs(found.scale - 1)
    if off > SCALE_DOUBTED and off > 3 * (found.scale_u if math.isfinite(found.scale_u) else 0.0):
        sentence = (
            f"distances on the given board come out at {found.scale:.4f} of what is stated: the calibration's board "
            "had another pitch, or its lengths are in another unit"
        )
        doubts.append(Doubt("pair", "scale", off > SCALE_REFUSED, sentence))
    return tuple(doubts)


def _against_board(met_mm: Array, board_mm: Array) -> tuple[float, float]:
    """Scale of points (n, 3) over the board's own, and their rms about the board that is moved and scaled to them."""
    a, b = board_mm - board_mm.mean(axis=0), met_mm - met_mm.mean(axis=0)
    left, sizes, right = np.linalg.svd(b.T @ a)
    mirror = np.sign(np.linalg.det(left @ right))
    scale = float((sizes * [1.0, 1.0, mirror]).sum() / (a**2).sum())
    turned = a @ (left @ np.diag([1.0, 1.0, mirror]) @ right).T
    return scale, float(np.sqrt(((b - scale * turned) ** 2).sum(axis=1).mean()))


def _stated_errors(pair: StatedPair) -> list[Doubt]:
    errors = {who: error for who, error in pair.errors_px.items() if error > 0}  # 0: not known
    found = [
        Doubt(
            who,
            "stated residual",
            True,
            f"the file states a reprojection error of {error:.3g} px, and a corner is found to 0.1 px: the model does "
            "not describe what was seen",
        )
        for who, error in errors.items()
        if error > ERROR_REFUSED_PX
    ]
    camera, projector = errors.get("camera", math.nan), errors.get("projector", math.nan)
    if PROJECTOR_LEAST_PX < projector <= ERROR_REFUSED_PX and projector > PROJECTOR_ERROR_DOUBTED * camera:
        sentence = (
            f"the file states a reprojection error of {projector:.3g} px in the projector and {camera:.3g} px in the "
            "camera: the phase ripples (response curve), or a scaler or keystone stood between frame and pixels"
        )
        found.append(Doubt("projector", "stated residual", False, sentence))
    return found


def _baseline(pair: StatedPair) -> list[Doubt]:
    low, high = BASELINES_MM
    if low <= pair.baseline_mm <= high:
        return []
    sentence = (
        f"camera and projector stand {pair.baseline_mm:.3g} mm apart by this file; are its lengths in metres "
        "(--unit m) or another unit?"
    )
    return [Doubt("pair", "distance of the centres", True, sentence)]


def _fields(pair: StatedPair) -> list[Doubt]:
    """See that the projector lights somewhere what the camera sees, and at which angle."""
    lit = _lit(pair)
    if not len(lit):
        other = (
            " The pose leads from the projector to the camera, it seems; invert it."
            if len(_lit(pair.reversed()))
            else ""
        )
        sentence = (
            "the projector lights nothing of what the camera sees, at any distance from half to fifty baselines: pose, "
            f"order of the devices or sizes are not those of one rig.{other}"
        )
        return [Doubt("pair", "fields do not meet", True, sentence)]
    away = lit - pair.centre_mm
    cosine = np.einsum("ij,ij->i", lit, away) / np.linalg.norm(lit, axis=1) / np.linalg.norm(away, axis=1)
    angle = math.degrees(math.acos(float(np.clip(np.median(cosine), -1, 1))))
    if angle < ANGLE_DOUBTED_DEG:
        sentence = (
            f"where the fields overlap most the rays meet under {angle:.2g} deg: an error of a pixel moves a point in "
            f"depth by {1 / math.sin(math.radians(angle)):.0f} times as much"
        )
        return [Doubt("pair", "angle between the rays", False, sentence)]
    return []


def _lit(pair: StatedPair) -> Array:
    """Points (n, 3) on the camera's rays that the projector's frame lights, at the distance where these are most."""
    camera, projector = pair.camera, pair.projector
    u, v = np.meshgrid(np.linspace(0, camera.width_px - 1, _GRID), np.linspace(0, camera.height_px - 1, _GRID))
    rays = camera.unproject(np.column_stack([u.ravel(), v.ravel()]))
    rays = rays[np.isfinite(rays).all(axis=1)]
    points = (rays[None] * (_DEPTHS * max(pair.baseline_mm, _LEAST_MM))[:, None, None]).reshape(-1, 3)
    with np.errstate(over="ignore", invalid="ignore"):
        places = pair.light(points)
    inside = (places >= -0.5).all(axis=1) & (places <= [projector.width_px - 0.5, projector.height_px - 0.5]).all(
        axis=1
    )
    lit = inside.reshape(len(_DEPTHS), -1)
    most = int(lit.sum(axis=1).argmax()) if lit.size else 0
    return points.reshape(len(_DEPTHS), -1, 3)[most][lit[most]]
