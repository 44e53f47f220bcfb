"""Cameras and surfaces as files that other programs read."""
