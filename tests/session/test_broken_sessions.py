"""Sessions broken in one place, and in several: each is refused, with every fault named."""

import struct
import zlib
from collections.abc import Callable
from datetime import datetime
from typing import Any

import numpy as np
import pytest
import typer
from typer.testing import CliRunner

from fringecal.cli.check import register
from fringecal.errors import SessionError
from fringecal.session import load_session

Bench = Any  # the fixture of conftest.py
Break = Callable[[Bench], None]
CASES: dict[str, tuple[Break, tuple[str, ...]]] = {}


def breaks(*said: str) -> Callable[[Break], Break]:
    """Register a way to break a session and what its one fault must say."""

    def registered(function: Break) -> Break:
        CASES[function.__name__] = (function, said)
        return function

    return registered


def sets(said: tuple[str, ...], name: str, change: Break) -> None:
    """Register a change of the document."""

    def function(bench: Bench) -> None:
        change(bench)
        bench.save()

    CASES[name] = (function, said)


def update(**keys: Any) -> Break:
    return lambda bench: bench.document.update(keys)


def table(table_name: str, /, **keys: Any) -> Break:
    return lambda bench: bench.document[table_name].update(keys)


def capture(capture_name: str, /, **keys: Any) -> Break:
    return lambda bench: bench.capture(capture_name).update(keys)


# The document -------------------------------------------------------------------------------------
sets(("format", "2"), "format_unknown", update(format=2))
sets(("rig", "missing"), "rig_missing", update(rig=None))
sets(("captured", "zone"), "date_without_zone", update(captured=datetime(2026, 1, 1)))
sets(("captured", "without quotes"), "date_as_text", update(captured="2026-01-01"))
sets(("oprator", 'did you mean "operator"'), "key_misspelt", update(oprator="ab"))
sets(("camera.hieght_mm", '"height_mm"'), "camera_key_misspelt",
     table("camera", hieght_mm={"value": 1.0, "u": 1.0}))  # fmt: skip
sets(('capture "bars"', "imags", '"images"'), "capture_key_misspelt",
     lambda bench: bench.capture("bars").update(imags=bench.capture("bars").pop("images")))  # fmt: skip
sets(('capture "grid"', "use", "only artefact, strips"), "use_of_a_grid", capture("grid", use="calibration"))
sets(('capture "bars"', '"calibration" or "verification"'), "use_unknown", capture("bars", use="both"))
sets(("height_mm", "1500"), "quantity_without_u", table("camera", height_mm=1500.0))
sets(("height_mm", "negative"), "negative_u", table("camera", height_mm={"value": 1500.0, "u": -1.0}))
sets(("height_mm", "positive"), "negative_height", table("camera", height_mm={"value": -1500.0, "u": 1.0}))


def mirror(**changed):
    """Return a plane mirror at 45 deg, but for what is changed."""
    return {"point_mm": {"value": [0.0, 1200.0, 1000.0], "u": 2.0}, "normal": [0.0, 1.0, -1.0]} | changed


sets(
    ("height_mm", "telecentric", "two statements"),
    "height_and_telecentric",
    table("camera", telecentric=True),
)
sets(
    ("camera.model", "lens.cameramodel", "not there"),
    "model_missing",
    table("camera", model="lens.cameramodel"),
)
sets(
    ("position_mm", "x, y, z"),
    "position_of_two",
    table("projector", position_mm={"value": [1.0, 2.0], "u": 1.0}),
)
sets(
    ("normal", "direction"),
    "mirror_without_direction",
    lambda bench: bench.document["projector"].update(mirror=mirror(normal=[0.0, 0.0, 0.0])),
)
sets(
    ("point_mm", "x, y, z"),
    "mirror_of_two_coordinates",
    lambda bench: bench.document["projector"].update(mirror=mirror(point_mm={"value": [1.0, 2.0], "u": 1.0})),
)
sets(("steps_deg", "'0'"), "step_as_text", table("phase", steps_deg=["0", 120.0, 240.0]))
sets(("steps_deg", "finite"), "step_not_finite", table("phase", steps_deg=[0.0, 120.0, float("nan")]))
sets(("bits", "4"), "bits_too_few", table("camera", bits=4))
sets(("channel", "purple"), "channel_unknown", table("camera", channel="purple"))
sets(('capture "bars": kind', "artifact"), "kind_unknown", capture("bars", kind="artifact"))
sets(("capture 4: name", "missing"), "name_missing", lambda bench: bench.capture("bars").pop("name"))
sets(("capture", "missing"), "no_capture", lambda bench: bench.document.pop("capture"))
sets(("repeat", "0"), "repeat_zero", capture("bars", repeat=0))


@breaks("session.toml", "line 3")
def toml_syntax(bench: Bench) -> None:
    bench.edit("captured = 2026", "captured = = 2026")


@breaks("session.toml", "steps_deg", "not valid TOML")
def steps_stated_twice(bench: Bench) -> None:
    bench.edit("steps_deg =", "steps_deg = [0.0, 90.0, 180.0]\nsteps_deg =")


@breaks("session.toml", "empty")
def toml_empty(bench: Bench) -> None:
    bench.put("session.toml", b" \n")


@breaks("session.toml", "UTF-8")
def toml_binary(bench: Bench) -> None:
    bench.put("session.toml", bench.encoded(bench.fringes(1)))


@breaks("no session.toml")
def toml_missing(bench: Bench) -> None:
    (bench.folder / "session.toml").unlink()


# Statements against each other --------------------------------------------------------------------
sets(("2 distinct", "modulo 360"), "two_steps_only", table("phase", steps_deg=[0.0, 120.0, 480.0]))
sets(('capture "bars": images', "3 images, needed 4"), "steps_against_images",
     capture("bars", steps_deg=[0.0, 90.0, 180.0, 270.0]))  # fmt: skip
sets(
    ('capture "bars": images', "3 images, needed 6", "2 time(s)"),
    "repeat_against_images",
    capture("bars", repeat=2),
)
sets(('capture "bars": images', "3 images, needed 6", "2 period(s)"), "periods_against_images",
     capture("bars", periods=[7.0, 8.0]))  # fmt: skip
sets(('capture "bars": images', "no images"), "images_empty", capture("bars", images=[]))
sets(('capture "bars": images', "bars-9.png", "did you mean"), "file_missing",
     capture("bars", images=["bars-0.png", "bars-1.png", "bars-9.png"]))  # fmt: skip
sets(('capture "bars": images', "no file matches"), "glob_empty", capture("bars", images=["rods-*.png"]))
sets(('capture "bars": images', "outside"), "file_outside", capture("bars", images=["../session.png"]))
sets(('capture "strips"', "captures 3, 4"), "name_twice", capture("bars", name="strips"))
sets(('capture "strips": target', "without a target"), "strips_without_target", capture("strips", target=None))
sets(('capture "grid": target', "line-grid"), "grid_of_strips", capture("grid", target="glass-strips"))
sets(('capture "strips": target', "nearest"), "target_unknown", capture("strips", target="glas-strips"))
sets(('capture "strips": target', "t.toml"), "target_file_missing", capture("strips", target="t.toml"))


@breaks('capture "bars": steps_deg', "120.0", "more than once")
def a_step_twice(bench: Bench) -> None:
    bench.put("bars-3.png", bench.fringes(99))
    bench.capture("bars").update(steps_deg=[0.0, 120.0, 120.0, 240.0], images=["bars-*.png"])
    bench.save()


@breaks('capture "bars": steps_deg', "no phase shifts")
def steps_missing(bench: Bench) -> None:
    del bench.document["phase"]
    for name in ("reference", "strips"):
        bench.capture(name)["steps_deg"] = [0.0, 120.0, 240.0]
    bench.save()


@breaks('capture "bars"', "bars-1.png", "listed 2 times")
def file_listed_twice(bench: Bench) -> None:
    bench.capture("bars")["images"] = ["bars-0.png", "bars-1.png", "bars-1.png"]
    bench.save()


@breaks('capture "bars": target', "thickness_mm")
def target_contradictory(bench: Bench) -> None:
    bench.put("t.toml", b'format = 1\nkind = "flat"\nname = "a"\ncertificate = "b"\nthickness_mm = 3\n')
    bench.capture("bars")["target"] = "t.toml"
    bench.save()


# Files --------------------------------------------------------------------------------------------
@breaks("bars-1.png", "empty file")
def file_empty(bench: Bench) -> None:
    bench.put("bars-1.png", b"")


@breaks("bars-1.png", "not a picture")
def file_of_text(bench: Bench) -> None:
    bench.put("bars-1.png", b"this is not a picture")


@breaks("bars-1.png", "truncated PNG")
def png_truncated(bench: Bench) -> None:
    bench.put("bars-1.png", bench.encoded(bench.fringes(8))[:-20])


@breaks("bars-1.png", "damaged PNG", "checksum")
def png_damaged(bench: Bench) -> None:
    content = bytearray(bench.encoded(bench.fringes(8)))
    content[len(content) // 2] ^= 0x10
    bench.put("bars-1.png", bytes(content))


@breaks("bars-1.png", "damaged PNG", "bytes of pixels")
def png_of_half_the_rows(bench: Bench) -> None:
    # Every checksum right, but half of the rows: a writer that stopped early and closed the file well.
    def chunk(kind: bytes, body: bytes) -> bytes:
        return struct.pack(">I", len(body)) + kind + body + struct.pack(">I", zlib.crc32(kind + body))

    header = struct.pack(">IIBBBBB", 48, 40, 8, 0, 0, 0, 0)
    rows = b"".join(b"\0" + row.tobytes() for row in bench.fringes(8)[:20])
    parts = chunk(b"IHDR", header) + chunk(b"IDAT", zlib.compress(rows)) + chunk(b"IEND", b"")
    bench.put("bars-1.png", b"\x89PNG\r\n\x1a\n" + parts)


@breaks("bars-1.jpg", "truncated JPEG")
def jpeg_truncated(bench: Bench) -> None:
    replace(bench, "bars-1.jpg", bench.encoded(bench.fringes(8), ".jpg")[:-200])


@breaks("bars-1.jpg", "damaged JPEG")
def jpeg_truncated_and_closed(bench: Bench) -> None:
    # libjpeg alone would fill the missing half with grey and return it.
    content = bench.encoded(bench.fringes(8, shape=(40, 48)), ".jpg")
    replace(bench, "bars-1.jpg", content[:-400] + b"\xff\xd9")


@breaks("bars-1.bmp", "truncated BMP")
def bmp_truncated(bench: Bench) -> None:
    replace(bench, "bars-1.bmp", bench.encoded(bench.fringes(8), ".bmp")[:-48])


@breaks("bars-1.tif", "TIFF")
def tiff_truncated(bench: Bench) -> None:
    content = bench.encoded(bench.fringes(8), ".tif")
    replace(bench, "bars-1.tif", content[: len(content) // 2])


def replace(bench: Bench, name: str, content: bytes) -> None:
    bench.put(name, content)
    bench.capture("bars")["images"][1] = name
    bench.save()


@breaks('capture "bars"', "pictures differ", "50 x 40 px")
def size_differs_within(bench: Bench) -> None:
    bench.put("bars-1.png", bench.fringes(8, shape=(40, 50)))


@breaks('capture "grid"', "64 x 40 px", "most pictures have 48 x 40 px")
def size_differs_between(bench: Bench) -> None:
    bench.put("grid.png", bench.fringes(8, shape=(40, 64)))


@breaks('capture "bars"', "pictures differ", "16 bit", "8 bit")
def depth_differs_within(bench: Bench) -> None:
    bench.put("bars-1.png", bench.fringes(8).astype(np.uint16) * 257)


@breaks('capture "grid"', "16 bit", "most pictures have 8 bit")
def depth_differs_between(bench: Bench) -> None:
    bench.put("grid.png", bench.fringes(8).astype(np.uint16) * 257)


@breaks('capture "bars"', "colour", "bars-1.png")
def colour_without_rule(bench: Bench) -> None:
    bench.put("bars-1.png", np.stack([bench.fringes(8), bench.fringes(9), bench.fringes(10)], axis=-1))


@breaks('capture "bars"', "bars-0.png", "bars-1.png", "byte for byte")
def frame_copied(bench: Bench) -> None:
    bench.put("bars-1.png", (bench.folder / "bars-0.png").read_bytes())


@breaks('capture "reference"', 'capture "bars"', "byte for byte")
def frame_copied_across_captures(bench: Bench) -> None:
    bench.put("bars-1.png", (bench.folder / "reference-1.png").read_bytes())


@breaks('capture "bars"', "bars-0.png", "bars-1.bmp", "pixel for pixel")
def frame_stale(bench: Bench) -> None:
    replace(bench, "bars-1.bmp", bench.encoded(bench.fringes(7), ".bmp"))


@breaks("bars-1.png", "black")
def frame_black(bench: Bench) -> None:
    bench.put("bars-1.png", np.zeros((40, 48), np.uint8))


@breaks("bars-1.png", "100.0% of the pixels are saturated")
def frame_saturated(bench: Bench) -> None:
    bench.put("bars-1.png", np.full((40, 48), 255, np.uint8))


@breaks('capture "bars"', "bits = 12", "8 bit")
def more_bits_than_the_file_has(bench: Bench) -> None:
    bench.capture("bars")["bits"] = 12
    bench.save()


def cli() -> typer.Typer:
    app = typer.Typer()
    app.callback()(lambda: None)
    register(app)
    return app


def test_there_are_enough_of_them() -> None:
    assert len(CASES) >= 30


@pytest.mark.parametrize("name", CASES)
def test_one_fault_is_named_and_is_the_only_one(bench: Bench, name: str) -> None:
    break_it, said = CASES[name]
    break_it(bench)
    with pytest.raises(SessionError) as refused:
        load_session(bench.folder)
    assert len(refused.value.faults) == 1, refused.value.faults
    for words in said:
        assert words in refused.value.faults[0]


@pytest.mark.parametrize("name", CASES)
def test_the_command_refuses_it(bench: Bench, name: str) -> None:
    break_it, said = CASES[name]
    break_it(bench)
    result = CliRunner().invoke(cli(), ["check", str(bench.folder)])
    assert result.exit_code == 1
    assert "1 fault(s)" in result.stderr
    for words in said:
        assert words in result.stderr


# Several at once; none of these hides another.
MANY = (
    "camera_key_misspelt", "key_misspelt", "height_and_telecentric", "kind_unknown", "strips_without_target",
    "grid_of_strips", "size_differs_between", "png_truncated",
)  # fmt: skip


def test_many_faults_are_all_named_at_once(bench: Bench) -> None:
    for name in MANY:
        CASES[name][0](bench)
    with pytest.raises(SessionError) as refused:
        load_session(bench.folder)
    assert len(refused.value.faults) == len(MANY), refused.value.faults
    for name in MANY:
        said = CASES[name][1]
        assert any(all(words in fault for words in said) for fault in refused.value.faults), name


def test_a_broken_capture_does_not_hide_the_files_of_another(bench: Bench) -> None:
    bench.capture("strips").pop("kind")
    bench.save()
    bench.put("bars-2.png", b"")
    faults = [str(fault) for fault in bench.check().faults]
    assert len(faults) == 2
    assert 'capture "strips": kind: missing' in faults[0]
    assert "bars-2.png: an empty file" in faults[1]


@pytest.mark.parametrize("path", ["nowhere", "session.toml", ""])
def test_a_path_that_is_no_session_folder(bench: Bench, path: str) -> None:
    place = {"nowhere": bench.folder / "nowhere", "session.toml": bench.folder / "grid.png"}
    with pytest.raises(SessionError) as refused:
        load_session(place.get(path, bench.folder.parent))
    assert len(refused.value.faults) == 1
