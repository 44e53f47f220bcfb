"""The changes that an audit found, one by one: each with its uncertainty, En, detection limit, limit and outcome."""

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from fringecal.projector import RigCalibration, angle_budget
from fringecal.records import DEFAULT_LIMITS, Check, Limits
from fringecal.uncertainty import Estimate, en_score, least_seen
from fringecal.workflows.audit.change_covariance import light_uncertainty
from fringecal.workflows.audit.layout import CAMERA_QUANTITIES, PLATE_DEGREE, STRIPS_DEGREE, strip_step
from fringecal.workflows.audit.observed import PlateFound, StripsFound, base_state
from fringecal.workflows.audit.run import CHANCE, Audit
from fringecal.workflows.audit.sentences import reuse_sentence
from fringecal.workflows.shared import judged
from fringecal.workflows.verify import artefact_checks, verification_checks

Array = NDArray[np.float64]

_MISSED = 0.05  # chance of not seeing a change as large as the detection limit
_SIGNIFICANT = 3.0  # uncertainties from which on the slope of an rms is that of the change, and not of its scatter
_U_NOISE = 0.05  # relative repeatability of a noise estimate, of some hundred thousand pixels that texture disturbs


@dataclass(frozen=True)
class Change:
    """One quantity today minus at the calibration.

    Parameters
    ----------
    name
        What changed.
    found
        The change, its standard uncertainty and unit.
    limit
        Largest size allowed, in the same unit.
    compared
        How many quantities are compared as one, of which this is made; 0 where it is judged alone.
    size
        Whether it is an rms, which chance alone never leaves at nought: its limit judges it, and it has no En.
    """

    name: str
    found: Estimate
    limit: float
    compared: int = 0
    size: bool = False

    @property
    def en(self) -> float | None:
        """`en_score` of the change; None for an rms, or where no uncertainty is known."""
        return en_score(self.found) if self.found.u > 0 and not self.size else None

    @property
    def detection_limit(self) -> float:
        """Smallest change that is seen with 95 % at the audit's chance of a false alarm.

        Of n quantities compared as one, ``sqrt(lambda) u`` with the lambda of `fringecal.uncertainty.least_seen`:
        whatever else changes beside it, no change vector c with ``w . c`` of that size has a smaller ``c V^-1 c``.
        Alone: (z at the chance + 1.645) u.

        Examples
        --------
        >>> one, all_ = (Change("scale", Estimate(0.0, 1.0), 1.0, n) for n in (0, 19))
        >>> round(one.detection_limit, 2), round(all_.detection_limit, 2)
        (4.22, 6.48)
        """
        if self.compared:
            return math.sqrt(least_seen(self.compared, CHANCE)) * self.found.u
        return float(stats.norm.ppf(1 - CHANCE / 2) + stats.norm.ppf(1 - _MISSED)) * self.found.u


def changes_of(found: Audit, limits: Limits = DEFAULT_LIMITS) -> tuple[Change, ...]:
    """Return every change that the audit's captures can show, with the laboratory's limit for it."""
    return (*_camera(found, limits), *_plate(found, limits), *_strips(found, limits), *_light(found, limits))


def audit_checks(found: Audit, limits: Limits = DEFAULT_LIMITS) -> tuple[Check, ...]:
    """Return the checks of an audit: the whole change against chance, every change, every artefact."""
    changes = (judged(f"change of {c.name}", c.found, c.limit, level=limits.level) for c in changes_of(found, limits))
    verify = limits.model_copy(update={"verify": limits.verify.model_copy(update={"en": limits.audit.artefact_en})})
    bars = (check for one in found.bars for check in verification_checks(one, verify))
    artefacts = (check for one in found.artefacts for check in artefact_checks(one, verify))
    return (*_pictures(found), _whole(found), *changes, *bars, *artefacts)


def _pictures(found: Audit) -> tuple[Check, ...]:
    """Say that pictures are the calibration's own; such an audit is never a clean pass."""
    if not found.reused:
        return ()
    rule = f"{reuse_sentence(found)} Take new pictures."
    return (Check(name="captures with pictures of the calibration", value=len(found.reused), limit=0,
                  decision="conditionalPass", rule=rule),)  # fmt: skip


def _whole(found: Audit) -> Check:
    """Judge whether anything changed at all: that alone is no failure, but always a condition."""
    return Check(
        name="rig as calibrated",
        value=found.probability,
        limit=CHANCE,
        decision="conditionalPass" if found.changed else "pass",
        rule=f"chance of a change as large as this on an unchanged rig, {CHANCE:.0%} at least "
        f"(chi-squared {found.chi2:.1f} of {found.change.size} quantities)",
    )


def _camera(found: Audit, limits: Limits) -> Iterator[Change]:
    if found.grid is None:
        return
    place = found.layout.parts["camera"].start
    own = limits.audit
    unit_of = np.eye(len(CAMERA_QUANTITIES))
    rows = (
        ("scale", 100 * (unit_of[0] + unit_of[1]) / 2, "%", own.scale_percent),
        ("camera tilt toward x", unit_of[2] * 180 / math.pi, "deg", own.tilt_deg),
        ("camera tilt toward y", unit_of[3] * 180 / math.pi, "deg", own.tilt_deg),
        ("distortion at the picture's corner", unit_of[4], "px", own.distortion_px),
    )
    for name, weights, unit, limit in rows:
        if name.startswith("camera tilt") and found.calibration.camera.telecentric:
            continue
        full = np.zeros(found.change.size)
        full[place : place + len(weights)] = weights
        yield Change(name, _combined(found, full, unit, name), limit, found.change.size)


def _combined(found: Audit, weights: Array, unit: str, label: str) -> Estimate:
    """Return a weighted sum of the compared vector."""
    u = math.sqrt(float(weights @ found.covariance @ weights))
    return Estimate(float(weights @ found.change), u, unit, label)


def _plate(found: Audit, limits: Limits) -> Iterator[Change]:
    if found.plate is None:
        return
    part, blocks = found.layout.parts["plate"], found.plate.blocks
    design = blocks.design(PLATE_DEGREE)[:, 1:]
    design = design - design.mean(axis=0)
    yield Change(
        "plate phase, rms over the plate",
        _root_mean_square(design, found.change[part], found.covariance[part, part], "rad"),
        limits.audit.plate_phase_rad,
        found.change.size,
        size=True,
    )
    yield Change("plate form, rms", _form(found.calibration, found.plate), limits.audit.plate_form_mm, size=True)


def _root_mean_square(design: Array, terms: Array, covariance: Array, unit: str) -> Estimate:
    """Return the rms of fitted terms over the field and its uncertainty.

    Where the terms are not significant, the slope of the rms says nothing: their mean uncertainty stands there.
    """
    gram = design.T @ design / len(design)
    rms = math.sqrt(max(float(terms @ gram @ terms), 0.0))
    u = math.sqrt(float(np.trace(gram @ covariance)))
    if rms > _SIGNIFICANT * u:
        slope = gram @ terms / rms
        u = math.sqrt(float(slope @ covariance @ slope))
    return Estimate(rms, u, unit, "rms")


def _form(calibration: RigCalibration, plate: PlateFound) -> Estimate:
    """Return the part of the plate's change that neither a polynomial nor noise explains, as a height at the origin."""
    blocks = plate.blocks
    design = blocks.design(PLATE_DEGREE)
    left = blocks.value - design @ np.linalg.lstsq(design, blocks.value, rcond=None)[0]
    dof = max(left.size - design.shape[1], 1)
    variance = float(left @ left) / dof
    light = plate.phase.map
    noise = float(np.nanmedian(light.sigma[light.valid])) ** 2 * float((1 / blocks.pixels).mean())
    form = math.sqrt(max(variance - noise, 0.0))
    # Of a variance with nu degrees of freedom, u is sqrt(2 / nu) of it; a root near nought has the root's own u.
    u_variance = variance * math.sqrt(2 / dof)
    u = u_variance / (2 * form) if form**2 > u_variance else math.sqrt(u_variance)
    slope = abs(float(calibration.model.gradient(0.0, 0.0)[2]))
    return Estimate(form / slope, u / slope, "mm", "plate form")


def _strips(found: Audit, limits: Limits) -> Iterator[Change]:
    """Return the change of the strips' height as the calibration in force reads it, and of the angle it stands for."""
    angle = math.radians(angle_budget(found.calibration).result.value)
    per_percent = math.degrees(math.sin(angle) * math.cos(angle)) / 100
    for strips, part in zip(found.strips, found.layout.strip_parts, strict=True):
        scale = _height_scale(found, strips, part)
        turned = Estimate(scale.value * per_percent, abs(scale.u * per_percent), "deg", "projection angle")
        which = "the strips" if len(found.strips) == 1 else strips.phase.capture.name
        yield Change(f"height scale, on {which}", scale, limits.audit.height_scale_percent, found.change.size)
        yield Change(f"projection angle, by {which}", turned, limits.audit.angle_deg, found.change.size)


def _height_scale(found: Audit, strips: StripsFound, part: slice) -> Estimate:
    """Return the mean change of one set of strips in percent of their phase difference."""
    step = strip_step(base_state(found.calibration), strips.tops)
    weights = np.zeros(found.change.size)
    weights[part] = 100 * (strips.tops.blocks.design(STRIPS_DEGREE) / step[:, None]).mean(axis=0)
    return _combined(found, weights, "%", "height scale")


def _light(found: Audit, limits: Limits) -> Iterator[Change]:
    """Return the changes of sharpness, contrast, brightness, noise and waveform."""
    now, then, own = found.appearance, found.appearance_then, limits.audit
    if then is None:
        return
    parts = found.layout.parts
    for name, unit, factor, limit in (("blur", "px", 1.0, own.blur_px), ("contrast", "%", 100.0, own.contrast_percent)):
        if parts[name].stop > parts[name].start:
            full = np.zeros(found.change.size)
            full[parts[name]] = factor
            yield Change(_LOOKS[name], _combined(found, full, unit, name), limit, found.change.size)
    uncertainties = {"modulation": light_uncertainty("modulation", then, now), "noise": _U_NOISE}
    for name, limit in (("modulation", own.modulation_percent), ("noise", own.noise_percent)):
        today, once = getattr(now, f"{name}_levels"), getattr(then, f"{name}_levels")
        if today and once:
            change = Estimate(100 * (today / once - 1), 100 * uncertainties[name], "%", name)
            yield Change(_LOOKS[name], change, limit)
    if now.harmonic is not None and then.harmonic is not None:
        u = math.hypot(now.u_harmonic or 0.0, then.u_harmonic or 0.0)
        yield Change("second harmonic", Estimate(now.harmonic - then.harmonic, u, "", "harmonic"), own.harmonic)


_LOOKS = {
    "blur": "blur of the grid's lines",
    "contrast": "contrast of the fringes",
    "modulation": "modulation",
    "noise": "noise of the camera",
}
