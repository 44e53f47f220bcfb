"""From phase-shifted frames to wrapped phase: phase shifts, noise, mask, shape of the fringes."""
