"""Why a capture does not fit its calibration, in one plain sentence for each cause."""

import math
from collections.abc import Iterator

import numpy as np

from fringecal.reconstruct import REACH_PX, CaptureHeld, Pose, PoseKind
from fringecal.records import DEFAULT_LIMITS, Limits
from fringecal.uncertainty import Estimate

SIGNIFICANT = 4.5
"""Standard uncertainties from which a displacement is believed: by chance once in 150 000."""

_MOST_SPREAD = 1.5  # of the plate's phase over its uncertainty: beyond, frames disagree, and no displacement is read


def causes_of(held: CaptureHeld, limits: Limits = DEFAULT_LIMITS) -> tuple[str, ...]:
    """Name what speaks against a capture; empty where nothing does.

    Parameters
    ----------
    held
        The capture beside the plate of its calibration.
    limits
        From which size on a cause is named.
    """
    if held.turned:
        return (f"the picture is {held.turned} against the calibration's",)
    return tuple(
        cause for causes in (_moved(held, limits), _posed(held, limits), _blurred(held, limits)) for cause in causes
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
    return Estimate(abs(held.pose.along_px), held.pose.u_along_px, "px"), "the bend of the fringes, along them alone"


def is_displaced(held: CaptureHeld, limits: Limits) -> bool:
    """Return whether the picture moved by more than the limit and chance allow."""
    seen = displacement(held)
    return seen is not None and seen[0].value > max(limits.reconstruct.picture_shift_px, SIGNIFICANT * seen[0].u)


def texture_lost(held: CaptureHeld) -> bool:
    """Return whether texture that must be seen beside the object is not found."""
    return held.texture is not None and held.texture_expected and not held.texture.found


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


def _posed(held: CaptureHeld, limits: Limits) -> Iterator[str]:
    """Name what the plate's phase leaves, where it is off by more than a height that matters."""
    if held.sample.offset_rad != 0:
        yield from _beside_plate(held)
    elif held.pose is not None and not is_displaced(held, limits):
        still = held.texture is not None and held.texture.found
        kinds = {PoseKind.PLATE, PoseKind.FRAMES} if still else set(PoseKind)
        poses = [pose for pose in held.pose.poses if pose.kind in kinds]
        if poses and _height_mm(held, poses[0]) > limits.reconstruct.plate_height_mm:
            yield ", or ".join(_said(pose) for pose in sorted(poses, key=lambda p: list(PoseKind).index(p.kind)))


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
    limit = max(limits.reconstruct.sharpness_percent / 100, SIGNIFICANT / texture.clearness)
    return 1 - texture.sharpness > limit
