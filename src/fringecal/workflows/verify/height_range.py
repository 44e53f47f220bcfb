"""Between which heights a surface with an artefact on the plate is looked for: one rule for bars and all others."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Headroom:
    """Room beside an artefact's own heights, below the plate and above its top.

    A fringe order is only ruled out by heights that nothing in the picture can have: too little room would rule out
    what a rig that reads heights wrongly must be shown to read, too much leaves several orders open.

    Parameters
    ----------
    share
        Of the artefact's height.
    least_mm
        For artefacts that have next to no height, as a flat on the plate.
    """

    share: float = 0.35
    least_mm: float = 3.0


HEADROOM = Headroom()


def with_headroom(tallest_mm: float, headroom: Headroom = HEADROOM) -> tuple[float, float]:
    """Return the lowest and the highest height, mm, of a surface that holds an artefact of that height.

    Examples
    --------
    >>> with_headroom(20.0), with_headroom(0.0)
    ((-7.0, 27.0), (-3.0, 3.0))
    """
    room = max(headroom.share * tallest_mm, headroom.least_mm)
    return -room, tallest_mm + room
