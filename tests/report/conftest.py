import numpy as np
import pytest


@pytest.fixture
def scene():
    """Plate coordinates and a height map with no symmetry: high at +x +y, a hole at -x -y."""
    column, row = np.meshgrid(np.arange(80), np.arange(60))
    x, y = (column - 39.5) * 2.0, -(row - 29.5) * 2.0
    z = np.zeros(x.shape)
    z[:10, -20:] = 5.0
    z[-10:, :15] = np.nan
    return x, y, z
