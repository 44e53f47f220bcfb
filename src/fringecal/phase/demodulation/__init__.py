"""From phase-shifted frames to wrapped phase: phase shifts, noise, mask, waveform of the fringes."""
