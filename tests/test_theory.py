"""The pages of docs/theory: their parts, and the numbers and claims on them, worked by the code they name."""

import math
import re
from pathlib import Path

import numpy as np
import pytest
from scipy import special, stats

from fringecal.phase import phase_error
from fringecal.projector import RigModel
from fringecal.projector.rig_model import PlateResidual

PAGES = sorted((Path(__file__).parents[1] / "docs" / "theory").glob("*.md"))
TEXT = {page.stem: page.read_text(encoding="utf-8") for page in PAGES}
PARTS = ["Symbols", "In the code", "What these numbers do not cover", "Sources"]


@pytest.mark.parametrize("page", TEXT)
def test_a_page_has_symbols_code_limits_and_sources(page):
    headings = re.findall(r"^## (.+)$", TEXT[page], flags=re.MULTILINE)
    assert [heading for heading in headings if heading in PARTS] == PARTS


@pytest.mark.parametrize("page", TEXT)
def test_equations_are_numbered_from_one(page):
    numbers = [int(n) for n in re.findall(r"^\((\d+)\) {2,}", TEXT[page], flags=re.MULTILINE)]
    assert numbers == list(range(1, len(numbers) + 1))


@pytest.mark.parametrize("page", TEXT)
def test_equations_fit_a_page_of_the_site(page):
    """Longer lines would have to be scrolled."""
    blocks = re.findall(r"^```text\n(.*?)^```", TEXT[page], flags=re.DOTALL | re.MULTILINE)
    assert [line for block in blocks for line in block.splitlines() if len(line) > 90] == []


# ---- phase in space -------------------------------------------------------------------------------
def pinhole(projector_mm: np.ndarray) -> RigModel:
    """Fringes along x from a point, aimed at the origin; phase rises toward +y, where the projector stands."""
    depth = -projector_mm / np.linalg.norm(projector_mm)
    across = np.cross(depth, [-1.0, 0.0, 0.0])
    below = -float(depth @ projector_mm)
    gain = 800.0 / below
    return RigModel(np.array([*gain * across, -gain * float(across @ projector_mm), *depth / below]), projector_mm)


def test_the_table_of_apparent_angles():
    """The plate point that the camera sees behind a strip, less the foot of the projector's ray, over the height."""
    rows = re.findall(r"^\| (\d+) \| (telecentric|\d+) \| ([\d. |]+) \|$", TEXT["phase-in-space"], flags=re.MULTILINE)
    assert len(rows) == 4
    y, h = np.array([-150.0, -75.0, 0.0, 75.0, 150.0]), 3.0
    for projector_height, camera_height, angles in rows:
        height = float(projector_height)
        model = pinhole(np.array([0.0, height * math.tan(math.radians(50.7)), height]))
        behind = y if camera_height == "telecentric" else y + y * h / (float(camera_height) - h)
        foot = model.foot(0.0, y, h)[1]
        found = np.degrees(np.arctan((behind - foot) / h))
        assert found == pytest.approx([float(a) for a in angles.split(" | ")], abs=0.005)
        assert model.phase(0.0, y, h) == pytest.approx(model.phase(0.0, foot, 0.0), rel=1e-12)


def test_inverse_linear_law_of_a_pixel_follows_from_the_seven_numbers():
    """(4): alpha and beta of a pixel, written out of the ratio."""
    model = pinhole(np.array([100.0, 1200.0, 1000.0]))
    a, b = np.array([80.0, -60.0]), np.array([-0.05, 0.04])
    n, n0, d = model.parameters[:3], model.parameters[3], model.parameters[4:]
    n_plate, d_plate = float(n[:2] @ a + n0), float(d[:2] @ a + 1)
    n_slope, d_slope = float(n[:2] @ b + n[2]), float(d[:2] @ b + d[2])
    alpha, beta = (n_slope - n_plate / d_plate * d_slope) / d_plate, -d_slope / d_plate
    z = np.array([-10.0, 5.0, 40.0])
    difference = model.phase(*(a[:, None] + b[:, None] * z), z) - model.phase(*a, 0.0)
    assert 1 / (alpha / difference + beta) == pytest.approx(z, rel=1e-10)


def test_strips_of_one_height_fit_any_stated_height():
    """For every assumed height one pair (n_z, d_z) gives the strips' phase exactly, and all heights follow it."""
    model, camera = pinhole(np.array([0.0, 1200.0, 1000.0])), np.array([20.0, -30.0, 1500.0])
    nx, ny, nz, n0, dx, dy, dz = model.parameters
    a = np.random.default_rng(3).uniform(-150, 150, (2, 200))
    true, stated = 3.0, 3.3

    def ray(z: float) -> np.ndarray:
        return a + (camera[:2, None] - a) * z / camera[2]

    def shrunk(z: float) -> float:
        return 1 - z / camera[2]

    # phi = (n.a g + n_z z + n.c (1 - g) + n0) / (d.a g + d_z z + d.c (1 - g) + 1) with g = 1 - z / C_z.
    ratio = shrunk(stated) / shrunk(true)
    seen = [v[0] * camera[0] + v[1] * camera[1] for v in ((nx, ny), (dx, dy))]
    over = [w * true + s * (1 - shrunk(true)) + o for w, s, o in zip((nz, dz), seen, (n0, 1.0), strict=True)]
    pair = [
        (ratio * whole - s * (1 - shrunk(stated)) - o) / stated
        for whole, s, o in zip(over, seen, (n0, 1.0), strict=True)
    ]
    other = RigModel(np.array([nx, ny, pair[0], n0, dx, dy, pair[1]]), np.full(3, np.inf), PlateResidual())
    assert other.phase(*a) == pytest.approx(model.phase(*a), rel=1e-12)  # the plate is the same
    assert other.phase(*ray(stated), stated) == pytest.approx(model.phase(*ray(true), true), rel=1e-12)
    factor = stated / shrunk(stated) / (true / shrunk(true))
    for z in (-5.0, 20.0, 60.0):
        reduced = factor * z / shrunk(z)
        read = reduced / (1 + reduced / camera[2])  # z / (1 - z / C_z) is what grows by the factor
        assert other.phase(*ray(read), read) == pytest.approx(model.phase(*ray(z), z), rel=1e-12)


def test_the_point_measured_is_not_the_plate_point_behind_it():
    apart = 150 / (1 - 50 / 1000) - 150
    assert f"the two are {apart:.1f} mm apart" in " ".join(TEXT["phase-in-space"].split())


# ---- phase from frames ----------------------------------------------------------------------------
PHI = 2 * np.pi * np.arange(2048) / 2048
THIRDS = np.deg2rad([0.0, 120.0, 240.0])


def ripple(error: np.ndarray) -> np.ndarray:
    return error - error.mean()


def test_ripple_of_wrong_phase_shifts():
    epsilon = np.deg2rad(0.1)
    error = phase_error(THIRDS, true_phase_shifts_rad=THIRDS + epsilon * np.arange(-1, 2))
    expected = np.abs(epsilon) / math.sqrt(3)
    assert np.abs(ripple(error)).max() == pytest.approx(expected, rel=5e-3)
    assert abs(np.mean(ripple(error) * np.exp(-2j * PHI))) == pytest.approx(expected / 2, rel=5e-3)


def test_ripple_of_one_brighter_frame():
    share, background = 1e-3, 1.5  # of A; A over B
    error = phase_error(THIRDS, offsets=[share * background, 0.0, 0.0])
    assert np.abs(error).max() == pytest.approx(2 / 3 * share * background, rel=2e-3)
    assert abs(np.mean(error * np.exp(-1j * PHI))) == pytest.approx(share * background / 3, rel=2e-3)


def test_ripple_of_the_second_harmonic():
    error = phase_error(THIRDS, ratios=[1e-3])
    assert error == pytest.approx(-1e-3 * np.sin(3 * PHI), abs=2e-6)


def test_share_of_fringeless_pixels_that_pass():
    """Modulation of noise alone follows Rayleigh's distribution: u = sqrt(2/N) sigma/B at the limit of B."""
    u, rng = 0.5, np.random.default_rng(1)
    frames = rng.normal(size=(3, 200_000))
    cosine = 2 / 3 * (frames * np.cos(THIRDS)[:, None]).sum(axis=0)
    sine = -2 / 3 * (frames * np.sin(THIRDS)[:, None]).sum(axis=0)
    passed = np.mean(math.sqrt(2 / 3) / np.hypot(cosine, sine) < u)
    assert passed == pytest.approx(math.exp(-1 / (2 * u**2)), abs=0.002)
    assert "exp(−1/(2u²))" in TEXT["phase-from-frames"]


# ---- tests and detection limits -------------------------------------------------------------------
def test_factors_of_the_detection_limits():
    distortion = stats.norm.ppf(0.975) + stats.norm.ppf(0.95)
    assert f"= {distortion:.2f} u(d)" in TEXT["camera-over-the-plate"]
    page = " ".join(TEXT["verification"].split())
    plain = math.sqrt(special.chndtrinc(special.chdtri(19, 0.01), 19, 0.05))
    share = np.linspace(0.01, 1, 400)
    worst = [math.sqrt((share * special.chndtrinc(special.chdtri(n, 0.01) / share, n, 0.05)).max()) for n in (19, 1)]
    assert f"D = {worst[0]:.2f} u for 19 quantities ({plain:.2f} u by (7) alone), and {worst[1]:.2f} u" in page


def test_widths_of_form_definitions_on_white_noise():
    page = " ".join(TEXT["verification"].split())
    vdi, iso = 2 * stats.norm.ppf(1 - 0.003 / 2), 2 * stats.norm.ppf(1 - 0.05 / 2)
    assert f"the first is about {vdi:.1f} σ, the second {iso:.1f} σ" in page


# ---- the projector as an inverse camera -----------------------------------------------------------
def test_a_homography_before_a_pinhole_is_a_pinhole_that_leans():
    """Why a keystone correction shows as aspect and lean: H K is again an upper triangle times a turn."""
    keystone = np.array([[1.0, 0.12, 0.0], [0.0, 1.06, 0.0], [0.0, 1.5e-4, 1.0]])
    core = np.array([[1700.0, 0, 900], [0, 1700, 500], [0, 0, 1]])
    lower, turn = np.linalg.qr((keystone @ core)[::-1].T)
    upper, turn = turn.T[::-1, ::-1], lower.T[::-1]
    assert upper @ turn == pytest.approx(keystone @ core)
    assert turn @ turn.T == pytest.approx(np.eye(3), abs=1e-12)
    upper = upper / upper[2, 2]
    assert np.tril(upper, -1) == pytest.approx(np.zeros((3, 3)), abs=1e-9)
    assert abs(upper[0, 1] / upper[1, 1]) > 0.005  # rad; a lean of 0.002 is named
    assert abs(abs(upper[1, 1] / upper[0, 0]) - 1) > 0.004  # an aspect so far off is named
