"""Why a capture does not fit its calibration, in one plain sentence for each cause."""

import math
from collections.abc import Iterator

import numpy as np

from fringecal.reconstruct import CLEAR, REACH_PX, CaptureHeld, FrameFault, FrameFinding, PictureHeld, Pose, PoseKind
from fringecal.records import DEFAULT_LIMITS, Limits
from fringecal.uncertainty import Estimate

SIGNIFICANT = 4.5
"""Standard uncertainties from which a displacement is believed: by chance once in 150 000."""

_LEAST_PIECES = 4  # of texture that are clear by themselves, to say that no part of the picture moved
# Standard uncertainty, px, of a displacement along the fringes beyond which their bend is too weak to show one: the
# calibration's own errors of its bend, which the plate's phase shows as well, look like tens of px then.
_MOST_U_ALONG_PX = 2.0
_MOST_SPREAD = 1.5  # of the plate's phase over its uncertainty: beyond, frames disagree, and no displacement is read


def causes_of(
    held: CaptureHeld, limits: Limits = DEFAULT_LIMITS, *, tied: bool = False, refused: bool = False
) -> tuple[str, ...]:
    """Name what speaks against a capture; empty where nothing does.

    Parameters
    ----------
    held
        The capture beside the plate of its calibration.
    limits
        From which size on a cause is named.
    tied
        Whether the plate in view was taken off the heights: where it lies is no fault then.
    refused
        Whether nothing could be measured: then what is level in the picture is taken for plate.
    """
    if held.turned:
        return (f"the picture is {held.turned} against the calibration's",)
    return tuple(
        cause
        for causes in (
            _frames(held, limits),
            _moved(held, limits),
            () if tied else _posed(held, limits, refused),
            _blurred(held, limits),
        )
        for cause in causes
    )


def displacement(held: CaptureHeld) -> tuple[Estimate, str] | None:
    """Return the picture's displacement against the calibration's, px, and by what it was seen; None if by nothing.

    The plate's texture shows it in every direction. Where it has none, the plate's phase shows how far the picture
    moved along the fringes; across them it cannot be told from a plate that was raised.
    """
    texture = held.texture
    if texture is not None and texture.found and (held.sample.seen or texture.at_rest < texture.clearness):
        return Estimate(math.hypot(texture.du_px, texture.dv_px), texture.u_px, "px"), "the plate's texture"
    if held.pose is None or held.texture_expected or held.pose.spread > _MOST_SPREAD:
        return None
    if not _camera_alone(held.pose) and not _harmless(held, held.pose):
        return None
    return Estimate(abs(held.pose.along_px), held.pose.u_along_px, "px"), "the bend of the fringes, along them alone"


def _camera_alone(pose: PictureHeld) -> bool:
    """Return whether the plate's phase is explained by nothing, or by the camera and not as well by plate or frames."""
    kinds = {one.kind for one in pose.poses}
    return not kinds or (PoseKind.CAMERA in kinds and not kinds & {PoseKind.PLATE, PoseKind.FRAMES})


def _harmless(held: CaptureHeld, pose: PictureHeld) -> bool:
    """Return whether what the plate's phase shows is less than the uncertainty of one pixel."""
    return pose.poses[0].step_rad < float(np.median(held.sample.sigma_rad[held.sample.plate]))


def is_displaced(held: CaptureHeld, limits: Limits) -> bool:
    """Return whether the picture moved by more than the limit and chance allow."""
    seen = displacement(held)
    texture = held.texture is not None and held.texture.found
    if seen is None or not (texture or (held.pose is not None and _camera_alone(held.pose))):
        return False
    if not texture and seen[0].u > _MOST_U_ALONG_PX:
        return False
    return seen[0].value > max(limits.reconstruct.picture_shift_px, SIGNIFICANT * seen[0].u)


def texture_lost(held: CaptureHeld) -> bool:
    """Return whether texture that must be seen beside the object is not found."""
    return held.texture is not None and held.texture_expected and not held.texture.found


def frames_disagree(held: CaptureHeld) -> tuple[FrameFinding, ...]:
    """Return which frames disagree with the others; compression that the plate's phase bears is no disagreement."""
    rough = held.pose is not None and held.pose.spread > _MOST_SPREAD
    return tuple(one for one in held.frames if one.fault is not FrameFault.COMPRESSED or rough)


def _frames(held: CaptureHeld, limits: Limits) -> Iterator[str]:
    found = frames_disagree(held)
    yield from (_of_frame(one) for one in found)
    rough = held.pose is not None and held.pose.spread > limits.reconstruct.plate_scatter_ratio
    if rough and not found:
        yield "the plate is rougher than noise allows: frames moved against one another, vibration, or a codec's errors"


def _of_frame(found: FrameFinding) -> str:
    """Say what is wrong with one frame, frames counted from 1."""
    left, right, top, bottom = found.place
    frame, where = found.frame + 1, f"columns {left} to {right}, rows {top} to {bottom}"
    match found.fault:
        case FrameFault.LIGHT if found.size > 0:
            return f"light was added in frame {frame}, up to {found.size:.0f} grey levels, or it moved there ({where})"
        case FrameFault.LIGHT:
            return f"frame {frame} is darker by up to {-found.size:.0f} grey levels, or moved ({where}): a shadow"
        case FrameFault.WHOLE:
            return f"frame {frame} does not fit the others all over the plate: it moved, or its light or shift changed"
        case FrameFault.MOVED:
            return f"frame {frame} lies about {found.size:.1f} px from the others: something moved between the frames"
        case FrameFault.ROWS_MOVED:
            return (
                f"single rows of frame {frame} lie about {found.size:.1f} px aside of their neighbours (between rows "
                f"{top} and {bottom}): camera or frame grabber lost the line's synchronism"
            )
        case FrameFault.STALE_ROWS:
            return f"rows {top} to {bottom} of frame {frame} repeat frame {found.size + 1:.0f}"
        case FrameFault.EMPTY_ROWS:
            return f"rows {top} to {bottom} of frame {frame} are missing"
    return "the frames show the seams of compression in blocks of 8 px: save them without loss"


def plate_off(held: CaptureHeld) -> bool:
    """Return whether the plate's texture is in view, but nothing at its phase."""
    texture = held.texture
    return held.sample.offset_rad != 0 and texture is not None and texture.shown_clearness >= CLEAR


def _moved(held: CaptureHeld, limits: Limits) -> Iterator[str]:
    texture = held.texture
    if texture_lost(held):
        yield (
            f"the plate's texture is not where it was within {REACH_PX} px: the camera or the plate in its plane moved "
            "by more, another plate lies there, or the picture is out of focus"
        )
    elif is_displaced(held, limits) and texture is not None and texture.found:
        along, across = _by_fringes(held, texture.du_px, texture.dv_px)
        yield (
            f"the picture moved by about {along:.1f} px along and {across:.1f} px across the fringes: the camera moved,"
            " or the plate in its plane"
        )
    elif is_displaced(held, limits) and held.pose is not None:
        yield f"the camera moved by about {abs(held.pose.along_px):.1f} px along the fringes"


def _by_fringes(held: CaptureHeld, du: float, dv: float) -> tuple[float, float]:
    """Return the parts of a displacement along and across the fringes, px."""
    across = np.array([np.mean(held.sample.along_u), np.mean(held.sample.along_v)])
    across /= np.hypot(*across)
    return abs(float(du * across[1] - dv * across[0])), abs(float(across @ (du, dv)))


def _posed(held: CaptureHeld, limits: Limits, refused: bool) -> Iterator[str]:
    """Name what the plate's phase leaves, where it is off by more than a height that matters."""
    if held.sample.offset_rad != 0:
        yield from _beside_plate(held) if refused or plate_off(held) else ()
    elif held.pose is not None and not is_displaced(held, limits):
        still = _texture_still(held, limits)
        kinds = {PoseKind.PLATE, PoseKind.FRAMES} if still else set(PoseKind)
        poses = [pose for pose in held.pose.poses if pose.kind in kinds]
        if poses and _height_mm(held, poses[0]) > limits.reconstruct.plate_height_mm:
            yield ", or ".join(_said(pose) for pose in sorted(poses, key=lambda p: list(PoseKind).index(p.kind)))


def _texture_still(held: CaptureHeld, limits: Limits) -> bool:
    """Return whether pieces of texture are found where they were, all over the picture."""
    texture = held.texture
    if texture is None or not texture.found or len(texture.by_piece) < _LEAST_PIECES:
        return False
    moved = np.percentile(np.hypot(*texture.by_piece[:, 2:].T), 80)
    return bool(moved <= limits.reconstruct.picture_shift_px)


def _beside_plate(held: CaptureHeld) -> Iterator[str]:
    """Name why the plate's phase is off everywhere by the same amount."""
    turns = held.sample.offset_rad / (2 * math.pi)
    yield (
        f"the largest level part of the picture is {turns:+.2f} of a fringe off the plate: frames in another order or "
        "listed from another one, plate raised, camera moved across the fringes, or no plate in view"
    )


def _height_mm(held: CaptureHeld, pose: Pose) -> float:
    """Return the height that the plate seems to have by what moved, root mean square, mm."""
    return pose.step_rad / float(np.median(np.abs(held.sample.along_z)))


def _said(pose: Pose) -> str:
    """Say one explanation."""
    values = pose.values
    if pose.kind is PoseKind.PLATE:
        tilt = math.hypot(values["tilt_u"], values["tilt_v"])
        return f"the plate is raised by {values['height']:+.2f} mm and tilted by {tilt:.2f} mm over the picture"
    if pose.kind is PoseKind.FRAMES:
        return f"the fringes moved as a whole by {values['phase'] / (2 * math.pi):+.3f} of a fringe (frames, projector)"
    moved = (
        f"the camera moved by about {abs(values['across']):.1f} px across and {abs(values['along']):.1f} px along the "
        f"fringes and turned by {math.degrees(values['turn']):+.2f} deg"
    )
    if pose.kind is PoseKind.SCALE:
        return f"{moved} with a picture scaled by {100 * values['scale']:+.2f} %"
    return moved


def _blurred(held: CaptureHeld, limits: Limits) -> Iterator[str]:
    """Name what took contrast from fringes and texture."""
    fringes, texture = contrast_lost(held, limits), sharpness_lost(held, limits)
    if fringes and texture:
        yield "fringes and texture of the plate are blurred: the camera is out of focus, or shook during the exposures"
    elif texture:
        yield "the plate's texture is blurred: the camera is out of focus, or the plate's surface changed"
    elif fringes:
        yield (
            "the fringes lost contrast on the plate: camera or projector is out of focus, something shook during the "
            "exposures, or other light was added"
        )


def contrast_lost(held: CaptureHeld, limits: Limits) -> bool:
    """Return whether the fringes' contrast on the plate fell by more than the limit and chance allow."""
    light = held.light
    if light is None:
        return False
    return 1 - light.contrast > max(limits.reconstruct.contrast_percent / 100, SIGNIFICANT * light.u_contrast)


def sharpness_lost(held: CaptureHeld, limits: Limits) -> bool:
    """Return whether the plate's texture lost more amplitude than the limit and chance allow."""
    texture = held.texture
    if texture is None or not held.texture_expected or not texture.found:
        return False
    return 1 - texture.sharpness > limits.reconstruct.sharpness_percent / 100 + SIGNIFICANT * texture.u_sharpness
