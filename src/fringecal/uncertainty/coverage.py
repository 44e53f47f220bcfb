"""Whether stated uncertainties hold: coverage of intervals with its binomial band, and spread against u."""

import math

from scipy.special import ndtri

from fringecal.uncertainty.estimates import COVERAGE


def wilson_interval(hits: int, number: int, *, coverage: float = COVERAGE) -> tuple[float, float]:
    """Return the score interval of a proportion.

    ``(p + k^2/2n -+ k sqrt(p (1-p)/n + k^2/4n^2)) / (1 + k^2/n)``, k of the normal distribution: E. B. Wilson,
    J. Am. Stat. Assoc. 22 (1927) 209. Unlike the plain interval it stays within 0 and 1 and holds for few trials.

    Parameters
    ----------
    hits, number
        How many of how many trials.
    coverage
        Coverage of the interval.

    Raises
    ------
    ValueError
        No trial, or more hits than trials.

    Examples
    --------
    >>> low, high = wilson_interval(81, 263)
    >>> f"{low:.4f} {high:.4f}"
    '0.2553 0.3662'
    """
    if not 0 <= hits <= number or number < 1:
        raise ValueError(f"{hits} hits in {number} trials: at least one trial, and no more hits than trials")
    k2, share = float(ndtri(0.5 + coverage / 2)) ** 2, hits / number
    half = math.sqrt(k2 * share * (1 - share) / number + (k2 / (2 * number)) ** 2)
    middle, total = share + k2 / (2 * number), 1 + k2 / number
    return max(0.0, (middle - half) / total), min(1.0, (middle + half) / total)
