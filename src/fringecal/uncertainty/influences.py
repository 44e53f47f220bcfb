"""The influence quantities that a measurement's uncertainty comes from, and the texts that name them to a reader.

An `Influence` is known to programs by its member and to files by its value, which never changes: old records must open.
What a reader sees stands in `TEXTS` alone and steers nothing.
"""

from dataclasses import dataclass
from enum import Enum


class Influence(Enum):
    """An influence quantity (JCGM 200:2012, 2.52); the value names it in files."""

    PHASE_SCATTER = "phase scatter"
    PIXEL_PHASE = "phase of one pixel"
    EXTRAPOLATION = "extrapolation beyond"
    GRID_PITCH = "grid pitch"
    GRID_CROSSINGS = "grid crossings"
    CAMERA_HEIGHT = "camera height"
    PRINCIPAL_POINT_U = "principal point, u"
    PRINCIPAL_POINT_V = "principal point, v"
    CAMERA_TILT_X = "camera tilt, x"
    CAMERA_TILT_Y = "camera tilt, y"
    LENS = "lens"
    STRIP_HEIGHT = "strip height"
    STRIP_PAINT = "paint of the strips"
    STRIP_SEATING = "seating of the strips"
    STRIP_PARALLELISM = "parallelism of the strips"
    TRANSLUCENCY = "depth of light in strips"
    INSTRUMENT = "calibration of the instrument"
    TEMPERATURE = "temperature of the artefacts"
    STEP_HEIGHT = "step height"
    BOX_HEIGHT = "box height"
    FLAT_HEIGHT = "flat height"
    WEDGE_ANGLE = "wedge angle"
    WEDGE_POSITION = "wedge position"
    ADDED_HEIGHT = "added height"
    PLATE_FLATNESS = "flatness of the plate"
    ARTEFACT_SCATTER = "scatter over the artefact"
    BREAK_SCATTER = "scatter of the breaks"
    BOARD_RIG = "rig by its board"
    KNOWN_BIAS = "known bias"
    INPUT = "input"

    @property
    def text(self) -> str:
        """What a reader sees."""
        return TEXTS[self]


#: What a reader sees of each, in reports, tables and messages: a text can be changed here and steers nothing.
TEXTS: dict[Influence, str] = {one: one.value for one in Influence} | {
    Influence.KNOWN_BIAS: "known bias of filters and height model, not corrected",
    Influence.INPUT: "",
}


@dataclass(frozen=True)
class Source:
    """Where an uncertainty comes from: an influence and, where there are several of its kind, which one.

    Parameters
    ----------
    influence
        The influence quantity.
    detail
        Which of several: the number of a lens parameter, an artefact's name, the height beyond which is extrapolated;
        for `Influence.INPUT`, an input of one's own model, its label.

    Examples
    --------
    >>> Source(Influence.LENS, "2").identifier, Source.parse("lens 2")
    ('lens 2', Source(influence=<Influence.LENS: 'lens'>, detail='2'))
    """

    influence: Influence
    detail: str = ""

    @property
    def identifier(self) -> str:
        """How files name it; `parse` reads it back."""
        return f"{self.influence.value} {self.detail}".rstrip()

    @property
    def text(self) -> str:
        """What a reader sees."""
        return f"{self.influence.text} {self.detail}".strip()

    @classmethod
    def parse(cls, identifier: str) -> "Source":
        """Read what `identifier` has written.

        Raises
        ------
        ValueError
            No influence is called so.
        """
        named = [one for one in Influence if f"{identifier} ".startswith(f"{one.value} ")]
        if not named:
            known = ", ".join(repr(one.value) for one in Influence)
            raise ValueError(f"{identifier!r} names no influence; known: {known}")
        influence = max(named, key=lambda one: len(one.value))
        return cls(influence, identifier[len(influence.value) :].strip())
