"""From which size on a fault of phase-shifted frames is named."""

from dataclasses import dataclass

from fringecal.phase.demodulation.adapted import LEAST_CHANGE_RAD


@dataclass(frozen=True)
class FindingLimits:
    """Sizes from which faults are named: with them those of drawn plates that cost so much are, none on clean sets.

    That campaign is `benchmarks/doctor_campaign.py`; its results, and the faults that look alike, stand in
    docs/phase.md. A deviation must be significant besides.

    Parameters
    ----------
    equal_share
        Two frames are of one phase shift if they differ by less than this share of what frames of this set differ by.
    apart_rad
        Difference of stated phase shifts below which two frames may be equal, rad.
    above_noise
        Times the noise that frames must differ by for such a comparison.
    misordered
        Frames are in another order if their residual falls to this share of that in the order given.
    misfit_over_noise, misfit_of_power
        The residual in the order given must be above this many variances of the noise, and this share of the frames'
        whole variance.
    alike
        Orders whose residual is within this factor of the best one's fit alike.
    most_permuted
        Frames of which all orders are tried (720 of six); of more, two are exchanged.
    mirrored_cosine
        Cosine between the fringes of set and reference, below which one runs the other way.
    shown_noise, foreign_noise
        A frame shows the reference if it differs from it by less than so many deviations of the noise, and all others
        by more than so many.
    background
        Change of one frame's background, as a share: of three frames, one that is 1 % brighter costs 0.013 rad at most.
    blur
        Loss of one frame's modulation at the same background, as a share: `1 - exp(-s^2 / 2)` of fringes that moved
        by s = 0.29 rad, rms, while it was exposed.
    clipping, of_second
        Third harmonic that no gamma explains, as a share of the first, and of the second: two gammas one after the
        other, or light added between, leave so much.
    gamma_rad
        Ripple from which harmonics are named, rms, rad: what they cost with the phase shifts at hand.
    scene_cycles
        Fringes in the picture from which spectra tell frames apart.
    scene_apart, scene_over_others
        A frame shows something else from this share of the spectrum, and so many times what other frames differ by:
        clean sets reach 0.02, a period longer by a fringe of the picture 0.08.
    least_cost_rad
        Ripple below which frames of other brightness are no finding, rms, rad.
    saturated
        Share of the picture's pixels at the white level.
    contrast
        Modulation over background, where a sharp slide gives 0.6 to 0.9.
    phase_shifts_rad
        Rms ripple by wrong phase shifts, rad: a third of the noise of one good pixel, 0.01.
    change_rad
        Change of a phase shift from edge to edge, rad: what is corrected besides.
    period_px, fringes
        Pixels per fringe, and fringes in the picture, below which heights are measured badly.
    square_contrast
        Fine power of squares of 8 px athwart over that of squares in place, from which frames were compressed: 1.02 at
        most on clean sets of plates, strips and ridges, 1.09 at least after JPEG of a quality of 95.
    """

    equal_share: float = 0.15
    apart_rad: float = 0.1
    above_noise: float = 3.0
    misordered: float = 0.3
    misfit_over_noise: float = 10.0
    misfit_of_power: float = 0.05
    alike: float = 1.05
    most_permuted: int = 6
    mirrored_cosine: float = -0.5
    shown_noise: float = 2.0
    foreign_noise: float = 4.0
    background: float = 0.01
    blur: float = 0.04
    clipping: float = 0.045
    of_second: float = 0.35
    gamma_rad: float = 0.012
    scene_cycles: float = 3.0
    scene_apart: float = 0.07
    scene_over_others: float = 3.0
    least_cost_rad: float = 0.004
    saturated: float = 0.003
    contrast: float = 0.25
    phase_shifts_rad: float = 0.004
    change_rad: float = LEAST_CHANGE_RAD
    period_px: float = 6.0
    fringes: float = 4.0
    square_contrast: float = 1.05


FINDING_LIMITS = FindingLimits()
