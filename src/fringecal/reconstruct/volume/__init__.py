"""Points in a calibrated volume, pixel by pixel, by a rig whose projector is an inverse camera."""
