"""Calibration and metrology of fringe-projection rigs."""

__version__ = "0.1.0"
