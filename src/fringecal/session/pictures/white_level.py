"""The white level of a capture: at which value its camera saturates, and who says so."""

from collections.abc import Sequence
from dataclasses import dataclass

from fringecal.session.faults import Fault
from fringecal.session.pictures.capture_files import FrameFacts

# Machine-vision cameras deliver 10, 12 or 14 bits; shifted to the left in 16 they leave these bits idle.
_SENSOR_BITS = (10, 12, 14)
_IDLE_BITS = (6, 4, 2)


@dataclass(frozen=True)
class WhiteLevel:
    """Value of a saturated pixel, with what was wrong or worth a remark in finding it."""

    value: int
    faults: tuple[Fault, ...] = ()
    notes: tuple[str, ...] = ()


def white_level(frames: Sequence[FrameFacts], bits: int | None, label: str) -> WhiteLevel:
    """Find the white level from stated bits, else from the files, else from the container's range.

    Parameters
    ----------
    frames
        Facts of all its pictures; without any, the level is that of 8 bit.
    bits
        Bits per pixel that `session.toml` states, or None.
    label
        How messages name the capture.
    """
    container_bits = max((frame.bits for frame in frames), default=8)
    if not frames:
        return WhiteLevel(255)
    if bits is not None:
        return _from_bits(frames, bits, container_bits, label)
    stated = {frame.container.white_level for frame in frames}
    if stated != {None}:
        return _from_files(stated, container_bits, label)
    return _from_values(frames, container_bits, label)


def _from_bits(frames: Sequence[FrameFacts], bits: int, container_bits: int, label: str) -> WhiteLevel:
    value = (1 << bits) - 1
    peak = max(frame.peak for frame in frames)
    if bits > container_bits:
        fault = Fault(label, f"bits = {bits}, but the files have {container_bits} bit", "correct bits")
    elif peak > value:
        remedy = "correct bits; if the values are shifted to the left, leave bits out"
        fault = Fault(label, f"bits = {bits} allows values up to {value}, found {peak}", remedy)
    else:
        return WhiteLevel(value)
    return WhiteLevel((1 << container_bits) - 1, (fault,))


def _from_files(stated: set[int | None], container_bits: int, label: str) -> WhiteLevel:
    if len(stated) == 1:
        return WhiteLevel(next(value for value in stated if value is not None))
    levels = ", ".join("none" if value is None else str(value) for value in sorted(stated, key=lambda v: v or 0))
    fault = Fault(label, f"the files state different white levels: {levels}", "state bits in the capture")
    return WhiteLevel((1 << container_bits) - 1, (fault,))


def _from_values(frames: Sequence[FrameFacts], container_bits: int, label: str) -> WhiteLevel:
    full = (1 << container_bits) - 1
    peak = max(frame.peak for frame in frames)
    if container_bits == 8 or peak == 0:
        return WhiteLevel(full)
    used = 0
    for frame in frames:
        used |= frame.used_bits
    idle = next((n for n in _IDLE_BITS if used % (1 << n) == 0), 0)
    if idle:
        value = full - ((1 << idle) - 1)
        note = f"{label}: all values are multiples of {1 << idle}: read as {16 - idle} bit shifted to the left"
        return WhiteLevel(value, notes=(f"{note}, white level {value}",))
    fitting = next((n for n in _SENSOR_BITS if peak < 1 << n), None)
    if fitting is None:
        return WhiteLevel(full)
    note = f"{label}: no value above {peak} in 16-bit files; if the camera has {fitting} bit, state it"
    return WhiteLevel(full, notes=(f"{note}: bits = {fitting}, or saturation is not seen",))
