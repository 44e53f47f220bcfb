"""What can be wrong with a phase-shifted set, one test for each cause; `doctor.diagnose` runs them all.

Every test looks at what its cause does first hand (two equal frames, a frame's background, a harmonic), because
the ripple of the phase alone names a family only: order 1 a frame's brightness, order 2 phase shifts, order N gamma.
"""

from fringecal.phase.diagnostics.compression import compressed
from fringecal.phase.diagnostics.symptoms_frames import duplicates, foreign, mirrored, misordered
from fringecal.phase.diagnostics.symptoms_light import brightness, contrast, saturated, waveform
from fringecal.phase.diagnostics.symptoms_scene import other_scene
from fringecal.phase.diagnostics.symptoms_shifts import sampling, wrong_phase_shifts

TESTS = (
    other_scene,
    duplicates,
    misordered,
    mirrored,
    foreign,
    saturated,
    brightness,
    wrong_phase_shifts,
    waveform,
    contrast,
    sampling,
    compressed,
)
