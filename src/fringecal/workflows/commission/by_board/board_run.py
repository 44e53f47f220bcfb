"""Commission a rig by a board in poses: camera and projector from the fringes on it, then what their trust rests on."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from fringecal.calibration import PosedBoard, RasterMap, posed_board
from fringecal.errors import FitError, PhaseError, SessionError
from fringecal.numerics import MAD_TO_SD
from fringecal.phase import RasterCoordinate, Waveform
from fringecal.projector import (
    BoardPose,
    BoardRigFit,
    BoardStatement,
    PoseAdvice,
    PoseFit,
    RigFault,
    RigFaultKind,
    advise_poses,
    fit_board_rig,
    pose_arrangement,
    rig_faults,
)
from fringecal.session import Capture, Session
from fringecal.targets import Charuco, Chessboard, Target
from fringecal.workflows.lens import board_pictures
from fringecal.workflows.shared import AxisPhase, lit_by_projector, raster_of_capture

Progress = Callable[[str], None]

_LEAST_POSES = 3
_USEFUL = 0.97  # of u, below which one more pose is worth its time
_LEAST_KNOCKED = 2  # poses in a row that disagree, before it is the rig and not the board that moved
_OF_ALL = (
    RigFaultKind.STRETCHED_PRINT,
    RigFaultKind.FRAME_SCALED,
    RigFaultKind.PICTURE_SCALED,
    RigFaultKind.FOCUS_CHANGED,
    RigFaultKind.RIG_MOVED,
    RigFaultKind.AXES_EXCHANGED,
)
"""Faults that all poses share."""
_SUSPECT = 5.0  # times what most poses have, that a pose's median residual may be: beyond, the board moved in between


@dataclass(frozen=True)
class BoardCommissioning:
    """A rig calibrated by a board in poses.

    Parameters
    ----------
    session
        What it was calibrated from.
    captures
        The board's captures: one for each pose, or one for each axis of a pose.
    posed
        What each shows, also those left aside, with the reason.
    fit
        The calibration; its poses are those of `used`, in their order.
    rasters
        How the fringes along each axis count the projector's pixels.
    faults
        What is wrong with the captures: named, never fitted away.
    advice
        Poses to add next, the most useful first.
    """

    session: Session
    captures: tuple[Capture, ...]
    posed: tuple[PosedBoard, ...]
    fit: BoardRigFit
    rasters: dict[str, RasterCoordinate]
    faults: tuple[RigFault, ...] = ()
    advice: tuple[PoseAdvice, ...] = ()

    @property
    def used(self) -> tuple[PosedBoard, ...]:
        """Poses that took part."""
        return tuple(one for one in self.posed if one.pose is not None)

    @property
    def target(self) -> Target:
        """The board."""
        target = self.captures[0].target
        assert target is not None
        return target

    @property
    def notes(self) -> tuple[str, ...]:
        """What a reader of the record should know besides the numbers."""
        part = [f"pose {one.name}: {one.unread}" for one in self.used if one.unread]
        aside = [f"pose {one.name} is left aside: {one.reason}" for one in self.posed if one.pose is None]
        axes = [f"axis {name}: {raster.sentence()}" for name, raster in self.rasters.items()]
        return (
            *axes,
            *_no_plate(self.session),
            *_one_axis(self.fit.rig.axes),
            *_undetermined(self.fit.rig.undetermined),
            *part,
            *aside,
            *self.next_poses,
        )

    @property
    def next_poses(self) -> tuple[str, ...]:
        """What to measure next, in sentences."""
        useful = [one for one in self.advice if one.ratio < _USEFUL]
        return tuple(
            f"one more pose, {one.text}: u of points in the volume would fall to {100 * one.ratio:.0f} % of what it is"
            for one in useful
        )


def _no_plate(session: Session) -> tuple[str, ...]:
    if any(capture.axes for capture in session.find("reference")) or all(one.maps for one in session.find("board")):
        return ()
    return (
        "no bare plate was captured under the fringes: their waveform was looked for on the board, whose squares hide "
        "it; with three phase shifts a gamma that is not corrected moves every coordinate",
    )


def _one_axis(axes: tuple[str, ...]) -> tuple[str, ...]:
    if len(axes) > 1:
        return ()
    return (
        f"fringes along {axes[0]} alone: the projector's other coordinate, its place and the turn about its fringes "
        "are not determined by them, and no wrong fringe order shows; points in space are determined all the same",
    )


def _undetermined(names: tuple[str, ...]) -> tuple[str, ...]:
    return (f"the poses tell nothing of {', '.join(names)}; what was assumed of them stands",) if names else ()


def is_board_session(session: Session) -> bool:
    """Tell whether a session is to be calibrated by a board with fringes: it has such poses, and no strips."""
    return any(capture.counted_axes for capture in session.find("board")) and not session.find("strips")


def commission_boards(session: Session, *, progress: Progress = lambda _: None) -> BoardCommissioning:
    """Calibrate camera and projector from a session whose board captures carry fringes.

    Parameters
    ----------
    session
        A checked session with a board in three poses and more, each under fringes along one axis or both.
    progress
        Called with a short sentence before each step.

    Raises
    ------
    SessionError
        Boards of different kinds, or too few poses that show what is needed; each with its reason.
    FitError
        The poses do not determine the rig.
    """
    captures = tuple(capture for capture in session.find("board") if capture.counted_axes)
    _demand_one_board(captures)
    found, rasters = _measured(captures, plate_waves(session), progress)
    found = _turned(found, rasters)
    demand_poses(found)
    progress("solving for camera, projector and poses")
    found, fit = solved_poses(session, captures, found)
    progress("faults of the captures, and poses to add")
    return BoardCommissioning(session, captures, found, fit, rasters, _faults(session, fit), advise_poses(fit))


def _faults(session: Session, fit: BoardRigFit) -> tuple[RigFault, ...]:
    known = session.projector is not None and session.projector.pixel_aspect is not None
    return rig_faults(fit, projector_aspect=_projector_aspect(session) if known else None)


def _projector_aspect(session: Session) -> float:
    """Return fy / fx of the projector by its pixels as stated; 1 where nothing is."""
    projector = session.projector
    return 1.0 if projector is None or projector.pixel_aspect is None else 1 / projector.pixel_aspect


def _demand_one_board(captures: Sequence[Capture]) -> None:
    if any(capture.target != captures[0].target for capture in captures):
        raise SessionError(["captures of kind 'board' name different targets; a rig is calibrated by one board"])


def plate_waves(session: Session) -> dict[str, Waveform]:
    """Return the waveform of the fringes along each axis as a bare plate shows it; none where none was captured.

    The squares of a board hide it, and with three phase shifts a gamma that is not corrected moves every coordinate.
    """
    plates = [capture for capture in session.find("reference") if capture.axes]
    if not plates:
        return {}
    found = {axis.name: raster_of_capture(plates[0], axis.name).adapted for axis in plates[0].axes}
    waves = {name: None if adapted is None else adapted.found_wave for name, adapted in found.items()}
    return {name: wave for name, wave in waves.items() if wave is not None}


def _measured(
    captures: Sequence[Capture], waves: Mapping[str, Waveform], progress: Progress
) -> tuple[tuple[PosedBoard, ...], dict[str, RasterCoordinate]]:
    """Read the projector's coordinates at the corners of each pose; the first capture's phase zeros hold for all."""
    found: list[PosedBoard] = []
    like: dict[str, AxisPhase] = {}
    for pose, shots in _by_pose(captures).items():
        progress(f"phase and corners of {pose}")
        counted = [(capture, name) for capture in shots for name in capture.counted_axes]
        try:
            axes = [_axis(capture, name, like.get(name), waves.get(name)) for capture, name in counted]
        except PhaseError as error:
            found.append(PosedBoard(pose, None, str(error)))
            continue
        capture = _evenly_lit(shots)
        for axis in axes:
            like.setdefault(axis.axis, axis)
        (_, image), target = next(iter(board_pictures(capture))), capture.target
        assert target is not None
        found.append(posed_board(pose, image, target, _raster_map(axes, shots)))
    return tuple(found), {name: axis.raster for name, axis in like.items()}


def _evenly_lit(shots: Sequence[Capture]) -> Capture:
    """Return the capture of a pose that shows it evenly lit; the first where none does."""
    return next((one for one in shots if one.white_paths), shots[0])


def _by_pose(captures: Sequence[Capture]) -> dict[str, list[Capture]]:
    """Return captures by the pose that they show: those that state one together, each other one alone.

    Raises
    ------
    SessionError
        Two captures of a pose have fringes along one axis, or one's name is that of another's pose.
    """
    found: dict[str, list[Capture]] = {}
    for capture in captures:
        found.setdefault(capture.pose or capture.name, []).append(capture)
    for pose, shots in found.items():
        axes = [name for capture in shots for name in capture.counted_axes]
        if len(set(axes)) < len(axes):
            names = ", ".join(capture.name for capture in shots)
            raise SessionError(
                [f"pose {pose!r}: captures {names} have fringes along the same axis; state another pose"]
            )
    return found


def _axis(capture: Capture, name: str, like: AxisPhase | None, wave: Waveform | None) -> AxisPhase:
    """Count along one axis as the first capture does: its zeros, its direction; with the plate's waveform, or its."""
    raster, own = (None, None) if like is None else (like.raster, _wave(like))
    found = raster_of_capture(capture, name, like=raster, wave=own if wave is None else wave, dark=False)
    return found if like is None or found.raster.falls == like.raster.falls else _mirrored(found)


def _wave(like: AxisPhase) -> Waveform | None:
    return None if like.adapted is None else like.adapted.found_wave


def _mirrored(axis: AxisPhase) -> AxisPhase:
    return replace(axis, raster=axis.raster.mirrored())


def _raster_map(axes: Sequence[AxisPhase], shots: Sequence[Capture]) -> RasterMap:
    shape = shots[0].shape
    px, u_px = np.full((2, *shape), np.nan), np.full((2, *shape), np.nan)
    for axis in axes:
        k = "uv".index(axis.axis)
        px[k], u_px[k] = axis.raster.px, axis.raster.u_px
    full = [one.read().max(axis=0) >= one.white_level for one in shots if one.paths]
    lit = lit_by_projector(_evenly_lit(shots))
    if lit is not None:  # of a capture without white and black of its own as well
        px[:, ~lit] = np.nan
    return RasterMap(px, u_px, lit, np.any(full, axis=0) if full else None)


def _turned(found: tuple[PosedBoard, ...], rasters: dict[str, RasterCoordinate]) -> tuple[PosedBoard, ...]:
    """Count one axis the other way if the projector would else see boards mirrored: its phase falls.

    A camera and a projector before the same side of a board see it turn the same way.
    """
    if sum(one.handed for one in found) >= 0:
        return found
    raster = rasters["u"]
    rasters["u"] = raster.mirrored()
    return tuple(one if one.pose is None else replace(one, pose=_flipped(one.pose, raster)) for one in found)


def _flipped(pose: BoardPose, raster: RasterCoordinate) -> BoardPose:
    place = pose.projector_px.copy()
    place[:, 0] = replace(raster, px=place[:, 0]).mirrored().px
    return replace(pose, projector_px=place)


def demand_poses(found: Sequence[PosedBoard]) -> None:
    """Refuse fewer than three poses that can be used, with the reason of each that cannot.

    Raises
    ------
    SessionError
        There are fewer.
    """
    used = [one for one in found if one.pose is not None]
    if len(used) < _LEAST_POSES:
        reasons = [f"capture {one.name!r}: {one.reason}" for one in found if one.pose is None]
        needed = f"{len(used)} of {len(found)} poses of the board can be used, {_LEAST_POSES} are needed"
        raise SessionError([f"{needed}; take more, tilted 20 to 40 deg to different sides", *reasons])


def solved_poses(
    session: Session, captures: Sequence[Capture], found: tuple[PosedBoard, ...]
) -> tuple[tuple[PosedBoard, ...], BoardRigFit]:
    """Solve; leave aside poses that disagree with the others, and solve again.

    Parameters
    ----------
    session, captures
        The session, and the captures of its board.
    found
        What each of these shows.

    Raises
    ------
    FitError
        The poses do not determine the rig.
    """
    fit = _fit(session, captures, found)
    suspects = dict(_disagreeing(fit, [one.pose for one in found if one.pose is not None]))
    if not suspects or len(fit.poses) - len(suspects) < _LEAST_POSES:
        return found, fit
    if len(suspects) > 1 and any(fault.kind in _OF_ALL for fault in _faults(session, fit)):
        return found, fit  # one cause for all: without the worst of them it would only be smaller
    suspects |= _knocked(fit, suspects)
    found = tuple(one.aside(suspects[one.name]) if one.name in suspects else one for one in found)
    return found, _fit(session, captures, found)


def _fit(session: Session, captures: Sequence[Capture], found: Sequence[PosedBoard]) -> BoardRigFit:
    projector = session.projector
    assert projector is not None
    assert projector.resolution_px is not None
    height, width = captures[0].shape
    aspect = _projector_aspect(session)
    poses = [one.pose for one in found if one.pose is not None]
    target = captures[0].target
    assert target is not None
    return fit_board_rig(
        poses, (width, height), projector.resolution_px, board=statement_of(target), projector_aspect=aspect
    )


def statement_of(target: Target) -> BoardStatement:
    """Return what is known of a board: the relative uncertainty of its lengths.

    Raises
    ------
    FitError
        The target is no board of squares.
    """
    if not isinstance(target, Chessboard | Charuco):
        raise FitError(
            f"a {target.kind} under fringes: corners of squares are read best; use a chessboard or a ChArUco board"
        )
    own = target.square_mm.estimate("square", "mm")
    return BoardStatement(pitch_u_rel=float(np.hypot(own.u / own.value, target.thermal_rel_u)))


def _disagreeing(fit: BoardRigFit, given: Sequence[BoardPose]) -> Iterator[tuple[str, str]]:
    """Name poses whose residuals, of points left out as well, are far above those of most, and say so."""
    said: set[str] = set()
    for device, k in (("camera", 0), ("projector", 2)):
        sizes = [_typical(pose, seen, k) for pose, seen in zip(fit.poses, given, strict=True)]
        usual = float(np.median(sizes))
        for number, (pose, size) in enumerate(zip(fit.poses, sizes, strict=True)):
            if size > _SUSPECT * usual and pose.name not in said:
                said.add(pose.name)
                otherwise = pose_arrangement(fit, number)
                reason = (
                    f"its points are off by {size:.2g} px in the {device}, those of most poses by {usual:.2g} px: did "
                    "the board move between the frames, or do they stand in another order than is stated?"
                )
                yield pose.name, reason if otherwise is None else otherwise.message.removeprefix(f"pose {pose.name}: ")


def _knocked(fit: BoardRigFit, suspects: Mapping[str, str]) -> dict[str, str]:
    """Say of poses that disagree that all from one on, or all up to one, do: the rig was moved then."""
    names = [pose.name for pose in fit.poses]
    alike = [name in suspects for name in names]
    if len(suspects) < _LEAST_KNOCKED or not (all(alike[-len(suspects) :]) or all(alike[: len(suspects)])):
        return {}
    split = names[len(suspects)] if alike[0] else names[-len(suspects)]
    reason = (
        f"poses before {split} and those from it on disagree: camera or projector was moved then, against the other; "
        "fix both, and capture the fewer of them anew"
    )
    return dict.fromkeys(suspects, reason)


def _typical(pose: PoseFit, given: BoardPose, k: int) -> float:
    rest, seen = (
        (pose.camera_residual_px, given.camera_px) if k == 0 else (pose.projector_residual_px, given.projector_px)
    )
    # Each axis by itself: a board that moved between the two is off along one of them.
    known = [column[np.isfinite(there)] for column, there in zip(rest.T, seen.T, strict=True)]
    return max((float(MAD_TO_SD * np.median(np.abs(column))) for column in known if column.size), default=0.0)
