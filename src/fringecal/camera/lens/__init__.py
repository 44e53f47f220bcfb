"""Lens models, and the full lens from pictures of a board."""
