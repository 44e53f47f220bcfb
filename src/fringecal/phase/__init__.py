"""Pixels only: from phase-shifted frames to phase with a standard uncertainty at every pixel."""
