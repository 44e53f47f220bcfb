"""Named checks of a measurement: whether the capture fits the calibration that it is measured with."""

from collections.abc import Iterator

import numpy as np

from fringecal.numerics import wrap
from fringecal.phase import Waveform
from fringecal.reconstruct import Reason, VisiblePlate, visible_plate
from fringecal.records import DEFAULT_LIMITS, Check, Limits
from fringecal.uncertainty import Estimate
from fringecal.workflows.reconstruct.capture_causes import (
    SIGNIFICANT,
    causes_of,
    contrast_lost,
    displacement,
    frames_disagree,
    is_displaced,
    plate_off,
    sharpness_lost,
    texture_lost,
)
from fringecal.workflows.reconstruct.frames_together import causes_in_frames, frame_checks
from fringecal.workflows.reconstruct.run import Measurement, near_plate_mm
from fringecal.workflows.shared import judged

_BELOW_PERCENT = 2.0  # of the heights: a scrap of a wrong order is not the capture's fault
# Overexposed by 2.2, a capture has 20 % left and these right; compressed or displaced until 2 % are left, wrong ones.
_LEAST_VALID_PERCENT = 20.0
_BEYOND_U = 6.0  # standard uncertainties of a height, 3 U: a plate that rises by more makes heights wrong
_LEAST_RISE_MM = 0.05  # that light from an object and the plate's own form may feign
_ANYTHING = (
    "the plate in view does not lie as it was calibrated: plate, camera or projector moved or bent, or frames are in "
    "another order"
)
_FEW = {
    "no_phase": "frames are compressed, smoothed, saturated or do not belong together",
    "order_undecided": "no plate is seen beside what is measured; state --lowest-mm and --highest-mm or take a second"
    " period",
    "no_ray": "they lie outside what the calibration covers",
    "edge": "the surface is finely broken, or the picture blurred",
}


def measurement_checks(found: Measurement, limits: Limits = DEFAULT_LIMITS) -> tuple[Check, ...]:
    """Judge the plate beside the object; the picture's place, contrast and texture against those of the calibration.

    A plate or camera that moved shifts or tilts the plate, and so do frames in another order; a frame that moved,
    vibration and a torn frame roughen it. What covers the whole picture, or the object alone, is not seen.
    """
    return (*_plate_checks(found, limits), *_below_plate(found), _valid_check(found), *_picture_checks(found, limits))


def measurement_causes(found: Measurement, limits: Limits = DEFAULT_LIMITS) -> tuple[str, ...]:
    """Name in one sentence each why a capture does not fit its calibration; empty where it does."""
    if not any(check.decision == "fail" for check in measurement_checks(found, limits)):
        return ()
    fatal = (f"{one.kind.text}: {one.what}" for one in found.diagnosed.findings if one.kind.fatal)
    shifted = _shifted_frame(found, limits)
    apart = causes_in_frames(found.held, *_waves(found), limits)
    causes = (
        *fatal,
        *shifted,
        *apart,
        *_few_heights(found),
        *causes_of(found.held, limits, tied=found.tied is not None),
    )
    return causes or (_ANYTHING,)


def tie_offered(found: Measurement, limits: Limits = DEFAULT_LIMITS) -> str:
    """Offer to take the plate in view off the heights where it lies elsewhere than in the calibration; empty else."""
    off = [check for check in _plate_checks(found, limits)[:2] if check.decision == "fail"]
    plate = (
        None if found.tied is not None or not off else visible_plate(found.surface, near_plate_mm(found.calibration))
    )
    if plate is None or is_displaced(found.held, limits):
        return ""
    return (
        f"The plate in view reads {plate.offset_mm:+.3f} mm and rises by {plate.rise_mm:.3f} mm: if the plate moved,"
        " --tie-to-plate takes that off the heights."
    )


def _plate_checks(found: Measurement, limits: Limits) -> tuple[Check, ...]:
    """Judge height, rise and scatter of the plate beside the object."""
    if found.treatment.minus_plate:
        return ()
    if found.tied is not None:
        return _tied_checks(found.tied, limits)
    plate = visible_plate(found.surface, near_plate_mm(found.calibration))
    if plate is None and plate_off(found.held):
        rule = "the plate's texture is in view, but no plate at the height of the calibration's"
        return (Check(name="plate beside the object: height", decision="fail", rule=rule),)
    if plate is None:
        rule = "too little of the plate is seen beside the object to tell whether it lies where it was calibrated"
        return (Check(name="plate beside the object", decision="info", rule=rule),)
    own = limits.reconstruct
    height = judged(
        "plate beside the object: height",
        Estimate(plate.offset_mm, plate.u_mm, "mm"),
        own.plate_height_mm,
        level=limits.level,
    )
    return (
        height,
        _below("plate beside the object: rise over the field", plate.rise_mm, _rise_limit_mm(found, limits), "mm"),
        _below("plate beside the object: scatter", plate.scatter_ratio, own.plate_scatter_ratio, ""),
    )


def _rise_limit_mm(found: Measurement, limits: Limits) -> float:
    """Return how much the plate may rise: as stated, or what takes heights beyond three of their U if that is less."""
    u_z = found.surface.u_z[found.surface.mask]
    return min(limits.reconstruct.plate_rise_mm, max(_BEYOND_U * float(np.median(u_z)), _LEAST_RISE_MM))


def _tied_checks(plate: VisiblePlate, limits: Limits) -> tuple[Check, ...]:
    """Say what was taken off the heights, and judge what no plane takes off."""
    taken = Check(
        name="plate beside the object: height",
        value=plate.offset_mm,
        u=plate.u_mm,
        unit="mm",
        decision="info",
        rule=f"taken off by --tie-to-plate, with a rise of {plate.rise_mm:.3f} mm; heights are over the plate in view",
    )
    return taken, _below(
        "plate beside the object: scatter", plate.scatter_ratio, limits.reconstruct.plate_scatter_ratio, ""
    )


def _below_plate(found: Measurement) -> tuple[Check, ...]:
    """Judge how much of the surface lies below the plate, where nothing can lie unless lower heights are stated."""
    lower = found.height_range_mm is not None and -np.inf < found.height_range_mm[0] < 0
    if found.treatment.minus_plate or found.tied is not None or lower:
        return ()
    z = found.surface.z[found.surface.mask]
    share = 100 * float(np.mean(z < -near_plate_mm(found.calibration))) if z.size else 0.0
    return (
        Check(
            name="surface below the plate",
            value=share,
            limit=_BELOW_PERCENT,
            unit="%",
            decision="pass" if share <= _BELOW_PERCENT else "fail",
            rule="share of the heights more than a seventh of a fringe below the plate: whole fringes are wrong, or "
            "the plate lies higher than it was calibrated",
        ),
    )


def _valid_percent(found: Measurement) -> float:
    """Share of the pixels that fringes reach, within the stated heights, that have a height, %."""
    reasons = found.surface.reasons
    reached = (reasons & (Reason.SHADOW | Reason.OUT_OF_RANGE)) == 0
    return 100 * float(np.mean(reasons[reached] == 0)) if reached.any() else 0.0


def _valid_check(found: Measurement) -> Check:
    """Judge how many of the pixels that fringes reach have a height: of a spoilt capture the few that do are chance."""
    share = _valid_percent(found)
    return Check(
        name="pixels with a height",
        value=share,
        limit=_LEAST_VALID_PERCENT,
        unit="%",
        decision="pass" if share >= _LEAST_VALID_PERCENT else "fail",
        rule="share of the pixels that fringes reach, at least",
    )


def _few_heights(found: Measurement) -> tuple[str, ...]:
    """Say for which reason few pixels have a height, if few have."""
    share = _valid_percent(found)
    if share >= _LEAST_VALID_PERCENT:
        return ()
    masked = {name: part for name, part in found.shares().items() if name not in {"valid", "shadow", "out_of_range"}}
    reason = max(masked, key=lambda name: masked[name])
    return (
        f"only {share:.1f} % of the pixels that fringes reach have a height, most others have none for the reason"
        f" '{reason.replace('_', ' ')}': {_FEW[reason]}; do not use the few that are left",
    )


def _below(name: str, value: float, limit: float, unit: str) -> Check:
    rules = {
        "mm": "rise of a plane through its pixels over their extent, beyond what their uncertainty explains",
        "": "root mean square of the pixels' departure from their plane over their random standard uncertainty",
    }
    decision = "pass" if value <= limit else "fail"
    return Check(name=name, value=value, limit=limit, unit=unit, decision=decision, rule=rules[unit])


def _picture_checks(found: Measurement, limits: Limits) -> Iterator[Check]:
    """Judge where the picture lies, and how sharp it is."""
    held = found.held
    yield _frames_check(found, limits)
    yield from frame_checks(held, *_waves(found), limits)
    yield _displacement_check(found, limits)
    if held.light is not None:
        yield Check(
            name="plate beside the object: contrast",
            value=100 * (1 - held.light.contrast),
            u=100 * held.light.u_contrast,
            limit=limits.reconstruct.contrast_percent,
            unit="%",
            decision="fail" if contrast_lost(held, limits) else "pass",
            rule="by how much modulation over background fell since the calibration, median over the plate in view",
        )
    if held.texture is not None and held.texture_expected and held.texture.found:
        yield Check(
            name="plate beside the object: sharpness",
            value=100 * (1 - held.texture.sharpness),
            u=100 * held.texture.u_sharpness,
            limit=limits.reconstruct.sharpness_percent,
            unit="%",
            decision="fail" if sharpness_lost(held, limits) else "pass",
            rule="by how much the amplitude of the plate's texture fell since the calibration",
        )


def _waves(found: Measurement) -> tuple[Waveform | None, Waveform | None]:
    """Return the waveform of the capture's fringes and that of the calibration's, where known."""
    return found.phase.adapted.found_wave, found.calibration.wave


def _shifted_frame(found: Measurement, limits: Limits) -> tuple[str, ...]:
    """Say which frame's phase shift is not that of the calibration, if any by more than moves a picture visibly.

    On a plate a frame that moved across the fringes looks like one with another phase shift, which the phase used is
    corrected for; edges and slopes of the object are not.
    """
    look, used = found.calibration.look, np.asarray(found.phase.phase_shifts_rad)
    if look is None or len(look.phase_shifts_rad) != len(used):
        return ()
    change = wrap(used - np.asarray(look.phase_shifts_rad))
    change = np.asarray(wrap(change - np.median(change)))
    frame, sample = int(np.argmax(np.abs(change))), found.held.sample
    pixels = abs(float(change[frame])) / float(np.median(np.hypot(sample.along_u, sample.along_v)))
    estimate = found.phase.estimated
    doubt = 0.0 if estimate is None else float(np.max(estimate.u_rad)) * SIGNIFICANT
    if pixels <= limits.reconstruct.picture_shift_px or abs(change[frame]) <= doubt:
        return ()
    return (
        f"the phase shift of frame {frame + 1} differs by {np.degrees(change[frame]):+.1f} deg from the calibration's:"
        f" the frame moved by about {pixels:.1f} px across the fringes, or the projector's shift changed",
    )


def _frames_check(found: Measurement, limits: Limits) -> Check:
    """Judge whether the frames belong together."""
    fatal = [finding.kind.text for finding in found.diagnosed.findings if finding.kind.fatal]
    number = len(frames_disagree(found.held)) + len(fatal) + len(_shifted_frame(found, limits))
    rule = "how many faults of single frames were found: by the plate, whose phase is known, and by rows"
    return Check(name="frames: findings", value=number, decision="fail" if number else "pass", rule=rule)


def _displacement_check(found: Measurement, limits: Limits) -> Check:
    """Judge the picture's displacement; where it could not be seen, say from which size on it would have been."""
    held, name, limit = found.held, "picture: displacement against the calibration", limits.reconstruct.picture_shift_px
    seen = displacement(held)
    if held.turned:
        return Check(name=name, limit=limit, unit="px", decision="fail", rule=f"the picture is {held.turned}")
    if texture_lost(held):
        return Check(name=name, limit=limit, unit="px", decision="fail", rule="the plate's texture is not found again")
    if seen is None:
        rule = "could not be seen: too little plate in view, and no texture of it"
        return Check(name=name, decision="info", rule=rule)
    size, by = seen
    least = SIGNIFICANT * size.u
    values = {"name": name, "value": size.value, "u": size.u, "unit": "px"}
    if is_displaced(held, limits):
        return Check(**values, limit=limit, decision="fail", rule=f"by {by}")
    if least > limit:
        return Check(**values, decision="info", rule=f"by {by}: less than {least:.2g} px could not be seen")
    return Check(**values, limit=limit, decision="pass", rule=f"by {by}; more than {least:.2g} px would have been seen")
