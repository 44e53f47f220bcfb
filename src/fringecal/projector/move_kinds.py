"""The moves of a rig's parts that an audit distinguish, and the texts that name them to a reader."""

from enum import Enum


class Move(Enum):
    """One physical thing that moves or changes; the value names it in files and never changes."""

    CAMERA_HEIGHT = "camera height"
    CAMERA_ALONG_X = "camera along x"
    CAMERA_ALONG_Y = "camera along y"
    CAMERA_TILT_X = "camera tilt toward x"
    CAMERA_TILT_Y = "camera tilt toward y"
    CAMERA_ROLL = "camera roll"
    FOCAL_LENGTH = "focal length"
    LENS_DISTORTION = "lens distortion"
    LENS_BLUR = "lens blur"
    PROJECTOR_ALONG_X = "lamp along x"
    PROJECTOR_ALONG_Y = "lamp along y"
    PROJECTOR_ALONG_Z = "lamp along z"
    AIMED_PROJECTOR_ALONG_X = "lamp, kept aimed, along x"
    AIMED_PROJECTOR_ALONG_Y = "lamp, kept aimed, along y"
    AIMED_PROJECTOR_ALONG_Z = "lamp, kept aimed, along z"
    PROJECTOR_TURNED_X = "lamp turned about x"
    PROJECTOR_TURNED_Y = "lamp turned about y"
    PROJECTOR_TURNED_Z = "lamp turned about z"
    SLIDE_PITCH = "slide pitch"
    SLIDE_TURN = "slide turn"
    FRINGE_BLUR = "fringe blur"
    PLATE_TILT_X = "plate tilt toward x"
    PLATE_TILT_Y = "plate tilt toward y"
    PLATE_HEIGHT = "plate height"
    STRIP_HEIGHT = "strip height"
    STRIP_SET_1 = "strip height, set 1"
    STRIP_SET_2 = "strip height, set 2"
    STRIP_SET_3 = "strip height, set 3"
    STRIP_SET_4 = "strip height, set 4"

    @property
    def text(self) -> str:
        """What a reader sees."""
        return MOVE_TEXTS[self]


#: One set of strips after another, each of which can be another than stated.
STRIP_SETS = (Move.STRIP_SET_1, Move.STRIP_SET_2, Move.STRIP_SET_3, Move.STRIP_SET_4)

#: What a reader sees of each, in reports, tables and messages: a text can be changed here and steers nothing.
MOVE_TEXTS: dict[Move, str] = {one: one.value for one in Move}
