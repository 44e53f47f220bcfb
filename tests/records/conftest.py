from types import SimpleNamespace

import numpy as np
import pytest

SCALE_MM = 0.5
SHAPE = (60, 80)


def example_document():
    """A record as plain JSON, written by hand: what the design names, with made-up numbers."""
    angle = {"value": 50.7, "u": 0.02, "dof": 41.0, "unit": "deg"}
    scale = {"value": 0.734, "u": 0.0001, "dof": None, "unit": "mm/px"}
    return {
        "format": "fringecal-calibration/1",
        "created": "2026-11-22T10:00:00Z",
        "software": {"fringecal": "0.1.0"},
        "command": ["fringecal", "commission", "bench", "--out", "out"],
        "session": {"rig": "bench-1", "captured": "2026-11-22T09:00:00Z"},
        "inputs": [{"capture": "grid", "file": "grid.png", "sha256": "0" * 64}],
        "image": {"width": 640, "height": 600, "white_level": 255},
        "camera": {
            "model": "plate",
            "names": ["a", "b"],
            "parameters": [0.734, 1500.0],
            "covariance": [[1e-8, 0.0], [0.0, 25.0]],
            "telecentric": False,
            "width": 640,
            "height": 600,
        },
        "steps": [{"capture": "strips", "stated_rad": [0.0, 2.1, 4.2]}],
        "scale": {"mean": scale, "horizontal": scale, "vertical": scale},
        "distortion": {
            "verdict": "none",
            "max_px": {"value": 0.02, "u": 0.03},
            "detection_limit_px": 0.08,
            "k1": 1e-4,
            "p_value": 0.4,
        },
        "projection": {
            "angle": angle,
            "columns": [{"u_px": 10.0, "x_mm": -1.5, "breaks": 24, "angle_deg": 50.6, "u_deg": 0.05}],
        },
        "rig": {
            "model": "projective",
            "parameter_names": ["n_x"],
            "parameters": [0.1],
            "covariance": [[1e-6]],
            "cross_covariance": [[0.0, 0.0]],
            "residual_rms_rad": 0.02,
            "plate_residual_rms_rad": 0.01,
            "plate_residual": {"degree": 1, "coefficients": [0.0, 0.1, 0.2], "box": [-1.0, 1.0, -2.0, 2.0]},
        },
        "budgets": {"scale": [{"label": "pitch", "u": 0.01, "contribution": 1e-4, "percent": 100.0}]},
        "checks": [{"name": "distortion", "value": 0.02, "limit": 0.1, "decision": "pass"}],
        "targets": {"grid-10mm": {"kind": "line-grid", "pitch_mm": {"value": 10.0, "u": 0.01}}},
        "notes": ["ö and [ brackets ] stay"],
    }


@pytest.fixture
def document():
    return example_document()


@pytest.fixture
def surface():
    """A surface with no symmetry: a corner tower at +x +y, a slope along x, a hole at -x -y.

    Row 0 is the picture's top, so the tower (large y) stands in the first rows and the last columns.
    """
    height, width = SHAPE
    column, row = np.meshgrid(np.arange(width), np.arange(height))
    x, y = (column - (width - 1) / 2) * SCALE_MM, -(row - (height - 1) / 2) * SCALE_MM
    z = 0.05 * x + 2.0
    z[:10, -20:] = 9.0
    mask = np.ones(SHAPE, dtype=bool)
    mask[-12:, :16] = False
    return SimpleNamespace(x=x, y=y, z=np.where(mask, z, np.nan), u_z=np.full(SHAPE, 0.01), mask=mask)
