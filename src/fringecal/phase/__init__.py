"""Pixels only: schemes, demodulation with noise and mask, unwrapping, and a doctor for the frames."""

from fringecal.phase.absolute import AbsolutePhase, absolute_phase
from fringecal.phase.adapted import Adapted, demodulate_adapted
from fringecal.phase.corrections import correct_steps, equalise
from fringecal.phase.counting import count_fields
from fringecal.phase.demodulate import PhaseMap, Reason, demodulate
from fringecal.phase.doctor import Diagnosis, diagnose
from fringecal.phase.evidence import Finding
from fringecal.phase.fourier import fourier_phase
from fringecal.phase.gray import decode_gray, unwrap_gray
from fringecal.phase.guided import unwrap_guided
from fringecal.phase.noise import Noise, estimate_noise, noise_from_repeats
from fringecal.phase.orders import FringeOrders, decide_orders
from fringecal.phase.period import FringePeriod, carrier, fringe_period, phase_gradient
from fringecal.phase.repeats import RepeatScatter, compare_repeats, findings_of_repeats, mean_of_repeats
from fringecal.phase.schemes import Scheme, buckets, carre, least_squares, quadrant_phase, scheme
from fringecal.phase.smoothing import smooth_phase
from fringecal.phase.steps import StepEstimate, estimate_steps
from fringecal.phase.strips import demodulate_strips
from fringecal.phase.summary import PhaseSummary, demand_phase, summarise
from fringecal.phase.temporal import beat_period, beat_phase, order_error_rate, unwrap_temporal
from fringecal.phase.unwrap import Unwrapped, unwrap
from fringecal.phase.waveform import Waveform, correct_gamma, estimate_waveform, phase_error

__all__ = [
    "AbsolutePhase",
    "Adapted",
    "Diagnosis",
    "Finding",
    "FringeOrders",
    "FringePeriod",
    "Noise",
    "PhaseMap",
    "PhaseSummary",
    "Reason",
    "RepeatScatter",
    "Scheme",
    "StepEstimate",
    "Unwrapped",
    "Waveform",
    "absolute_phase",
    "beat_period",
    "beat_phase",
    "buckets",
    "carre",
    "carrier",
    "compare_repeats",
    "correct_gamma",
    "correct_steps",
    "count_fields",
    "decide_orders",
    "decode_gray",
    "demand_phase",
    "demodulate",
    "demodulate_adapted",
    "demodulate_strips",
    "diagnose",
    "equalise",
    "estimate_noise",
    "estimate_steps",
    "estimate_waveform",
    "findings_of_repeats",
    "fourier_phase",
    "fringe_period",
    "least_squares",
    "mean_of_repeats",
    "noise_from_repeats",
    "order_error_rate",
    "phase_error",
    "phase_gradient",
    "quadrant_phase",
    "scheme",
    "smooth_phase",
    "summarise",
    "unwrap",
    "unwrap_gray",
    "unwrap_guided",
    "unwrap_temporal",
]
