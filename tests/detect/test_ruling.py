"""Lines of several weights on one sheet: what was indexed, by drawn paper whose pitch is known."""

import numpy as np
import pytest
from scipy import ndimage

from fringecal.camera import ruled_pitch, thesis_scale
from fringecal.detect import Ruling, find_grid, ruling_of
from fringecal.errors import DetectionError
from fringecal.uncertainty import Estimate

SHAPE = (300, 400)
STATED = Estimate(1.0, 0.001, "mm")


def paper(px_per_mm, weights, *, fine=1.0, blur=0.6, tilt=0.0, sigma=1.5, seed=3):
    """Draw millimetre paper: widths in mm by every how many mm; `fine` is the ink of the finest, `tilt` per width."""
    v, u = np.mgrid[: 2 * SHAPE[0], : 2 * SHAPE[1]] / 2.0
    scale = 1 + tilt * (u / SHAPE[1] - 0.5)
    x, y = (u - SHAPE[1] / 2) / scale / px_per_mm + 41.3, (v - SHAPE[0] / 2) / scale / px_per_mm + 31.7
    cover = np.zeros(u.shape)
    for every, width in weights.items():
        ink = fine if every == min(weights) else 1.0
        for along in (x, y):
            off = np.abs(along - every * np.rint(along / every))
            cover = np.maximum(cover, ink * np.clip((width / 2 - off) * px_per_mm * 2 + 0.5, 0, 1))
    picture = ndimage.gaussian_filter(220 - 130 * cover, 2 * blur)
    picture = picture.reshape(SHAPE[0], 2, SHAPE[1], 2).mean(axis=(1, 3))
    return np.clip(picture + sigma * np.random.default_rng(seed).standard_normal(SHAPE), 0, 255).astype(np.uint8)


def found(picture, heavy_every):
    """Return the ruling and the scale along u, mm/px."""
    detection = find_grid(picture)
    ruling = ruling_of(picture, detection)
    return ruling, thesis_scale(detection, ruled_pitch(ruling, STATED, heavy_every)).horizontal.value


@pytest.mark.parametrize(
    ("px_per_mm", "weights", "fine", "heavy_every"),
    [
        (16, {1: 0.12, 5: 0.2}, 1.0, 5),  # fine and heavy lines are both indexed
        (14, {1: 0.12, 5: 0.2, 10: 0.35}, 0.6, 5),
        (14, {1: 0.12, 5: 0.2, 10: 0.35}, 0.6, 10),
        (6, {1: 0.15, 5: 0.6}, 0.5, 5),  # the heavy ones, with fine ones in between
        (5, {1: 0.15, 5: 0.5, 10: 0.9}, 0.5, 5),
    ],
)
@pytest.mark.parametrize("tilt", [0.0, 0.15])
def test_the_scale_is_right_whichever_lines_were_indexed(px_per_mm, weights, fine, heavy_every, tilt):
    ruling, scale = found(paper(px_per_mm, weights, fine=fine, tilt=tilt), heavy_every)
    # The mean over the middle third differs from the scale at the centre by the square of its tilt.
    assert scale == pytest.approx(1 / px_per_mm, rel=0.02)
    assert ruling.spacing_px == pytest.approx(ruling.parts * px_per_mm, rel=0.03)


def test_plain_lines_have_nothing_in_between():
    ruling, scale = found(paper(18, {1: 0.15}), None)
    assert (ruling.parts, ruling.rhythms) == (1, ())
    assert scale == pytest.approx(1 / 18, rel=0.01)


@pytest.mark.parametrize(
    ("weights", "heavy_every", "candidates"),
    [
        ({1: 0.15}, 5, "1 or 5 mm"),  # are these the heavy ones, and the fine ones not to be seen?
        ({1: 0.12, 5: 0.25}, 4, "1 or 4 mm"),  # stated wrongly
        ({2: 0.2, 10: 0.5}, 10, "1 or 10 mm"),  # the fine lines of the sheet stand at 2 mm, not at 1 mm
    ],
)
def test_an_ambiguous_pitch_is_refused_with_its_candidates(weights, heavy_every, candidates):
    with pytest.raises(DetectionError, match=candidates):
        found(paper(16, weights), heavy_every)


def test_finer_lines_that_nothing_states_make_the_pitch_ambiguous():
    picture = paper(6, {1: 0.15, 5: 0.6}, fine=0.5)
    ruling = ruling_of(picture, find_grid(picture))
    assert ruling.parts == 5
    assert "4 finer lines between neighbouring indexed lines" in ruling.sentence()
    with pytest.raises(DetectionError, match="1 or 5 mm"):
        ruled_pitch(ruling, STATED, None)


def test_u_grows_with_the_distance():
    pitch = ruled_pitch(Ruling(5, (), 30.0), STATED, 5)
    assert (pitch.value, pitch.u) == (5.0, 0.005)
