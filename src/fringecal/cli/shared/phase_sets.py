"""Where `fringecal phase` finds its sets: a session's captures, a folder of pictures, or pictures by name."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from fringecal.cli.shared.pictures import read_picture
from fringecal.errors import PhaseError
from fringecal.session import FILE_NAME, Capture, FringeAxis, Session, load_session, natural_key
from fringecal.workflows.shared import lit_by_projector

_SENSOR_BITS = (10, 12, 14)  # of cameras whose files have 16

SUFFIXES = (".png", ".tif", ".tiff", ".bmp", ".jpg", ".jpeg")


@dataclass(frozen=True)
class PhaseSet:
    """One phase-shifted set to be demodulated: one period, one repeat."""

    name: str
    frames: np.ndarray
    phase_shifts_rad: np.ndarray
    white_level: float | None
    reference: np.ndarray | None = None
    repeats: np.ndarray | None = None


@dataclass(frozen=True)
class Group:
    """Sets of one scene; with several periods, one set for each, in the order of `periods`; Gray-code frames.

    `extent` is the length of the projected picture in the unit of the periods, where it is stated; `axis` what a
    session states of fringes along an axis of its projector, `lit` where that lights the picture.
    """

    name: str
    sets: tuple[PhaseSet, ...]
    periods: tuple[float, ...] = ()
    gray: np.ndarray | None = None
    extent: float | None = None
    axis: FringeAxis | None = None
    lit: np.ndarray | None = None

    @property
    def absolute(self) -> bool:
        """Whether orders can be decided."""
        return len(self.periods) > 1 or self.gray is not None

    @property
    def counts_by_itself(self) -> bool:
        """Whether fringes are counted over the picture: no projector is stated whose pixels they number."""
        return self.absolute and self.axis is None

    @property
    def projected(self) -> float | None:
        """Return the fringes of the shortest period in the whole projected picture, where its extent is stated."""
        return self.extent / min(self.periods) if self.extent is not None and self.periods else None


@dataclass(frozen=True)
class StatedPeriods:
    """Periods of the fringes in one unit, and the length of the projected picture in the same."""

    lengths: tuple[float, ...] = ()
    extent: float | None = None


@dataclass(frozen=True)
class Stated:
    """What the command line states of pictures that belong to no session."""

    phase_shifts_rad: np.ndarray
    periods: StatedPeriods = StatedPeriods()
    channel: str | None = None
    bits: int | None = None


def session_groups(folder: Path, name: str | None, extent: float | None = None) -> Iterator[Group]:
    """Give every phase-shifted set of a session, or of one of its captures.

    Raises
    ------
    PhaseError
        No such capture, or none that is phase-shifted.
    """
    session = load_session(folder)
    shifted = {key: one for key, one in session.captures.items() if one.phase_shifts_rad}
    if name is not None and name not in shifted:
        known = ", ".join(shifted) or "none"
        raise PhaseError(f"{folder}: no phase-shifted capture is called {name!r}; there are: {known}")
    if not shifted:
        raise PhaseError(f"{folder}: no capture is phase-shifted; state steps_deg and list three frames or more")
    for key in [name] if name is not None else shifted:
        lit = lit_by_projector(shifted[key])
        for one in _by_axis(shifted[key]):
            for group in _capture_groups(one, _reference_of(session, one)):
                yield replace(group, extent=extent, axis=one.axes[0] if one.axes else None, lit=lit)


def _by_axis(capture: Capture) -> Iterator[Capture]:
    """Give a capture once for each axis that its fringes vary along, named by it; as it is where it states none."""
    if not capture.axes:
        yield capture
    for axis in capture.axes:
        yield replace(capture.along(axis.name), name=f"{capture.name}-{axis.name}")


def _reference_of(session: Session, capture: Capture) -> Capture | None:
    """Return the session's picture of the bare plate, or for a plate any other, to compare a capture with."""
    others = [one for one in session.captures.values() if one.name != capture.name and one.phase_shifts_rad]
    same = [
        one
        for one in others
        if one.phase_shifts_rad == capture.phase_shifts_rad
        and (one.periods, one.axes[:1]) == (capture.periods, capture.axes)
    ]
    plates = [one for one in same if one.kind == "reference"]
    # A plate's own frames in another order show against anything else that the rig has taken.
    if capture.kind == "reference" and same:
        return same[0]
    return plates[0] if len(plates) == 1 else None


def _capture_groups(capture: Capture, plate: Capture | None) -> Iterator[Group]:
    """Give one group for each repeat of a capture, with one set for each fringe period."""
    for repeat in range(capture.repeat):
        name = capture.name + (f"-repeat{repeat + 1}" if capture.repeat > 1 else "")
        periods = range(max(1, len(capture.periods)))
        gray = capture.read_gray() if capture.gray_paths else None
        yield Group(name, tuple(_capture_set(capture, plate, repeat, k) for k in periods), capture.periods, gray)


def _capture_set(capture: Capture, plate: Capture | None, repeat: int, period: int) -> PhaseSet:
    """Read the set of one period and one repeat."""
    name = capture.name
    name += f"-period{period + 1}" if len(capture.periods) > 1 else ""
    name += f"-repeat{repeat + 1}" if capture.repeat > 1 else ""
    frames = capture.read_set(repeat=repeat, period=period)
    bare = plate.read_set(period=period) if plate is not None else None
    if bare is not None and bare.shape != frames.shape:
        bare = None
    again = _repeats_of(capture, period) if repeat == 0 else None
    return PhaseSet(name, frames, np.asarray(capture.phase_shifts_rad), capture.white_level, bare, again)


def _repeats_of(capture: Capture, period: int) -> np.ndarray | None:
    """Return all repeats of one fringe period, (R, N, H, W), where there are several."""
    if capture.repeat < 2:
        return None
    return np.stack([capture.read_set(repeat=k, period=period) for k in range(capture.repeat)])


def holds_session(folder: Path) -> bool:
    """Tell whether a folder is a session."""
    return (folder / FILE_NAME).exists()


def pictures_of(folder: Path) -> list[Path]:
    """Return the pictures of a folder in natural order.

    Raises
    ------
    PhaseError
        There are none.
    """
    found = [path for path in folder.iterdir() if path.suffix.lower() in SUFFIXES]
    if not found:
        raise PhaseError(f"{folder}: neither {FILE_NAME} nor pictures ({', '.join(SUFFIXES)}) are in this folder")
    return sorted(found, key=lambda path: natural_key(path.name))


def saturation_level(frames: np.ndarray, bits: int | None) -> float | None:
    """Return the grey level of saturated pixels: of the bits stated, or as values of 10 to 14 bits in 16 show it.

    Bits shifted to the left leave the lowest idle; unshifted ones show where the highest is their largest number.
    None leaves it to the numbers' type.

    Raises
    ------
    PhaseError
        Values that the stated bits cannot make.
    """
    if frames.dtype != np.uint16:
        return None
    peak, idle = int(frames.max()), int(np.bitwise_or.reduce(frames, axis=None))
    left = next((n for n in _SENSOR_BITS if idle and idle % (1 << (16 - n)) == 0), None)
    if bits is None:
        bits = left or next((n for n in _SENSOR_BITS if peak == (1 << n) - 1), None)
    if bits is None:
        return None
    if peak < 1 << bits:
        return float((1 << bits) - 1)
    if idle % (1 << (16 - bits)) == 0 or bits == 16:  # noqa: PLR2004 -- bits of the files
        return float((1 << 16) - (1 << (16 - bits)))
    raise PhaseError(
        f"--bits {bits} allows values up to {(1 << bits) - 1}, or multiples of {1 << (16 - bits)} where they are "
        f"shifted to the left; found {peak} and others in between"
    )


def picture_group(paths: Sequence[Path], stated: Stated) -> Group:
    """Read pictures that belong to no session: all frames of the first period, then of the next.

    Raises
    ------
    PhaseError
        Not as many pictures as phase shifts and periods need, or pictures of different size or depth.
    SessionError
        A picture that cannot be read.
    """
    pictures = [read_picture(path, stated.channel) for path in paths]
    n_steps, n_sets = len(stated.phase_shifts_rad), max(1, len(stated.periods.lengths))
    if len(paths) != n_steps * n_sets:
        names = ", ".join(path.name for path in paths[:12]) + (", ..." if len(paths) > 12 else "")
        raise PhaseError(
            f"found {len(paths)} pictures ({names}) for {n_steps} phase shifts"
            + (f" and {n_sets} periods" if n_sets > 1 else "")
            + f"; needed: {n_steps * n_sets}, one frame per phase shift"
            + (" of each period" if n_sets > 1 else "")
            + ". Name the pictures of the set only, in the order of its phase shifts."
        )
    if len({(grey.shape, grey.dtype.str) for grey in pictures}) > 1:
        sizes = ", ".join(f"{p.name} {g.shape[::-1]} {g.dtype}" for p, g in zip(paths, pictures, strict=True))
        raise PhaseError(f"the pictures of one set must have one size and depth; found {sizes}")
    name = paths[0].stem
    frames = np.stack(pictures).reshape(n_sets, n_steps, *pictures[0].shape)
    labels = [name + (f"-period{k + 1}" if n_sets > 1 else "") for k in range(n_sets)]
    white = saturation_level(frames, stated.bits)
    sets = (PhaseSet(label, part, stated.phase_shifts_rad, white) for label, part in zip(labels, frames, strict=True))
    return Group(name, tuple(sets), stated.periods.lengths, extent=stated.periods.extent)
