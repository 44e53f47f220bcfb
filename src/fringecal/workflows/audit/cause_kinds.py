"""The single causes that an audit tells apart, and the texts that name them to a reader."""

from enum import Enum


class Cause(Enum):
    """What may have changed a rig by itself; the value names it in files and never changes."""

    CAMERA_HEIGHT = "camera height changed"
    CAMERA_PLACE = "camera shifted or turned"
    CAMERA_LENS = "camera lens refocused"
    PROJECTOR_PLACE = "lamp moved"
    PROJECTOR_TURNED = "projector or mirror turned"
    SLIDE_PITCH = "slide pitch changed"
    SLIDE_TURNED = "slide turned"
    PROJECTOR_LENS = "projector refocused"
    PLATE_TILTED = "plate tilted"
    PLATE_RAISED = "plate raised or lowered"
    STRIPS = "strips not as high as stated"

    @property
    def text(self) -> str:
        """What a reader sees."""
        return CAUSE_TEXTS[self]


#: What a reader sees of each, in reports, tables and messages: a text can be changed here and steers nothing.
CAUSE_TEXTS: dict[Cause, str] = {one: one.value for one in Cause} | {Cause.PROJECTOR_PLACE: "projector moved"}
