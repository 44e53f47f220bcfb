"""How a projector's light follows the grey value that it is sent, and the grey value for a wanted light."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fringecal.errors import PhaseError

Array = NDArray[np.float64]

_LEAST_STEPS = 3  # of a measured ladder: two say that it is straight
_FINE = 4097  # places at which a gamma is tabulated: between two of them it is straight to 1e-7


@dataclass(frozen=True)
class Response:
    """Light over grey value, both from 0 to 1, rising; between the places given it is straight.

    Parameters
    ----------
    grey, light
        Places (n,), ascending, from 0 to 1 each.
    """

    grey: Array
    light: Array

    def shown(self, grey: ArrayLike) -> Array:
        """Light (0 to 1) for grey values (0 to 1)."""
        return np.interp(np.asarray(grey, float), self.grey, self.light)

    def wanted(self, light: ArrayLike) -> Array:
        """Grey values (0 to 1) that show a light (0 to 1)."""
        return np.interp(np.asarray(light, float), self.light, self.grey)


def gamma_response(exponent: float) -> Response:
    """Return the response `light = grey^exponent`.

    Raises
    ------
    PhaseError
        An exponent that no projector has (outside 0.2 to 5).

    Examples
    --------
    >>> round(float(gamma_response(2.0).shown(0.5)), 6)
    0.25
    """
    if not 0.2 <= exponent <= 5:
        raise PhaseError(f"an exponent of {exponent:g} is no projector's; 0.2 to 5 were expected, 1 is straight")
    # Places that lie close where the curve bends most, at its foot.
    grey = np.linspace(0, 1, _FINE) ** 2
    return Response(grey, grey**exponent)


def measured_response(grey: Sequence[float], light: Sequence[float]) -> Response:
    """Return the response that a ladder of grey values showed, scaled to 0 and 1 at its ends.

    Parameters
    ----------
    grey
        Grey values that were sent, of any unit, ascending.
    light
        What a linear camera saw of each.

    Raises
    ------
    PhaseError
        Fewer than three steps, grey values that do not ascend, or light that falls: no grey value could be named for
        each light.
    """
    sent, seen = np.asarray(grey, float), np.asarray(light, float)
    if sent.shape != seen.shape or sent.ndim != 1 or sent.size < _LEAST_STEPS or not np.isfinite([sent, seen]).all():
        raise PhaseError(f"a ladder of {sent.size} grey values and {seen.size} lights; at least {_LEAST_STEPS} pairs")
    if (np.diff(sent) <= 0).any():
        raise PhaseError("the ladder's grey values do not ascend; sort it, each value once")
    if (np.diff(seen) <= 0).any():
        k = int(np.argmin(np.diff(seen)))
        raise PhaseError(
            f"light does not rise from grey value {sent[k]:g} to {sent[k + 1]:g}: saturated, or noise; leave such "
            "steps out, and darken the camera"
        )
    return Response((sent - sent[0]) / (sent[-1] - sent[0]), (seen - seen[0]) / (seen[-1] - seen[0]))
