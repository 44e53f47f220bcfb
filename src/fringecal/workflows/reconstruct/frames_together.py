"""Whether the frames of a capture belong together, and were taken as those of the calibration were."""

from collections.abc import Iterator

from fringecal.phase import Waveform
from fringecal.reconstruct import CaptureHeld, FrameFault, FrameMotion
from fringecal.records import Check, Limits

_CERTAIN = 4.5  # standard uncertainties from which a change is believed: by chance once in 150 000


def causes_in_frames(held: CaptureHeld, wave: Waveform | None, usual: Waveform | None, limits: Limits) -> Iterator[str]:
    """Name in one sentence each what speaks against frames that were taken together by the calibration's camera.

    Parameters
    ----------
    held
        The capture beside the plate of its calibration.
    wave, usual
        Waveform of its fringes and that of the calibration; None where not known.
    limits
        From which size on a cause is named.
    """
    motion = held.motion
    if motion is not None and frames_apart(motion, limits) and not _named(held):
        yield (
            f"frame {motion.frame + 1} lies about {motion.px:.2f} px from the others: camera, plate or object moved or "
            "shook while the frames were taken"
        )
    if noise_changed(held, limits) and held.noise is not None:
        yield (
            f"noise between neighbouring pixels of the plate is {held.noise.ratio:.2f} times the calibration's: frames "
            "were smoothed, compressed, averaged or interpolated, and u(z) does not hold for them"
        )
    torn = None if held.texture is None else held.texture.torn
    if torn is not None and picture_torn(held, limits):
        yield (
            f"the parts of the picture on both sides of {torn.along} {torn.at_px} lie {torn.px:.1f} px apart against "
            "the calibration's: frames are torn, lines were lost, or the camera turned"
        )
    if wave is not None and usual is not None and wave_changed(wave, usual, limits):
        yield (
            f"the fringes' second harmonic is {abs(wave.ratios[0]):.3f} of the first, {abs(usual.ratios[0]):.3f} at "
            "the calibration: response, exposure or focus of camera or projector changed"
        )


def frames_apart(motion: FrameMotion, limits: Limits) -> bool:
    """Return whether a frame lies further from the others than the limit and chance allow."""
    return motion.apart and motion.px > limits.reconstruct.frames_apart_px


def noise_changed(held: CaptureHeld, limits: Limits) -> bool:
    """Return whether noise between neighbours differs from the calibration's by more than the limit and chance."""
    noise = held.noise
    return (
        noise is not None and abs(noise.ratio - 1) > limits.reconstruct.noise_percent / 100 + _CERTAIN * noise.u_ratio
    )


def picture_torn(held: CaptureHeld, limits: Limits) -> bool:
    """Return whether two parts of the picture lie apart by more than the limit and chance allow."""
    torn = None if held.texture is None else held.texture.torn
    return torn is not None and torn.px > max(limits.reconstruct.picture_shift_px, _CERTAIN * torn.u_px)


def wave_changed(wave: Waveform, usual: Waveform, limits: Limits) -> bool:
    """Return whether the second harmonic differs from the calibration's by more than the limit and chance allow."""
    change, u = _harmonic(wave, usual)
    return change > limits.reconstruct.harmonic + _CERTAIN * u


def frame_checks(held: CaptureHeld, wave: Waveform | None, usual: Waveform | None, limits: Limits) -> Iterator[Check]:
    """Judge frames against one another and against the calibration's; say what would have been noticed."""
    own = limits.reconstruct
    yield _motion_check(held.motion, limits)
    torn = None if held.texture is None else held.texture.torn
    if torn is not None:
        yield Check(
            name="picture: displacement of a part",
            value=torn.px,
            u=torn.u_px,
            limit=own.picture_shift_px,
            unit="px",
            decision="fail" if picture_torn(held, limits) else "pass",
            rule=f"by the plate's texture on both sides of {torn.along} {torn.at_px}; more than "
            f"{max(own.picture_shift_px, _CERTAIN * torn.u_px):.2g} px would have been noticed",
        )
    if held.noise is not None:
        yield Check(
            name="plate beside the object: noise from pixel to pixel",
            value=100 * (held.noise.ratio - 1),
            u=100 * held.noise.u_ratio,
            limit=own.noise_percent,
            unit="%",
            decision="fail" if noise_changed(held, limits) else "pass",
            rule="change since the calibration of neighbours' scatter over what their noise says; more than "
            f"{own.noise_percent + 100 * _CERTAIN * held.noise.u_ratio:.2g} % would have been noticed",
        )
    if wave is not None and usual is not None:
        change, u = _harmonic(wave, usual)
        yield Check(
            name="fringes: second harmonic",
            value=change,
            u=u,
            limit=own.harmonic,
            decision="fail" if wave_changed(wave, usual, limits) else "pass",
            rule="change since the calibration, as a share of the first; more than "
            f"{own.harmonic + _CERTAIN * u:.2g} would have been noticed",
        )


def _motion_check(motion: FrameMotion | None, limits: Limits) -> Check:
    """Judge how far frames lie from one another; without residuals and texture say that nothing could be seen."""
    name, limit = "frames: displacement of a single frame", limits.reconstruct.frames_apart_px
    if motion is None:
        rule = "could not be seen: three frames leave no residual, and the plate shows no texture in each of them"
        return Check(name=name, decision="info", rule=rule)
    values = {"name": name, "value": motion.px, "u": motion.u_px, "unit": "px"}
    least = max(motion.least_px, limit)
    rule = f"of frame {motion.frame + 1} against the others; more than {least:.2g} px would have been noticed"
    if frames_apart(motion, limits):
        return Check(**values, limit=limit, decision="fail", rule=rule)
    return Check(**values, limit=limit, decision="pass" if motion.least_px <= limit else "info", rule=rule)


def _named(held: CaptureHeld) -> bool:
    """Return whether a moved frame is named already."""
    return any(one.fault is FrameFault.MOVED for one in held.frames)


def _harmonic(wave: Waveform, usual: Waveform) -> tuple[float, float]:
    """Return by how much the second harmonic differs, and the standard uncertainty of that."""
    return float(abs(wave.ratios[0] - usual.ratios[0])), float((wave.u[0] ** 2 + usual.u[0] ** 2) ** 0.5)
