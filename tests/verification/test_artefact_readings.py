"""Numbers of artefacts from surfaces drawn by their geometry: values, references, and how causes reach them."""

from dataclasses import dataclass

import numpy as np
import pytest

from fringecal.errors import FitError
from fringecal.targets import parse_target
from fringecal.targets.target_surface import surface_mm
from fringecal.uncertainty.components import UncertaintyComponent
from fringecal.uncertainty.influences import Influence
from fringecal.verification.forms.probes import probe
from fringecal.verification.forms.readings import readings_table, take_readings

PIXEL_MM = 0.5


def q(value, u=0.003):
    return {"value": value, "u": u}


def target(kind, **dimensions):
    return parse_target({"format": 1, "kind": kind, "name": kind, "certificate": "drawn", **dimensions})


@dataclass(frozen=True)
class Drawn:
    x: np.ndarray
    y: np.ndarray
    z: np.ndarray

    @property
    def u_z(self):
        return np.zeros_like(self.z)

    @property
    def mask(self):
        return np.isfinite(self.z)


def drawn(artefact, *, turn_deg=0.0, noise_mm=0.0, stretch=1.0, size=(400, 400)) -> Drawn:
    """Draw the artefact on a plate, heights stretched."""
    v, u = np.mgrid[: size[0], : size[1]]
    x, y = (u - (size[1] - 1) / 2) * PIXEL_MM, ((size[0] - 1) / 2 - v) * PIXEL_MM
    c, s = np.cos(np.deg2rad(turn_deg)), np.sin(np.deg2rad(turn_deg))
    z = stretch * surface_mm(artefact, c * x + s * y, c * y - s * x)
    return Drawn(x, y, z + noise_mm * np.random.default_rng(0).standard_normal(z.shape))


def exact(u, v, z):
    return []


def by_name(readings):
    return {reading.name: reading for reading in readings}


def contributions(reading):
    return {source.detail or source.influence: u for source, u in reading.budget.contributions().items()}


def read(artefact, surface, by_component=exact):
    return by_name(take_readings(probe(artefact, surface), surface, by_component))


BLOCK = target("steps", heights_mm=q([5.0, 10.0, 20.0]), width_mm=q(30.0), length_mm=q(60.0))
BALL = target("sphere", diameter_mm=q(50.0))
BAR = target("ball-bar", diameters_mm=q([30.0, 30.0]), spacing_mm=q(100.0))


def test_steps_give_amplification_and_linearity() -> None:
    found = read(BLOCK, drawn(BLOCK, turn_deg=20, stretch=1.02))
    assert found["amplification coefficient"].measured == pytest.approx(1.02, abs=1e-9)
    assert found["linearity deviation"].measured == pytest.approx(0.0, abs=1e-9)
    assert found["step of 20 mm"].error == pytest.approx(0.4, abs=1e-9)
    # The slope over heights 0, 5, 10, 20 weighs the certified ones by their distance from the mean 8.75.
    weights = (np.array([5, 10, 20]) - 8.75) / np.sum((np.array([0, 5, 10, 20]) - 8.75) ** 2)
    assert found["amplification coefficient"].u_reference == pytest.approx(0.003 * np.linalg.norm(weights), rel=1e-9)


def test_a_bent_height_scale_shows_as_linearity_deviation() -> None:
    surface = drawn(BLOCK)
    bent = Drawn(surface.x, surface.y, surface.z + 0.001 * surface.z**2)
    heights = np.array([0.0, 5.0, 10.0, 20.0])
    response = heights + 0.001 * heights**2
    expected = np.abs(response - np.polyval(np.polyfit(heights, response, 1), heights)).max()
    assert read(BLOCK, bent)["linearity deviation"].measured == pytest.approx(expected, rel=1e-6)


def test_ball_and_ball_bar() -> None:
    ball = read(BALL, drawn(BALL, noise_mm=0.01))
    assert ball["size"].error == pytest.approx(0.0, abs=0.005)
    # Noise is along z: across the surface it is smaller by the cosine, at most its own 5.9 sigma range.
    assert 0.03 < ball["form, 95 % of the points"].measured < 0.0392 * 1.1
    assert ball["form"].en is None
    bar = read(BAR, drawn(BAR, turn_deg=30))
    assert bar["spacing"].measured == pytest.approx(100.0, abs=1e-6)
    assert bar["ball 2: size"].measured == pytest.approx(30.0, abs=1e-6)


def test_flat_wedge_and_box() -> None:
    flat = target("flat", flatness_mm=q(0.0, 0.01))
    surface = drawn(flat)
    bowl = Drawn(surface.x, surface.y, surface.z + 2e-6 * (surface.x**2 + surface.y**2))
    half = (199.5 - 3) * PIXEL_MM  # without the rim of three pixels
    # The worst 3 per mille are the four corners: each loses a triangle of legs a with a^2 / 2 = 0.003 (2 half)^2 / 4,
    # along whose long side x^2 + y^2 is 2 half^2 - 2 half a + a^2 / 2.
    leg = half * np.sqrt(0.006)
    assert read(flat, bowl)["flatness"].measured == pytest.approx(2e-6 * (2 * half**2 - 2 * half * leg), rel=0.01)
    wedge = target("wedge", angle_deg=q(10.0), width_mm=q(120.0), length_mm=q(100.0))
    assert read(wedge, drawn(wedge, turn_deg=-15))["angle"].measured == pytest.approx(10.0, abs=1e-6)
    box = target("box", width_mm=q(80.0), length_mm=q(60.0), height_mm=q(20.0))
    assert read(box, drawn(box, stretch=0.99))["height"].error == pytest.approx(-0.2, abs=1e-9)


def test_an_influence_reaches_heights_in_proportion_and_spacing_through_the_scale() -> None:
    def components(u, v, z):
        x, y = (u - 199.5) * PIXEL_MM, (199.5 - v) * PIXEL_MM
        up, across = (
            UncertaintyComponent(Influence.INPUT, 1.0, detail=f"{name} scale") for name in ("height", "lateral")
        )
        yield up, np.stack([x, y, 1.001 * z], axis=1)
        yield across, np.stack([1.0005 * x, 1.0005 * y, z], axis=1)

    steps = read(BLOCK, drawn(BLOCK), components)
    assert contributions(steps["step of 20 mm"])["height scale"] == pytest.approx(0.020, rel=1e-6)
    assert contributions(steps["step of 20 mm"])["lateral scale"] == pytest.approx(0.0, abs=1e-9)
    assert steps["step of 20 mm"].u_measured == pytest.approx(0.020, rel=1e-6)
    bar = read(BAR, drawn(BAR), components)
    assert contributions(bar["spacing"])["lateral scale"] == pytest.approx(0.05, rel=1e-3)


def test_scatter_of_a_mean_follows_the_noise() -> None:
    box = target("box", width_mm=q(80.0), length_mm=q(60.0), height_mm=q(20.0))
    reading = read(box, drawn(box, noise_mm=0.05))["height"]
    points = min(reading.points, 6000)
    # The jackknife of 24 blocks scatters by 1 / sqrt(2 * 23) = 15 %.
    assert contributions(reading)[Influence.ARTEFACT_SCATTER] == pytest.approx(0.05 / np.sqrt(points), rel=0.45)


def test_table_holds_every_number() -> None:
    surface = drawn(BLOCK, stretch=1.001)
    table = readings_table(take_readings(probe(BLOCK, surface), surface, exact)).set_index("name")
    assert list(table.index)[:3] == ["step of 5 mm", "step of 10 mm", "step of 20 mm"]
    # Nothing moves and nothing scatters: only the certificate's 0.003 mm stands against the error of 0.02 mm.
    assert table.loc["step of 20 mm", "en"] == pytest.approx(0.02 / (1.959964 * 0.003), rel=1e-6)
    assert np.isnan(table.loc["linearity deviation", "en"])


@pytest.mark.parametrize(
    ("artefact", "message"),
    [
        (BALL, "0 of 1 balls"),
        (BLOCK, "0 of 3 height steps"),
        (target("box", width_mm=q(80.0), length_mm=q(60.0), height_mm=q(20.0)), "no top of the box"),
    ],
)
def test_a_bare_plate_is_no_artefact(artefact, message) -> None:
    bare = drawn(target("flat", flatness_mm=q(0.0)))
    with pytest.raises(FitError, match=message):
        probe(artefact, bare)


def test_what_has_no_surface_is_refused() -> None:
    with pytest.raises(FitError, match="strips"):
        probe(
            target("strips", count=3, width_mm=q(10.0), gap_mm=q(10.0), height_mm=q(3.0), length_mm=q(100.0)),
            drawn(target("flat", flatness_mm=q(0.0))),
        )


def test_temperature_that_rig_and_block_have_in_common_cancels():
    warm = 2e-5  # relative: 0.4 um on 20 mm

    def by_component(u, v, z):
        moved = np.stack([(u - 199.5) * PIXEL_MM, (199.5 - v) * PIXEL_MM, z * (1 + warm)], axis=-1)
        yield UncertaintyComponent(Influence.TEMPERATURE, np.zeros(1)), moved

    block = target("steps", heights_mm=q([5.0, 10.0, 20.0], 0.0), width_mm=q(30.0), length_mm=q(60.0))
    surface = drawn(block)
    found = probe(block, surface)
    by_rig = by_name(take_readings(found, surface, by_component))
    both = by_name(take_readings(found, surface, by_component, thermal_rel_u=warm))
    name = max(by_rig, key=lambda n: by_rig[n].measured)
    assert by_rig[name].u_measured == pytest.approx(warm * by_rig[name].measured, rel=0.02)
    assert both[name].u_reference == pytest.approx(warm * both[name].reference, rel=1e-6)
    assert both[name].shared == pytest.approx(both[name].u_measured * both[name].u_reference, rel=0.02)
