"""Pixels only: grid lines and their crossings, boards, strips in a picture."""
