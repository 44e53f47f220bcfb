"""Rays against surfaces, light, and what the camera makes of it."""
