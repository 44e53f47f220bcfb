"""What a calibration would have become if one of the things that were stated had been stated otherwise."""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from fringecal.calibration.grid_stage import CameraKnowledge
from fringecal.calibration.rig_stage import Calibrated
from fringecal.camera import PlateCamera, effects_of_statements
from fringecal.projector import Observations, RigFit, fit_rig
from fringecal.uncertainty import Estimate, Influence

Array = NDArray[np.float64]

STATED_OFF = 0.01
"""Share by which a statement is changed to see what follows: far above rounding, and what follows is still linear."""
_POINTS = 2_000  # of a surface: only the change counts, which is as smooth as the rig's few parameters


@dataclass(frozen=True)
class WrongStatement:
    """One stated quantity, and what follows if it is stated too large by the share `STATED_OFF`.

    Parameters
    ----------
    name
        What is stated, as it stands in sentences.
    stated
        Its value and standard uncertainty.
    influence
        Which source of uncertainty it is.
    artefact
        The capture whose target states it; empty for what belongs to the camera.
    effect
        Change of the rig's parameters, in the order of `RigCalibration.vector`.
    scale_rel
        Relative change of the scale on the plate.
    pulls
        Changes of how far each stated height has to be pulled to make all agree, in its standard uncertainties.
    """

    name: str
    stated: Estimate
    influence: Influence
    artefact: str
    effect: Array
    scale_rel: float
    pulls: Array


def wrong_statements(found: Calibrated, known: CameraKnowledge) -> tuple[WrongStatement, ...]:
    """Return what would follow from each statement on which heights rest, if it were wrong.

    Asked are the heights of each artefact in the joint fit (all of an artefact's together, as a certificate with
    another scale would have them), the pitch of the grid, and, where they are stated, the camera's height and the
    focal length of its lens. Everything is solved again with the statement changed, and nothing else.

    Parameters
    ----------
    found
        The calibration.
    known
        What was stated of the camera.

    Raises
    ------
    FitError
        The calibration's own points do not determine it again.
    """
    observed = found.observations.thinned(_POINTS)
    degree = found.rig.model.residual.degree
    near = found.rig.model.projector_mm

    def solve(
        camera: PlateCamera, raised: dict[int, float | Array] | None = None, start: RigFit | None = None
    ) -> RigFit:
        return fit_rig(
            observed.surfaces(camera, raised=raised), residual_degree=degree, projector_near=near, start=start
        )

    camera = found.camera.fit.camera
    base = solve(camera)
    statements = []
    for name, artefact, surfaces in _artefacts(found):
        raised = {i: STATED_OFF * _height(observed, i) for i in surfaces}
        fit = solve(camera, raised, base)
        highest = max((observed.height_mm[i] for i in surfaces), key=lambda one: one.value)
        effect = _vector(camera, fit) - _vector(camera, base)
        influence = highest.influence or Influence.STRIP_HEIGHT
        pulls = _pulls(fit) - _pulls(base)
        statements.append(WrongStatement(name, highest, influence, artefact, effect, 0.0, pulls))
    for name, stated, influence, changed in _camera_statements(found, known):
        moved = replace(camera, parameters=camera.parameters + changed)
        fit = solve(moved, None, base)
        effect = _vector(moved, fit) - _vector(camera, base)
        scale_rel = moved.scale("mean").value / camera.scale("mean").value - 1
        statements.append(WrongStatement(name, stated, influence, "", effect, scale_rel, _pulls(fit) - _pulls(base)))
    return tuple(statements)


def _artefacts(found: Calibrated) -> Iterator[tuple[str, str, range]]:
    """Name the artefacts of the joint fit, and which of its surfaces are theirs."""
    end = 1 + len(found.orders)
    yield "height of the strips", "", range(1, end)
    for standard in found.standards:
        seen = standard.seen.observations
        start, end = end, end + (0 if seen is None else len(seen.height_mm))
        if end > start:
            yield f"heights of {standard.name}", standard.name, range(start, end)


def _height(observed: Observations, surface: int) -> float | Array:
    relief = observed.relief_mm[surface] if observed.relief_mm else 0.0
    return observed.height_mm[surface].value + relief


def _camera_statements(found: Calibrated, known: CameraKnowledge) -> Iterator[tuple[str, Estimate, Influence, Array]]:
    """Yield what is stated of grid and camera, and by how much the camera's parameters change with it."""
    findings = found.camera
    height = findings.assumed_height if known.height_mm is None else known.height_mm
    effects = effects_of_statements(findings.fit, height, lens=known.lens is not None)
    stated = {Influence.GRID_PITCH: ("pitch of the grid", findings.pitch)}
    if known.height_mm is not None:
        stated[Influence.CAMERA_HEIGHT] = ("height of the camera", known.height_mm)
    if known.lens is not None:
        stated[Influence.LENS] = ("focal length of the lens", known.lens.lens.estimate("fx_px"))
    for influence, (name, value) in stated.items():
        if influence in effects:
            yield name, value, influence, STATED_OFF * effects[influence]


def _pulls(fit: RigFit) -> Array:
    return np.concatenate(fit.height_changes_u) if fit.height_changes_u else np.zeros(0)


def _vector(camera: PlateCamera, fit: RigFit) -> Array:
    return np.concatenate([camera.parameters, fit.model.parameters, fit.model.residual.coefficients])
