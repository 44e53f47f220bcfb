"""The full lens: from board pictures, or from a file that the session states."""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from fringecal.calibration import KnownLens, LensFindings, lens_from_pictures
from fringecal.camera import Lens, Model, Solver
from fringecal.errors import RecordError, SessionError
from fringecal.records import lens_of_bytes, read_lens
from fringecal.session import CameraKnown, Capture, Session


def known_lens(session: Session) -> KnownLens | None:
    """Give the full lens that the session states or holds the board pictures for; None with neither.

    Raises
    ------
    SessionError
        Both are given, and only one can be the truth.
    RecordError, DetectionError, FitError
        The file holds no such lens, too few pictures show the board, or the poses do not determine the lens.
    """
    stated, boards = session.camera.model, session.find("board")
    if stated is not None and boards:
        raise SessionError(["camera.model is stated and a capture of kind 'board' gives another; keep one of the two"])
    if stated is not None:
        return KnownLens(_stated_lens(session.camera), file=stated.name)
    if not boards:
        return None
    found = measure_lens(session)
    return KnownLens(found.fit.lens, findings=found)


def _stated_lens(camera: CameraKnown) -> Lens:
    """Read the lens from the bytes that the session was checked and hashed with, or from a file that none names."""
    assert camera.model is not None  # whoever asks has seen it
    if camera.model_content is None:
        return read_lens(camera.model)
    try:
        return lens_of_bytes(camera.model_content)
    except RecordError as error:
        raise RecordError(f"{camera.model}: {error}") from error


def measure_lens(
    session: Session, *, solver: Solver = "auto", model: Model = "brown", flat_board: bool = False
) -> LensFindings:
    """Find the board in all pictures of kind "board" and fit the full lens.

    Raises
    ------
    SessionError
        There is no such capture, or they are of different boards.
    DetectionError, FitError
        As `lens_from_pictures`.
    """
    captures = session.find("board")
    targets = [capture.target for capture in captures if capture.target is not None]
    if not targets or len(targets) < len(captures):
        raise SessionError(["no capture of kind 'board' that names its target; add one to session.toml"])
    if any(target != targets[0] for target in targets):
        raise SessionError(["captures of kind 'board' name different targets; a lens is fitted to one board"])
    pictures = [named for capture in captures for named in board_pictures(capture)]
    return lens_from_pictures(pictures, targets[0], solver=solver, model=model, flat_board=flat_board)


def board_pictures(capture: Capture) -> Iterator[tuple[str, NDArray[np.generic]]]:
    """Give the pictures of a board that a capture holds, by name: each, or of a board with fringes the even one.

    Where no picture is lit evenly, the mean of the frames is: whole sets of phase shifts leave no fringes in it.
    """
    if not capture.counted_axes:
        yield from ((path.name, image) for path, image in zip(capture.paths, capture.read(), strict=True))
        return
    white = capture.read_light("white")
    if white is None and capture.maps:
        raise SessionError([f"capture {capture.name!r}: maps alone show no board; add a picture of it as white"])
    name = capture.white_paths[0].name if capture.white_paths else f"{capture.name} (mean)"
    yield name, np.asarray(capture.read().mean(axis=0) if white is None else white, np.float32)
