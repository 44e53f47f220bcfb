"""Files that announce more than they hold, or hold more than they announce: refused, in little memory."""

import functools
import os
import socket
import struct
import subprocess
import sys
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from fringecal.session.faults import PictureError
from fringecal.session.pictures import capture_files
from fringecal.session.pictures.capture_files import expand
from fringecal.session.pictures.picture import decode
from fringecal.session.pictures.size_limits import MOST_BYTES, MOST_PIXELS, check_size, regular_bytes

PASSES = ((0, 0, 8, 8), (4, 0, 8, 8), (0, 4, 4, 8), (2, 0, 4, 4), (0, 2, 2, 4), (1, 0, 2, 2), (0, 1, 1, 2))  # of Adam7


def chunk(kind: bytes, body: bytes) -> bytes:
    return struct.pack(">I", len(body)) + kind + body + struct.pack(">I", zlib.crc32(kind + body))


def png(width: int, height: int, packed: bytes, *, interlaced: int = 0, before: bytes = b"", depth: int = 8) -> bytes:
    header = struct.pack(">IIBBBBB", width, height, depth, 0, 0, 0, interlaced)
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + before + chunk(b"IDAT", packed) + chunk(b"IEND", b"")


@functools.cache
def zeros(count: int) -> bytes:
    """Many zeros, deflated without making them all at once."""
    packer, piece = zlib.compressobj(9), bytes(1 << 20)
    parts = [packer.compress(piece) for _ in range(count >> 20)]
    return b"".join([*parts, packer.flush()])


def jpeg(width: int, height: int, *, frame: int = 0xC0, scans: int = 1, frames: int = 1) -> bytes:
    """A JPEG after ITU-T T.81 whose every scan is 80 zero bytes."""
    tables = b"\xff\xdb" + struct.pack(">H", 67) + b"\0" + bytes([1] * 64)
    start = b"\xff" + bytes([frame]) + struct.pack(">HBHHB", 11, 8, height, width, 1) + b"\1\x11\0"
    codes = b"".join(b"\xff\xc4" + struct.pack(">H", 20) + bytes([kind, 1, *[0] * 15, 0]) for kind in (0, 0x10))
    scan = b"\xff\xda" + struct.pack(">HB", 8, 1) + b"\1\0\0\x3f\0" + bytes(80)
    return b"\xff\xd8" + tables + start * frames + codes + scan * scans + b"\xff\xd9"


def tiff(width: int, height: int, strips: list[tuple[int, int]], *, data: bytes = b"", **changed: int) -> bytes:
    """A little-endian TIFF 6.0 of 8-bit grey; its `data` begin at byte 4096."""
    stated = {"compression": 1, "samples": 1, "rows": height, "next": 0} | changed
    tags: list[tuple[int, list[int]]] = [
        (256, [width]), (257, [height]), (258, [8]), (259, [stated["compression"]]), (262, [1]),
        (273, [at for at, _ in strips]), (277, [stated["samples"]]), (278, [stated["rows"]]),
        (279, [size for _, size in strips]),
    ]  # fmt: skip
    after, entries, values = 10 + 12 * len(tags) + 4, b"", b""
    for tag, numbers in tags:
        raw = struct.pack(f"<{len(numbers)}I", *numbers)
        place = struct.unpack("<I", raw)[0] if len(raw) == 4 else after + len(values)
        values += b"" if len(raw) == 4 else raw
        entries += struct.pack("<HHII", tag, 4, len(numbers), place)
    head = b"II*\0" + struct.pack("<IH", 8, len(tags)) + entries + struct.pack("<I", stated["next"]) + values
    return head.ljust(4096, b"\0") + data


def bmp(width: int, height: int, packing: int) -> bytes:
    header = struct.pack("<IiiHHIIiiII", 40, width, height, 1, 8, packing, 0, 0, 0, 256, 0)
    return (b"BM" + struct.pack("<IHHI", 1100, 0, 0, 1078) + header).ljust(1100, b"\0")


BOMBS: dict[str, Callable[[], bytes]] = {
    "an interlaced PNG of 100 x 100 that unpacks to 256 MiB": lambda: png(100, 100, zeros(256 << 20), interlaced=1),
    "a PNG of 100 x 100 that unpacks to 256 MiB": lambda: png(100, 100, zeros(256 << 20)),
    "a PNG of 16,000 x 16,000 with 16 kB of pixels": lambda: png(16_000, 16_000, zeros(16 << 20)),
    "a PNG of more chunks than any writer makes": lambda: png(9, 9, b"", before=chunk(b"teXt", b"") * 300_000),
    "a JPEG of 32,000 x 32,000 in 220 bytes": lambda: jpeg(32_000, 32_000),
    "the same, coded arithmetically": lambda: jpeg(32_000, 32_000, frame=0xC9),
    "a JPEG of 16,000 x 16,000 in 220 bytes": lambda: jpeg(16_000, 16_000),
    "a progressive JPEG of 5,000 scans": lambda: jpeg(4000, 4000, frame=0xC2, scans=5000),
    "a JPEG of two frames, the second large": lambda: jpeg(64, 64, frames=2),
    "a JPEG that is all fill bytes": lambda: b"\xff\xd8" + b"\xff" * (16 << 20),
    "a TIFF whose strip is nowhere": lambda: tiff(16_000, 16_000, [(0, 0)]),
    "a TIFF whose 16 strips are nowhere": lambda: tiff(2000, 1600, [(0, 0)] * 16, rows=100),
    "a TIFF whose strips are one and the same": lambda: tiff(
        1000, 1000, [(4096, 100_000)] * 10, rows=100, data=bytes(100_000)
    ),
    "a deflated TIFF of 100 x 100 that unpacks to 256 MiB": lambda: tiff(
        100, 100, [(4096, len(zeros(256 << 20)))], data=zeros(256 << 20), compression=8
    ),
    "the same with rows without end": lambda: tiff(
        100, 100, [(4096, len(zeros(256 << 20)))], data=zeros(256 << 20), compression=8, rows=2**32 - 1
    ),
    "a TIFF of 2000 samples": lambda: tiff(9000, 9000, [(4096, 9)], data=bytes(9), samples=2000),
    "a TIFF whose directory follows itself": lambda: tiff(10, 10, [(4096, 100)], data=bytes(100), next=8),
    "a BMP packed by runs": lambda: bmp(1000, 100, 1),
    "a BMP of 16,000 x 16,000 in 1100 bytes": lambda: bmp(16_000, 16_000, 0),
}
ROOM_MIB = 160  # beside what the program takes: 80 for the 262,144 chunks that are read; no bomb fits


def test_bombs_are_refused_in_little_memory(tmp_path: Path) -> None:
    # A process of its own, whose memory the kernel bounds: what is unpacked all the same ends in a MemoryError.
    for number, bomb in enumerate(BOMBS.values()):
        (tmp_path / f"{number:02}").write_bytes(bomb())
    script = f"""
import pathlib, resource, sys
from fringecal.session import PictureError, decode, regular_bytes
used = int(next(line for line in open("/proc/self/status") if line.startswith("VmSize")).split()[1]) << 10
resource.setrlimit(resource.RLIMIT_AS, (used + ({ROOM_MIB} << 20),) * 2)
for file in sorted(pathlib.Path({str(tmp_path)!r}).iterdir()):
    try:
        decode(regular_bytes(file))
        print("read", flush=True)
    except PictureError as error:
        print(error.found, flush=True)
"""
    if not Path("/proc/self/status").exists():
        pytest.skip("no /proc to ask for the memory in use")
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, timeout=60, check=False)
    said = dict(zip(BOMBS, done.stdout.splitlines(), strict=False))
    assert said.keys() == BOMBS.keys(), done.stderr
    assert "read" not in said.values(), said


def test_a_large_picture_of_16_bit_is_read() -> None:
    rows, columns = np.arange(9000, dtype=np.uint16)[:, None], np.arange(12_000, dtype=np.uint16)
    picture = rows * np.uint16(3) + columns
    content = cv2.imencode(".png", picture, [cv2.IMWRITE_PNG_COMPRESSION, 1])[1].tobytes()
    assert np.array_equal(decode(content).pixels, picture)


def test_a_dark_frame_may_be_packed_as_tightly_as_deflate_can() -> None:
    picture = np.zeros((3000, 4000), np.uint16)
    content = cv2.imencode(".png", picture, [cv2.IMWRITE_PNG_COMPRESSION, 9])[1].tobytes()
    assert picture.nbytes > 900 * len(content)  # Deflate's own limit is 1032
    assert decode(content).pixels.shape == picture.shape


@pytest.mark.parametrize("shape", [(1, 1), (2, 3), (5, 4), (9, 17), (64, 33)])
def test_interlaced_pictures_are_read(shape: tuple[int, int]) -> None:
    picture = np.random.default_rng(11).integers(0, 255, shape).astype(np.uint8)
    passes = [picture[y::dy, x::dx] for x, y, dx, dy in PASSES]
    rows = b"".join(b"\0" + row.tobytes() for part in passes if part.size for row in part)
    whole = png(shape[1], shape[0], zlib.compress(rows), interlaced=1)
    assert np.array_equal(decode(whole).pixels, picture)
    with pytest.raises(PictureError, match="bytes of pixels, needed"):
        decode(png(shape[1], shape[0], zlib.compress(rows[:-1]), interlaced=1))


def test_nothing_beside_the_pixels_reaches_the_decoder(monkeypatch: pytest.MonkeyPatch) -> None:
    picture = np.random.default_rng(12).integers(0, 255, (20, 30)).astype(np.uint8)
    rows = zlib.compress(b"".join(b"\0" + row.tobytes() for row in picture))
    beside = chunk(b"iCCP", b"p\0\0" + zeros(16 << 20)) + chunk(b"acTL", struct.pack(">II", 2**31 - 1, 0))
    seen: list[bytes] = []
    decoded: Callable[..., Any] = cv2.imdecode
    monkeypatch.setattr(cv2, "imdecode", lambda data, how: (seen.append(data.tobytes()), decoded(data, how))[1])
    assert np.array_equal(decode(png(30, 20, rows, before=beside)).pixels, picture)
    assert seen == [png(30, 20, rows)]


def test_a_missing_strip_is_not_zeros() -> None:
    rows = np.random.default_rng(13).integers(0, 255, (40, 100)).astype(np.uint8).tobytes()
    whole = [(4096 + 1000 * k, 1000) for k in range(4)]
    assert decode(tiff(100, 40, whole, rows=10, data=rows)).pixels.tobytes() == rows
    with pytest.raises(PictureError, match="3 strips or tiles of pixels, needed 4"):
        decode(tiff(100, 40, [*whole[:2], (0, 0), whole[3]], rows=10, data=rows))
    with pytest.raises(PictureError, match="strip or tile 2 holds 900 bytes of pixels, needed 1000"):
        decode(tiff(100, 40, [whole[0], (5096, 900), *whole[2:]], rows=10, data=rows))


@pytest.mark.parametrize("compression", [5, 32773, 7])
def test_packed_strips_without_their_pixels_are_refused_in_one_line(compression: int) -> None:
    strips = [(4096 + 10 * k, 10) for k in range(10)]
    with pytest.raises(PictureError, match="damaged TIFF: ") as refused:
        decode(tiff(1000, 1000, strips, rows=100, data=bytes(3000), compression=compression))
    assert "\n" not in refused.value.found
    assert "grfmt" not in refused.value.found


def test_decoders_are_heard_whatever_the_environment_asks_for() -> None:
    level = cv2.utils.logging.setLogLevel(0)
    try:
        with pytest.raises(PictureError, match="Not enough data for scanline 0"):
            decode(tiff(1000, 1000, [(4096, 10)], data=bytes(3000), compression=32773))
        assert cv2.utils.logging.getLogLevel() == 0
    finally:
        cv2.utils.logging.setLogLevel(level)


@pytest.mark.parametrize(("size", "depth"), [((1 << 14, 1 << 14), 4), ((14_192, 10_640), 6), ((1 << 28, 1), 1)])
def test_limits_of_size(size: tuple[int, int], depth: int) -> None:
    assert size[0] * size[1] <= MOST_PIXELS
    check_size(*size, depth, MOST_BYTES)
    with pytest.raises(PictureError, match="at most"):
        check_size(size[0], size[1] * 5, depth, MOST_BYTES)


def demand_no_file(path: Path, kind: str) -> None:
    with pytest.raises(PictureError, match=kind):
        regular_bytes(path)


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no named pipes here")
def test_what_is_no_file_is_not_opened(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    with socket.socket(socket.AF_UNIX) as one:
        one.bind(str(tmp_path / "socket"))
        demand_no_file(tmp_path / "pipe", "a pipe, a file was needed")
        demand_no_file(tmp_path / "socket", "a socket")
        demand_no_file(Path("/dev/zero"), "a device")
        demand_no_file(tmp_path, "a folder")
        demand_no_file(tmp_path / ("x" * 300), "cannot be read")
        demand_no_file(tmp_path / "a\0b", "cannot be read")
        paths, faults = expand(tmp_path, ["pipe", "socket", "x" * 300], "images")
    assert not paths
    assert [fault.found.split(" ", 1)[1] for fault in faults[:2]] == [
        "is a pipe, a file was needed", "is a socket, a file was needed",
    ]  # fmt: skip


def test_many_missing_files_are_counted_and_their_folder_is_read_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for number in range(300):
        (tmp_path / f"frame-{number}.tif").touch()
    read: list[Any] = []
    scan: Callable[..., Any] = os.scandir
    monkeypatch.setattr(capture_files.os, "scandir", lambda folder: (read.append(folder), scan(folder))[1])
    paths, faults = expand(tmp_path, [f"frame-{number}.png" for number in range(20_000)], "images")
    assert not paths
    assert len(faults) == 21
    assert 'did you mean "frame-0.tif"?' in str(faults[0])
    assert '"frame-20.png" is not there, and 19979 more are not' in str(faults[-1])
    assert len(read) == 1
    assert "at most 100000" in str(expand(tmp_path, ["a.png"] * 100_001, "images")[1][0])
