"""A session that has passed its check: captures, what is known of the rig, and the hash of every input."""

import hashlib
from dataclasses import dataclass, field, replace
from datetime import datetime
from functools import cached_property
from pathlib import Path
from typing import Literal

import numpy as np

from fringecal.errors import SessionError
from fringecal.session.faults import PictureError, hint, joined
from fringecal.session.fringes.fringe_axes import FringeAxis
from fringecal.session.fringes.phase_maps import StatedMap
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
    """What is known of the projector beforehand.

    Parameters
    ----------
    position_mm
        Nominal position x, y, z of its pupil in the plate frame, mm, with uncertainties, or None.
    mirror
        A mirror that it is seen in: the position is then that of the projector itself, not of its image.
    resolution_px
        Columns and rows of its raster, or None.
    pixel_aspect
        Distance of rows over that of columns, where it is stated: 0.5 for diamond pixels.
    """

    position_mm: Quantity | None = None
    mirror: MirrorKnown | None = None
    resolution_px: tuple[int, int] | None = None
    pixel_aspect: float | None = None


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
    axes
        Axes of the projector that the fringes vary along, in the order of the files; empty where none are stated.
        `periods` are then those of the first, in px of the projector.
    maps
        Phase maps that another program made, in place of frames.
    white_paths, white_sha256, black_paths, black_sha256
        Pictures lit evenly, and not at all, by the projector.
    pose
        Name of the pose that the capture shares with others, or the empty text.
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
    axes: tuple[FringeAxis, ...] = ()
    maps: tuple[StatedMap, ...] = ()
    white_paths: tuple[Path, ...] = ()
    white_sha256: tuple[str, ...] = ()
    black_paths: tuple[Path, ...] = ()
    black_sha256: tuple[str, ...] = ()
    pose: str = ""
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
        """Read the frames of one repeat and one fringe period (of the first axis, where there are two)."""
        sets = self.read().reshape(self.repeat * self.n_sets, -1, *self.shape)
        return sets[repeat * self.n_sets + period]

    @property
    def n_sets(self) -> int:
        """Phase-shifted sets of one repeat: a set for each period of each axis."""
        return sum(len(axis.periods_px) for axis in self.axes) if self.axes else max(1, len(self.periods))

    @property
    def files(self) -> tuple[tuple[Path, str], ...]:
        """Every picture file of the capture with its hash."""
        paths = (*self.paths, *self.gray_paths, *self.white_paths, *self.black_paths)
        hashes = (*self.sha256, *self.gray_sha256, *self.white_sha256, *self.black_sha256)
        return (*zip(paths, hashes, strict=True), *((one.path, one.sha256) for one in self.maps))

    @property
    def counted_axes(self) -> tuple[str, ...]:
        """Axes of the projector that frames or maps count its pixels along."""
        return tuple(axis.name for axis in self.axes) or tuple(dict.fromkeys(one.axis for one in self.maps))

    def read_gray(self) -> np.ndarray:
        """Read the Gray-code frames, (N, H, W), the coarsest bit first (of the first axis, where there are two)."""
        return self._gray_frames[: self.axes[0].gray] if self.axes else self._gray_frames

    def along(self, name: str) -> "Capture":
        """Return the capture as one whose fringes vary along one of its axes only; it shares the frames.

        Raises
        ------
        SessionError
            The capture has no such axis.
        """
        names = [axis.name for axis in self.axes]
        if name not in names:
            raise SessionError([f"capture {self.name!r}: no fringes vary along {name}, only along {joined(names)}"])
        k = names.index(name)
        frames, gray = self._frames_of_axis(k), self._gray_of_axis(k)
        return replace(
            self,
            axes=(self.axes[k],),
            periods=self.axes[k].periods_px,
            paths=tuple(self.paths[i] for i in frames),
            sha256=tuple(self.sha256[i] for i in frames),
            gray_paths=self.gray_paths[gray],
            gray_sha256=self.gray_sha256[gray],
            pixels=None if self.pixels is None else self.pixels[frames],
            gray_pixels=None if self.gray_pixels is None else self.gray_pixels[gray],
        )

    def read_light(self, which: Literal["white", "black"]) -> np.ndarray | None:
        """Return the mean of the pictures lit evenly, or not at all, float64, (H, W); None where there are none."""
        paths, hashes = getattr(self, f"{which}_paths"), getattr(self, f"{which}_sha256")
        return self._stack(paths, hashes).mean(axis=0) if paths else None

    def _frames_of_axis(self, k: int) -> list[int]:
        """Return which of the frames belong to an axis."""
        number = np.arange(len(self.paths)).reshape(self.repeat, self.n_sets, -1)
        first = sum(len(axis.periods_px) for axis in self.axes[:k])
        return number[:, first : first + len(self.axes[k].periods_px)].ravel().tolist()

    def _gray_of_axis(self, k: int) -> slice:
        first = sum(axis.gray for axis in self.axes[:k])
        return slice(first, first + self.axes[k].gray)

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
