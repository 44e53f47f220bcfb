"""One picture named on the command line, read as grey."""

from pathlib import Path

import numpy as np

from fringecal.errors import SessionError
from fringecal.session import PictureError, decode, read_bytes, to_grey


def read_picture(path: Path, channel: str | None = "luma") -> np.ndarray:
    """Read one picture; colour becomes luma, or what `channel` says; with None colour is refused.

    Raises
    ------
    SessionError
        The file is no picture that can be read.
    """
    try:
        picture = decode(read_bytes(path))
        return to_grey(picture.pixels, channel if picture.pixels.ndim == 3 else None, 2**picture.bits - 1)
    except PictureError as error:
        raise SessionError([f"{path}: {error}"]) from error
