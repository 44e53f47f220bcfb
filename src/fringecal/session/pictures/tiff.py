"""Read one grey or RGB picture from a TIFF file."""

import io
import logging

import numpy as np
import tifffile

from fringecal.session.faults import PictureError
from fringecal.session.pictures.containers import Container, check_size

_MAX_SAMPLE_VALUE, _WHITE_LEVEL, _ORIENTATION = 281, 50717, 274
_MIN_IS_WHITE, _MIN_IS_BLACK, _RGB = 0, 1, 2
_PACKED_BY_NEED_OF_A_CODEC = "imagecodecs"

# tifffile logs what it repairs; a repaired file is refused here, so the log would only repeat it.
logging.getLogger("tifffile").addHandler(logging.NullHandler())


class NeedsCodec(PictureError):
    """A compression that tifffile alone cannot undo."""


def read_tiff(data: bytes) -> tuple[np.ndarray | None, Container]:
    """Decode a TIFF of one page.

    Returns
    -------
    pixels
        (H, W) or (H, W, C), uint8 or uint16; None when its compression needs another decoder.
    container
        What the file states; `MaxSampleValue` and DNG's `WhiteLevel` count as a stated white level.

    Raises
    ------
    PictureError
        If the file is truncated, has several pages, a palette, floats, or odd bit depths.
    """
    # A damaged directory makes tifffile raise errors of nearly every builtin kind.
    try:
        with tifffile.TiffFile(io.BytesIO(data)) as file:
            return _read_page(file, data)
    except PictureError:
        raise
    except Exception as error:
        raise PictureError(f"damaged TIFF: {error}") from error


def _read_page(file: tifffile.TiffFile, data: bytes) -> tuple[np.ndarray | None, Container]:
    if len(file.pages) != 1:
        raise PictureError(f"{len(file.pages)} pages in one TIFF", "save one picture per file")
    page = file.pages[0]
    check_size(page.imagewidth, page.imagelength)
    if page.bitspersample not in (8, 16) or page.sampleformat != 1:
        raise PictureError(
            f"samples of {page.bitspersample} bit, format {page.sampleformat}; needed unsigned, 8 or 16 bit",
            "save the camera's picture unreduced, 10 to 14 bit in a 16-bit file",
        )
    if page.photometric not in (_MIN_IS_WHITE, _MIN_IS_BLACK, _RGB):
        raise PictureError(f"colours of kind {page.photometric!s}", "save as grey or RGB")
    end = max((at + n for at, n in zip(page.dataoffsets, page.databytecounts, strict=True)), default=0)
    if end > len(data):
        raise PictureError(f"truncated TIFF: {len(data)} bytes, needed {end}")
    return _pixels(page), _container(page)


def _pixels(page: tifffile.TiffPage) -> np.ndarray | None:
    try:
        pixels = page.asarray()
    except ValueError as error:
        if _PACKED_BY_NEED_OF_A_CODEC in str(error):
            return None
        raise
    if page.axes == "SYX":
        pixels = np.moveaxis(pixels, 0, -1)
    if page.photometric == _MIN_IS_WHITE:
        pixels = np.iinfo(pixels.dtype).max - pixels
    return pixels


def _container(page: tifffile.TiffPage) -> Container:
    full = (1 << page.bitspersample) - 1
    stated = [_number(page, tag) for tag in (_WHITE_LEVEL, _MAX_SAMPLE_VALUE)]
    white = next((value for value in stated if value is not None and 0 < value < full), None)
    return Container("TIFF", white, _number(page, _ORIENTATION) or 1)


def _number(page: tifffile.TiffPage, tag: int) -> int | None:
    if tag not in page.tags:
        return None
    value = page.tags[tag].value
    return int(value[0] if isinstance(value, tuple) else value)
