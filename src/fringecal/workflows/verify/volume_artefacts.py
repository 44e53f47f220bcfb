"""Verify a rig that a board has calibrated on artefacts in any pose in its volume; no plate is needed."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from types import SimpleNamespace

import numpy as np
from numpy.typing import NDArray

from fringecal.errors import SessionError
from fringecal.projector import BoardRig, rig_points
from fringecal.records import BoardCalibrationRecord
from fringecal.session import Capture, Session
from fringecal.targets import Artefact, BallBar, Flat, Sphere, Steps
from fringecal.uncertainty import Influence, UncertaintyComponent
from fringecal.verification import (
    Departures,
    PointPicture,
    Probe,
    Reading,
    departures_of,
    fit_plane,
    fit_sphere,
    take_readings,
    volume_probe,
)
from fringecal.workflows.shared import VolumeCapture, board_rig_of, demand_for_rig, points_of_capture
from fringecal.workflows.verify.artefacts import sentence_of

Array = NDArray[np.float64]
Progress = Callable[[str], None]

IN_VOLUME = (Flat, Steps, Sphere, BallBar)
_FACING = np.array([1.0, -1.0, -1.0])  # from the camera's frame to one whose z points toward the camera
_JUDGED = 20_000  # pixels whose departures are compared with their u: the rms is known to half a percent
_SEED = 2634  # of the draw of those pixels


@dataclass(frozen=True)
class VolumeVerification:
    """An artefact measured in the volume of a rig: its numbers beside the certificate's.

    Parameters
    ----------
    capture, target
        What was measured, and what it is.
    rig
        The calibration.
    seen
        The capture's points, in the camera's frame.
    probe
        Which pixels are the artefact's, and its numbers.
    readings, departures
        The numbers with their uncertainty, and the pixels' distances from the form against theirs.
    residual_mm
        Distances from the form, (H, W), mm, NaN beside the artefact.
    """

    capture: Capture
    target: Artefact
    rig: BoardRig
    seen: VolumeCapture
    probe: Probe
    readings: tuple[Reading, ...]
    departures: Departures
    residual_mm: Array

    @property
    def sentence(self) -> str:
        """State whether the artefact's numbers agree with its certificate."""
        return sentence_of(self.readings)

    @property
    def height_model(self) -> str:
        """By what points follow from phase."""
        return "inverse camera"

    @property
    def how(self) -> str:
        """State what was measured, and by what."""
        known = 100 * float(self.seen.volume.mask.mean())
        u = " and ".join(f"{one:.3f}" for one in self.seen.usual_u_px if one > 0)
        return (
            f"{self.capture.name}: {known:.1f} % of the picture has a point in the calibrated volume; u of the "
            f"projector's coordinate by the phase is {u} px in most pixels."
        )


def verify_in_volume(
    session: Session, name: str | None, written: BoardCalibrationRecord, *, progress: Progress = lambda _: None
) -> VolumeVerification:
    """Measure an artefact and compare it with its certificate.

    Parameters
    ----------
    session
        A checked session of the calibrated rig.
    name
        The capture; the only artefact where None.
    written
        The calibration's record.
    progress
        Called with a short sentence before each step.

    Raises
    ------
    SessionError
        No such capture, no target that can be judged, or one that took part in the calibration.
    PhaseError, FitError
        The frames hold no phase, or the points do not show the artefact.
    """
    rig = board_rig_of(written)
    capture = volume_artefact(session, name)
    demand_for_rig(capture, rig)
    target = capture.target
    assert target is not None
    progress(f"points of {capture.name}")
    seen = points_of_capture(capture, rig, written.raster, dtype=np.float64)
    progress(f"finding the {target.kind} and its numbers")
    return judged_in_volume(capture, target, rig, seen)


def volume_artefact(session: Session, name: str | None) -> Capture:
    """Return the capture to be verified on: the one named, or the only artefact.

    Raises
    ------
    SessionError
        No such capture, or no target that can be judged in a volume.
    """
    free = [capture for capture in session.find("artefact") if capture.use != "calibration"]
    capture = session.named(name) if name is not None else free[0] if len(free) == 1 else session.one("artefact")
    if not isinstance(capture.target, IN_VOLUME):
        kinds = ", ".join(kind.model_fields["kind"].default for kind in IN_VOLUME)
        found = "no target" if capture.target is None else f"a target of kind {capture.target.kind!r}"
        raise SessionError(
            [f"capture {capture.name!r}: {found}; by a rig with a board's calibration {kinds} are judged"]
        )
    return capture


def judged_in_volume(capture: Capture, target: Artefact, rig: BoardRig, seen: VolumeCapture) -> VolumeVerification:
    """Find an artefact in a capture's points, and judge it.

    Raises
    ------
    FitError
        The points do not show it.
    """
    cloud = np.stack([seen.volume.x, seen.volume.y, seen.volume.z], axis=-1).astype(np.float64) * _FACING
    picture = PointPicture.of(cloud, seen.volume.mask, _between(rig, cloud[seen.volume.mask]))
    probe = volume_probe(target, picture)
    surface = SimpleNamespace(x=cloud[..., 0], y=cloud[..., 1], z=cloud[..., 2], mask=seen.volume.mask)
    readings = take_readings(
        probe,
        surface,
        lambda u, v, _: _moved(rig, seen, (u, v)),
        instrument=(target.instrument, target.instrument_u_mm),
        thermal_rel_u=target.thermal_rel_u,
    )
    residual = np.full(cloud.shape[:2], np.nan)
    flat = cloud.reshape(-1, 3)
    for group, off in zip(probe.groups, probe.residuals([flat[g] for g in probe.groups]), strict=True):
        residual.ravel()[group] = off
    found = _departures(rig, seen, target, probe, flat)
    return VolumeVerification(capture, target, rig, seen, probe, readings, found, residual)


def _between(rig: BoardRig, points: Array) -> Array:
    """Return the direction between camera and projector from the points' middle, (3,)."""
    middle = np.median(points, axis=0)
    ways = -middle, rig.centre_mm * _FACING - middle
    return np.asarray(sum(way / np.linalg.norm(way) for way in ways))


def _modes(rig: BoardRig) -> Array:
    """Return the principal axes of the calibration's covariance, each one standard uncertainty long, (24, n)."""
    u = np.sqrt(np.maximum(np.diag(rig.covariance), 0.0))
    scale = np.where(u > 0, u, 1.0)
    sizes, axes = np.linalg.eigh(rig.covariance / np.outer(scale, scale))
    known = sizes > 0
    return np.asarray(scale[:, None] * axes[:, known] * np.sqrt(sizes[known]))


def _moved(
    rig: BoardRig, seen: VolumeCapture, pixels: tuple[Array, Array]
) -> Iterator[tuple[UncertaintyComponent, Array]]:
    """Yield each principal axis of the calibration's uncertainty, and the points as it moves them."""
    points, by_rig, _ = _at(rig, seen, pixels)
    for mode in _modes(rig).T:
        yield UncertaintyComponent(Influence.BOARD_RIG, 0.0, rig.dof), points + by_rig @ mode


def _at(rig: BoardRig, seen: VolumeCapture, pixels: tuple[Array, Array]) -> tuple[Array, Array, Array]:
    """Return points (n, 3), their change by the rig's parameters (n, 3, 24), and their random covariance (n, 3, 3)."""
    columns, rows = (axis.astype(np.intp) for axis in pixels)
    found = rig_points(
        rig,
        np.column_stack(pixels),
        seen.place_px[:, rows, columns].T,
        projector_u_px=np.maximum(seen.u_px[:, rows, columns].T.astype(np.float64), 1e-9),
    )
    turned = found.by_rig * _FACING[None, :, None]
    random = found.random_mm2 * _FACING[:, None] * _FACING
    return found.points_mm * _FACING, turned, random


def _departures(rig: BoardRig, seen: VolumeCapture, target: Artefact, probe: Probe, flat: Array) -> Departures:
    """Compare distances from the form with their u: the pixel's own noise, and what the calibration bends of the form.

    What moves or turns the form as a whole the fit takes with it; what a flat may be off flat is its certificate's.
    """
    width, rng = seen.volume.z.shape[1], np.random.default_rng(_SEED)
    few = [np.sort(rng.permutation(group)[: _JUDGED // len(probe.groups)]) for group in probe.groups]
    own = target.flatness_mm.value + target.flatness_mm.u if isinstance(target, Flat) else 0.0
    all_off = probe.residuals([flat[g] for g in probe.groups])
    off, u = [], []
    for group, chosen, every in zip(probe.groups, few, all_off, strict=True):
        normal, free = _form_terms(flat[chosen], target)
        _, by_rig, random = _at(rig, seen, ((chosen % width).astype(float), (chosen // width).astype(float)))
        bends = np.einsum("ni,nij->nj", normal, by_rig)
        bends -= free @ np.linalg.lstsq(free, bends, rcond=None)[0]
        variance = np.einsum("ni,nij,nj->n", normal, random, normal)
        variance += np.einsum("ni,ij,nj->n", bends, rig.covariance, bends) + own**2
        off.append(every[np.searchsorted(group, chosen)])
        u.append(np.sqrt(variance))
    return departures_of(np.concatenate(off), np.concatenate(u))


def _form_terms(points: Array, target: Artefact) -> tuple[Array, Array]:
    """Return the form's normals at points, (n, 3), and what its own parameters do to the distances, (n, m)."""
    if isinstance(target, Sphere | BallBar):
        fit = fit_sphere(points)
        normal = points - fit.centre_mm
        normal /= np.linalg.norm(normal, axis=1)[:, None]
        return normal, normal
    plane = fit_plane(points)
    local = points - plane.point_mm
    axes = np.linalg.svd(local, full_matrices=False)[2][:2]
    return np.broadcast_to(plane.normal, points.shape), np.column_stack([np.ones(len(points)), local @ axes.T])
