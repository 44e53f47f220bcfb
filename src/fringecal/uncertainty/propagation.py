"""Propagation of uncertainty by derivatives: first order with full covariance, and what second order adds."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fringecal.errors import FitError
from fringecal.uncertainty.budgets import Budget, combined
from fringecal.uncertainty.components import UncertaintyComponent
from fringecal.uncertainty.estimates import Estimate

Floats = NDArray[np.float64]
Model = Callable[[NDArray], ArrayLike]

_STEPS_PER_U = 100.0  # a first derivative's step is this part of u: what it neglects grows with the square of the step
_CURVATURE_STEPS_PER_U = 10.0  # of second and third derivatives, whose rounding grows as the step shrinks
_COMPLEX_STEP = 1e-200  # so small that its square is nothing (W. Squire, G. Trapp, SIAM Rev. 40 (1998) 110)
_EXACT_SCALE = 1e-3  # of an input's size, or the size itself near zero, where the input has no u to set a step by
_ASYMMETRY = 1e-9  # relative, of a covariance: rounding of who computed it


@dataclass(frozen=True)
class SecondOrder:
    """A result corrected for the curvature of its model by `shift`, and its `u` to second order."""

    value: float
    shift: float
    u: float


def jacobian(model: Model, x: ArrayLike, *, u: ArrayLike | None = None, method: str = "central") -> Floats:
    """Differentiate a model with respect to its inputs.

    Parameters
    ----------
    model
        Function of an (n,) array, with a scalar or (m,) result.
    x
        (n,) point.
    u
        (n,) scale of each input, its standard uncertainty; sets the step of "central".
    method
        "central": central differences, step ``u / 100``. "complex": complex step, exact to rounding, for
        models made of analytic operations only (no abs, no comparison, no arctan2).

    Returns
    -------
    (n,) for a scalar model, (m, n) else.

    Examples
    --------
    >>> jacobian(lambda x: x[0] ** 2 * x[1], [3.0, 2.0], method="complex").round(9).tolist()
    [12.0, 9.0]
    """
    point = np.asarray(x, float)
    if method == "complex":
        columns = [np.imag(model(point + 1j * _COMPLEX_STEP * unit)) / _COMPLEX_STEP for unit in np.eye(point.size)]
    elif method == "central":
        columns = [
            (np.asarray(model(point + h), float) - np.asarray(model(point - h), float)) / (2 * h[i])
            for i, h in enumerate(np.diag(_steps(point, u) / _STEPS_PER_U))
        ]
    else:
        raise ValueError(f'method {method!r} is not "central" or "complex"')
    result = np.stack(columns, axis=-1)
    if not np.all(np.isfinite(result)):
        raise FitError(f"the model has no finite derivative at {point.tolist()}; check the inputs and their ranges")
    return result


def hessian(model: Model, x: ArrayLike, *, u: ArrayLike | None = None) -> Floats:
    """Second derivatives of a scalar model by central differences, (n, n); steps are a tenth of `u`."""
    point = np.asarray(x, float)
    steps = np.diag(_steps(point, u) / _CURVATURE_STEPS_PER_U)

    def f(p: Floats) -> float:
        return float(np.asarray(model(p)))

    n = point.size
    second = np.zeros((n, n))
    for i in range(n):
        for j in range(i, n):
            a, b = steps[i], steps[j]
            corners = f(point + a + b) - f(point + a - b) - f(point - a + b) + f(point - a - b)
            second[i, j] = second[j, i] = corners / (4 * a[i] * b[j])
    return second


def propagate(
    model: Model,
    inputs: Sequence[Estimate],
    *,
    covariance: ArrayLike | None = None,
    sensitivities: ArrayLike | None = None,
    dof_rule: str = "interpolated",
    method: str = "central",
    unit: str = "",
    label: str = "",
) -> Budget:
    """Propagate estimates through a scalar model to first order, and account for each of them.

    ``u^2 = c C c^T`` with c the derivatives at the estimates (JCGM 100:2008, eq. 13 and 16).
    Degrees of freedom: `effective_dof`, `correlated_dof`.

    Parameters
    ----------
    model
        Function of the (n,) array of input values.
    inputs
        n estimates; their dof enter the result's.
    covariance
        (n, n) covariance of the inputs; the inputs' own `u`, uncorrelated, when omitted.
    sensitivities
        (n,) derivatives, when they are known; numeric by `jacobian` when omitted.
    dof_rule
        "interpolated", or "truncated" to the integer below as JCGM 100:2008 G.4.1 does.
    method, unit, label
        Of the derivative; of the result.

    Examples
    --------
    >>> shift = Estimate(3.665, 0.03, unit="mm", label="fringe shift", dof=11)
    >>> strip = Estimate(3.0, 0.005, unit="mm", label="strip height")
    >>> angle = propagate(lambda x: np.degrees(np.arctan2(x[0], x[1])), [shift, strip], unit="deg")
    >>> round(angle.result.value, 2), round(angle.result.u, 2), next(iter(angle.contributions())).text
    (50.7, 0.23, 'fringe shift')
    """
    x = np.array([item.value for item in inputs])
    u = np.array([item.u for item in inputs])
    matrix = np.diag(u**2) if covariance is None else _checked(covariance, len(x))
    scale = np.sqrt(np.diag(matrix))
    c = jacobian(model, x, u=scale, method=method) if sensitivities is None else np.asarray(sensitivities, float)
    components = [
        UncertaintyComponent.of(replace(item, u=float(ui)), float(ci))
        for item, ui, ci in zip(inputs, scale, c, strict=True)
    ]
    unit_scale = np.where(scale > 0, scale, 1.0)
    correlation = None if covariance is None else matrix / np.outer(unit_scale, unit_scale)
    value = float(np.asarray(model(x)))
    return combined(value, components, unit=unit, label=label, correlation=correlation, dof_rule=dof_rule)


def propagate_covariance(
    model: Model, x: ArrayLike, covariance: ArrayLike, *, method: str = "central"
) -> tuple[Floats, Floats]:
    """Propagate a covariance through a model with several results: values (m,) and covariance (m, m).

    Examples
    --------
    >>> sum_and_difference = lambda x: [x[0] + x[1], x[0] - x[1]]
    >>> propagate_covariance(sum_and_difference, [5.0, 3.0], [[4, 0], [0, 1]])[1].round(9).tolist()
    [[5.0, 3.0], [3.0, 5.0]]
    """
    point = np.asarray(x, float)
    matrix = _checked(covariance, point.size)
    c = np.atleast_2d(jacobian(model, point, u=np.sqrt(np.diag(matrix)), method=method))
    return np.atleast_1d(np.asarray(model(point), float)), c @ matrix @ c.T


def second_order(model: Model, inputs: Sequence[Estimate], *, covariance: ArrayLike | None = None) -> SecondOrder:
    """Correct a result for the curvature of its model.

    ``y = f + 1/2 sum f_ij u_ij`` (JCGM 100:2008 Amd. 1:2026, 4.1.4); the variance gains
    ``sum (f_ij^2 / 2 + f_i f_ijj) u_i^2 u_j^2`` (5.1.2 NOTE), which holds for independent normal inputs
    and is added for uncorrelated inputs only.

    Parameters
    ----------
    model, inputs, covariance
        As in `propagate`.

    Examples
    --------
    >>> square = second_order(lambda x: x[0] ** 2, [Estimate(0.0, 1.0)])
    >>> round(square.value, 6), round(square.u, 6)  # chi-square with one degree of freedom
    (1.0, 1.414214)
    """
    x = np.array([item.value for item in inputs])
    u = np.array([item.u for item in inputs])
    matrix = np.diag(u**2) if covariance is None else _checked(covariance, len(x))
    u = np.sqrt(np.diag(matrix))
    second = hessian(model, x, u=u)
    shift = 0.5 * float(np.sum(second * matrix))
    c = jacobian(model, x, u=u)
    variance = float(c @ matrix @ c)
    if np.count_nonzero(matrix - np.diag(np.diag(matrix))) == 0:
        third = _third(model, x, _steps(x, u) / _CURVATURE_STEPS_PER_U)
        variance += float(np.sum((0.5 * second**2 + c[:, None] * third) * np.outer(u**2, u**2)))
    value = float(np.asarray(model(x)))
    return SecondOrder(value + shift, shift, math.sqrt(max(variance, 0.0)))


def _third(model: Model, x: Floats, steps: Floats) -> Floats:
    """Differentiate f_ijj, (n, n)."""
    n = x.size
    third = np.zeros((n, n))
    for j, h in enumerate(np.diag(steps)):

        def curvature(p: Floats, h: Floats = h, j: int = j) -> float:
            ends = np.asarray(model(p + h)) + np.asarray(model(p - h)) - 2 * np.asarray(model(p))
            return float(ends) / h[j] ** 2

        for i, g in enumerate(np.diag(steps)):
            third[i, j] = (curvature(x + g) - curvature(x - g)) / (2 * g[i])
    return third


def _steps(x: Floats, u: ArrayLike | None) -> Floats:
    given = np.zeros_like(x) if u is None else np.broadcast_to(np.asarray(u, float), x.shape)
    return np.where(given > 0, given, _EXACT_SCALE * np.maximum(np.abs(x), _EXACT_SCALE))


def _checked(covariance: ArrayLike, size: int) -> Floats:
    matrix = np.asarray(covariance, float)
    if matrix.shape != (size, size) or not np.allclose(matrix, matrix.T, rtol=_ASYMMETRY, atol=0):
        raise ValueError(f"a symmetric covariance of shape ({size}, {size}) is needed, found shape {matrix.shape}")
    return matrix
