"""What each test of the diagnostics could see, and from which size on: not to look is not to find nothing."""

from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from fringecal.phase.demodulation.phase_shifts import RARE, SIGNIFICANT, share_of_mean
from fringecal.phase.diagnostics.evidence import Evidence

_FEWEST_TO_ORDER = 4  # frames, of which another order does not fit as well
_NO_BLOCKS = "too few smooth blocks of two to three fringes; take the plate, or more fringes"


@dataclass(frozen=True)
class Look:
    """Whether one kind of fault could be seen.

    Parameters
    ----------
    subject
        What was looked for.
    could
        Whether it could be seen at all.
    words
        From which size on, or why not.
    """

    subject: str
    could: bool
    words: str

    def document(self) -> dict[str, Any]:
        """Return it as plain values."""
        return asdict(self)


def looked_for(all_looks: Sequence[Look]) -> tuple[str, ...]:
    """Say in one sentence each what was looked for, from which size on, and what could not be looked for.

    What could not be seen for one reason stands together.
    """
    reasons: dict[str, list[str]] = {}
    for look in all_looks:
        if not look.could:
            reasons.setdefault(look.words, []).append(look.subject)
    seen = "; ".join(f"{look.subject} ({look.words})" for look in all_looks if look.could)
    blind = "; ".join(f"{', '.join(subjects)} ({words})" for words, subjects in reasons.items())
    return (f"looked for: {seen}",) * bool(seen) + (f"could not look for: {blind}",) * bool(blind)


def looks(evidence: Evidence) -> tuple[Look, ...]:
    """Say of every test whether it could see, and what size it would have seen."""
    return (
        _scene(evidence),
        _equal_frames(evidence),
        _order(evidence),
        _saturation(evidence),
        *_by_blocks(evidence),
        _contrast(evidence),
        _sampling(evidence),
    )


def _scene(evidence: Evidence) -> Look:
    subject, spectra, needed = "a frame of another period or scene", evidence.spectra, evidence.limits.scene_cycles
    if spectra is None:
        return Look(subject, False, "the pictures are too small, or not finite")
    if evidence.fringes < needed:
        return Look(subject, False, f"{evidence.fringes:.1f} fringes in the picture; {needed:g} are needed")
    return Look(subject, True, f"from {max(1 / evidence.fringes, _PERIODS_TO):.0%} of the period")


_PERIODS_TO = 0.01  # of the period: spectra of long pictures resolve more than perspective leaves


def _equal_frames(evidence: Evidence) -> Look:
    subject = "two frames of one phase shift"
    typical = float(np.ptp(evidence.frames, axis=0).mean())
    noise = float(evidence.map.noise.sigma(evidence.frames.mean()))
    if typical < evidence.limits.above_noise * noise:
        return Look(subject, False, "noise is as large as what frames differ by")
    return Look(subject, True, f"that differ by less than {evidence.limits.equal_share:.0%} of what the others do")


def _order(evidence: Evidence) -> Look:
    subject, count = "frames in another order", len(evidence.frames)
    if count >= _FEWEST_TO_ORDER:
        return Look(subject, True, f"misfit of {evidence.limits.misfit_of_power:.0%} of the frames' variance")
    if evidence.period is not None and evidence.reference_period is not None:
        return Look(subject, True, "against the other capture")
    return Look(subject, False, f"{count} frames fit in any order; give a session with another capture")


def _saturation(evidence: Evidence) -> Look:
    subject = "saturation"
    if evidence.white_level is None:
        return Look(subject, False, "the white level is not known; state --bits, or bits in the session")
    return Look(subject, True, f"from {evidence.limits.saturated:.1%} of the pixels at {evidence.white_level:g}")


def _by_blocks(evidence: Evidence) -> Iterator[Look]:
    """Say what the blocks of a few fringes could show."""
    found, wave, limits = evidence.phase_shifts, evidence.wave, evidence.limits
    subjects = ("brightness of single frames", "fringes blurred in single frames", "phase shifts", "uneven shifts")
    if found is None or wave is None or not evidence.blocks:
        yield from (Look(subject, False, _NO_BLOCKS) for subject in (*subjects, "harmonics"))
        return
    _, u_gain = share_of_mean(np.abs([block.signal for block in evidence.blocks]))
    _, u_level = share_of_mean(np.array([block.background for block in evidence.blocks]))
    yield Look(subjects[0], True, f"from {max(limits.background, SIGNIFICANT * u_level.max()):.1%}")
    yield Look(subjects[1], True, f"from {max(limits.blur, SIGNIFICANT * np.hypot(u_gain, u_level).max()):.1%}")
    # One of n phase shifts off by d makes a ripple of d / n, rms d / (n sqrt 2).
    of_ripple = limits.phase_shifts_rad * len(evidence.frames) * np.sqrt(2)
    shift = np.rad2deg(max(found.coverage(RARE) * found.u_rad.max(), of_ripple))
    yield Look(subjects[2], True, f"from {shift:.2f} deg in one frame")
    height, width = evidence.map.phase.shape
    change = found.coverage(RARE) * found.u_gradient_rad_px.max(axis=0) * [width, height]
    if not np.isfinite(change).any():
        yield Look(subjects[3], False, "blocks at four places along the picture are needed")
    else:
        along = np.rad2deg(max(limits.change_rad, change[np.isfinite(change)].max()))
        where = "" if np.isfinite(change).all() else f" along {'uv'[int(np.isfinite(change).argmax())]} only"
        yield Look(subjects[3], True, f"from {along:.1f} deg from edge to edge{where}")
    share = SIGNIFICANT * wave.u[0]
    yield Look("harmonics", True, f"a second from {share:.1%} of the first, and {limits.gamma_rad:g} rad of ripple")


def _contrast(evidence: Evidence) -> Look:
    could = bool(evidence.map.valid.any())
    return Look("weak fringes", could, f"below {evidence.limits.contrast:.0%}" if could else "no pixel has a phase")


def _sampling(evidence: Evidence) -> Look:
    subject, limits = "fringes too short or too long", evidence.limits
    if evidence.period is None:
        return Look(subject, False, "no fringe period could be measured")
    if evidence.of_several:
        return Look(subject, True, f"below {limits.period_px:g} px; a long period of several is meant to be long")
    return Look(subject, True, f"below {limits.period_px:g} px, and {limits.fringes:g} fringes in the picture")
