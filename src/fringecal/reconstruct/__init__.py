"""From phase to x, y, z and u(z) in the plate frame."""
