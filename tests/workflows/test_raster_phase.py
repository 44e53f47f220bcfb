"""A capture's projector coordinates: counted in one pass, and by the maps of all periods, they are the same."""

import numpy as np
import pytest

from fringecal.session import load_session, write_session
from fringecal.simulate import load_raster_rig, simulate_raster_session
from fringecal.workflows.shared import raster_of_capture, raster_phase

# Single precision of a phase of 36 fringes is 2e-5 rad, of a coordinate 6e-5 px; the arctangents differ by as much.
SAME_PX = 3e-4


@pytest.fixture(scope="module")
def made():
    """A plate and a board with dark squares under fringes of 1, 6 and 36 to the picture, in small pictures."""
    rig = load_raster_rig("dlp-small").at(
        camera={"width_px": 240, "height_px": 192, "focal_px": 450.0, "principal_offset_px": (1.0, -0.6)}
    )
    return simulate_raster_session(rig, ["pose-04", "plate"], seed=6)


@pytest.fixture(scope="module")
def session(made, tmp_path_factory):
    folder = tmp_path_factory.mktemp("raster") / "session"
    return load_session(write_session(folder, made.document, made.frames, extra_files=made.files))


def by_maps(capture, axis, monkeypatch, **options):
    with monkeypatch.context() as patched:
        patched.setattr(raster_phase, "goes_by_steps", lambda *_: False)
        return raster_of_capture(capture, axis, **options).raster


@pytest.mark.parametrize("axis", ["u", "v"])
def test_one_pass_and_all_maps_give_the_same_numbers(made, session, monkeypatch, axis) -> None:
    plate = session.named("plate")
    fast, slow = raster_of_capture(plate, axis).raster, by_maps(plate, axis, monkeypatch)
    assert fast.orders is None  # it went from period to period
    assert np.array_equal(np.isfinite(fast.px), np.isfinite(slow.px))
    assert np.nanmax(np.abs(fast.px - slow.px)) < SAME_PX
    assert np.array_equal(fast.u_px[np.isfinite(fast.px)], slow.u_px[np.isfinite(fast.px)])
    off = fast.px - made.captures["plate"].projector_px["uv".index(axis)]
    # No wrong fringe, at the projector's edges neither: there half a pixel is lit, and blur moves it by some px.
    assert np.nanmax(np.abs(off)) < min(plate.along(axis).axes[0].periods_px) / 2


def test_dark_squares_are_left_to_the_maps_where_they_count(session, monkeypatch) -> None:
    board = session.named("pose-04")
    light, every = raster_of_capture(board, "u", dark=False).raster, raster_of_capture(board, "u").raster
    slow = by_maps(board, "u", monkeypatch)
    assert np.isfinite(light.px).sum() < 0.9 * np.isfinite(slow.px).sum()
    assert np.array_equal(every.px, slow.px, equal_nan=True)
    assert np.nanmax(np.abs(light.px - slow.px)) < SAME_PX
