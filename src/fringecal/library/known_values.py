"""What is known beforehand, as a person states it: values with their standard uncertainty, artefacts by name."""

from collections.abc import Sequence
from pathlib import Path

from fringecal.targets import Quantity, Target, load_target


def known(value: float | Sequence[float], u: float | Sequence[float]) -> Quantity:
    """State a value, or several of one kind, with standard uncertainty.

    Parameters
    ----------
    value
        In the unit that the argument it is passed to names.
    u
        Standard uncertainty in the same unit: one for all values, or one for each.

    Raises
    ------
    ValueError
        An uncertainty below 0, or values that are not finite.

    Examples
    --------
    >>> known(1500.0, u=5.0).estimate("camera height", "mm").interval_95
    (1490.2001..., 1509.7998...)
    """
    return Quantity.model_validate({"value": value, "u": u})


def target_of(stated: Target | str | Path) -> Target:
    """Return an artefact: as given, by the name of a shipped one, or from a TOML file.

    Raises
    ------
    TargetError
        There is no such artefact, or its file is wrong.
    """
    return load_target(stated) if isinstance(stated, str | Path) else stated
