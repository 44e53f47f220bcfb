"""A measured value with its standard uncertainty, as documents write it."""

from typing import Annotated

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, FiniteFloat, model_validator

Finite = Annotated[FiniteFloat, Field(strict=True)]
NonNegative = Annotated[FiniteFloat, Field(strict=True, ge=0)]


def _tuple(value: object) -> object:
    return tuple(value) if isinstance(value, list) else value


class Quantity(BaseModel):
    """Value and standard uncertainty: numbers, or equally long lists of numbers."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    value: Annotated[Finite | tuple[Finite, ...], BeforeValidator(_tuple)]
    u: Annotated[NonNegative | tuple[NonNegative, ...], BeforeValidator(_tuple)]

    @model_validator(mode="after")
    def _same_length(self) -> "Quantity":
        if isinstance(self.u, tuple) and (
            not isinstance(self.value, tuple) or len(self.u) != len(self.value)
        ):
            raise ValueError("u must be one number, or as many as value has")
        return self
