"""Rigs whose projector is an inverse camera: both devices, a board in poses, one joint least squares."""
