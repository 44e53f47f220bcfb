"""Walk a JPEG before it is decoded: its one frame, its scans, its end mark (ITU-T T.81, annex B)."""

import re
from collections.abc import Iterator

from fringecal.session.faults import PictureError
from fringecal.session.pictures.containers import Container, exif_orientation
from fringecal.session.pictures.size_limits import check_size

_SCAN, _APP1, _END = 0xDA, 0xE1, 0xD9
_READ_FRAMES = (0xC0, 0xC1, 0xC2)  # baseline, extended and progressive, coded by Huffman's tables
_NO_FRAMES = (0xC4, 0xC8, 0xCC)  # of 0xC0 to 0xCF: tables, and one that is kept free
_BARE = (0x01, *range(0xD0, 0xD9))  # markers without a length
# A marker is bytes 0xFF and one that is neither 0xFF nor, within a scan, a stuffed 0 or the number of a restart.
_MARKER = re.compile(rb"\xff+([^\xff])", re.DOTALL)
_MARKER_IN_SCAN = re.compile(rb"\xff+([^\x00\xff\xd0-\xd7])", re.DOTALL)
# libjpeg's own scripts have 10 scans, the finest splits some 20; each one goes over the whole picture.
_MOST_SCANS = 50
_MOST_SEGMENTS = 1 << 16  # a profile of 4 GiB fits in so many
_FRAME_SIZE = 6  # bytes of a frame's header before its channels


def inspect_jpeg(data: bytes) -> Container:
    """Walk the segments of a JPEG and see that it holds one picture of a size that is read, and ends.

    Raises
    ------
    PictureError
        It does not.
    """
    orientation, frames, scans = 1, 0, 0
    for count, (marker, body) in enumerate(_segments(data)):
        if marker == _APP1 and body.startswith(b"Exif\0\0"):
            orientation = exif_orientation(body[6:])
        elif 0xC0 <= marker <= 0xCF and marker not in _NO_FRAMES:
            _check_frame(marker, body, len(data))
            frames += 1
        scans += marker == _SCAN
        if scans > _MOST_SCANS or count > _MOST_SEGMENTS:
            what = f"{_MOST_SCANS} scans" if scans > _MOST_SCANS else f"{_MOST_SEGMENTS} segments"
            raise PictureError(f"a JPEG of more than {what}", "save it again as PNG or TIFF")
        if marker == _SCAN and frames != 1:
            raise PictureError(f"damaged JPEG: {frames} frame headers before its pixels, needed one")
    if not scans:
        raise PictureError(f"truncated JPEG: {len(data)} bytes, and no picture in them")
    return Container("JPEG", orientation=orientation)


def _segments(data: bytes) -> Iterator[tuple[int, bytes]]:
    """Yield marker and content of every segment to the end mark."""
    at, in_scan = 2, False
    while found := (_MARKER_IN_SCAN.search(data, at) if in_scan else _MARKER.match(data, at)):
        marker, at = found[1][0], found.end()
        if marker == _END:
            return
        length = 0 if marker in _BARE else max(2, int.from_bytes(data[at : at + 2]))
        if at + length > len(data):
            break
        yield marker, data[at + 2 : at + length]
        at += length
        in_scan = marker == _SCAN or (in_scan and marker in _BARE)
    if not in_scan and at + 2 < len(data):
        raise PictureError(f"damaged JPEG: no marker at byte {at}")
    raise PictureError(f"truncated JPEG: {len(data)} bytes, and the end mark is missing")


def _check_frame(marker: int, body: bytes, packed: int) -> None:
    if marker not in _READ_FRAMES:
        raise PictureError(f"a JPEG of coding {marker - 0xC0}", "save it as PNG or TIFF")
    if len(body) < _FRAME_SIZE:
        raise PictureError("damaged JPEG: its frame header is cut short")
    check_size(int.from_bytes(body[3:5]), int.from_bytes(body[1:3]), body[5], packed)
