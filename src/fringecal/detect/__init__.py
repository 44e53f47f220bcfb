"""Pixels only: lines, crossings and strips found in a picture, each with its sigma."""
