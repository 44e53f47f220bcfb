"""Frames that are not what the list says: copied, taken twice, in another order, or left from before."""

from collections.abc import Iterator
from itertools import combinations, permutations

import numpy as np
from numpy.typing import NDArray

from fringecal.numerics import wrap
from fringecal.phase.diagnostics.evidence import Evidence, Finding
from fringecal.phase.diagnostics.finding_kinds import FindingKind


def _differences(frames: NDArray) -> dict[tuple[int, int], float]:
    """Return the rms difference of every pair of frames."""
    pairs = combinations(range(len(frames)), 2)
    return {(i, j): float(np.sqrt(np.mean((frames[i] - frames[j]) ** 2))) for i, j in pairs}


def duplicates(evidence: Evidence) -> Iterator[Finding]:
    """Find frames that show the same phase shift: copies bit by bit (stale), or taken anew (duplicate)."""
    differences, limits = _differences(evidence.frames), evidence.limits
    typical = max(differences.values())
    noise = float(evidence.map.noise.sigma(evidence.frames.mean())) * np.sqrt(2)
    for (i, j), difference in differences.items():
        apart = abs(float(wrap(evidence.phase_shifts_rad[i] - evidence.phase_shifts_rad[j])))
        unlike = difference > limits.equal_share * typical or typical < limits.above_noise * noise
        if unlike or apart < limits.apart_rad:
            continue
        copied = difference == 0
        yield Finding(
            FindingKind.STALE_FRAME if copied else FindingKind.DUPLICATE_FRAMES,
            f"frames {i + 1} and {j + 1} are {'the same picture, bit by bit' if copied else 'of the same phase shift'}",
            f"they differ by {difference:.2f} grey levels rms, others by {typical:.0f}",
            apart / np.sqrt(6),
            "wait for a new picture before storing it, and take the set again"
            if copied
            else "the fringes were not moved between them: take the set again",
        )


def misordered(evidence: Evidence) -> Iterator[Finding]:
    """Find frames in another order than their phase shifts, from the residual of four frames and more."""
    n, limits = len(evidence.frames), evidence.limits
    if n < 4:
        return
    phase_shifts = evidence.phase_shifts_rad
    design = np.column_stack([np.ones(n), np.cos(phase_shifts), -np.sin(phase_shifts)])
    outside = np.eye(n) - design @ np.linalg.pinv(design)
    power = np.cov(evidence.frames, bias=True)
    noise = float(evidence.map.noise.sigma(evidence.frames.mean())) ** 2 * (n - 3)
    as_stated = float(np.trace(outside @ power))
    orders = list(permutations(range(n))) if n <= limits.most_permuted else list(_exchanges(n))
    # Of frames without noise rounding leaves some below zero.
    residuals = np.array([max(float(np.trace(outside @ power[np.ix_(order, order)])), 0.0) for order in orders])
    # Several orders of evenly spaced phase shifts fit alike: of these, the one that moves the fewest frames.
    alike = np.flatnonzero(residuals <= limits.alike * residuals.min())
    best = max((orders[k] for k in alike), key=lambda order: sum(k == place for place, k in enumerate(order)))
    seen = max(limits.misfit_over_noise * noise, limits.misfit_of_power * float(np.trace(power)))
    if residuals.min() < limits.misordered * as_stated and as_stated > seen:
        yield Finding(
            FindingKind.SWAPPED_FRAMES,
            f"the frames fit the stated phase shifts in the order {', '.join(str(k + 1) for k in best)}",
            f"residual {np.sqrt(as_stated / n):.1f} grey levels as given, {np.sqrt(residuals.min() / n):.1f} in that "
            "order",
            float(np.pi / 2),
            "put the files into the order of steps_deg",
        )


def _exchanges(n: int) -> Iterator[tuple[int, ...]]:
    """Give all orders in which two of n have changed places."""
    for i, j in combinations(range(n), 2):
        order = list(range(n))
        order[i], order[j] = j, i
        yield tuple(order)


def mirrored(evidence: Evidence) -> Iterator[Finding]:
    """Find a phase that falls where the reference's rises: three phase shifts in another order look perfect alone."""
    if evidence.period is None or evidence.reference_period is None:
        return
    here, there = (np.array(p.gradient_rad_px) for p in (evidence.period, evidence.reference_period))
    cosine = float(here @ there / np.hypot(*here) / np.hypot(*there))
    if cosine < evidence.limits.mirrored_cosine:
        yield Finding(
            FindingKind.SWAPPED_FRAMES,
            "the phase decreases where that of the other set (of the plate, or of what lies on it) increases",
            f"directions {evidence.period.direction_deg:z.0f} and {evidence.reference_period.direction_deg:z.0f} deg",
            float(np.pi / np.sqrt(3)),
            "two frames of one of the sets have changed places, or the fringes were moved the other way: "
            "check the order of the files",
        )


def foreign(evidence: Evidence) -> Iterator[Finding]:
    """Find a frame of an object set that still shows the reference."""
    reference = evidence.reference
    if reference is None or reference.shape != evidence.frames.shape:
        return
    differences = np.sqrt(np.mean((evidence.frames[:, None] - reference) ** 2, axis=2))
    noise = float(evidence.map.noise.sigma(evidence.frames.mean())) * np.sqrt(2)
    differences = differences.min(axis=1)  # frames in another order are another fault
    worst, rest = int(differences.argmin()), np.delete(differences, differences.argmin())
    shown, others = evidence.limits.shown_noise, evidence.limits.foreign_noise
    if differences[worst] < shown * noise and rest.min() > others * max(differences[worst], noise):
        yield Finding(
            FindingKind.STALE_FRAME,
            f"frame {worst + 1} shows the reference and not what the other frames show",
            f"it differs from the reference by {differences[worst]:.1f} grey levels rms, others by {rest.min():.0f}",
            float(np.pi / np.sqrt(3)),
            "take the set again and wait for a new picture after placing the object",
        )
