"""Verify a calibrated rig on an artefact of known geometry: the zig-zag of angle bars."""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

from fringecal.errors import FitError, FringecalError, SessionError
from fringecal.projector import HEIGHT_MODELS, RigCalibration
from fringecal.reconstruct import HeightMap, ObjectPhase, absolute_phase, height_of_phase
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
from fringecal.workflows.verify.form_phase import form_place, shown_form, shown_phase
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
    place: FormPlace
    pose: ZigzagPose
    errors: ZigzagErrors
    models: dict[str, ZigzagErrors]
    filters: tuple[FilterResult, ...] = ()


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
        found, absolute = _measured(phase, calibration, plate, rows_px, progress)
        if with_models:
            found = _by_other_models(found, absolute, calibration, rows_px, progress)
        return _with_filters(found, calibration, progress) if with_filters else found
    except FringecalError as error:
        raise caused_by_frames_of(error, phase, plate) from error


def studied(
    found: Verification,
    calibration: RigCalibration,
    *,
    with_filters: bool = True,
    progress: Progress = lambda _: None,
) -> Verification:
    """Return a verification with its phase read by the simpler height models too, and with every filter judged.

    Parameters
    ----------
    found
        Bars as verified by the default profiles, for example with a whole session.
    calibration
        The same calibration.
    with_filters
        As for `verify`.
    """
    heights = with_headroom(zigzag_shape(found.target).height_mm)
    shown = shown_form(found.target, found.place, found.phase.map, calibration)
    absolute = shown_phase(shown, found.phase.map, calibration, heights)
    found = _by_other_models(found, absolute, calibration, None, progress)
    return _with_filters(found, calibration, progress) if with_filters else found


def _measured(
    phase: CapturePhase,
    calibration: RigCalibration,
    plate: Capture | None,
    rows_px: tuple[int, ...] | None,
    progress: Progress,
) -> tuple[Verification, ObjectPhase]:
    """Read the bars by the rig model; also return the phase they were read from."""
    capture, target = phase.capture, phase.capture.target
    assert isinstance(target, Zigzag)
    heights = with_headroom(zigzag_shape(target).height_mm)
    place = _place(target, phase, calibration, heights)
    absolute = shown_phase(shown_form(target, place, phase.map, calibration), phase.map, calibration, heights)
    surface = height_of_phase(absolute, calibration)
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
    diagnosed = diagnose_capture(phase, calibration, plate=plate)
    models = {"projective": errors}
    return Verification(capture, target, phase, diagnosed, surface, place, pose, errors, models), absolute


def _by_other_models(
    found: Verification,
    absolute: ObjectPhase,
    calibration: RigCalibration,
    rows_px: tuple[int, ...] | None,
    progress: Progress,
) -> Verification:
    """Read the same phase by the simpler height models."""
    progress("height models side by side")
    models = dict(found.models)
    for name in HEIGHT_MODELS[:-1]:
        surface = height_of_phase(absolute, calibration, model=name)
        models[name] = zigzag_errors(surface, found.target, found.pose, rows_px=rows_px)
    return replace(found, models=models)


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


def _with_filters(found: Verification, calibration: RigCalibration, progress: Progress) -> Verification:
    """Measure again from filtered frames, then judge every filter after (thesis tables 4.3 to 4.8)."""
    progress("filters ranked")
    heights = with_headroom(zigzag_shape(found.target).height_mm)
    surfaces = {}
    for name in FILTERS:
        filtered = filtered_phase(found.phase, name)
        shown = shown_form(found.target, found.place, filtered, calibration)
        surfaces[name] = height_of_phase(shown_phase(shown, filtered, calibration, heights), calibration)
    return replace(found, filters=filter_study(surfaces, found.target, found.pose))
