"""What a calibration takes for granted where the session states nothing, and what stating it would bring."""

from collections.abc import Iterator
from dataclasses import replace

from fringecal.projector import NOT_STATED, RigCalibration, angle_budget, forecast_height
from fringecal.uncertainty import Influence

_WORTH_SAYING = 0.1  # of a variance: without it u falls by 5 %, which its second digit hardly shows
_UNMEASURED = frozenset({Influence.PRINCIPAL_POINT_U, Influence.PRINCIPAL_POINT_V})
_FORECAST_MM = 20.0  # height for which the gain is stated beside the angle's: of the middle of what such rigs measure


def assumption_sentences(rig: RigCalibration) -> tuple[str, ...]:
    """Say which components rest on an assumption, how much they weigh, and what measuring them would bring.

    Parameters
    ----------
    rig
        The calibrated rig with its uncertainty components.
    """
    return (*_lens(rig), *_flatness(rig))


def without(rig: RigCalibration, influences: frozenset[Influence]) -> RigCalibration:
    """Return the rig as it would be if nothing was uncertain about some influences."""
    return replace(rig, components=tuple(c for c in rig.components if c.influence not in influences))


def _lens(rig: RigCalibration) -> Iterator[str]:
    """Say what a lens calibration would bring, where the optical axis is an assumption that weighs."""
    assumed = frozenset(c.influence for c in rig.components) & _UNMEASURED
    if not assumed:
        return
    known = without(rig, assumed)
    before, after = (angle_budget(one).result.u for one in (rig, known))
    share = 1 - (after / before) ** 2 if before > 0 else 0.0
    if share < _WORTH_SAYING:
        return
    z_before, z_after = (forecast_height(one, _FORECAST_MM).rms_mm for one in (rig, known))
    yield (
        f"{100 * share:.0f} % of the variance of the projection angle is an assumption: no lens is stated, and its "
        "optical axis is taken to meet the image centre within 1 % of the picture's diagonal. A lens calibration "
        "(fringecal lens, then camera.model) takes that row away: the angle's standard uncertainty would fall from "
        f"{before:.2g} to {after:.2g} deg, that of a height of {_FORECAST_MM:g} mm from {z_before:.2g} to "
        f"{z_after:.2g} mm."
    )


def _flatness(rig: RigCalibration) -> Iterator[str]:
    """Say that the plate counts as a plane, where its flatness is not stated."""
    plate = [c for c in rig.components if c.influence is Influence.PLATE_FLATNESS]
    if plate and all(c.detail == NOT_STATED for c in plate):
        yield (
            "The plate's flatness is not stated: it counts as a plane, and what it is off one is missing in every "
            "uncertainty. Name a target of kind flat with flatness_mm in the reference capture: heights take it over "
            "about as it is, the angle by what it bends the grid."
        )
