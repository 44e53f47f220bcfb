"""The loops of `orders`: chi-squared of every order at every pixel, and over neighbours where that is not enough."""

import numpy as np
from numba import njit
from numpy.typing import NDArray

from fringecal.numerics import TURN, over_bands

Single = NDArray[np.float32]

# Chi-squared: sum of squared deviations in standard uncertainties, one for each longer period.
_FAR_BETTER = 4.0  # times the best order's chi-squared over the window that the second must have: errors twice as large
_MOST_OF_ONE = 9.0  # of one neighbour, three standard uncertainties: beyond an edge it fits no order of this side
_OWN = 1e9  # a pixel's own chi-squared is not limited
_SHARED = 0.2  # of a pixel's allowance that each neighbour adds: their noise averages, a common ripple does not
_REACH = 2  # px to each side that are averaged for an uncertain pixel: 25 px, whose noise is a fifth of one's
_LEAST_NEIGHBOURS = 3  # of eight, within half a fringe: at a straight edge five are of the same surface
_ROUNDING = 1e-5  # of a turn, far above that of single precision: a candidate too many costs nothing
_CONTINUES = 2.0  # rad, off what slope predicts: noise and curvature within it, a third of all phases outside
_STEPS = 0.8  # rad, of neighbours off the slope: four times the noise of a difference that fringes of use have
_LEAST_OF_ONE_ORDER = 0.9  # of the pixels around: fewer at an edge of the surface
_LEAST_LEAD = 2  # votes: a lead of one is one noisy pixel


@njit(inline="always")
def _chi_squared(phi, n, long, u_long, i, j, ratios, zeros):  # type: ignore[no-untyped-def]
    """Return the chi-squared of order n at a pixel; a longer fringe that is masked does not count."""
    total = 0.0
    for k in range(ratios.size):
        off = long[k, i, j] - ratios[k] * (phi + TURN * n) - zeros[k]
        off -= TURN * np.rint(off / TURN)
        if off == off:
            total += (off / u_long[k, i, j]) ** 2
    return total


@njit(inline="always")
def _best_two(chi_squareds):  # type: ignore[no-untyped-def]
    """Return the least chi-squared's place, the least and the second least."""
    place, least, second = 0, np.inf, np.inf
    for n in range(chi_squareds.size):
        if chi_squareds[n] < least:
            place, least, second = n, chi_squareds[n], least
        elif chi_squareds[n] < second:
            second = chi_squareds[n]
    return place, least, second


def orders(  # noqa: PLR0913, PLR0917 -- what the kernel takes
    phi: Single,
    long: Single,
    u_long: Single,
    ratios: NDArray[np.float64],
    zeros: NDArray[np.float64],
    cycle: int,
    clear: float,
    most: float,
) -> tuple[NDArray[np.int16], NDArray[np.bool_]]:
    """Return the order of every pixel, -1 where open, and where the neighbours were asked."""
    found, asked = np.full(phi.shape, -1, np.int16), np.zeros(phi.shape, np.bool_)
    codes = ratios[0] * np.arange(cycle) % 1
    by_code = np.argsort(codes, kind="stable")
    tables = codes[by_code], by_code
    over_bands(_orders, len(phi), phi, long, u_long, ratios, zeros, tables, clear, most, found, asked)
    return found, asked


@njit(inline="always")
def _add_likely(phi, over, long, u_long, i, j, ratios, zeros, tables, bound, chi_squareds):  # type: ignore[no-untyped-def]
    """Add the chi-squared, `bound` at most, of every order less `over` at a pixel to sums.

    The first longer fringe alone puts most orders beyond the bound: those near its phase lie side by side once sorted.
    """
    codes, by_code = tables
    here = (long[0, i, j] - zeros[0]) / TURN - ratios[0] * (phi / TURN + over)
    reach = np.sqrt(bound) * u_long[0, i, j] / TURN + _ROUNDING
    if not reach < 0.5:  # also where the first longer fringe is masked
        for n in range(codes.size):
            chi_squareds[n] += min(_chi_squared(phi, n + over, long, u_long, i, j, ratios, zeros), bound)
        return
    here -= np.floor(here)
    k = np.searchsorted(codes, here - reach) if here >= reach else np.searchsorted(codes, here - reach + 1) - codes.size
    chi_squareds += bound
    for _ in range(codes.size):
        turn = k // codes.size
        if codes[k - turn * codes.size] + turn > here + reach:
            break
        n = by_code[k - turn * codes.size]
        chi_squareds[n] += min(_chi_squared(phi, n + over, long, u_long, i, j, ratios, zeros), bound) - bound
        k += 1


@njit(nogil=True, cache=True)
def _orders(first, last, phi, long, u_long, ratios, zeros, tables, clear, most, found, asked):  # type: ignore[no-untyped-def]
    """Decide the orders of some rows."""
    width = phi.shape[1]
    # An order at the bound leaves the best one clear, or that one is not accepted.
    bound = most * ratios.size + clear + 1
    for i in range(first, last):
        chi_squareds = np.empty(tables[0].size)
        for j in range(width):
            if not np.isfinite(phi[i, j]):
                continue
            chi_squareds[:] = 0.0
            _add_likely(phi[i, j], 0, long, u_long, i, j, ratios, zeros, tables, bound, chi_squareds)
            place, least, second = _best_two(chi_squareds)
            if second - least > clear and least < most * ratios.size:
                found[i, j] = place
                continue
            asked[i, j] = True
            count = _over_window(phi, long, u_long, ratios, zeros, tables, i, j, chi_squareds)
            place, least, second = _best_two(chi_squareds)
            # A ripple that all of them share fits no order well, but the right one far less than the others.
            fits = least < most * ratios.size * (1 + _SHARED * count) or second > _FAR_BETTER * least
            if second - least > clear and fits:
                found[i, j] = place


@njit
def _over_window(phi, long, u_long, ratios, zeros, tables, i, j, chi_squareds):  # type: ignore[no-untyped-def]
    """Sum the chi-squared over the neighbours, each in the order that continues the pixel's own."""
    height, width = phi.shape
    chi_squareds[:] = 0.0
    count = 0
    for a in range(max(0, i - _REACH), min(height, i + _REACH + 1)):
        for b in range(max(0, j - _REACH), min(width, j + _REACH + 1)):
            there = phi[a, b]
            if not np.isfinite(there):
                continue
            over = np.rint((phi[i, j] - there) / TURN)
            count += 1
            most = _MOST_OF_ONE * ratios.size * (1.0 if a != i or b != j else _OWN)
            _add_likely(there, over, long, u_long, a, b, ratios, zeros, tables, most, chi_squareds)
    return count


def alone(absolute: Single, cycle_rad: float) -> NDArray[np.bool_]:
    """Tell which pixels have fewer than three neighbours within half a fringe: at edges, orders may be by chance."""
    found = np.zeros(absolute.shape, np.bool_)
    over_bands(_alone, len(absolute), absolute, cycle_rad, found)
    return found


@njit(nogil=True, cache=True)
def _alone(first, last, absolute, cycle_rad, found):  # type: ignore[no-untyped-def]
    """Count the neighbours in some rows."""
    height, width = absolute.shape
    for i in range(first, last):
        for j in range(width):
            here, near = absolute[i, j], 0
            for a in range(max(0, i - 1), min(height, i + 2)):
                for b in range(max(0, j - 1), min(width, j + 2)):
                    off = absolute[a, b] - here
                    near += abs(off - cycle_rad * np.rint(off / cycle_rad)) < np.pi  # one is the pixel itself
            found[i, j] = near <= _LEAST_NEIGHBOURS


@njit(cache=True)
def hang_together(absolute, cycle_rad, most_rad):  # type: ignore[no-untyped-def]
    """Label what is connected by steps of less than `most_rad`, and count whole cycles along it.

    Returns the phase, continuous within each piece, float64, and labels from 1 in raster order; 0 is masked.
    """
    height, width = absolute.shape
    values = np.full((height, width), np.nan)
    labels = np.zeros((height, width), np.int32)
    queue = np.empty(height * width, np.int64)
    number = 0
    for start in range(height * width):
        i, j = start // width, start % width
        if labels[i, j] > 0 or not np.isfinite(absolute[i, j]):
            continue
        number += 1
        labels[i, j], values[i, j] = number, absolute[i, j]
        queue[0], first, last = start, 0, 1
        while first < last:
            i, j = queue[first] // width, queue[first] % width
            first += 1
            for di, dj in ((-1, 0), (1, 0), (0, -1), (0, 1)):
                a, b = i + di, j + dj
                if 0 <= a < height and 0 <= b < width and labels[a, b] == 0:
                    off = absolute[a, b] - values[i, j]
                    off -= cycle_rad * np.rint(off / cycle_rad)
                    if abs(off) < most_rad:
                        labels[a, b], values[a, b] = number, values[i, j] + off
                        queue[last] = a * width + b
                        last += 1
    return values, labels


def continued(known: Single, lower: Single, slopes: Single, reach: int) -> Single:
    """Give open pixels `lower` or one fringe more, where nearly all of the known pixels around continue one of them.

    `slopes` (2, H, W) is how the phase rises along u and v, rad/px; pixels up to `reach` px away are asked. Beside an
    edge of the surface only those are that hang together with the pixel by steps of the phase as the slope has them.
    """
    result = known.copy()
    over_bands(_continue, len(known), known, lower, slopes, reach, result)
    return result


@njit(nogil=True, cache=True)
def _continue(first, last, known, lower, slopes, reach, result):  # type: ignore[no-untyped-def]
    """Continue in some rows."""
    width = known.shape[1]
    side = 2 * reach + 1
    asked, queue = np.zeros((side, side), np.bool_), np.empty(side * side, np.int64)
    for i in range(first, last):
        for j in range(width):
            if np.isfinite(known[i, j]) or not np.isfinite(lower[i, j]):
                continue
            asked[:] = True
            order = _voted(known, lower, slopes, i, j, asked)
            if order < 0:
                _hanging(lower, slopes, i, j, asked, queue)
                order = _voted(known, lower, slopes, i, j, asked)
            if order >= 0:
                result[i, j] = lower[i, j] + TURN * order


@njit
def _voted(known, lower, slopes, i, j, asked):  # type: ignore[no-untyped-def]
    """Return 0 or 1 if nearly all of those that are asked say so, else -1; what fits neither is of another surface."""
    height, width = known.shape
    reach = asked.shape[0] // 2
    votes = np.zeros(3, np.int64)
    for a in range(max(0, i - reach), min(height, i + reach + 1)):
        for b in range(max(0, j - reach), min(width, j + reach + 1)):
            if not asked[a - i + reach, b - j + reach] or not np.isfinite(known[a, b]):
                continue
            off = known[a, b] - lower[i, j] - slopes[0, i, j] * (b - j) - slopes[1, i, j] * (a - i)
            if abs(off) < _CONTINUES:
                votes[0] += 1
            elif abs(off - TURN) < _CONTINUES:
                votes[1] += 1
            else:
                votes[2] += 1
    order = 1 if votes[1] > votes[0] else 0
    return order if votes[order] >= max(_LEAST_LEAD, _LEAST_OF_ONE_ORDER * votes.sum()) else -1


@njit
def _hanging(lower, slopes, i, j, asked, queue):  # type: ignore[no-untyped-def]
    """Mark what hangs together with a pixel by steps of the wrapped phase that the slope explains."""
    height, width = lower.shape
    reach = asked.shape[0] // 2
    side = asked.shape[1]
    asked[:] = False
    asked[reach, reach] = True
    queue[0], first, last = reach * side + reach, 0, 1
    while first < last:
        a, b = queue[first] // side, queue[first] % side
        first += 1
        here = lower[i + a - reach, j + b - reach]
        for da, db in ((-1, 0), (1, 0), (0, -1), (0, 1)):
            c, d = a + da, b + db
            if not (0 <= c < side and 0 <= d < side) or asked[c, d]:
                continue
            v, u = i + c - reach, j + d - reach
            if not (0 <= v < height and 0 <= u < width):
                continue
            off = lower[v, u] - here - slopes[0, i, j] * db - slopes[1, i, j] * da
            off -= TURN * np.rint(off / TURN)
            if abs(off) < _STEPS:
                asked[c, d] = True
                queue[last] = c * side + d
                last += 1
