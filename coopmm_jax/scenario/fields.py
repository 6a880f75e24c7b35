"""Types of the fields of a scenario file, and the base of its sections.

"Pair" means one number for both robots, or a list [robot I, robot II].

>>> class Tyre(Section):
...     grip: Pair[Positive] = quantity(0.8, "friction on the floor [-]")
>>> Tyre(grip=[0.7, 0.9]).grip
(0.7, 0.9)
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, TypeVar

from pydantic import BaseModel, BeforeValidator, ConfigDict, Discriminator, Field, Strict, Tag, model_validator

from coopmm_jax.errors import UserError

Number = TypeVar("Number")
Finite = Annotated[float, Strict(), Field(allow_inf_nan=False)]
NotNegative = Annotated[Finite, Field(ge=0)]
Positive = Annotated[Finite, Field(gt=0)]
AboveMinusOne = Annotated[Finite, Field(gt=-1)]
Count = Annotated[int, Strict(), Field(ge=1, lt=2**31)]
Flag = Annotated[bool, Strict()]


def _one_or_list(value: Any) -> str:
    return "list" if isinstance(value, list | tuple) else "one"


# Which alternative is meant is decided by looking at the value, so that a bad value gives one error, not one for each.
_One = Annotated[Number, Tag("one")]
Pair = Annotated[
    _One | Annotated[tuple[Number, ...], Field(min_length=2, max_length=2), Tag("list")], Discriminator(_one_or_list)
]
PerEntry = Annotated[_One | Annotated[tuple[Number, ...], Tag("list")], Discriminator(_one_or_list)]


def _lists(value: Any) -> Any:
    """Lists of numbers; one number alone, as on the command line, is a list of one."""
    if isinstance(value, int | float) and not isinstance(value, bool):
        return (value,)
    if not isinstance(value, list | tuple):
        raise UserError("", "a list of numbers for both robots, or one for each", value)
    nested = [isinstance(entry, list | tuple) for entry in value]
    if any(nested) and (len(value) != 2 or not all(nested)):
        raise UserError("", "a list of numbers for both robots, or one for each", value)
    return value


def _one_or_two_lists(value: Any) -> str:
    return "list" if isinstance(value, list | tuple) and value and isinstance(value[0], list | tuple) else "one"


_Numbers = Annotated[tuple[Number, ...], Field(min_length=1)]
# One number for each pitch link of an arm: a list for both robots, or one for each.
PerLink = Annotated[
    Annotated[_Numbers[Number], Tag("one")] | Annotated[tuple[_Numbers[Number], _Numbers[Number]], Tag("list")],
    Discriminator(_one_or_two_lists),
    BeforeValidator(_lists),
]


def quantity(default: Any, meaning: str) -> Any:
    """A field with its default, and its meaning and unit for the help text."""
    return Field(default, description=meaning)


class Section(BaseModel):
    """Base of every section: unknown keys are errors, values cannot be changed in place."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    @model_validator(mode="before")
    @classmethod
    def _left_out(cls, data: Any) -> Any:
        """Let "none" drop what a base scenario gives for a field that can be left out."""
        if not isinstance(data, Mapping):
            return data
        optional = {name for name, field in cls.model_fields.items() if field.default is None}
        return {name: value for name, value in data.items() if not (name in optional and value == "none")}
