"""Sound sessions of every kind of file: the values read are those that were written."""

import hashlib
import io
import math
import struct
import zlib
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import tifffile

from fringecal.errors import SessionError
from fringecal.session import Capture, check_session, load_session
from fringecal.session.pictures.picture import decode, to_grey

Bench = Any  # the fixture of conftest.py
DATA = Path(__file__).parents[1] / "data"


def bars(bench: Bench, contents: list[bytes], ending: str, **keys: Any) -> Capture:
    """Give the bars other files and load them."""
    for k, content in enumerate(contents):
        bench.put(f"bars-{k}.{ending}", content)
    bench.capture("bars").update(images=[f"bars-{k}.{ending}" for k in range(len(contents))], **keys)
    bench.save()
    return load_session(bench.folder).named("bars")


def tiff(frame: np.ndarray, **keys: Any) -> bytes:
    file = io.BytesIO()
    tifffile.imwrite(file, frame, **keys)
    return file.getvalue()


def wide(seed: int, bits: int, *, shift: int = 0) -> np.ndarray:
    """A 16-bit frame of random values of so many bits."""
    values = np.random.default_rng(seed).integers(0, 1 << bits, (40, 48), dtype=np.uint16)
    return values << shift


def test_everything_stated_is_read(bench: Bench) -> None:
    bench.document.update(operator="ab", temperature_degC=20.5, minutes_since_power_on=45)
    bench.save()
    session = load_session(bench.folder)
    assert (session.rig, session.operator, session.temperature_degC) == ("bench-1", "ab", 20.5)
    assert session.captured.isoformat() == "2026-11-22T10:00:00+00:00"
    assert session.minutes_since_power_on == 45
    assert (session.camera.height_mm.value, session.camera.height_mm.u) == (1500.0, 5.0)
    assert session.projector.position_mm.value == (0.0, 1222.0, 1000.0)
    assert session.phase_shifts_rad == pytest.approx((0, 2 * math.pi / 3, 4 * math.pi / 3), abs=1e-15)
    assert list(session.captures) == ["grid", "reference", "strips", "bars"]
    assert session.one("grid").phase_shifts_rad == ()
    assert session.one("strips").target.kind == "strips"
    assert session.one("artefact").shape == (40, 48)


def test_the_toml_file_itself_may_be_named(bench: Bench) -> None:
    assert load_session(bench.folder / "session.toml").folder == bench.folder


def test_frames_come_in_file_order_with_their_hashes(bench: Bench) -> None:
    capture = load_session(bench.folder).one("strips")
    files = [bench.folder / f"strips-{k}.png" for k in range(3)]
    assert capture.sha256 == tuple(hashlib.sha256(f.read_bytes()).hexdigest() for f in files)
    written = np.stack([cv2.imread(str(f), cv2.IMREAD_UNCHANGED) for f in files])
    np.testing.assert_array_equal(capture.read(), written)
    assert capture.read().dtype == np.uint8


def test_frames_are_read_once_and_cannot_be_changed(bench: Bench) -> None:
    capture = load_session(bench.folder).one("strips")
    assert capture.read() is capture.read()
    with pytest.raises(ValueError, match="read-only"):
        capture.read()[0, 0, 0] = 1


def test_a_file_changed_after_the_check_is_refused(bench: Bench) -> None:
    session = load_session(bench.folder)
    bench.put("strips-1.png", bench.fringes(77))
    with pytest.raises(SessionError, match=r"strips-1\.png: changed since"):
        session.one("strips").read()


def test_every_input_has_its_hash(bench: Bench) -> None:
    bench.put(
        "own.toml",
        b'kind = "flat"\nformat = 1\nname = "a"\ncertificate = "b"\nflatness_mm = { value = 0.1, u = 0.05 }\n',
    )
    bench.capture("reference")["target"] = "own.toml"
    bench.save()
    inputs = load_session(bench.folder).inputs
    assert set(inputs) == {p.name for p in bench.folder.iterdir()}
    for name, sha256 in inputs.items():
        assert sha256 == hashlib.sha256((bench.folder / name).read_bytes()).hexdigest()


@pytest.mark.parametrize("ending", ["png", "bmp", "tif"])
def test_lossless_files_give_the_values_written(bench: Bench, ending: str) -> None:
    frames = [bench.fringes(k) for k in (50, 51, 52)]
    capture = bars(bench, [bench.encoded(f, f".{ending}") for f in frames], ending)
    np.testing.assert_array_equal(capture.read(), frames)


def test_jpeg_is_read_and_remarked_upon(bench: Bench) -> None:
    frames = [bench.fringes(k) for k in (50, 51, 52)]
    capture = bars(bench, [bench.encoded(f, ".jpg") for f in frames], "jpg")
    # Quality 95: quantisation steps of a few levels leave an error of about one.
    assert np.abs(capture.read().astype(int) - np.stack(frames)).mean() < 2
    assert any("JPEG is lossy" in note for note in check_session(bench.folder).notes)


@pytest.mark.parametrize("compression", [None, "zlib"])
def test_16_bit_tiff(bench: Bench, compression: str | None) -> None:
    frames = [wide(k, 16) for k in range(3)]
    capture = bars(bench, [tiff(f, compression=compression) for f in frames], "tif", bits=16)
    np.testing.assert_array_equal(capture.read(), frames)
    assert (capture.bits, capture.white_level) == (16, 65535)


def test_lzw_tiff_and_big_endian_tiff(bench: Bench) -> None:
    frames = [wide(k, 16) for k in range(3)]
    lzw = [cv2.imencode(".tif", f, [cv2.IMWRITE_TIFF_COMPRESSION, 5])[1].tobytes() for f in frames[:2]]
    capture = bars(bench, [*lzw, tiff(frames[2], byteorder=">")], "tif", bits=16)
    np.testing.assert_array_equal(capture.read(), frames)


def test_min_is_white_is_turned_as_the_file_states(bench: Bench) -> None:
    frame = bench.fringes(5)
    np.testing.assert_array_equal(decode(tiff(frame, photometric="miniswhite")).pixels, 255 - frame)


def test_12_bit_in_16_as_stated(bench: Bench) -> None:
    capture = bars(bench, [bench.encoded(wide(k, 12)) for k in range(3)], "png", bits=12)
    assert capture.white_level == 4095


def test_bits_too_small_for_the_values(bench: Bench) -> None:
    with pytest.raises(SessionError, match="bits = 12 allows values up to 4095, found"):
        bars(bench, [bench.encoded(wide(k, 14)) for k in range(3)], "png", bits=12)


def only_bars(bench: Bench) -> None:
    bench.document["capture"] = [bench.capture("bars")]


def test_12_bit_shifted_to_the_left_is_noticed(bench: Bench) -> None:
    only_bars(bench)
    capture = bars(bench, [bench.encoded(wide(k, 12, shift=4)) for k in range(3)], "png")
    assert capture.white_level == 4095 << 4
    assert any("multiples of 16" in note for note in check_session(bench.folder).notes)


def test_12_bit_without_a_statement_is_remarked_upon(bench: Bench) -> None:
    only_bars(bench)
    assert bars(bench, [bench.encoded(wide(k, 12)) for k in range(3)], "png").white_level == 65535
    assert any("bits = 12" in note for note in check_session(bench.folder).notes)


def test_png_states_its_significant_bits(bench: Bench) -> None:
    def with_sbit(content: bytes) -> bytes:
        body = b"sBIT" + bytes([12])
        chunk = struct.pack(">I", 1) + body + struct.pack(">I", zlib.crc32(body))
        return content[:33] + chunk + content[33:]  # after the signature (8) and IHDR (25)

    only_bars(bench)
    contents = [with_sbit(bench.encoded(wide(k, 12, shift=4))) for k in range(3)]
    assert bars(bench, contents, "png").white_level == 65520


def test_tiff_states_its_largest_sample_value(bench: Bench) -> None:
    only_bars(bench)
    contents = [tiff(wide(k, 12), extratags=[(281, 3, 1, 4095, True)]) for k in range(3)]
    assert bars(bench, contents, "tif").white_level == 4095


def test_16_bit_beside_8_bit_where_the_capture_states_it(bench: Bench) -> None:
    assert bars(bench, [tiff(wide(k, 16)) for k in range(3)], "tif", bits=16).bits == 16
    assert load_session(bench.folder).one("grid").bits == 8


def colours(bench: Bench) -> list[np.ndarray]:
    return [np.stack([bench.fringes(3 * k + c) for c in range(3)], axis=-1) for k in range(3)]


@pytest.mark.parametrize("ending", ["png", "bmp", "tif"])
@pytest.mark.parametrize(("channel", "index"), [("red", 2), ("green", 1), ("blue", 0)])
def test_one_channel_of_colour(bench: Bench, ending: str, channel: str, index: int) -> None:
    frames = colours(bench)  # OpenCV writes blue, green, red
    capture = bars(bench, [bench.encoded(f, f".{ending}") for f in frames], ending, channel=channel)
    np.testing.assert_array_equal(capture.read(), np.stack(frames)[..., index])


def test_mean_and_luma_of_colour() -> None:
    pixel = np.array([[[10, 100, 201]]], np.uint8)
    assert to_grey(pixel, "mean", 255) == round(311 / 3)
    # BT.601: 0.299 * 10 + 0.587 * 100 + 0.114 * 201 = 84.604
    assert to_grey(pixel, "luma", 255) == 85


def test_a_clipped_channel_makes_a_saturated_pixel() -> None:
    pixel = np.array([[[255, 100, 10]]], np.uint8)
    assert to_grey(pixel, "mean", 255) == 255
    assert to_grey(pixel, "green", 255) == 100


def test_grey_saved_as_rgb_needs_no_rule(bench: Bench) -> None:
    frames = [bench.fringes(k) for k in (60, 61, 62)]
    contents = [bench.encoded(np.repeat(f[..., None], 3, axis=-1)) for f in frames]
    np.testing.assert_array_equal(bars(bench, contents, "png").read(), frames)


def test_alpha_is_dropped(bench: Bench) -> None:
    frame = bench.fringes(60)
    alpha = np.full_like(frame, 7)
    assert decode(bench.encoded(np.stack([frame, frame, frame, alpha], axis=-1))).pixels.ndim == 2


def test_exif_orientation_is_not_applied(bench: Bench) -> None:
    tag = struct.pack("<HHII", 274, 3, 1, 6)  # a quarter turn
    exif = b"Exif\0\0" + b"II*\0" + struct.pack("<IH", 8, 1) + tag + b"\0\0\0\0"
    content = bench.encoded(bench.fringes(60), ".jpg")
    turned = content[:2] + b"\xff\xe1" + struct.pack(">H", len(exif) + 2) + exif + content[2:]
    picture = decode(turned)
    assert picture.pixels.shape == (40, 48)
    assert picture.container.orientation == 6
    np.testing.assert_array_equal(picture.pixels, decode(content).pixels)


def test_globs_are_sorted_by_number(bench: Bench) -> None:
    for k in range(12):
        bench.put(f"many/f-{k}.png", bench.fringes(100 + k))
    bench.capture("bars").update(images=["many/f-*.png"], repeat=4)
    bench.save()
    capture = load_session(bench.folder).named("bars")
    assert [path.name for path in capture.paths] == [f"f-{k}.png" for k in range(12)]
    np.testing.assert_array_equal(capture.read_set(repeat=2), [bench.fringes(106 + k) for k in range(3)])


def test_periods_repeats_and_gray_code(bench: Bench) -> None:
    for k in range(12):
        bench.put(f"f-{k}.png", bench.fringes(100 + k))
    for k in range(2):
        bench.put(f"g-{k}.png", bench.fringes(200 + k))
    bench.capture("bars").update(images=["f-*.png"], gray=["g-*.png"], repeat=2, periods=[7.0, 8.0])
    bench.save()
    capture = load_session(bench.folder).named("bars")
    assert capture.periods == (7.0, 8.0)
    # Order: repeat, period, step. Repeat 1, period 1 starts at frame 9.
    np.testing.assert_array_equal(capture.read_set(repeat=1, period=1), [bench.fringes(109 + k) for k in range(3)])
    np.testing.assert_array_equal(capture.read_gray(), [bench.fringes(200), bench.fringes(201)])


def test_five_frames_a_turn_apart_are_a_scheme_and_only_remarked_upon(bench: Bench) -> None:
    contents = [bench.encoded(bench.fringes(80 + k)) for k in range(5)]
    capture = bars(bench, contents, "png", steps_deg=[0.0, 90.0, 180.0, 270.0, 360.0])
    assert len(capture.phase_shifts_rad) == 5
    assert any("0.0, 360.0 deg are equal modulo 360" in note for note in check_session(bench.folder).notes)


def test_pictures_without_phase_shifting(bench: Bench) -> None:
    assert bars(bench, [bench.encoded(bench.fringes(80))], "png", steps_deg=[]).phase_shifts_rad == ()


def test_strips_without_reference_are_remarked_upon(bench: Bench) -> None:
    bench.document["capture"] = [bench.capture("strips")]
    bench.save()
    check = check_session(bench.folder)
    assert check.session is not None
    assert any("reference" in note for note in check.notes)


def test_partly_saturated_frames_are_remarked_upon(bench: Bench) -> None:
    frame = bench.fringes(80)
    frame[:10] = 255
    bench.put("bars-1.png", frame)
    notes = check_session(bench.folder).notes
    assert any("bars-1.png: 25.0% of the pixels are saturated" in note for note in notes)


def test_asking_for_a_capture_that_is_not_there(bench: Bench) -> None:
    session = load_session(bench.folder)
    with pytest.raises(SessionError, match=r'no capture "bar".*"bars"'):
        session.named("bar")
    with pytest.raises(SessionError, match='no capture of kind "board"'):
        session.one("board")
    assert [capture.name for capture in session.find("artefact")] == ["bars"]


def test_two_of_a_kind_must_be_told_apart(bench: Bench) -> None:
    bench.capture("bars").update(kind="strips", target="glass-strips")
    bench.save()
    with pytest.raises(SessionError, match=r"2 captures .* \(strips, bars\)"):
        load_session(bench.folder).one("strips")


def test_byte_order_mark_and_foreign_letters(bench: Bench) -> None:
    text = (bench.folder / "session.toml").read_text(encoding="utf-8")
    bench.put("session.toml", b"\xef\xbb\xbf" + text.replace("bench-1", "Prüfstand 1").encode())
    assert load_session(bench.folder).rig == "Prüfstand 1"


def test_real_four_step_capture() -> None:
    session = load_session(DATA / "fpp_tools_lens")
    capture = session.one("object")
    assert capture.read().shape == (4, 862, 933)
    # The README of the data: 22.3 px on the board, above the dome, and a phase that falls with the column.
    frames = capture.read()[:, 270, 100:701].astype(float)
    phase = np.unwrap(np.arctan2(frames[3] - frames[1], frames[0] - frames[2]))
    assert phase[-1] < phase[0]
    assert 2 * np.pi * 600 / (phase[0] - phase[-1]) == pytest.approx(22.3, abs=0.05)


def test_real_three_step_captures() -> None:
    session = load_session(DATA / "kamino_object1")
    assert [c.periods[0] for c in session.find("object")] == pytest.approx([200 / 3, 100.0])
    assert session.named("s1").read().shape == (3, 1216, 1936)
    # The author's own formula against least squares with the steps stated: the order of the frames.
    first, second, third = session.named("s1").read()[:, 60, 400:640].astype(float)
    theirs = np.arctan2(np.sqrt(3) * (first - third), 2 * second - first - third)
    steps = np.array(session.named("s1").phase_shifts_rad)
    quadrature = -(np.stack([first, second, third]) * np.sin(steps)[:, None]).sum(axis=0)
    in_phase = (np.stack([first, second, third]) * np.cos(steps)[:, None]).sum(axis=0)
    np.testing.assert_allclose(np.angle(np.exp(1j * (np.arctan2(quadrature, in_phase) - theirs))), 0, atol=1e-9)
