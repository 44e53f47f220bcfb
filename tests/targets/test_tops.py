"""The planes and balls of artefacts against the height map of the same targets, which is written independently."""

import numpy as np
import pytest

from fringecal.targets import load_target, parse_target, surface_mm, tops_of

BALL_BAR = parse_target(
    {
        "format": 1,
        "kind": "ball-bar",
        "name": "bar",
        "certificate": "drawn",
        "diameters_mm": {"value": [20.0, 30.0], "u": 0.01},
        "spacing_mm": {"value": 60.0, "u": 0.01},
    }
)
SHOWN = {
    "step-block": load_target("step-block"),
    "angle-bars": load_target("angle-bars"),
    "glass-strips": load_target("glass-strips"),
    "ball-bar": BALL_BAR,
}


@pytest.mark.parametrize("name", sorted(SHOWN))
def test_upright_sight_meets_the_surface(name) -> None:
    target = SHOWN[name]
    rng = np.random.default_rng(4)
    x, y = rng.uniform(-120, 120, 4000), rng.uniform(-60, 60, 4000)
    upright = np.zeros(x.size)
    met = np.stack([top.met_by(x, y, upright, upright) for top in tops_of(target)])
    height = np.max(np.nan_to_num(met, nan=0.0), axis=0)
    assert np.allclose(height, surface_mm(target, x, y), atol=1e-9)


@pytest.mark.parametrize("name", sorted(SHOWN))
def test_where_slanting_sight_meets_a_top_the_top_is(name) -> None:
    target = SHOWN[name]
    rng = np.random.default_rng(5)
    x, y, dx, dy = (rng.uniform(-size, size, 4000) for size in (120, 60, 0.4, 0.4))
    for top in tops_of(target):
        z = top.met_by(x, y, dx, dy)
        met = np.isfinite(z) & (z >= top.heights_mm[0])
        # A ball's upper half alone is its top: further down slanting sight meets the lower half.
        assert met.any()
        assert np.allclose(top.height(x + dx * z, y + dy * z)[met], z[met], atol=1e-6)


def test_what_is_printed_has_no_top() -> None:
    assert tops_of(load_target("grid-10mm")) == ()
