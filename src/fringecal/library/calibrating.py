"""Calibrate a rig in one call: from arrays, or from a session folder."""

from collections.abc import Callable, Mapping, Sequence
from datetime import datetime
from pathlib import Path

from numpy.typing import ArrayLike

from fringecal.calibration import CameraFindings, camera_from_grid
from fringecal.detect import GridDetection
from fringecal.errors import SessionError
from fringecal.library.calibration_value import Calibration
from fringecal.library.known_values import target_of
from fringecal.session import (
    CameraKnown,
    Capture,
    ProjectorKnown,
    Session,
    capture_of_arrays,
    load_session,
    session_of_captures,
)
from fringecal.targets import LineGrid, Quantity, Target
from fringecal.uncertainty import Influence
from fringecal.workflows.commission import calibrate_session, camera_knowledge, judged_session

type Frames = ArrayLike
type Shown = tuple[ArrayLike, Target | str | Path]


def calibrate(  # noqa: PLR0913 -- keyword arguments: everything that can be known of a rig
    session: Session | str | Path | None = None,
    *,
    grid: ArrayLike | GridDetection | None = None,
    grid_target: Target | str | Path = "grid-10mm",
    plate: Frames | None = None,
    strips: Frames | None = None,
    strips_target: Target | str | Path = "glass-strips",
    phase_shifts_deg: Sequence[float] = (),
    periods: Sequence[float] = (),
    standards: Mapping[str, Shown] | None = None,
    artefacts: Mapping[str, Shown] | None = None,
    camera_height_mm: Quantity | None = None,
    telecentric: bool = False,
    camera_model: str | Path | None = None,
    projector_mm: Quantity | None = None,
    white_level: int | None = None,
    rig: str = "rig",
    captured: datetime | None = None,
    progress: Callable[[str], None] = lambda _: None,
) -> Calibration:
    """Calibrate a rig from a session, or from arrays: a grid picture, the bare plate and strips under fringes.

    The same stages run on both, with the same numbers; arrays are never written to disk.

    Parameters
    ----------
    session
        A checked session or its folder. It states everything itself: no other argument but `progress` goes with it.
    grid
        Grey picture of the ruled grid, (H, W), uint8 or uint16; or its crossings, from `fringecal.detect.find_grid` or
        `fringecal.detect.grid_of_crossings`.
    grid_target, strips_target
        What the grid and the strips are: a target, the name of a shipped one, or a TOML file.
    plate, strips
        Frames of the bare plate and of the strips on it, (N, H, W), in the order period, phase shift.
    phase_shifts_deg
        Phase shift of each frame of one set, deg.
    periods
        Fringe periods, where there are several.
    standards
        Further artefacts of known heights that take part in the fit: by name, frames and target.
    artefacts
        Artefacts that judge the calibration, measured with its result: by name, frames and target.
    camera_height_mm, telecentric, camera_model
        Entrance pupil above the plate, `known(1500.0, u=5.0)`, mm; or parallel rays; or the file of a full model.
    projector_mm
        Stated x, y, z of the projector's pupil in the plate frame, `known([0, 1222, 1000], u=3)`, mm.
    white_level
        Grey value of a saturated pixel; by default that of the array's type.
    rig, captured
        Name of the rig, and when the frames were taken (now, where nothing is said).
    progress
        Called with a short sentence before each step.

    Returns
    -------
    Calibration

    Raises
    ------
    SessionError
        What is given contradicts itself, or something needed is missing.
    DetectionError, PhaseError, FitError
        What the pictures do not show or determine, with the reason.

    Examples
    --------
    >>> import fringecal
    >>> fringecal.calibrate(grid=[[0]])
    Traceback (most recent call last):
        ...
    fringecal.errors.SessionError: no frames of the bare plate, no frames of strips; pass plate and strips, or a session
    """
    if session is None:
        missing = [name for name, given in (("grid", grid), ("plate", plate), ("strips", strips)) if given is None]
        if grid is None or plate is None or strips is None:
            raise SessionError([_missing_sentence(missing)])
        shown = {"standard": standards or {}, "artefact": artefacts or {}}
        captures = [
            *_grid_captures(grid, grid_target, white_level),
            _fringes("plate", "reference", plate, None, phase_shifts_deg, periods, white_level),
            _fringes("strips", "strips", strips, target_of(strips_target), phase_shifts_deg, periods, white_level),
            *(
                _fringes(name, "artefact", frames, target_of(target), phase_shifts_deg, periods, white_level, use=use)
                for use, group in (("calibration", shown["standard"]), ("verification", shown["artefact"]))
                for name, (frames, target) in group.items()
            ),
        ]
        given = session_of_captures(
            captures,
            rig=rig,
            captured=captured,
            camera=CameraKnown(None if camera_model is None else Path(camera_model), camera_height_mm, telecentric),
            projector=None if projector_mm is None else ProjectorKnown(projector_mm),
        )
    else:
        _demand_session_alone(grid, plate, strips, standards, artefacts, camera_height_mm, projector_mm)
        given = load_session(session) if isinstance(session, str | Path) else session
    camera = _camera(grid, grid_target, given) if isinstance(grid, GridDetection) else None
    calibrated = calibrate_session(given, camera=camera, progress=progress)
    return Calibration.of(judged_session(calibrated, progress=progress))


def _grid_captures(
    grid: ArrayLike | GridDetection, target: Target | str | Path, white_level: int | None
) -> tuple[Capture, ...]:
    """Return the capture of the grid's picture; none where its crossings are given."""
    if isinstance(grid, GridDetection):
        return ()
    return (capture_of_arrays("grid", "grid", grid, target=target_of(target), white_level=white_level),)


def _camera(grid: GridDetection, target: Target | str | Path, session: Session) -> CameraFindings:
    """Fit the camera to given crossings.

    Raises
    ------
    SessionError
        The target is no line grid, or the crossings are of a picture of another size.
    """
    shown = target_of(target)
    if not isinstance(shown, LineGrid):
        raise SessionError([f"{shown.name}: no line grid; name the grid that the crossings are of"])
    size = session.one("reference").shape
    if tuple(grid.shape) != tuple(size):
        raise SessionError([f"crossings of a picture {grid.shape}, frames of {size} px (height, width); use one size"])
    return camera_from_grid(grid, shown.pitch_mm.estimate(Influence.GRID_PITCH, "mm"), camera_knowledge(session))


def _fringes(
    name: str,
    kind: str,
    frames: Frames,
    target: Target | None,
    phase_shifts_deg: Sequence[float],
    periods: Sequence[float],
    white_level: int | None,
    *,
    use: str | None = None,
) -> Capture:
    return capture_of_arrays(
        name,
        kind,
        frames,
        target=target,
        phase_shifts_deg=phase_shifts_deg,
        periods=periods,
        white_level=white_level,
        use=use,
    )


def _missing_sentence(missing: Sequence[str]) -> str:
    words = {"grid": "no picture of the grid", "plate": "no frames of the bare plate", "strips": "no frames of strips"}
    return f"{', '.join(words[name] for name in missing)}; pass {' and '.join(missing)}, or a session"


def _demand_session_alone(*given: object) -> None:
    if any(item is not None for item in given):
        raise SessionError(
            ["a session states its captures and what is known of the rig; pass either a session or arrays, not both"]
        )
