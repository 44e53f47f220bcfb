"""Sessions from arrays: the same captures as those of a folder, with their frames in memory and no file behind them."""

import hashlib
import math
from collections.abc import Iterable, Sequence
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from fringecal.errors import SessionError
from fringecal.session.captures import CameraKnown, Capture, ProjectorKnown, Session
from fringecal.targets import Target

_WHITE_LEVELS = {"uint8": 255, "uint16": 65535}
_CALIBRATING = ("strips",)  # kinds that take part in the calibration unless told otherwise, as in session.toml


def capture_of_arrays(  # noqa: PLR0913 -- as many as a capture states
    name: str,
    kind: str,
    frames: ArrayLike,
    *,
    target: Target | None = None,
    phase_shifts_deg: Sequence[float] = (),
    repeat: int = 1,
    periods: Sequence[float] = (),
    gray: ArrayLike | None = None,
    white_level: int | None = None,
    use: str | None = None,
) -> Capture:
    """Make a capture of frames that are in memory.

    Parameters
    ----------
    name, kind
        As in `session.toml`.
    frames
        Grey values as the camera delivered them, uint8 or uint16, (H, W) or (N, H, W), in the order repeat, period,
        phase shift (the phase shift changes fastest).
    target
        The artefact shown, where one is.
    phase_shifts_deg
        Phase shift of each frame of one set, deg; none for a picture without fringes.
    repeat, periods
        How often the whole set was taken; the fringe periods, where there are several.
    gray
        Gray-code frames, (M, H, W), the coarsest bit first.
    white_level
        Grey value of a saturated pixel; by default that of the array's type.
    use
        "calibration" or "verification"; by default strips take part in the calibration and nothing else does.

    Raises
    ------
    SessionError
        The frames are of another type or number than they should be, or two of them are identical.

    Examples
    --------
    >>> frames = np.arange(3 * 4 * 5, dtype=np.uint8).reshape(3, 4, 5)
    >>> capture = capture_of_arrays("plate", "reference", frames, phase_shifts_deg=(0, 120, 240))
    >>> capture.shape, capture.white_level, capture.read().shape
    ((4, 5), 255, (3, 4, 5))
    """
    pixels = _frames(name, frames)
    sets = repeat * max(1, len(periods))
    if phase_shifts_deg and len(pixels) != sets * len(phase_shifts_deg):
        raise SessionError(
            [
                f"capture {name!r}: {sets} sets of {len(phase_shifts_deg)} phase shifts need "
                f"{sets * len(phase_shifts_deg)} frames, found {len(pixels)}"
            ]
        )
    hashes = _hashes(pixels)
    if len(set(hashes)) < len(hashes):
        raise SessionError([f"capture {name!r}: two of its frames are identical; every frame is taken anew"])
    codes = None if gray is None else _frames(name, gray)
    return Capture(
        name=name,
        kind=kind,
        target=target,
        paths=_names(name, len(pixels)),
        sha256=hashes,
        phase_shifts_rad=tuple(math.radians(shift) for shift in phase_shifts_deg),
        shape=(pixels.shape[1], pixels.shape[2]),
        bits=8 * pixels.dtype.itemsize,
        white_level=_WHITE_LEVELS[pixels.dtype.name] if white_level is None else white_level,
        repeat=repeat,
        periods=tuple(periods),
        gray_paths=() if codes is None else _names(f"{name}-gray", len(codes)),
        gray_sha256=() if codes is None else _hashes(codes),
        use=use or ("calibration" if kind in _CALIBRATING else "verification"),
        pixels=pixels,
        gray_pixels=codes,
    )


def session_of_captures(
    captures: Iterable[Capture],
    *,
    rig: str = "rig",
    captured: datetime | None = None,
    camera: CameraKnown | None = None,
    projector: ProjectorKnown | None = None,
) -> Session:
    """Make a session of captures that are in memory.

    Parameters
    ----------
    captures
        Captures of different names, all of one size in px but for board pictures.
    rig
        Name of the rig; a calibration is refused for sessions of another.
    captured
        When the frames were taken; now, where nothing is said.
    camera, projector
        What is known of them beforehand.

    Raises
    ------
    SessionError
        Two captures have one name, or pictures differ in size.
    """
    named: dict[str, Capture] = {}
    for capture in captures:
        if capture.name in named:
            raise SessionError([f"two captures are called {capture.name!r}; give each a name of its own"])
        named[capture.name] = capture
    sizes = {f"{c.shape[1]} x {c.shape[0]} px": c.name for c in named.values()}
    if len(sizes) > 1:
        found = ", ".join(f"{name!r} {size}" for size, name in sizes.items())
        raise SessionError([f"the captures differ in size ({found}); one camera takes all of them, uncropped"])
    inputs = {
        path.as_posix(): sha256
        for c in named.values()
        for path, sha256 in zip((*c.paths, *c.gray_paths), (*c.sha256, *c.gray_sha256), strict=True)
    }
    return Session(
        folder=Path(),
        rig=rig,
        captured=captured or datetime.now(UTC),
        camera=camera or CameraKnown(),
        projector=projector,
        phase_shifts_rad=(),
        captures=named,
        inputs=inputs,
    )


def _frames(name: str, given: ArrayLike) -> np.ndarray:
    """Return a read-only copy of frames, (N, H, W)."""
    frames = np.array(given)
    if frames.ndim == 2:
        frames = frames[None]
    if frames.ndim != 3 or not frames.size:
        raise SessionError([f"capture {name!r}: frames are (H, W) or (N, H, W), found shape {frames.shape}"])
    if frames.dtype.name not in _WHITE_LEVELS:
        raise SessionError(
            [
                f"capture {name!r}: grey values as the camera delivered them are needed, uint8 or uint16; found "
                f"{frames.dtype}. Scaled or averaged values hide noise and saturation"
            ]
        )
    frames.flags.writeable = False
    return frames


def _hashes(frames: np.ndarray) -> tuple[str, ...]:
    return tuple(hashlib.sha256(frame.tobytes()).hexdigest() for frame in frames)


def _names(name: str, number: int) -> tuple[Path, ...]:
    return tuple(Path(f"{name}-{k}") for k in range(number))
