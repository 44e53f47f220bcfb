"""What an audit found, in words: whether the rig changed, what probably moved and by how much, what else it may be."""

import math
from collections.abc import Sequence

from fringecal.projector import STRIP_SETS, Move
from fringecal.workflows.audit.ranked_causes import CauseFit
from fringecal.workflows.audit.run import Audit

_CLOSE = 3.0  # difference of log evidence: below it, odds under 20 to 1, the runner-up is named as well
_UNEXPLAINED = 1e-4  # chance of the misfit that a cause leaves, below which more than one thing may have moved
_FIRST_ORDER = 0.01  # of chi-squared, a tenth of the change: signatures hold no closer
_TOO_SMALL = 1e-6  # smaller probabilities are no longer to be taken by their number
_LIKELY = ((0.95, "very likely"), (0.5, "likely"), (0.05, "possible"), (0.0, "unlikely"))  # 5 %: as tests have it
_PART_OF_USUAL = 2.0  # amounts are stated where they exceed this many of their uncertainties
_ANGLES = frozenset(
    {
        Move.CAMERA_TILT_X,
        Move.CAMERA_TILT_Y,
        Move.CAMERA_ROLL,
        Move.PROJECTOR_TURNED_X,
        Move.PROJECTOR_TURNED_Y,
        Move.PROJECTOR_TURNED_Z,
        Move.SLIDE_TURN,
        Move.PLATE_TILT_X,
        Move.PLATE_TILT_Y,
    }
)
_RATIOS = frozenset({Move.FOCAL_LENGTH, Move.SLIDE_PITCH, Move.STRIP_HEIGHT, *STRIP_SETS})
_OTHER_UNITS = {Move.LENS_BLUR: "px^2", Move.FRINGE_BLUR: "mm^2", Move.LENS_DISTORTION: "k1"}


def audit_sentence(found: Audit) -> str:
    """Say first what the audit cannot tell, then whether the rig changed and what explains it best."""
    return " ".join(filter(None, (reuse_sentence(found), change_sentence(found))))


def reuse_sentence(found: Audit) -> str:
    """Say which captures hold pictures of the calibration's own session; nothing where all pictures are new."""
    if not found.reused:
        return ""
    return (
        f"The pictures of {', '.join(found.reused)} are the calibration's own (equal by hash): they say nothing "
        "about the time since."
    )


def change_sentence(found: Audit) -> str:
    """Say whether the rig changed, and which single cause explains it best, with the runner-up where it is close."""
    if not found.changed:
        head = "The difference" if found.reused else "The rig is as calibrated: the difference"
        return f"{head} is within what chance explains (as large on {found.probability:.0%} of unchanged rigs)."
    head = (
        f"The rig has changed since its calibration (an unchanged one would seem so {chance_words(found.probability)})."
    )
    if not found.causes:
        return head
    best, *others = found.causes
    unexplained = ""
    if best.probability < _UNEXPLAINED and best.chi2 > _FIRST_ORDER * found.chi2:
        unexplained = " It does not explain all of the change: more than one thing may have moved."
    close = [fit for fit in others[:1] if best.log_evidence - fit.log_evidence < _CLOSE]
    also = f" Hardly less likely: {cause_words(close[0])}." if close else ""
    return f"{head} Probable cause: {cause_words(best)}.{unexplained}{also}"


def chance_words(probability: float) -> str:
    """Say a small probability as a frequency.

    Examples
    --------
    >>> chance_words(0.0034), chance_words(1.12e-56)
    ('once in 300', 'less than once in a million')
    """
    if probability < _TOO_SMALL:
        return "less than once in a million"
    return f"once in {float(f'{1 / probability:.1g}'):.0f}"


def cause_probabilities(causes: Sequence[CauseFit]) -> tuple[float, ...]:
    """Probability of each single cause, if one of them it was and all were as likely before."""
    best = max(fit.log_evidence for fit in causes)
    odds = [math.exp(fit.log_evidence - best) for fit in causes]
    return tuple(one / sum(odds) for one in odds)


def likelihood_words(probability: float) -> str:
    """Say how likely a cause is.

    Examples
    --------
    >>> [likelihood_words(p) for p in (0.97, 0.6, 0.1, 0.001)]
    ['very likely', 'likely', 'possible', 'unlikely']
    """
    return next(words for least, words in _LIKELY if probability >= least)


def cause_words(fit: CauseFit) -> str:
    """Name a cause with the amounts that it takes."""
    sure = {move: value for move, value in fit.amounts.items() if abs(value) > _PART_OF_USUAL * fit.u_amounts[move]}
    parts = [f"{move.text} {amount_text(move, value)}" for move, value in sure.items()]
    return f"{fit.cause.text} ({', '.join(parts)})" if parts else fit.cause.text


def amount_unit(move: Move) -> tuple[str, float]:
    """Return the unit in which a move is stated, and the factor to it from `MOVES`' own."""
    if move in _ANGLES:
        return "deg", 180 / math.pi
    if move in _RATIOS:
        return "%", 100.0
    return _OTHER_UNITS.get(move, "mm"), 1.0


def amount_text(move: Move, value: float) -> str:
    """Print an amount in its unit.

    Examples
    --------
    >>> amount_text(Move.STRIP_HEIGHT, 0.0333), amount_text(Move.CAMERA_HEIGHT, -5.0)
    ('+3.33 %', '-5 mm')
    """
    unit, factor = amount_unit(move)
    return f"{value * factor:+.3g} {unit}"
