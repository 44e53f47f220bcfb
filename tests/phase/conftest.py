"""An independent forward model: frames written out once more, so that no test calls the code under test."""

import cv2
import numpy as np
import pytest


def _fringes(phi, phase_shifts_rad, background=120.0, modulation=80.0):
    steps = np.asarray(phase_shifts_rad, float).reshape(-1, *(1,) * np.ndim(phi))
    return background + modulation * np.cos(np.asarray(phi, float) + steps)


def _camera(frames, rng, *, sigma=0.0, gain=0.0, white=255, dtype=np.uint8):
    noisy = frames + rng.standard_normal(frames.shape) * np.sqrt(sigma**2 + gain * np.maximum(frames, 0))
    return np.clip(np.rint(noisy), 0, white).astype(dtype)


def _wrap(x):
    return np.angle(np.exp(1j * np.asarray(x, float)))


@pytest.fixture(scope="session")
def fringes():
    """Frames I_n = A + B cos(phi + delta_n), float64."""
    return _fringes


@pytest.fixture(scope="session")
def camera():
    """A camera: shot and read noise, rounding, clipping."""
    return _camera


@pytest.fixture(scope="session")
def wrap():
    return _wrap


@pytest.fixture
def rng():
    return np.random.default_rng(20260)


def _read(folder, names):
    return np.stack([cv2.imread(str(folder / name), cv2.IMREAD_GRAYSCALE) for name in names])


@pytest.fixture(scope="session")
def lens_frames(request):
    folder = request.config.rootpath / "tests" / "data" / "fpp_tools_lens"
    return _read(folder, [f"lens_orig_{angle:03d}.jpg" for angle in (0, 90, 180, 270)])


@pytest.fixture(scope="session")
def kamino_frames(request):
    """Real three-step sets at two periods, (2, 3, H, W)."""
    folder = request.config.rootpath / "tests" / "data" / "kamino_object1"
    frames = _read(folder, [f"pat{k:02d}.png" for k in range(6)])
    return frames.reshape(2, 3, *frames.shape[1:])


@pytest.fixture(scope="session")
def wall_frames(request):
    """Two real three-step sets of a flat wall with different gamma, (6, H, W)."""
    folder = request.config.rootpath / "tests" / "data" / "kamino_gamma_plane"
    return _read(folder, [f"pat{k:02d}.png" for k in range(6)])
