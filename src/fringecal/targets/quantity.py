"""A measured dimension as a target file states it: value with standard uncertainty."""

import math
import numbers
from collections.abc import Mapping, Sequence
from typing import Annotated, Any, Self

import numpy as np
from pydantic import (
    AfterValidator,
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    SerializerFunctionWrapHandler,
    model_serializer,
    model_validator,
)

from fringecal.uncertainty import Estimate, Influence

# Standard deviation of a distribution of half width 1 (JCGM 100:2008, 4.3.7 and 4.3.9).
HALF_WIDTH_TO_U = {"rectangular": 1 / math.sqrt(3), "triangular": 1 / math.sqrt(6)}

HOW_TO_STATE = (
    "write { value = ..., u = ... } with u the standard uncertainty, "
    'or { value = ..., half_width = ..., distribution = "rectangular" }'
)


def _is_number(item: object) -> bool:
    return isinstance(item, numbers.Real) and not isinstance(item, bool) and math.isfinite(item)


def _number(given: object) -> float:
    if not _is_number(given):
        raise ValueError(f"one finite number is needed, found {given!r}")
    return float(given)  # type: ignore[arg-type]


def _numbers(given: object) -> float | tuple[float, ...]:
    if not isinstance(given, Sequence | np.ndarray) or isinstance(given, str):
        return _number(given)
    if len(given) == 0:
        raise ValueError("the list is empty; give one number, or one per item")
    wrong = [item for item in given if not _is_number(item)]
    if wrong:
        raise ValueError(f"only finite numbers may stand in the list, found {wrong[0]!r}")
    return tuple(float(item) for item in given)


def _scaled(given: object, factor: float) -> float | tuple[float, ...]:
    found = _numbers(given)
    return tuple(factor * item for item in found) if isinstance(found, tuple) else factor * found


def _with_u(given: Mapping[str, Any]) -> dict[str, Any]:
    stated = dict(given)
    if "half_width" in stated and "u" in stated:
        raise ValueError("u and half_width state one thing twice; keep one of them")
    if "half_width" in stated:
        distribution = stated.pop("distribution", None)
        if distribution not in HALF_WIDTH_TO_U:
            known = " or ".join(f'"{name}"' for name in HALF_WIDTH_TO_U)
            raise ValueError(f"half_width needs distribution = {known}, found {distribution!r}")
        stated["u"] = _scaled(stated.pop("half_width"), HALF_WIDTH_TO_U[distribution])
    elif "distribution" in stated:
        raise ValueError("distribution belongs to half_width; state half_width, or only u")
    return stated


class Quantity(BaseModel):
    """A dimension, or one dimension per item, with standard uncertainty in the same unit.

    In a file it is ``{ value = 10.0, u = 0.05 }`` or, with the bounds of a tolerance,
    ``{ value = 10.0, half_width = 0.1, distribution = "rectangular" }``, which gives
    u = a / sqrt(3); ``"triangular"`` gives u = a / sqrt(6) (JCGM 100:2008, 4.3.7 and 4.3.9).

    Parameters
    ----------
    value
        One number, or one per item where the items differ.
    u
        Standard uncertainty: one number for all items, or one per item.
    degrees_of_freedom
        Of that u; None where it is taken as exactly known, as certificates mostly have it.

    Examples
    --------
    >>> height_mm = Quantity(value=[3.001, 2.998], u=0.005)
    >>> height_mm.array(2)
    array([3.001, 2.998])
    >>> print(height_mm.estimate(Influence.STRIP_HEIGHT, "mm", item=1))
    strip height = 2.9980 mm, u = 0.0050 mm, dof inf
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    value: Annotated[float | tuple[float, ...], BeforeValidator(_numbers)]
    u: Annotated[float | tuple[float, ...], BeforeValidator(_numbers)]
    degrees_of_freedom: Annotated[float, Field(gt=0)] | None = None

    @model_serializer(mode="wrap")
    def _without_what_is_not_stated(self, write: SerializerFunctionWrapHandler) -> dict[str, Any]:
        # What an older file could not state is left out where it is not stated: equal targets stay equal.
        return {key: value for key, value in write(self).items() if value is not None}

    @model_validator(mode="before")
    @classmethod
    def _read(cls, given: Any) -> Any:
        if isinstance(given, Mapping):
            return _with_u(given)
        if isinstance(given, cls):
            return given
        raise ValueError(f"found {given!r} without its uncertainty; {HOW_TO_STATE}")

    @model_validator(mode="after")
    def _agree(self) -> "Quantity":
        if min(self.us) < 0:
            raise ValueError(f"u is a standard uncertainty and cannot be negative, found {self.u}")
        n_u = len(self.u) if isinstance(self.u, tuple) else 1
        if n_u not in (1, len(self.values)):
            raise ValueError(f"{n_u} uncertainties for {len(self.values)} value(s); give one u, or one per value")
        return self

    @property
    def values(self) -> tuple[float, ...]:
        """All values, as a tuple even where one number stands for all items."""
        return self.value if isinstance(self.value, tuple) else (self.value,)

    @property
    def us(self) -> tuple[float, ...]:
        """One standard uncertainty per value."""
        return self.u if isinstance(self.u, tuple) else (self.u,) * len(self.values)

    def array(self, count: int) -> np.ndarray:
        """Spread the values over `count` items, shape (count,); one number stands for all of them."""
        return np.broadcast_to(np.array(self.values), (count,)).copy()

    def u_array(self, count: int) -> np.ndarray:
        """Spread the standard uncertainties over `count` items, shape (count,)."""
        return np.broadcast_to(np.array(self.us), (count,)).copy()

    def estimate(self, name: Influence | str, unit: str, *, item: int = 0) -> Estimate:
        """Take one item as an `Estimate`; a single number is the estimate of every item.

        `name` is the influence that the quantity is to other results, or a mere label where it is none.
        """
        k = item if len(self.values) > 1 else 0
        influence, label = (name, name.text) if isinstance(name, Influence) else (None, name)
        return Estimate(self.values[k], self.us[k], unit, label, self.dof, influence=influence)

    @property
    def dof(self) -> float:
        """Degrees of freedom of u; infinite where none are stated."""
        return math.inf if self.degrees_of_freedom is None else self.degrees_of_freedom

    def scaled(self, factor: float) -> Self:
        """Return the same with values and u multiplied.

        Examples
        --------
        >>> Scalar(value=10.0, u=0.1).scaled(2.0).u
        0.2
        """
        return self.model_copy(update={"value": _scaled(self.value, factor), "u": _scaled(self.u, factor)})


class Scalar(Quantity):
    """A `Quantity` that is one number by its nature, such as a pitch."""

    value: Annotated[float, BeforeValidator(_number)]
    u: Annotated[float, BeforeValidator(_number)]


def _positive[Q: Quantity](quantity: Q) -> Q:
    if min(quantity.values) <= 0:
        raise ValueError(f"must be greater than zero, found {min(quantity.values):g}")
    return quantity


Positive = Annotated[Scalar, AfterValidator(_positive)]
Positives = Annotated[Quantity, AfterValidator(_positive)]
