"""Phase maps of other programs in place of frames: read, counted as the projector's pixels, refused with the reason."""

import io
from typing import Any

import numpy as np
import pytest
from scipy.io import savemat

from fringecal.guarded import MIB, Refusal
from fringecal.guarded_arrays import archive_of, matlab_of
from fringecal.session import check_session, load_session
from fringecal.session.document import MapTable
from fringecal.session.faults import PictureError
from fringecal.session.fringes.phase_maps import _read as read_one
from fringecal.workflows.shared import raster_of_capture

Bench = Any  # the fixture of conftest.py
SHAPE = (40, 48)
COLUMNS = np.linspace(20, 160, SHAPE[1])[None, :] + np.linspace(0, 5, SHAPE[0])[:, None]


def phase(fringes: float, *, noise: float = 0.02, zero: float = 0.0) -> np.ndarray:
    made = 2 * np.pi * fringes * COLUMNS / 192 + zero
    return made + noise * np.random.default_rng(int(fringes)).standard_normal(SHAPE)


def add_maps(bench: Bench, *maps: dict[str, Any], **keys: Any) -> None:
    bench.document["projector"]["resolution_px"] = [192, 96]
    capture = {"name": "surface", "kind": "object", "images": [], "maps": list(maps)} | keys
    bench.document["capture"].append(capture)


def said(bench: Bench) -> str:
    bench.save()
    return " ".join(str(fault) for fault in check_session(bench.folder).faults)


@pytest.mark.parametrize("ending", ["npy", "npz", "mat"])
def test_an_absolute_map_counts_columns(bench: Bench, ending: str) -> None:
    absolute = phase(12, zero=0.5)
    absolute[:3] = np.nan
    path = bench.folder / f"phase.{ending}"
    if ending == "npy":
        np.save(path, absolute)
    elif ending == "npz":
        np.savez(path, phi=absolute, other=np.zeros(3))
    else:
        savemat(path, {"phi": absolute})
    stated = {"file": path.name, "axis": "u", "fringes": 12.0, "absolute": True, "zero_deg": float(np.degrees(0.5))}
    add_maps(bench, stated | ({"name": "phi"} if ending == "npz" else {}))
    assert said(bench) == ""
    session = load_session(bench.folder)
    capture = session.captures["surface"]
    assert (capture.shape, capture.counted_axes) == (SHAPE, ("u",))
    assert path.name in session.inputs
    raster = raster_of_capture(capture, "u").raster
    error = raster.px[3:] - COLUMNS[3:]
    # 12 fringes over 192 px: 16 px a turn; the noise of 0.02 rad is found from the map itself.
    assert np.std(error) == pytest.approx(0.02 * 16 / (2 * np.pi), rel=0.06)
    assert raster.u_px[5, 5] == pytest.approx(np.std(error), rel=0.15)
    assert np.isnan(raster.px[:3]).all()


def test_wrapped_maps_of_several_periods_count_together(bench: Bench) -> None:
    for fringes in (1, 12):
        np.save(bench.folder / f"w{fringes}.npy", np.angle(np.exp(1j * phase(fringes))))
    maps = ({"file": f"w{n}.npy", "axis": "u", "fringes": float(n), "u_rad": 0.02} for n in (1, 12))
    add_maps(bench, *maps)
    assert said(bench) == ""
    raster = raster_of_capture(load_session(bench.folder).captures["surface"], "u").raster
    assert np.abs(raster.px - COLUMNS).max() < 0.3


@pytest.mark.parametrize(
    ("change", "keys", "words"),
    [
        ({"name": "psi"}, {}, ["holds other, phi", "there is no 'psi'", "state name"]),
        ({"name": None}, {}, ["which one is meant is not stated"]),
        ({"name": "other"}, {}, ["of shape (3,)", "(H, W) of real numbers"]),
        ({"period": 16.0}, {}, ["one of period and fringes is needed"]),
        ({"file": "../phase.npz"}, {}, ["outside the session folder"]),
        ({"file": "reference-0.png"}, {}, ["is no .npy, .npz or .mat file"]),
        ({"axis": "w"}, {}, ['write axis = "u"']),
        ({"fringe": 3.0}, {}, ['did you mean "fringes"']),
        ({}, {"axes": ["u"]}, ["stated beside maps"]),
        ({}, {"white": ["grid.png"]}, []),
    ],
)
def test_what_is_wrong_with_a_map_is_named(bench: Bench, change, keys, words) -> None:
    np.savez(bench.folder / "phase.npz", phi=phase(12), other=np.zeros(3))
    stated = {"file": "phase.npz", "name": "phi", "axis": "u", "fringes": 12.0} | change
    add_maps(bench, {key: value for key, value in stated.items() if value is not None}, **keys)
    found = said(bench)
    assert all(word in found for word in words), found
    assert bool(found) is bool(words) or "listed 2 times" in found


def test_pickled_objects_are_not_opened(bench: Bench) -> None:
    np.save(bench.folder / "phase.npy", np.array([[object()]], dtype=object), allow_pickle=True)
    add_maps(bench, {"file": "phase.npy", "axis": "u", "fringes": 12.0})
    assert "cannot be read as arrays" in said(bench)


@pytest.mark.parametrize("ending", ["npy", "npz", "mat", "Mat"])
def test_whatever_is_damaged_is_a_fault_and_no_traceback(bench: Bench, ending: str) -> None:
    """Cut short anywhere, or any byte inverted: the map is read with other numbers, or named as wrong."""
    path = bench.folder / f"phase.{ending}"
    small = np.linspace(0, 9, 12).reshape(3, 4)
    with path.open("wb") as file:
        if ending == "npy":
            np.save(file, small)
        elif ending == "npz":
            np.savez_compressed(file, phi=small)
        else:
            savemat(file, {"phi": small}, do_compression=ending == "Mat")
    good = path.read_bytes()
    stated = MapTable(file=path.name, axis="u", fringes=12.0)
    for k in range(0, len(good), 3):
        for content in (good[:k], good[:k] + bytes([good[k] ^ 0xFF]) + good[k + 1 :], good[:k] + b"\0" + good[k + 1 :]):
            path.write_bytes(content)
            try:
                found = read_one(bench.folder, stated, [192, 96]).phase_rad
            except PictureError:
                continue
            assert found.size <= small.size
    path.write_bytes(good)
    np.testing.assert_array_equal(read_one(bench.folder, stated, [192, 96]).phase_rad, small)


def test_an_archive_that_unpacks_to_more_than_is_read_is_refused(bench: Bench) -> None:
    packed = io.BytesIO()
    np.savez_compressed(packed, phi=np.zeros((1000, 1000)))
    assert archive_of(packed.getvalue())["phi"].shape == (1000, 1000)
    with pytest.raises(Refusal, match="7 MiB that are read"):
        archive_of(packed.getvalue(), 7 * MIB)  # 8 MB are 7.6 MiB
    for squeezed in (False, True):
        matlab = io.BytesIO()
        savemat(matlab, {"phi": np.zeros((1000, 1000), np.uint8)}, do_compression=squeezed)
        assert matlab_of(matlab.getvalue(), 8 * MIB)["phi"].shape == (1000, 1000)
        with pytest.raises(Refusal, match="that are left to be read"):
            matlab_of(matlab.getvalue(), 7 * MIB)  # 1 MB of bytes, and 8 MB as numbers of 64 bit
