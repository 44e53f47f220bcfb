"""What can be wrong with phase-shifted frames, and the texts that name it to a reader."""

from enum import Enum


class FindingKind(Enum):
    """One thing that can be wrong; the value names it in files and never changes."""

    STALE_FRAME = "stale frame"
    DUPLICATE_FRAMES = "duplicate frames"
    SWAPPED_FRAMES = "swapped frames"
    ANOTHER_PERIOD = "frame of another period"
    FOREIGN_FRAME = "foreign frame"
    SATURATION = "saturation"
    LAMP_DRIFT = "lamp drift"
    VIBRATION = "vibration"
    VIBRATION_BETWEEN_REPEATS = "vibration between repeats"
    CLIPPED_SLIDE = "clipped slide"
    GAMMA = "gamma"
    THIRD_HARMONIC = "third harmonic"
    DEFOCUS = "defocus"
    WRONG_PHASE_SHIFTS = "wrong steps"
    UNEVEN_PHASE_SHIFTS = "uneven steps"
    SHORT_FRINGES = "too few pixels per fringe"
    LONG_FRINGES = "too many pixels per fringe"
    COMPRESSED = "compressed frames"

    @property
    def fatal(self) -> bool:
        """Whether no correction removes it: all else that is measured from the frames' differences is meaningless."""
        return self in _FATAL

    @property
    def text(self) -> str:
        """What a reader sees."""
        return FINDING_TEXTS[self]


_FATAL = frozenset(
    {
        FindingKind.STALE_FRAME,
        FindingKind.DUPLICATE_FRAMES,
        FindingKind.SWAPPED_FRAMES,
        FindingKind.ANOTHER_PERIOD,
        FindingKind.FOREIGN_FRAME,
    }
)

#: What a reader sees of each, in reports, tables and messages: a text can be changed here and steers nothing.
FINDING_TEXTS: dict[FindingKind, str] = {one: one.value for one in FindingKind} | {
    FindingKind.WRONG_PHASE_SHIFTS: "wrong phase shifts",
    FindingKind.UNEVEN_PHASE_SHIFTS: "uneven phase shifts",
}
