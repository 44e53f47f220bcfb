"""Propagation of distributions by an adaptive Monte Carlo, and the check of first order (JCGM 101)."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fringecal.errors import FitError
from fringecal.uncertainty.estimates import COVERAGE
from fringecal.uncertainty.sampling.distributions import Distribution

Floats = NDArray[np.float64]
Draw = Callable[[np.random.Generator, int], ArrayLike]

MOST_TRIALS = 20_000_000
"""Draws after which a result that is not stable is given up, and 160 MB of results; a million often give an interval
to one or two digits (JCGM 101:2008, 7.2.1)."""

_BEYOND, _LEAST_BLOCK = 100, 10_000
"""Draws beyond the interval in a block, and the least block: M = max(100 / (1 - p), 10^4) (JCGM 101:2008, 7.9.4 b)."""


_BATCHES = 10
"""Parts of a given number of draws, whose scatter tells how far their results can be trusted."""


@dataclass(frozen=True)
class MonteCarlo:
    """Result of a Monte Carlo: mean, standard deviation, two coverage intervals, and how it was reached.

    `tolerance` is the numerical tolerance delta that the results meet: twice the standard deviation by which another
    Monte Carlo of as many draws would differ.
    """

    value: float
    u: float
    symmetric: tuple[float, float]
    shortest: tuple[float, float]
    coverage: float
    trials: int
    tolerance: float


@dataclass(frozen=True)
class Validation:
    """Ends of a first-order interval against a Monte Carlo's; valid when both agree within `tolerance`."""

    d_low: float
    d_high: float
    tolerance: float
    valid: bool


def propagate_distributions(
    model: Callable[..., ArrayLike],
    inputs: Sequence[Distribution],
    rng: np.random.Generator,
    *,
    coverage: float = COVERAGE,
    digits: int = 2,
    max_trials: int = MOST_TRIALS,
) -> MonteCarlo:
    """Propagate independent distributions through a model, given as a function of one array per input.

    Parameters
    ----------
    model
        Vectorised: n arrays of one length in, one out.
    inputs
        n distributions.
    rng
        Seeded by the caller.
    coverage, digits, max_trials
        See `adaptive`.

    Examples
    --------
    >>> from fringecal.uncertainty.sampling.distributions import Normal
    >>> rng = np.random.default_rng(1)
    >>> total = propagate_distributions(lambda a, b: a + b, [Normal(1, 3), Normal(2, 4)], rng, digits=1)
    >>> round(total.u)
    5
    """

    def draw(generator: np.random.Generator, size: int) -> ArrayLike:
        return model(*(item.draw(generator, size) for item in inputs))

    return adaptive(draw, rng, coverage=coverage, digits=digits, max_trials=max_trials)


def adaptive(
    draw: Draw,
    rng: np.random.Generator,
    *,
    coverage: float = COVERAGE,
    digits: int = 2,
    tolerance: float | None = None,
    max_trials: int = MOST_TRIALS,
) -> MonteCarlo:
    """Draw results until value, u and both ends of the interval are stable (JCGM 101:2008, 7.9).

    Blocks of ``M = max(ceil(100 / (1 - p)), 10^4)`` draws; after each, twice the standard deviation of the
    mean of the blocks' results must not exceed delta: for value, u, both ends of the symmetric interval and
    the width of the shortest one, whose ends wander because its minimum is flat.

    Parameters
    ----------
    draw
        Function of (rng, M) that returns M results of the model.
    coverage
        Coverage probability p of the intervals.
    digits
        Significant digits of u that count; they set delta by `numerical_tolerance`.
    tolerance
        Delta itself, instead of `digits`.
    max_trials
        Where to give up.

    Raises
    ------
    FitError
        Not stable within `max_trials`, or the model returns values that are not finite.
    """
    block = max(math.ceil(_BEYOND / (1 - coverage)), _LEAST_BLOCK)
    drawn: list[Floats] = []
    rows: list[Floats] = []
    while len(drawn) * block < max_trials:
        drawn.append(_finite(draw(rng, block)))
        rows.append(_summary(np.sort(drawn[-1]), coverage))
        if len(drawn) < 2:
            continue
        spread = np.std(rows, axis=0, ddof=1) / math.sqrt(len(rows))
        u = math.sqrt(float(np.mean([r[1] ** 2 for r in rows])))
        delta = numerical_tolerance(u, digits) if tolerance is None else tolerance
        if np.all(2 * spread <= delta):
            return _result(np.concatenate(drawn), coverage, delta)
    raise FitError(
        f"the Monte Carlo was not stable after {len(drawn) * block} trials; ask for fewer digits than "
        f"{digits}, or look for a model without finite variance"
    )


def summarise_draws(values: ArrayLike, *, coverage: float = COVERAGE) -> MonteCarlo:
    """Summarise results that were drawn beforehand, as many as a slow model allows (JCGM 101:2008, 7.2).

    How far they can be trusted, the result's `tolerance`, is judged from ten batches of them as in `adaptive`.

    Parameters
    ----------
    values
        (M,) results of the model, M a few thousand at least.
    coverage
        Coverage probability of the intervals.

    Raises
    ------
    FitError
        Values that are not finite.

    Examples
    --------
    >>> drawn = summarise_draws(np.random.default_rng(1).normal(5.0, 2.0, 100_000))
    >>> round(drawn.u, 1), abs(drawn.u - 2.0) < drawn.tolerance < 0.1
    (2.0, True)
    """
    drawn = _finite(values)
    rows = [_summary(np.sort(batch), coverage) for batch in np.array_split(drawn, _BATCHES)]
    spread = np.std(rows, axis=0, ddof=1) / math.sqrt(_BATCHES)
    return _result(drawn, coverage, float(2 * spread.max()))


def numerical_tolerance(u: float, digits: int = 2) -> float:
    """Half a unit of the last significant digit of u: ``u = c 10^l``, ``delta = 10^l / 2`` (7.9.2).

    Examples
    --------
    >>> numerical_tolerance(0.0754, 1), numerical_tolerance(2.0, 2), numerical_tolerance(0.0996, 1)
    (0.005, 0.05, 0.05)
    """
    if not u > 0:
        raise ValueError(f"u must be greater than 0 to have significant digits, found {u:g}")
    power = int(f"{u:.{digits - 1}e}".split("e")[1]) - digits + 1
    return 0.5 * 10.0**power


def symmetric_interval(values: ArrayLike, coverage: float = COVERAGE) -> tuple[float, float]:
    """Probabilistically symmetric interval: as many values below as above (7.7)."""
    ordered = np.sort(np.asarray(values, float))
    inside = round(coverage * ordered.size)
    start = (ordered.size - inside) // 2
    return float(ordered[start]), float(ordered[min(start + inside, ordered.size - 1)])


def shortest_interval(values: ArrayLike, coverage: float = COVERAGE) -> tuple[float, float]:
    """Shortest interval that holds the share `coverage` of the values (5.3.4)."""
    ordered = np.sort(np.asarray(values, float))
    inside = min(round(coverage * ordered.size), ordered.size - 1)
    start = int(np.argmin(ordered[inside:] - ordered[: ordered.size - inside]))
    return float(ordered[start]), float(ordered[start + inside])


def validate_first_order(
    value: float, expanded: float, monte_carlo: MonteCarlo, *, tolerance: float, interval: str = "symmetric"
) -> Validation:
    """Compare ``value +- expanded`` with a Monte Carlo interval of the same coverage (8.1).

    Parameters
    ----------
    tolerance
        Delta, from `numerical_tolerance` of the first-order u; run the Monte Carlo to a fifth of it.
    interval
        "symmetric" or "shortest".
    """
    if interval not in ("symmetric", "shortest"):
        raise ValueError(f'interval {interval!r} is not "symmetric" or "shortest"')
    low, high = monte_carlo.symmetric if interval == "symmetric" else monte_carlo.shortest
    d_low, d_high = abs(value - expanded - low), abs(value + expanded - high)
    return Validation(d_low, d_high, tolerance, max(d_low, d_high) <= tolerance)


def _finite(values: ArrayLike) -> Floats:
    result = np.asarray(values, float)
    if not np.all(np.isfinite(result)):
        lost = int(np.count_nonzero(~np.isfinite(result)))
        raise FitError(f"the model gave {lost} of {result.size} values that are not finite; bound its inputs")
    return result


def _summary(ordered: Floats, coverage: float) -> Floats:
    symmetric, shortest = symmetric_interval(ordered, coverage), shortest_interval(ordered, coverage)
    return np.array([ordered.mean(), ordered.std(ddof=1), *symmetric, shortest[1] - shortest[0]])


def _result(values: Floats, coverage: float, delta: float) -> MonteCarlo:
    values = np.sort(values)
    return MonteCarlo(
        value=float(values.mean()),
        u=float(values.std(ddof=1)),
        symmetric=symmetric_interval(values, coverage),
        shortest=shortest_interval(values, coverage),
        coverage=coverage,
        trials=values.size,
        tolerance=delta,
    )
