"""Verify a calibrated rig on an artefact of known geometry: the zig-zag of angle bars."""

import math
from collections.abc import Callable
from dataclasses import dataclass

from fringecal.errors import FitError, FringecalError, SessionError
from fringecal.projector import HEIGHT_MODELS, RigCalibration
from fringecal.reconstruct import HeightMap, absolute_phase, height_of_phase
from fringecal.session import Capture, Session
from fringecal.targets import BallBar, Box, Flat, Sphere, Steps, Strips, Wedge, Zigzag
from fringecal.uncertainty import Influence
from fringecal.verification import (
    FILTERS,
    FilterResult,
    FormPlace,
    InCommon,
    ZigzagErrors,
    ZigzagPose,
    filter_study,
    is_common,
    register_zigzag,
    zigzag_errors,
    zigzag_shape,
)
from fringecal.workflows.shared import (
    CaptureDiagnosis,
    CapturePhase,
    caused_by_frames_of,
    demand_same_picture,
    diagnose_capture,
    filtered_phase,
    phase_of_capture,
    plate_beside,
)
from fringecal.workflows.verify.form_phase import form_place, shown_form, surfaces_of
from fringecal.workflows.verify.height_range import with_headroom

Progress = Callable[[str], None]

VERIFIED = (Zigzag, Flat, Strips, Steps, Wedge, Box, Sphere, BallBar)
"""Targets that heights can be judged on."""


@dataclass(frozen=True)
class Verification:
    """A zig-zag measured with a calibrated rig, against its certificate.

    `models` holds the errors by height model, `filters` by combination of filters before and after the phase.
    """

    capture: Capture
    target: Zigzag
    phase: CapturePhase
    diagnosed: CaptureDiagnosis
    surface: HeightMap
    pose: ZigzagPose
    errors: ZigzagErrors
    models: dict[str, ZigzagErrors]
    filters: tuple[FilterResult, ...]


def verify(
    session: Session,
    capture_name: str | None,
    calibration: RigCalibration,
    *,
    rows_px: tuple[int, ...] | None = None,
    with_filters: bool = True,
    with_models: bool = True,
    progress: Progress = lambda _: None,
) -> Verification:
    """Measure a zig-zag and compare it with its certificate along profiles.

    Parameters
    ----------
    session, capture_name
        The session, and the capture of the bars; None takes the only one of kind artefact.
    calibration
        The rig's calibration.
    rows_px
        Rows of the profiles; by default the thesis's A..E, or five spread over the bars.
    with_filters
        Also judge every combination of median and mean filtering before and after the phase.
    with_models
        Also read the same phase by the simpler height models.

    Raises
    ------
    SessionError
        No such capture, its target is no zig-zag, or its pictures do not fit the calibration.
    FitError
        The surface is not the target's.
    """
    capture = artefact_capture(session, capture_name, calibration)
    if not isinstance(capture.target, Zigzag):
        raise SessionError([f"capture {capture.name!r}: its target is no zig-zag; name the capture of the bars"])
    progress("phase of the bars")
    phase = phase_of_capture(capture, wave=calibration.wave)
    plate = plate_beside(session, capture)
    try:
        progress("heights of the bars")
        return _measured(phase, calibration, plate, rows_px, with_filters, with_models, progress)
    except FringecalError as error:
        raise caused_by_frames_of(error, phase, plate) from error


def _measured(  # noqa: PLR0913, PLR0917 -- private: what verify was asked for, and what it has found so far
    phase: CapturePhase,
    calibration: RigCalibration,
    plate: Capture | None,
    rows_px: tuple[int, ...] | None,
    with_filters: bool,
    with_models: bool,
    progress: Progress,
) -> Verification:
    capture, target = phase.capture, phase.capture.target
    assert isinstance(target, Zigzag)
    heights = with_headroom(zigzag_shape(target).height_mm)
    place = _place(target, phase, calibration, heights)
    simpler = HEIGHT_MODELS[:-1] if with_models else ()
    shown = shown_form(target, place, phase.map, calibration)
    surface, *others = surfaces_of(shown, phase.map, calibration, heights, ("projective", *simpler))
    progress("registering the zig-zag")
    turned = math.remainder(place.turn_rad, math.pi)
    pose = register_zigzag(surface, target, start=ZigzagPose(place.x_mm, place.y_mm, turned))
    errors = zigzag_errors(
        surface,
        target,
        pose,
        rows_px=rows_px,
        sensitivities=surface.sensitivities,
        dof=surface.systematic.dof,
        common=_in_common(surface, target),
    )
    models = {"projective": errors}
    if with_models:
        progress("height models side by side")
    for name, other in zip(simpler, others, strict=True):
        models[name] = zigzag_errors(other, target, pose, rows_px=rows_px)
    filters: tuple[FilterResult, ...] = ()
    if with_filters:
        progress("filters ranked")
        filters = _filter_study(phase, calibration, place, pose, heights)
    diagnosed = diagnose_capture(phase, calibration, plate=plate)
    return Verification(capture, target, phase, diagnosed, surface, pose, errors, models, filters)


def _in_common(surface: HeightMap, target: Zigzag) -> InCommon:
    """Return which influences of the heights move the certified bars as well: one instrument's, and temperature."""
    sources = surface.systematic.sources
    instrument = (k for k, s in enumerate(sources) if is_common(s.influence, s.detail, target.instrument))
    temperature = (k for k, s in enumerate(sources) if s.influence is Influence.TEMPERATURE)
    return InCommon(tuple(instrument), tuple(temperature))


def _place(target: Zigzag, phase: CapturePhase, calibration: RigCalibration, heights: tuple[float, float]) -> FormPlace:
    """Find the bars by their form; where they are not what is stated, say by the surface what they are instead."""
    try:
        return form_place(target, phase.map, calibration, name=phase.capture.name)
    except FitError:
        absolute = absolute_phase(phase.map, calibration, height_range_mm=heights)
        register_zigzag(height_of_phase(absolute, calibration, height_range_mm=heights), target)
        raise


def artefact_capture(session: Session, name: str | None, calibration: RigCalibration) -> Capture:
    """Return the capture to be verified: the one named, or the only one of kind artefact.

    Raises
    ------
    SessionError
        No such capture, no target to judge by, or pictures of another size than the calibration's.
    """
    capture = _only_artefact(session) if name is None else session.named(name)
    if capture.target is None:
        raise SessionError([f"capture {capture.name!r}: names no target; state the artefact with its certificate"])
    if not isinstance(capture.target, VERIFIED):
        kinds = ", ".join(kind.model_fields["kind"].default for kind in VERIFIED)
        found = f"a target of kind {capture.target.kind!r}"
        raise SessionError([f"capture {capture.name!r}: {found} has no surface to verify on; use {kinds}"])
    if capture.use == "calibration":
        raise SessionError(
            [
                f'capture {capture.name!r}: states use = "calibration", so the rig was fitted to it and agrees with '
                "it in any case; verify on an artefact that took no part"
            ]
        )
    demand_same_picture(capture, calibration)
    return capture


def _only_artefact(session: Session) -> Capture:
    """Return the only artefact that took no part in the calibration."""
    free = [capture for capture in session.find("artefact") if capture.use != "calibration"]
    return free[0] if len(free) == 1 else session.one("artefact")


def _filter_study(
    phase: CapturePhase,
    calibration: RigCalibration,
    place: FormPlace,
    pose: ZigzagPose,
    heights: tuple[float, float],
) -> tuple[FilterResult, ...]:
    """Measure again from filtered frames, then judge every filter after (thesis tables 4.3 to 4.8)."""
    target = phase.capture.target
    assert isinstance(target, Zigzag)
    surfaces = {}
    for name in FILTERS:
        filtered = filtered_phase(phase, name)
        shown = shown_form(target, place, filtered, calibration)
        (surfaces[name],) = surfaces_of(shown, filtered, calibration, heights)
    return filter_study(surfaces, target, pose)
