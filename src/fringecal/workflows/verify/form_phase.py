"""An artefact's phase by what is known of it: its form is looked for, and decides the order of every fringe on it."""

from dataclasses import replace

import numpy as np

from fringecal.errors import FitError
from fringecal.phase import PhaseMap
from fringecal.projector import RigCalibration
from fringecal.reconstruct import ObjectPhase, Reason, absolute_phase
from fringecal.targets import Artefact, tops_of
from fringecal.verification import FormPhase, FormPlace, demand_form, find_form, orders_by_form


def form_place(
    target: Artefact, phase_map: PhaseMap, calibration: RigCalibration, *, name: str = "artefact"
) -> FormPlace:
    """Find where an artefact lies in a phase map.

    Parameters
    ----------
    target
        The artefact.
    phase_map
        Phase of the capture.
    calibration
        The rig.
    name
        The capture's, for messages.

    Raises
    ------
    FitError
        It is not to be seen.
    """
    tops = tops_of(target)
    found = find_form(tops, phase_map.phase, phase_map.valid, calibration)
    try:
        demand_form(found, tops, target.kind)  # type: ignore[attr-defined]
    except FitError as error:
        raise FitError(f"capture {name!r}: {error}") from error
    return found.place


def shown_form(target: Artefact, place: FormPlace, phase_map: PhaseMap, calibration: RigCalibration) -> FormPhase:
    """Give the pixels of an artefact at a known place, and the plate's beside it, their orders.

    Raises
    ------
    FitError
        Its orders are open, or its pixels show something else.
    """
    return orders_by_form(tops_of(target), place, phase_map.phase, phase_map.valid, calibration)


def shown_phase(
    shown: FormPhase, phase_map: PhaseMap, calibration: RigCalibration, height_range_mm: tuple[float, float]
) -> ObjectPhase:
    """Return the phase of an artefact and the plate beside it over the plate's, everything else masked.

    Where further periods decide orders by themselves they do so here as well: the form only says where it lies.

    Parameters
    ----------
    shown
        The artefact's pixels with their orders.
    phase_map, calibration
        Phase of the capture, and the rig.
    height_range_mm
        Heights that the artefact can have.
    """
    absolute = absolute_phase(phase_map, calibration, height_range_mm=height_range_mm)
    step = shown.step_rad
    if phase_map.orders is not None:
        step = np.where(np.isfinite(step), absolute.difference_rad, np.nan)
    reasons = np.where(np.isfinite(step), 0, np.maximum(absolute.reasons, int(Reason.ORDER_UNDECIDED)))
    return replace(absolute, difference_rad=step, reasons=reasons.astype(np.uint8))
