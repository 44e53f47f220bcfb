"""A session that has passed its check: captures, what is known of the rig, and the hash of every input."""

import hashlib
from dataclasses import dataclass, field
from datetime import datetime
from functools import cached_property
from pathlib import Path

import numpy as np

from fringecal.errors import SessionError
from fringecal.session.faults import PictureError, hint, joined
from fringecal.session.pictures.picture import decode, to_grey
from fringecal.session.pictures.size_limits import regular_bytes
from fringecal.targets import Quantity, Target


@dataclass(frozen=True)
class CameraKnown:
    """What is known of the camera beforehand.

    Parameters
    ----------
    model
        File of a full camera model (mrcal or OpenCV), or None.
    height_mm
        Entrance pupil above the plate, or None.
    telecentric
        Whether all rays are parallel.
    model_content
        The bytes of that file as the session was checked and hashed, so that the lens is read from no others.
    """

    model: Path | None = None
    height_mm: Quantity | None = None
    telecentric: bool = False
    model_content: bytes | None = field(default=None, repr=False)


@dataclass(frozen=True)
class MirrorKnown:
    """A plane mirror: any point of its surface, mm, with uncertainties, and the direction across it; plate frame."""

    point_mm: Quantity
    normal: tuple[float, float, float]


@dataclass(frozen=True)
class ProjectorKnown:
    """Nominal position x, y, z of the projector's pupil in the plate frame, mm, with uncertainties.

    With a `mirror` the position is that of the projector itself, not of its image.
    """

    position_mm: Quantity
    mirror: MirrorKnown | None = None


@dataclass(frozen=True)
class Capture:
    """Pictures of one thing, taken for one purpose.

    Parameters
    ----------
    name, kind, target
        As in `session.toml`; `target` is None where the kind needs none.
    paths, sha256
        Files in the order repeat, period, step (the step changes fastest), and their hashes.
    phase_shifts_rad
        Phase shifts of one set; empty for pictures that are not phase-shifted.
    repeat, periods
        How often the whole set was taken; fringe periods, empty where not stated.
    gray_paths, gray_sha256
        Gray-code pictures, the coarsest bit first.
    shape
        (height, width) in px.
    bits, white_level
        Bits of the container, 8 or 16, and the value of a saturated pixel.
    channel
        Rule by which colour becomes grey, or None.
    use
        "calibration" for what the rig is fitted to, "verification" for what must stay independent of that fit.
    pixels, gray_pixels
        The frames themselves, (N, H, W), where they are given as arrays (`capture_of_arrays`): `paths` then only names
        them, and no file is read.
    """

    name: str
    kind: str
    target: Target | None
    paths: tuple[Path, ...]
    sha256: tuple[str, ...]
    phase_shifts_rad: tuple[float, ...]
    shape: tuple[int, int]
    bits: int
    white_level: int
    repeat: int = 1
    periods: tuple[float, ...] = ()
    gray_paths: tuple[Path, ...] = ()
    gray_sha256: tuple[str, ...] = ()
    channel: str | None = None
    use: str = "verification"
    pixels: np.ndarray | None = field(default=None, repr=False, compare=False)
    gray_pixels: np.ndarray | None = field(default=None, repr=False, compare=False)

    def read(self) -> np.ndarray:
        """Read all frames: (N, H, W), uint8 or uint16, read-only, kept after the first call.

        Raises
        ------
        SessionError
            If a file has changed since the session was checked.
        """
        return self._frames

    def read_set(self, *, repeat: int = 0, period: int = 0) -> np.ndarray:
        """Read the frames of one repeat and one fringe period, (n_steps, H, W)."""
        n_sets = self.repeat * max(1, len(self.periods))
        sets = self.read().reshape(n_sets, -1, *self.shape)
        return sets[repeat * max(1, len(self.periods)) + period]

    def read_gray(self) -> np.ndarray:
        """Read the Gray-code frames, (N, H, W), the coarsest bit first."""
        return self._gray_frames

    @cached_property
    def _frames(self) -> np.ndarray:
        return self._stack(self.paths, self.sha256) if self.pixels is None else self.pixels

    @cached_property
    def _gray_frames(self) -> np.ndarray:
        return self._stack(self.gray_paths, self.gray_sha256) if self.gray_pixels is None else self.gray_pixels

    def _stack(self, paths: tuple[Path, ...], hashes: tuple[str, ...]) -> np.ndarray:
        dtype = np.uint8 if self.bits == 8 else np.uint16
        frames = np.empty((len(paths), *self.shape), dtype)
        for k, (path, sha256) in enumerate(zip(paths, hashes, strict=True)):
            frames[k] = self._frame(path, sha256)
        frames.flags.writeable = False
        return frames

    def _frame(self, path: Path, sha256: str) -> np.ndarray:
        try:
            data = regular_bytes(path)
        except PictureError as error:
            raise SessionError([f"{path}: {error}"]) from error
        if hashlib.sha256(data).hexdigest() != sha256:
            raise SessionError([f"{path}: changed since the session was checked; load the session again"])
        return to_grey(decode(data).pixels, self.channel, self.white_level)


@dataclass(frozen=True)
class Session:
    """An input folder without faults.

    Parameters
    ----------
    folder, rig, captured, operator, temperature_degC, minutes_since_power_on
        As in `session.toml`; what is not stated is None.
    camera, projector
        What is known beforehand; `projector` is None where nothing is.
    phase_shifts_rad
        Phase shifts that hold unless a capture has its own; empty where not stated.
    captures
        By name, in the order of the file.
    inputs
        sha256 of every file that the session consists of, by its path in the folder.
    """

    folder: Path
    rig: str
    captured: datetime
    camera: CameraKnown
    projector: ProjectorKnown | None
    phase_shifts_rad: tuple[float, ...]
    captures: dict[str, Capture]
    inputs: dict[str, str]
    operator: str | None = None
    temperature_degC: float | None = None  # noqa: N815  (the unit is written so)
    minutes_since_power_on: float | None = None

    def find(self, kind: str) -> tuple[Capture, ...]:
        """Return all captures of a kind, in the order of the file."""
        return tuple(capture for capture in self.captures.values() if capture.kind == kind)

    def one(self, kind: str) -> Capture:
        """Return the only capture of a kind.

        Raises
        ------
        SessionError
            If there is none, or more than one.
        """
        found = self.find(kind)
        if len(found) == 1:
            return found[0]
        if not found:
            kinds = joined(sorted({c.kind for c in self.captures.values()}))
            raise SessionError([f'{self.folder}: no capture of kind "{kind}", only {kinds}; add one'])
        names = joined(capture.name for capture in found)
        raise SessionError([f'{self.folder}: {len(found)} captures of kind "{kind}" ({names}); name the one'])

    def named(self, name: str) -> Capture:
        """Return the capture of a name.

        Raises
        ------
        SessionError
            If there is none; the message names the nearest.
        """
        if name not in self.captures:
            raise SessionError([f'{self.folder}: no capture "{name}"; {hint(name, self.captures)}'])
        return self.captures[name]
