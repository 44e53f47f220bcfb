"""The form of a board: its warp as a polynomial of the place, its print's scale and stretch, with what is expected."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.polynomial import legendre
from numpy.typing import NDArray

from fringecal.numerics import powers_up_to
from fringecal.projector.board_rig.board_poses import BoardPose, BoardStatement

Array = NDArray[np.float64]

FREE_DEGREE = 2  # of a warp of which nothing is stated: two bows and a twist, as a sheet on a plate has
STATED_DEGREE = 4  # of one whose size is stated: its terms are held by that
SCALE_NAMES = ("board.scale_rel", "board.stretch_rel")


@dataclass(frozen=True)
class BoardForm:
    """How a board may depart from its drawing.

    Parameters
    ----------
    box
        Its extent (x_low, x_high, y_low, y_high), mm, over which the warp's Legendre polynomials run.
    terms
        Degrees along x and y of each term of the warp.
    warp_u_mm
        Standard deviation that is expected of each term's coefficient, (terms,), mm; infinite if none is.
    pitch_u_rel, stretch_u_rel
        As in `BoardStatement`.
    """

    box: tuple[float, float, float, float]
    terms: tuple[tuple[int, int], ...]
    warp_u_mm: Array
    pitch_u_rel: float
    stretch_u_rel: float

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the form's parameters: scale, stretch, then the warp's coefficients."""
        return (*SCALE_NAMES, *(f"board.warp_{i}{j}_mm" for i, j in self.terms))

    @property
    def expected_u(self) -> Array:
        """Standard deviation expected of each parameter about 0; 0 for what is held, infinite for what is open.

        The scale is held: a larger board farther away looks the same, so that its error is no matter of the fit.
        """
        return np.concatenate([[0.0, self.stretch_u_rel], self.warp_u_mm])

    def lifts(self, board_mm: Array) -> Array:
        """Height of each point under a unit of each coefficient of the warp, (n, terms)."""
        x0, x1, y0, y1 = self.box
        degree = max((max(term) for term in self.terms), default=0)
        s, t = (2 * board_mm[:, 0] - x0 - x1) / (x1 - x0), (2 * board_mm[:, 1] - y0 - y1) / (y1 - y0)
        along, across = legendre.legvander(s, degree), legendre.legvander(t, degree)
        columns = [along[:, i] * across[:, j] for i, j in self.terms]
        return np.stack(columns, axis=1) if columns else np.zeros((len(s), 0))


def board_form(poses: Sequence[BoardPose], statement: BoardStatement, warp_degree: int | None = None) -> BoardForm:
    """Return the form that a board may have, from its points and what is stated of it.

    Parameters
    ----------
    poses
        For the board's extent.
    statement
        Scale, stretch and flatness with their u.
    warp_degree
        Of the polynomial; 0 takes the board as flat. By default 2 where no flatness is stated, else 4.
    """
    points = np.concatenate([pose.board_mm for pose in poses])
    (x0, y0), (x1, y1) = points[:, :2].min(axis=0), points[:, :2].max(axis=0)
    stated = math.isfinite(statement.flatness_u_mm)
    degree = (STATED_DEGREE if stated else FREE_DEGREE) if warp_degree is None else warp_degree
    terms = tuple(pair for pair in powers_up_to(degree) if sum(pair) >= 2)
    # Over the box a product of Legendre polynomials of degrees i, j has the mean square 1 / ((2 i + 1)(2 j + 1)).
    sizes = np.array([math.sqrt((2 * i + 1) * (2 * j + 1)) for i, j in terms])
    each = statement.flatness_u_mm / math.sqrt(max(len(terms), 1)) if stated else math.inf
    box = (float(x0), float(x1), float(y0), float(y1))
    return BoardForm(box, terms, each * sizes, statement.pitch_u_rel, statement.stretch_u_rel)
