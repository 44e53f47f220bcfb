"""Pictures named on the command line, read as grey; of colour pictures the channel that shows most."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import typer

from fringecal.detect import pattern_contrast
from fringecal.errors import SessionError
from fringecal.session import Picture, PictureError, decode, regular_bytes, to_grey

CHANNELS = ("mean", "red", "green", "blue", "luma")
# One channel has more noise than luma, which is a mean: it is taken where its pattern stands out by so much more.
_CLEARLY_MORE = 1.2


def read_picture(path: Path, channel: str | None = "luma") -> np.ndarray:
    """Read one picture; colour becomes luma, or what `channel` says; with None colour is refused.

    Raises
    ------
    SessionError
        The file is no picture that can be read.
    """
    return _grey(path, _decoded(path, picture_bytes(path)), channel)


def demand_channel(channel: str | None) -> None:
    """Refuse a channel that there is not."""
    if channel is not None and channel not in CHANNELS:
        raise typer.BadParameter(f"{channel!r} is none of {', '.join(CHANNELS)}", param_hint="--channel")


def picture_bytes(path: Path) -> bytes:
    """Read a picture's file: once, so that what is hashed is what is used.

    Raises
    ------
    SessionError
        It cannot be read.
    """
    try:
        return regular_bytes(path)
    except PictureError as error:
        raise SessionError([f"{path}: {error}"]) from error


def read_channels(
    paths: Sequence[Path], channel: str | None, contents: Sequence[bytes] = ()
) -> list[tuple[str | None, list[np.ndarray]]]:
    """Read pictures as grey by the stated channel, or by each that is worth trying, the one that shows most first.

    Parameters
    ----------
    paths
        The files.
    channel
        Which channel of colour pictures; None for the best.
    contents
        Their bytes, if they were read before (`picture_bytes`).

    Returns
    -------
    list of (str or None, list of numpy.ndarray)
        Name of the channel, None where all pictures are grey, and the pictures by it, (H, W) each.

    Raises
    ------
    SessionError
        A file is no picture that can be read.
    """
    contents = contents or [picture_bytes(path) for path in paths]
    pictures = [_decoded(path, content) for path, content in zip(paths, contents, strict=True)]
    if not any(picture.is_colour for picture in pictures):
        return [(None, [picture.pixels for picture in pictures])]
    wanted = ("luma", "red", "green", "blue") if channel is None else (channel,)
    read = [(name, [_grey(path, one, name) for path, one in zip(paths, pictures, strict=True)]) for name in wanted]
    best_first = sorted(read, key=lambda each: _shown(*each), reverse=True) if channel is None else read
    return [(name, greys) for name, greys in best_first]


def channel_sentence(name: str, stated: str | None) -> str:
    """Say which channel of a colour picture was taken, and why."""
    if stated is not None:
        return f"colour picture: {name}, as stated"
    return f"colour picture: {name} was taken, which shows most of the pattern; --channel chooses another"


def _shown(name: str, pictures: list[np.ndarray]) -> float:
    """Return how much the pattern stands out; luma is preferred to single channels."""
    return sum(pattern_contrast(grey) for grey in pictures) * (_CLEARLY_MORE if name == "luma" else 1.0)


def _decoded(path: Path, content: bytes) -> Picture:
    """Decode the bytes of a picture file."""
    try:
        return decode(content)
    except PictureError as error:
        raise SessionError([f"{path}: {error}"]) from error


def _grey(path: Path, picture: Picture, channel: str | None) -> np.ndarray:
    """Reduce a picture to grey."""
    try:
        return to_grey(picture.pixels, channel if picture.is_colour else None, 2**picture.bits - 1)
    except PictureError as error:
        raise SessionError([f"{path}: {error}"]) from error
