"""Pixels only: schemes, demodulation with noise and mask, unwrapping, and the steps found from the frames."""

from fringecal.phase.demodulate import PhaseMap, Reason, demodulate
from fringecal.phase.noise import Noise, estimate_noise, noise_from_repeats
from fringecal.phase.schemes import Scheme, buckets, carre, least_squares, quadrant_phase, scheme
from fringecal.phase.unwrap import Unwrapped, unwrap

__all__ = [
    "Noise",
    "PhaseMap",
    "Reason",
    "Scheme",
    "Unwrapped",
    "buckets",
    "carre",
    "demodulate",
    "estimate_noise",
    "least_squares",
    "noise_from_repeats",
    "quadrant_phase",
    "scheme",
    "unwrap",
]
