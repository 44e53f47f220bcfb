"""Numbers as text: a value to the second digit of its uncertainty (JCGM 100:2008, 7.2.6), and no digit beyond."""

import math

_MOST_DECIMALS = 7  # finer steps are printed with a power of ten
_MANY_DOF = 1000.0  # Student's t is the normal distribution then, to 0.2 % of the expanded uncertainty


def decimals_of(u: float) -> int:
    """Return the decimal place of the second significant digit of an uncertainty; negative left of the point.

    Examples
    --------
    >>> [decimals_of(u) for u in (0.0123, 0.0996, 5.04, 123.0)]
    [3, 2, 1, -1]
    """
    return 1 - int(f"{u:.1e}".partition("e")[2])


def value_text(value: float, u: float | None, *, sign: bool = False, otherwise: str = ".4g") -> str:
    """Print a value to the second digit of its standard uncertainty.

    Parameters
    ----------
    value, u
        In the same unit. Where `u` says nothing (None, 0, not finite), the value is printed as `otherwise` says.
    sign
        Whether to print a plus before what is positive, as for changes and errors.
    otherwise
        Format specification without a sign.

    Examples
    --------
    >>> value_text(50.70409, 0.0869), value_text(-4.0e-07, 1.0e-3), value_text(1222.13, 123.4)
    ('50.704', '0.0000', '1220')
    >>> value_text(0.00031, 0.013, sign=True), value_text(1.23456e-11, 2.0e-13)
    ('0.000', '1.235e-11')
    """
    plus = "+" if sign else ""
    if u is None or not math.isfinite(u) or u <= 0 or not math.isfinite(value):
        text = format(value, plus + otherwise)
    elif (decimals := decimals_of(u)) > _MOST_DECIMALS:
        exponent = int(f"{value:e}".partition("e")[2])
        kept = exponent + decimals
        text = f"{value:{plus}.{kept}e}" if value and kept >= 0 else "0"
    else:
        text = f"{round(value, decimals):{plus}.{max(decimals, 0)}f}"
    return text if any(digit in text for digit in "123456789") else text.lstrip("+-")


def uncertainty_text(u: float) -> str:
    """Print an uncertainty to two significant digits, as `value_text` prints the value that it belongs to.

    Examples
    --------
    >>> [uncertainty_text(u) for u in (0.08696, 0.0996, 5.04, 123.4, 2.04e-13, 0.0)]
    ['0.087', '0.10', '5.0', '120', '2.0e-13', '0']
    """
    if u == 0:
        return "0"
    if not math.isfinite(u) or decimals_of(u) > _MOST_DECIMALS:
        return f"{u:.1e}"
    return value_text(u, u)


def dof_text(dof: float | None) -> str:
    """Print degrees of freedom: beyond 1000 their number says nothing more, and none stated are infinitely many.

    Examples
    --------
    >>> [dof_text(dof) for dof in (12.34, 228.0, 1.55e9, math.inf, None)]
    ['12', '228', '> 1000', '∞', '∞']
    """
    if dof is None or math.isinf(dof):
        return "∞"
    return "> 1000" if dof > _MANY_DOF else f"{dof:.0f}"
