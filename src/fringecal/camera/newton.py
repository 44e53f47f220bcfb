"""Least squares for a handful of parameters of very different sizes: Levenberg and Marquardt's method."""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

_ROUNDS = 60
_STEP = 0.05  # of a derivative: so many standard uncertainties of the parameter, were the others known
_DONE = 1e-3  # standard uncertainties: a step that is smaller ends the search
_DAMPING = (1e-4, 1e8)


def least_squares(residuals: Callable[[Array], Array], start: Array, sizes: Array) -> tuple[Array, Array]:
    """Find the parameters at which the sum of squared residuals is least.

    Parameters
    ----------
    residuals
        Function from parameters, (n,), to residuals over their standard uncertainties, (m,).
    start
        First guess, (n,).
    sizes
        Changes of the parameters that residuals notice, (n,): only the first derivatives are taken with them.

    Returns
    -------
    parameters, jacobian
        Where the sum is least, and the derivatives there, (m, n).

    Notes
    -----
    Derivatives are differences over a share of what each parameter is known to (central ones at the end), so that
    parameters whose sizes differ by ten orders are all differentiated well. Damping after Marquardt, J. SIAM 11
    (1963) 431.

    Examples
    --------
    >>> x = np.linspace(0, 1, 9)
    >>> found, _ = least_squares(
    ...     lambda p: (p[0] * np.exp(p[1] * x) - 2 * np.exp(-x)) / 1e-6, np.ones(2), np.full(2, 0.1)
    ... )
    >>> found.round(6).tolist()
    [2.0, -1.0]
    """
    at, rest = start.astype(float), residuals(start)
    steps, damping = sizes.astype(float), _DAMPING[0]
    for _ in range(_ROUNDS):
        jacobian = np.column_stack([(residuals(at + step) - rest) / step.max() for step in np.diag(steps)])
        unit = _unit(jacobian, steps)
        moved, rest_moved, damping = _improved(residuals, at, rest, jacobian * unit, unit, damping)
        done = float(np.abs((moved - at) / unit).max()) < _DONE
        at, rest, steps = moved, rest_moved, np.minimum(_STEP * unit, 10 * steps)
        if done:
            break
    central = [(residuals(at + step) - residuals(at - step)) / (2 * step.max()) for step in np.diag(steps)]
    return at, np.column_stack(central)


def _unit(jacobian: Array, steps: Array) -> Array:
    """Return the change of each parameter that moves the residuals by one in all; its step where nothing moves."""
    length = np.linalg.norm(jacobian, axis=0)
    return np.where(length > 0, 1 / np.where(length > 0, length, 1.0), steps)


def _improved(
    residuals: Callable[[Array], Array], at: Array, rest: Array, scaled: Array, unit: Array, damping: float
) -> tuple[Array, Array, float]:
    """Take one step that makes the sum smaller, damped as far as it must be; stay where none does."""
    left, values, right = np.linalg.svd(scaled, full_matrices=False)
    along = left.T @ rest
    while damping < _DAMPING[1]:
        step = -right.T @ (values * along / (values**2 + damping)) * unit
        moved = residuals(at + step)
        if np.all(np.isfinite(moved)) and moved @ moved <= rest @ rest:
            return at + step, moved, max(damping / 10, 1e-12)
        damping *= 10
    return at, rest, damping
