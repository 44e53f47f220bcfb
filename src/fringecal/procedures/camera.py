"""The camera from its grid picture: crossings, ray model on the plate, the thesis's tables, distortion test."""

import math
from dataclasses import dataclass

import numpy as np
from scipy import special

from fringecal.camera.lens import Lens
from fringecal.camera.plate_fit import CameraFit, fit_plate_camera
from fringecal.camera.scale import ThesisScale, thesis_scale
from fringecal.camera.verdict import DistortionVerdict, distortion_verdict
from fringecal.detect.grid import GridDetection, find_grid
from fringecal.errors import FitError, SessionError
from fringecal.procedures.lens import KnownLens, known_lens
from fringecal.session import Capture, Session
from fringecal.targets import LineGrid
from fringecal.targets.geometry import grid_points_mm
from fringecal.uncertainty.estimates import Estimate

_DISTORTION = (("k1",), ("k1", "k2"), ("k1", "k2", "p1", "p2"))
_CHANCE = 0.001


@dataclass(frozen=True)
class CameraFindings:
    """What the grid picture says of the camera."""

    capture: Capture
    target: LineGrid
    detection: GridDetection
    fit: CameraFit
    distortion: DistortionVerdict
    tables: ThesisScale
    lens: KnownLens | None = None

    @property
    def scales(self) -> dict[str, Estimate]:
        """Scale on the plate at the image centre, mm/px: mean, horizontal and vertical."""
        return {name: self.fit.camera.scale(name) for name in ("mean", "horizontal", "vertical")}

    @property
    def scale_budget(self) -> dict[str, float]:
        """Contributions to u of the mean scale in mm/px, by cause."""
        camera = self.fit.camera
        base, total = camera.scale("mean").value, camera.scale("mean").u
        budget = {
            label: camera.replaced(camera.parameters + effect).scale("mean").value - base
            for label, effect in self.fit.causes.items()
        }
        left = total**2 - sum(change**2 for change in budget.values())
        return budget | {"grid crossings": math.sqrt(max(0.0, left))}


def measure_camera(session: Session) -> CameraFindings:
    """Find the grid in its picture and fit the camera on the plate.

    Raises
    ------
    SessionError
        The grid's target is no line grid.
    DetectionError, FitError
        No grid shows, or it does not determine the camera.
    """
    capture = session.one("grid")
    if not isinstance(capture.target, LineGrid):
        raise SessionError([f"capture {capture.name!r}: its target is no line grid; name one"])
    detection = find_grid(capture.read()[0], polarity=capture.target.polarity)
    lens = known_lens(session)
    fit = fit_camera(session, capture.target, detection, None if lens is None else lens.lens)
    points = np.column_stack([detection.u_px, detection.v_px])
    tables = thesis_scale(detection, capture.target.pitch_mm.estimate("grid pitch", "mm"))
    return CameraFindings(capture, capture.target, detection, fit, distortion_verdict(fit, points), tables, lens)


def fit_camera(session: Session, target: LineGrid, detection: GridDetection, lens: Lens | None = None) -> CameraFit:
    """Fit the camera to a detected grid with what the session states of it.

    Terms of distortion beyond k1 are let in one set after the other, while each makes the residual smaller
    than chance would (F-test at 0.1 %).
    """
    known = session.camera
    x, y = grid_points_mm(detection.column, detection.row, target.pitch_mm.values[0])
    height = None
    if known.height_mm is not None:
        height = known.height_mm.estimate("camera height", "mm")

    def solve(distortion: tuple[str, ...]) -> CameraFit:
        return fit_plate_camera(
            np.column_stack([detection.u_px, detection.v_px]),
            np.column_stack([x, y]),
            detection.shape,
            pitch_rel_u=target.pitch_mm.us[0] / target.pitch_mm.values[0],
            sigma_px=detection.sigma_px,
            height_mm=height,
            telecentric=known.telecentric,
            lens=lens,
            distortion=distortion,
            index=(detection.row, detection.column),
        )

    best = solve(_DISTORTION[0])
    if lens is not None:
        return best
    for terms in _DISTORTION[1:]:
        try:
            richer = solve(terms)
        except FitError:  # a long lens shows the grid too flat for these terms: they are not there to be seen
            break
        if not _explains_more(best, richer):
            break
        best = richer
    return best


def _explains_more(plain: CameraFit, richer: CameraFit) -> bool:
    """Tell whether the richer fit's residual is smaller than its further terms explain by chance."""
    if richer.dof < 1 or plain.dof <= richer.dof:
        return richer.dof >= 1 and richer.rms_px < 0.9 * plain.rms_px
    squares = (plain.rms_px**2 * plain.dof, richer.rms_px**2 * richer.dof)
    added = plain.dof - richer.dof
    ratio = (squares[0] - squares[1]) / added / (squares[1] / richer.dof)
    return bool(special.fdtrc(added, richer.dof, max(ratio, 0.0)) < _CHANCE)
