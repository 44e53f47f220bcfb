"""Phase shifts that are not as stated or not the same all over, and fringes too short or too long to be measured."""

from collections.abc import Iterator

import numpy as np

from fringecal.phase.demodulation.phase_shifts import RARE
from fringecal.phase.demodulation.waveform import phase_error, ripple_rms
from fringecal.phase.diagnostics.evidence import Evidence, Finding
from fringecal.phase.diagnostics.finding_kinds import FindingKind


def wrong_phase_shifts(evidence: Evidence) -> Iterator[Finding]:
    """Find phase shifts that are not as stated, or that change over the field."""
    phase_shifts = evidence.phase_shifts
    if phase_shifts is None:
        return
    error = phase_error(phase_shifts.stated_rad, true_phase_shifts_rad=phase_shifts.phase_shifts_rad)
    worst = int(np.abs(phase_shifts.errors_rad).argmax())
    sure = abs(phase_shifts.errors_rad[worst]) > phase_shifts.coverage(RARE) * phase_shifts.u_rad[worst]
    if sure and ripple_rms(error) > evidence.limits.phase_shifts_rad:
        found = ", ".join(f"{angle:.2f}" for angle in np.rad2deg(phase_shifts.phase_shifts_rad))
        yield Finding(
            FindingKind.WRONG_PHASE_SHIFTS,
            f"the frames' phase shifts are {found} deg",
            f"up to {np.rad2deg(phase_shifts.errors_rad[worst]):+z.2f} deg "
            f"(u {np.rad2deg(phase_shifts.u_rad[worst]):.2f}) from those stated",
            ripple_rms(error),
            "state the found phase shifts; or set the mirror more finely",
        )
    height, width = evidence.map.phase.shape
    change = phase_shifts.field_change_rad_px((height, width))
    largest = float(np.abs(change * [width, height]).max())
    if largest > evidence.limits.change_rad:
        yield Finding(
            FindingKind.UNEVEN_PHASE_SHIFTS,
            "a phase shift is not the same all over the field: the fringes turned or stretched as they were moved",
            f"{np.rad2deg(largest):.2f} deg from edge to edge",
            largest / 2 / np.sqrt(6),
            "set the mirror more finely; commission, verify and reconstruct correct what is linear over the field",
        )


def sampling(evidence: Evidence) -> Iterator[Finding]:
    """Find fringes too short for the camera or too long for the picture."""
    period = evidence.period
    if period is None:
        return
    height, width = evidence.map.phase.shape
    direction = np.deg2rad(period.direction_deg)
    length = width * abs(np.cos(direction)) + height * abs(np.sin(direction))
    if period.period_px < evidence.limits.period_px:
        yield Finding(
            FindingKind.SHORT_FRINGES,
            "a pixel averages over a large part of a fringe, and edges mix fringes",
            f"{period.period_px:.1f} px per fringe; 8 to 40 are good",
            None,
            "use a coarser slide or a closer camera",
        )
    elif length / period.period_px < evidence.limits.fringes and not evidence.of_several:
        yield Finding(
            FindingKind.LONG_FRINGES,
            "there are few fringes in the picture: the phase changes little with height",
            f"{period.period_px:.0f} px per fringe, {length / period.period_px:.1f} fringes in the picture",
            None,
            "use a finer slide; keep this one for the fringe order",
        )
