"""What else than the projector would make it seem displaced: a plate that is not flat, a camera of another height."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from fringecal.camera import CAMERA_NAMES, CameraFit
from fringecal.projector.angle.angle_theory import Displacement, displaced_by
from fringecal.projector.angle.projection_angle import ProjectorPosition
from fringecal.projector.joint_fit import RigFit
from fringecal.projector.plate_form import FORM_TERMS, PlateForm
from fringecal.projector.rig_calibration import Observations, RigCalibration, bent_effects
from fringecal.uncertainty import Influence

Array = NDArray[np.float64]

_TRIED_MM = 0.05  # of a form whose effect is asked: within what is linear
_MOST_FORM = 3e-3  # of the field's longer side: a plate further from flat than 1 mm in 340 shows to the eye
_MOST_HEIGHT = 0.1  # of the camera's height: nobody misreads a tape by more
_SAG = 1.5  # from middle to ends of a bow, over the distance of its ends from the best plane
_BOWS = {(2, 0): "x", (0, 2): "y"}
_TWIST = (1, 1)


def with_other_causes(
    found: Displacement,
    calibration: RigCalibration,
    stated: ProjectorPosition,
    observations: Observations,
    fits: tuple[CameraFit, RigFit],
) -> Displacement:
    """Return a displacement with what else would explain it, each alone and by a size that can be.

    Parameters
    ----------
    found
        The displacement; one that agrees needs no cause.
    calibration, stated
        The rig, and where its projector is stated to stand.
    observations, fits
        What the rig was fitted to; the fits of camera and rig.
    """
    if found.agrees or observations.form is None:
        return found
    forms = _of_the_plate(found, calibration, stated, observations, observations.form, fits)
    return replace(found, others=(*_of_the_camera(found, calibration, stated), *forms))


def _of_the_camera(found: Displacement, calibration: RigCalibration, stated: ProjectorPosition) -> Iterator[str]:
    """Say by how much the camera's height would have to be wrong, if that explains the displacement."""
    place = CAMERA_NAMES.index("height_mm")
    for component in calibration.components:
        if component.influence is Influence.CAMERA_HEIGHT:
            amount = found.fraction(displaced_by(calibration, component.effect, stated))
            # What explains the projector found is what the parameters lack: the other way round.
            wrong_mm = 0.0 if amount is None else -amount * float(component.effect[place])
            if 0 < abs(wrong_mm) < _MOST_HEIGHT * calibration.camera["height_mm"]:
                which = "higher" if wrong_mm > 0 else "lower"
                yield f"the camera stands about {abs(wrong_mm):.0f} mm {which} than stated"


def _of_the_plate(  # noqa: PLR0913, PLR0917 -- private: what `with_other_causes` was given
    found: Displacement,
    calibration: RigCalibration,
    stated: ProjectorPosition,
    observations: Observations,
    form: PlateForm,
    fits: tuple[CameraFit, RigFit],
) -> Iterator[str]:
    """Say how a plate would have to be bowed or twisted, if that explains the displacement."""
    terms = [term for term in FORM_TERMS if sum(term) == sum(_TWIST)]
    axes = [_TRIED_MM * np.eye(len(FORM_TERMS))[FORM_TERMS.index(term)] for term in terms]
    effects = bent_effects(observations, form, *fits, axes)
    most_mm = _MOST_FORM * max(form.box[1] - form.box[0], form.box[3] - form.box[2])
    for term, effect in zip(terms, effects, strict=True):
        amount = found.fraction(displaced_by(calibration, effect, stated))
        size_mm = 0.0 if amount is None else -amount * _TRIED_MM
        if 0 < abs(size_mm) < most_mm:
            yield _form_words(term, size_mm)


def _form_words(term: tuple[int, int], size_mm: float) -> str:
    """Describe a form; its size is the distance of ends or corners from the best plane.

    Examples
    --------
    >>> _form_words((0, 2), -0.1)
    'the plate is not flat (its middle 0.15 mm higher than its ends along y)'
    """
    if term == _TWIST:
        return f"the plate is not flat (twisted, its corners {abs(size_mm):.2f} mm off its plane)"
    where = "lower" if size_mm > 0 else "higher"
    return f"the plate is not flat (its middle {_SAG * abs(size_mm):.2f} mm {where} than its ends along {_BOWS[term]})"
