"""The form of the reference plate: what is known of its departure from a plane, and how it may depart beyond that.

Heights count from the plate's best plane over the field. A plate that is not flat puts itself, and all that lies on
it, off the heights that the fit takes them for; its form is smooth, so that no averaging takes it away.
"""

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.polynomial import legendre
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]

#: Degrees along x and y of the terms of a form: all of second and third order, square to every plane over the field.
FORM_TERMS = ((2, 0), (1, 1), (0, 2), (3, 0), (2, 1), (1, 2), (0, 3))
_U_SECOND, _U_THIRD = 0.33, 0.18
"""Standard deviation of a term's coefficient over the largest distance from the best plane: of 20 000 forms with normal
coefficients, those of third order half as large as those of second, each scaled to the same largest distance."""

type Box = tuple[float, float, float, float]


@dataclass(frozen=True)
class PlateForm:
    """The plate's form as a sum of `FORM_TERMS`, products of Legendre polynomials over a box.

    Parameters
    ----------
    box
        Part of the plate, (x_low, x_high, y_low, y_high) in mm, that the best plane belongs to.
    coefficients_mm
        What is known of the form, one coefficient for each term, (7,); nothing by default.
    axes_mm
        How it may depart from that: sets of coefficients, one standard uncertainty each, independent of one another.
    dof
        Degrees of freedom of those uncertainties.
    is_stated
        Whether anything is known: a plate of which nothing is stated has no axes either, and says so in every budget.

    Examples
    --------
    >>> bowed = PlateForm((-100.0, 100.0, -50.0, 50.0), np.array([0.2, 0, 0, 0, 0, 0, 0]))
    >>> bowed.height([0.0, 100.0], 0.0).round(3).tolist()
    [-0.1, 0.2]
    """

    box: Box
    coefficients_mm: Array = field(default_factory=lambda: np.zeros(len(FORM_TERMS)))
    axes_mm: tuple[Array, ...] = ()
    dof: float = math.inf
    is_stated: bool = True

    def height(self, x_mm: ArrayLike, y_mm: ArrayLike) -> Array:
        """Return the known form's height over the best plane, mm."""
        return form_height(self.coefficients_mm, self.box, x_mm, y_mm)

    def change(self, axis: int, x_mm: ArrayLike, y_mm: ArrayLike) -> Array:
        """Return by how much one standard uncertainty along an axis changes the plate's height, mm."""
        return form_height(self.axes_mm[axis], self.box, x_mm, y_mm)


def form_height(coefficients_mm: Array, box: Box, x_mm: ArrayLike, y_mm: ArrayLike) -> Array:
    """Evaluate a form; beyond its box it goes on as at the edge.

    Parameters
    ----------
    coefficients_mm
        One for each of `FORM_TERMS`.
    box
        (x_low, x_high, y_low, y_high), mm.
    x_mm, y_mm
        Points of the plate, of shapes that broadcast.

    Examples
    --------
    >>> bow = np.array([0.3, 0, 0, 0, 0, 0, 0])  # Legendre's second polynomial along x
    >>> form_height(bow, (-100.0, 100.0, -80.0, 80.0), [-100.0, 0.0, 100.0], 0.0).round(6).tolist()
    [0.3, -0.15, 0.3]
    """
    x, y = np.broadcast_arrays(np.asarray(x_mm, float), np.asarray(y_mm, float))
    if not np.any(coefficients_mm):
        return np.zeros(x.shape)
    order = 1 + max(max(term) for term in FORM_TERMS)
    grid = np.zeros((order, order))
    for (i, j), value in zip(FORM_TERMS, coefficients_mm, strict=True):
        grid[i, j] = value
    return np.asarray(legendre.legval2d(_unit(x, *box[:2]), _unit(y, *box[2:]), grid))


def _unit(values: Array, low: float, high: float) -> Array:
    return np.clip((2 * values - low - high) / (high - low), -1.0, 1.0)


def form_of_flatness(distance_mm: float, box: Box, *, dof: float = math.inf) -> PlateForm:
    """Return what a certificate of flatness says of a plate: how large its form is, not which.

    Parameters
    ----------
    distance_mm
        Largest distance of the surface from its best plane; half of the width between two planes that enclose it, or
        more.
    box
        Part of the plate that the certificate is for.
    dof
        Degrees of freedom of the distance.

    Examples
    --------
    >>> form = form_of_flatness(0.1, (-100.0, 100.0, -50.0, 50.0))
    >>> round(float(np.hypot.reduce([form.change(k, 100.0, 50.0) for k in range(7)])), 3)
    0.068
    """
    sizes = [_U_SECOND if sum(term) == 2 else _U_THIRD for term in FORM_TERMS]
    axes = tuple(distance_mm * row for row in np.diag(sizes)) if distance_mm > 0 else ()
    return PlateForm(box, axes_mm=axes, dof=dof)


def unknown_form(box: Box) -> PlateForm:
    """Return the form of a plate of which nothing is stated: it counts as a plane, and the budgets say so."""
    return PlateForm(box, is_stated=False)
