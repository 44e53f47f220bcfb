"""Diagnostics of phase-shifted frames: what is wrong with them, what it costs, what to do."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fringecal.errors import PhaseError
from fringecal.phase.demodulation.adapted import smoothed_noise
from fringecal.phase.demodulation.blocks import RIPPLE_ORDERS, Block, measure_blocks
from fringecal.phase.demodulation.demodulate import PhaseMap, demodulate
from fringecal.phase.demodulation.fringe_period import FringePeriod, fringe_period
from fringecal.phase.demodulation.phase_shifts import PhaseShiftEstimate, phase_shifts_and_blocks
from fringecal.phase.demodulation.waveform import Waveform, waveform_of_blocks
from fringecal.phase.diagnostics.compression import square_contrast
from fringecal.phase.diagnostics.evidence import Evidence, Finding, sparse
from fringecal.phase.diagnostics.finding_kinds import FindingKind
from fringecal.phase.diagnostics.finding_limits import FINDING_LIMITS, FindingLimits
from fringecal.phase.diagnostics.looks import Look, looked_for, looks
from fringecal.phase.diagnostics.symptoms import TESTS
from fringecal.phase.diagnostics.symptoms_scene import frame_spectra


@dataclass(frozen=True)
class Diagnosis:
    """What the frames show.

    Parameters
    ----------
    findings
        What is wrong, the costliest first; empty if nothing is.
    map
        The set demodulated with the stated phase shifts.
    period, phase_shifts, wave
        Fringe period, phase shifts and waveform as measured; None where the scene does not allow it.
    ripple
        Ripple that the phase has with the stated phase shifts, by order k (1 brightness, 2 phase shifts, 3 gamma with
        three frames): the error is the sum of `Re(r_k exp(-i k phase))`, rad; empty where it was not measured.
    notes
        What could not be measured, and why.
    looks
        Of every test, whether it could see, and from which size on.
    """

    findings: tuple[Finding, ...]
    map: PhaseMap
    period: FringePeriod | None
    phase_shifts: PhaseShiftEstimate | None
    wave: Waveform | None
    ripple: dict[int, complex]
    notes: tuple[str, ...]
    looks: tuple[Look, ...] = ()

    @property
    def fatal(self) -> bool:
        """Return whether the set is not one: no correction makes a phase of it."""
        return any(finding.kind.fatal for finding in self.findings)

    def looked(self) -> tuple[str, ...]:
        """Say what was looked for, from which size on, and what could not be looked for."""
        return looked_for(self.looks)

    @property
    def ripple_rad(self) -> dict[int, float]:
        """Return the amplitude of each order of ripple, rad."""
        return {order: abs(value) for order, value in self.ripple.items()}

    def kinds(self) -> tuple[FindingKind, ...]:
        """Return the kinds of the findings."""
        return tuple(finding.kind for finding in self.findings)


def diagnose(
    frames: ArrayLike,
    phase_shifts_rad: ArrayLike,
    *,
    white_level: float | None = None,
    reference: ArrayLike | None = None,
    mask: ArrayLike | None = None,
    mm_per_rad: float | None = None,
    of_several: bool = False,
    limits: FindingLimits = FINDING_LIMITS,
) -> Diagnosis:
    """Look for every fault that phase-shifted frames can show.

    Parameters
    ----------
    frames
        Grey values, (N, H, W), best of the bare plate; of an object, what is smooth in it is used.
    phase_shifts_rad
        Stated phase shifts, rad, (N,).
    white_level
        Saturation, grey levels; by default the largest of an integer type.
    reference
        Frames of the bare plate, (N, H, W), where `frames` show an object: a swap of three frames can only be
        seen against them.
    mask
        True where the surface is smooth, (H, W).
    mm_per_rad
        Height that one radian stands for, to state costs in mm.
    of_several
        True for the longer periods of several: that there are few fringes is then no fault.
    limits
        From which size on a fault is named.

    Raises
    ------
    PhaseError
        Frames and phase shifts that do not fit together, as in `demodulate`.
    """
    grey = np.asarray(frames)
    phase_shifts = np.asarray(phase_shifts_rad, np.float64).ravel()
    # A large residual is a symptom here, and no reason to look away.
    map_ = demodulate(grey, phase_shifts, white_level=white_level, max_residual=np.inf)
    evidence = Evidence(
        sparse(grey),
        phase_shifts,
        map_,
        limits=limits,
        spectra=frame_spectra(grey),
        white_level=_white_level(grey, white_level),
        of_several=of_several,
        square_contrast=square_contrast(grey),
    )
    evidence = _with_reference(evidence, grey, reference, white_level)
    notes: list[str] = []
    ripple: dict[int, complex] = {}
    try:
        evidence = replace(evidence, period=fringe_period(map_.phase, map_.valid))
        found, blocks = phase_shifts_and_blocks(grey, phase_shifts, mask=mask, white_level=white_level)
        evidence = replace(evidence, phase_shifts=found, blocks=blocks, wave=waveform_of_blocks(blocks))
        ripple = _ripple(measure_blocks(grey, map_, mask))
    except PhaseError as error:
        notes.append(f"phase shifts, brightness and waveform could not be measured: {error}")
    notes += smoothed_noise(map_, evidence.phase_shifts)
    findings = [finding for test in TESTS for finding in test(evidence)]
    fatal = [finding for finding in findings if finding.kind.fatal]
    return Diagnosis(
        tuple(_priced(fatal or findings, mm_per_rad)),
        map_,
        evidence.period,
        evidence.phase_shifts,
        evidence.wave,
        ripple,
        tuple(notes),
        looks(evidence),
    )


def _white_level(grey: NDArray, stated: float | None) -> float | None:
    """Return the stated level of saturation, or that of the numbers' type."""
    if stated is not None or not np.issubdtype(grey.dtype, np.integer):
        return stated
    return float(np.iinfo(grey.dtype).max)


def _with_reference(
    evidence: Evidence, grey: NDArray, reference: ArrayLike | None, white_level: float | None
) -> Evidence:
    """Add what the reference shows, if there is one of the same size."""
    if reference is None:
        return evidence
    plate = np.asarray(reference)
    if plate.shape != grey.shape:
        raise PhaseError(f"the reference has frames of shape {plate.shape}, the set {grey.shape}: they must be equal")
    map_ = demodulate(plate, evidence.phase_shifts_rad, white_level=white_level, max_residual=np.inf)
    both = sparse(np.concatenate([grey, plate]))
    try:
        period = fringe_period(map_.phase, map_.valid)
    except PhaseError:
        period = None
    return replace(evidence, frames=both[: len(grey)], reference=both[len(grey) :], reference_period=period)


def _ripple(blocks: list[Block]) -> dict[int, complex]:
    """Return each order of ripple, the median over the blocks of either part."""
    if not blocks:
        return {}
    ripples = np.array([block.ripple for block in blocks])
    middle = np.median(ripples.real, axis=0) + 1j * np.median(ripples.imag, axis=0)
    return dict(zip(RIPPLE_ORDERS, middle.tolist(), strict=True))


def _priced(findings: list[Finding], mm_per_rad: float | None) -> list[Finding]:
    """Sort findings by cost and state it in mm too."""
    ordered = sorted(findings, key=lambda finding: -(finding.cost_rad or 0.0))
    if mm_per_rad is None:
        return ordered
    return [
        finding if finding.cost_rad is None else replace(finding, cost_mm=finding.cost_rad * abs(mm_per_rad))
        for finding in ordered
    ]
