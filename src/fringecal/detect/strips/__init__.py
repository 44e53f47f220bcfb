"""Strips in a picture, from the phase that they add."""
