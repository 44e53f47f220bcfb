"""The projector of a virtual rig: the phase its slide puts on any point in space."""

from typing import NamedTuple

import numpy as np

from fringecal.simulate.rig.drawn_camera import Three, Two
from fringecal.simulate.rig.rig_spec import ProjectorSpec, RigSpec
from fringecal.simulate.tracing.compiled import compiled

N_HARMONICS = 63  # of the slide: a square wave's next one is 1.5 % of the first, and blur takes it
NEGLIGIBLE = 1e-7  # of the mean light, for harmonics that are left out: a thousandth of 16 bit's last one
SERIES_SAMPLES = 8192  # of a fringe, for the series of a gamma: harmonics alias from the 8129th on
ALONG_X = 0.9  # cosine against x from which the projector counts as looking along it


class Projector(NamedTuple):
    """A projector ready for tracing; lengths in mm.

    `axes` has two directions across the optical axis and the axis itself as rows; `carrier` is the
    gradient of phase over the slide's two coordinates (tangents to the axis).
    """

    position: Three
    axes: tuple[Three, Three, Three]
    carrier: Two
    phase0: float
    lens: Two


@compiled
def slide_point(projector: Projector, x: float, y: float, z: float) -> tuple[float, float]:
    """Slide coordinates (tangents, lens included) of the ray through a point of the plate frame."""
    s, e = projector.position, projector.axes
    dx, dy, dz = x - s[0], y - s[1], z - s[2]
    depth = e[2][0] * dx + e[2][1] * dy + e[2][2] * dz
    p = (e[0][0] * dx + e[0][1] * dy + e[0][2] * dz) / depth
    q = (e[1][0] * dx + e[1][1] * dy + e[1][2] * dz) / depth
    r2 = p * p + q * q
    radial = 1 + r2 * (projector.lens[0] + r2 * projector.lens[1])
    return p * radial, q * radial


@compiled
def phase_at(projector: Projector, x: float, y: float, z: float) -> float:
    """Unwrapped phase in rad at a point of the plate frame, in mm."""
    p, q = slide_point(projector, x, y, z)
    return projector.carrier[0] * p + projector.carrier[1] * q + projector.phase0


def build_projector(spec: ProjectorSpec) -> Projector:
    """Aim the projector, turn its slide and rule it so that the plate's origin sees pitch and direction."""
    position = np.array(spec.position_mm)
    forward = np.array([*spec.aim_mm, 0.0]) - position
    forward /= np.linalg.norm(forward)
    # Any direction across the axis will do for the first slide coordinate: the carrier takes up the
    # turn. The plate's x axis serves unless the projector looks along it.
    helper = np.eye(3)[int(abs(forward[0]) > ALONG_X)]
    first = helper - (helper @ forward) * forward
    first /= np.linalg.norm(first)
    axes = tuple(tuple(row.tolist()) for row in (first, np.cross(forward, first), forward))
    bare = Projector(spec.position_mm, axes, (0.0, 0.0), 0.0, spec.distortion)  # type: ignore[arg-type]
    across = np.radians(spec.across_deg)
    wanted = 2 * np.pi / spec.pitch_mm * np.array([np.cos(across), np.sin(across)])
    carrier = np.linalg.solve(slide_gradient(bare, np.zeros(3))[:2], wanted)
    phase0 = spec.phase_at_origin_rad - float(carrier @ slide_point(bare, 0.0, 0.0, 0.0))
    return bare._replace(carrier=(float(carrier[0]), float(carrier[1])), phase0=phase0)


def slide_gradient(projector: Projector, point_mm: np.ndarray) -> np.ndarray:
    """Gradient of the two slide coordinates at a point: shape (3, 2), rows x, y, z, in 1/mm."""
    axes = np.array(projector.axes)
    along = axes @ (np.asarray(point_mm, float) - projector.position)
    p, q = along[:2] / along[2]
    tangents = (axes[:2] - np.outer((p, q), axes[2])) / along[2]
    k1, k2 = projector.lens
    r2 = p * p + q * q
    slope = 2 * (k1 + 2 * k2 * r2)
    lens = (1 + r2 * (k1 + r2 * k2)) * np.eye(2) + slope * np.outer((p, q), (p, q))
    return (lens @ tangents).T


def phase_gradient(projector: Projector, point_mm: np.ndarray) -> np.ndarray:
    """Gradient of phase at a point of the plate frame, shape (3,), in rad/mm."""
    return slide_gradient(projector, point_mm) @ projector.carrier


def rational_form(projector: Projector) -> np.ndarray:
    """Seven numbers of phi(X) = (n.X + n0) / (d.X + 1): n, n0, d; exact for a lens without distortion."""
    axes, position = np.array(projector.axes), np.array(projector.position)
    across = projector.carrier @ axes[:2]
    scale = -float(position @ axes[2])
    d = axes[2] / scale
    n = across / scale + projector.phase0 * d
    n0 = -float(across @ position) / scale + projector.phase0
    return np.array([*n, n0, *d])


def harmonics(rig: RigSpec) -> np.ndarray:
    """Cosine series of the light on the plate, mean 1: a_0 + a_1 cos(phi) + a_2 cos(2 phi) + ...

    The slide transmits (1 + contrast w(phi)) / 2 to the power gamma, w a cosine or its sign; blur by
    a Gaussian of standard deviation s at pitch p multiplies a_k by exp(-2 (pi k s / p)^2).
    """
    spec = rig.projector
    series = _square_series(spec) if spec.profile == "square" else _sinusoid_series(spec)
    order = np.arange(series.size)
    series = series / series[0] * np.exp(-2 * (np.pi * order * spec.defocus_mm / spec.pitch_mm) ** 2)
    kept = np.flatnonzero(np.abs(series) > NEGLIGIBLE)
    return series[: max(2, kept[-1] + 1)]


def _square_series(spec: ProjectorSpec) -> np.ndarray:
    high, low = ((1 + spec.contrast) / 2) ** spec.gamma, ((1 - spec.contrast) / 2) ** spec.gamma
    order = np.arange(1, N_HARMONICS + 1)
    odd = 2 / (np.pi * order) * np.sin(np.pi * order / 2)
    return np.concatenate([[(high + low) / 2], (high - low) * odd])


def _sinusoid_series(spec: ProjectorSpec) -> np.ndarray:
    phi = 2 * np.pi * np.arange(SERIES_SAMPLES) / SERIES_SAMPLES
    transmitted = ((1 + spec.contrast * np.cos(phi)) / 2) ** spec.gamma
    series = np.fft.rfft(transmitted).real[: N_HARMONICS + 1] / phi.size
    return np.concatenate([series[:1], 2 * series[1:]])
