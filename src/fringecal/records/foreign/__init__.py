"""Calibrations of a camera, or of a camera and a projector, as other programs write them: read and written."""
