"""Read one grey or RGB picture from a TIFF file."""

import io
import logging
import zlib

import numpy as np
import tifffile

from fringecal.session.faults import PictureError
from fringecal.session.pictures.containers import Container
from fringecal.session.pictures.png_chunks import unpacked_size
from fringecal.session.pictures.size_limits import check_size

_MAX_SAMPLE_VALUE, _WHITE_LEVEL, _ORIENTATION = 281, 50717, 274
_MIN_IS_WHITE, _MIN_IS_BLACK, _RGB = 0, 1, 2
# Compressions: none, Deflate (its two numbers), and those that OpenCV's libtiff undoes by rows: LZW, JPEG, PackBits.
_PLAIN, _DEFLATE, _BY_LIBTIFF = 1, (8, 32946), (5, 7, 32773)
_BY_PLANES = 2  # each channel in strips or tiles of its own
_MOST_SEGMENTS = 1 << 18  # strips or tiles: 16 times the rows of the tallest square picture that is read

# tifffile logs what it repairs; a repaired file is refused here, so the log would only repeat it.
logging.getLogger("tifffile").addHandler(logging.NullHandler())


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
        If the file is truncated, has several pages, a palette, floats, or odd bit depths, lacks pixels, or is larger
        than what is read.
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
    page = file.pages[0]
    # Before pages are counted: a chain of a million directories takes minutes to follow.
    _check_sizes(page, len(data))
    if _has_second(file):
        raise PictureError("several pages in one TIFF", "save one picture per file")
    if page.bitspersample not in (8, 16) or page.sampleformat != 1:
        raise PictureError(
            f"samples of {page.bitspersample} bit, format {page.sampleformat}; needed unsigned, 8 or 16 bit",
            "save the camera's picture unreduced, 10 to 14 bit in a 16-bit file",
        )
    if page.photometric not in (_MIN_IS_WHITE, _MIN_IS_BLACK, _RGB):
        raise PictureError(f"colours of kind {page.photometric!s}", "save as grey or RGB")
    if page.compression not in (_PLAIN, *_DEFLATE, *_BY_LIBTIFF):
        raise PictureError(f"a TIFF packed in way {page.compression!s}", "save it unpacked, by LZW or by Deflate")
    _check_segments(page, data)
    return None if page.compression in _BY_LIBTIFF else _pixels(page), _container(page)


def _has_second(file: tifffile.TiffFile) -> bool:
    try:
        file.pages[1]
    except IndexError:
        return False
    return True


def _check_sizes(page: tifffile.TiffPage, packed: int) -> None:
    """Judge the picture and its strips or tiles by their sizes in the header."""
    if page.imagedepth != 1 or page.tiledepth != 1:
        raise PictureError(f"a TIFF of depth {page.imagedepth}", "save one picture per file")
    bytes_per_pixel = page.samplesperpixel * -(-page.bitspersample // 8)
    check_size(page.imagewidth, page.imagelength, bytes_per_pixel, packed)
    if page.is_tiled:
        check_size(page.tilewidth, page.tilelength, bytes_per_pixel, packed)
    if len(page.dataoffsets) > _MOST_SEGMENTS:
        found = f"a TIFF of {len(page.dataoffsets)} strips or tiles, at most {_MOST_SEGMENTS} are read"
        raise PictureError(found, "save it in larger ones")


def _check_segments(page: tifffile.TiffPage, data: bytes) -> None:
    """See that every strip or tile is in the file, and holds as many bytes as its pixels need."""
    segments = list(zip(page.dataoffsets, page.databytecounts, strict=True))
    end = max((at + n for at, n in segments), default=0)
    if end > len(data):
        raise PictureError(f"truncated TIFF: {len(data)} bytes, needed {end}")
    needed, whole = _needed_bytes(page)
    there = sum(at > 0 and n > 0 for at, n in segments)
    if len(segments) != len(needed) or there != len(needed):
        raise PictureError(f"damaged TIFF: {there} strips or tiles of pixels, needed {len(needed)}")
    if sum(n for _, n in segments) > len(data):
        raise PictureError("damaged TIFF: its strips or tiles overlap")
    view = memoryview(data)
    for number, ((at, n), least) in enumerate(zip(segments, needed, strict=True)):
        wrong = _wrong_size(page, view[at : at + n], least, whole)
        if wrong:
            found = f"strip or tile {number + 1} holds {wrong} bytes of pixels, needed {least}"
            raise PictureError(f"damaged TIFF: {found}")


def _wrong_size(page: tifffile.TiffPage, packed: memoryview, least: int, whole: int) -> str:
    """Say what a strip or tile holds where that is not what it needs; of LZW, JPEG, PackBits libtiff judges."""
    if page.compression in _DEFLATE:
        found = unpacked_size(zlib.decompressobj(), packed, whole)
        return f"more than {whole}" if found > whole else (str(found) if found < least else "")
    return str(len(packed)) if page.compression == _PLAIN and len(packed) < least else ""


def _needed_bytes(page: tifffile.TiffPage) -> tuple[list[int], int]:
    """Bytes of pixels in every strip or tile, and in a whole one; a plane's last strip has the rows that are left."""
    planes = page.samplesperpixel if page.planarconfig == _BY_PLANES else 1
    pixel = page.bitspersample // 8 * (page.samplesperpixel // planes)
    if page.is_tiled:
        whole = page.tilewidth * page.tilelength * pixel
        across, down = -(-page.imagewidth // page.tilewidth), -(-page.imagelength // page.tilelength)
        return [whole] * (across * down * planes), whole
    rows, row = min(page.rowsperstrip, page.imagelength), page.imagewidth * pixel
    strips = [row * min(rows, page.imagelength - first) for first in range(0, page.imagelength, rows)]
    return strips * planes, row * rows


def _pixels(page: tifffile.TiffPage) -> np.ndarray:
    pixels = page.asarray()
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
