"""The section [uncertainty] of a scenario: which of its numbers vary from sample to sample, and how.

    [uncertainty]
    plant.m_p = { distribution = "uniform", low = 0.8, high = 1.2, relative = true }
    disturbance.phase = { distribution = "uniform", low = 0.0, high = 6.283185307179586 }
    plant.m_obj = { distribution = "none" }  # whatever the base scenario says of it

>>> mass = {"distribution": "normal", "mean": 5, "std": 0.1}
>>> UncertaintySection.model_validate({"plant": {"m_p": mass}}).entries()[0].place
'plant.m_p'
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import Annotated, Any, Literal, NamedTuple

from pydantic import Field, model_validator

from coopmm_jax.errors import UserError
from coopmm_jax.scenario.fields import Finite, Flag, Positive, Section, quantity
from coopmm_jax.scenario.overrides import DISTRIBUTION, is_number, merged
from coopmm_jax.scenario.validation import closest, validate

_SHAPES = {  # distribution -> the numbers that describe it
    "uniform": ("low", "high"),
    "log_uniform": ("low", "high"),
    "normal": ("mean", "std"),
    "truncated_normal": ("mean", "std", "low", "high"),
}


def shapes() -> dict[str, tuple[str, ...]]:
    """Distributions by name, each with the numbers that describe it."""
    return dict(_SHAPES)


class Distribution(Section):
    """Distribution of one number. Without ``relative`` and ``offset`` the drawn value replaces the scenario's."""

    distribution: Literal["uniform", "log_uniform", "normal", "truncated_normal"]
    low: Finite | None = None
    high: Finite | None = None
    mean: Finite | None = None
    std: Positive | None = None
    relative: Flag = quantity(False, "the draw is a factor on the scenario's value")
    offset: Flag = quantity(False, "the draw is added to the scenario's value")
    each: Flag = quantity(False, "one draw for each number that the name stands for, not one for all")
    group: Annotated[str, Field(min_length=1)] | None = quantity(None, "entries of one group share one draw")

    @model_validator(mode="after")
    def _consistent(self) -> Distribution:
        needed = _SHAPES[self.distribution]
        for name in ("low", "high", "mean", "std"):
            given = getattr(self, name)
            if (name in needed) != (given is not None):
                must = f"{'given' if name in needed else 'left out'} for {self.distribution}"
                raise UserError(name, must, "missing" if given is None else given)
        low, high = self.bounds()
        if low >= high:
            raise UserError("high", f"greater than low ({low:g})", high)
        if self.distribution == "log_uniform" and low <= 0.0:
            raise UserError("low", "greater than 0 for log_uniform", low)
        if self.relative and self.offset:
            raise UserError("offset", "left out where relative is true", "true")
        if self.each and self.group:
            raise UserError("group", "left out where each is true", self.group)
        return self

    def bounds(self) -> tuple[float, float]:
        """Smallest and largest value [in the field's units, or of the factor on it]."""
        return (-math.inf if self.low is None else self.low, math.inf if self.high is None else self.high)

    def moments(self) -> tuple[float, float]:
        """Mean and standard deviation [likewise]; 0 and 1 for a distribution without them."""
        return (0.0 if self.mean is None else self.mean, 1.0 if self.std is None else self.std)


class Entry(NamedTuple):
    """One line of the section."""

    place: str  # dotted name of a field
    part: int | None  # 0 or 1 of a pair of robots, 0 to n - 1 of a list; None: not one of them alone
    distribution: Distribution

    @property
    def name(self) -> str:
        """As the user writes it."""
        return self.place + ("" if self.part is None else f".{self.part + 1}")


class UncertaintySection(Section, extra="allow"):
    """[uncertainty]: section.field = { distribution = ..., ... }; section.field.1, .2: a robot's, or a list's."""

    # tables in tables, with a Distribution at the end of each path
    __pydantic_extra__: dict[str, dict[str, Any]] = Field(init=False)  # pyright: ignore[reportIncompatibleVariableOverride]

    @model_validator(mode="before")
    @classmethod
    def _tables(cls, data: Any) -> Any:
        if not isinstance(data, Mapping):
            raise UserError("", "a table of section.field = {...}", data)
        return _fields((), merged({}, data))

    def entries(self) -> tuple[Entry, ...]:
        """The lines in the order of the file."""
        return tuple(_entries((), self.__pydantic_extra__))


def _entries(path: tuple[str, ...], table: Mapping[str, Any]) -> Iterator[Entry]:
    for name, given in table.items():
        if not isinstance(given, Distribution):
            yield from _entries((*path, name), given)
        elif is_number(name) and len(path) > 1:
            yield Entry(".".join(path), int(name) - 1, given)
        else:
            yield Entry(".".join((*path, name)), None, given)


def _fields(path: tuple[str, ...], table: Any) -> dict[str, Any]:
    """Tables in tables with a distribution at the end of each path, without those that are dropped or empty."""
    if not isinstance(table, Mapping):
        raise UserError(".".join(path), "a table of field = {...}", table)
    result: dict[str, Any] = {}
    for name, given in table.items():
        place = (*path, name)
        if not path or _is_table_of_tables(given):
            result[name] = _fields(place, given)
        elif not _dropped(given):
            result[name] = _distribution(".".join(place), given)
    return {name: given for name, given in result.items() if given}


def _is_table_of_tables(given: Any) -> bool:
    tables = isinstance(given, Mapping) and bool(given)
    return tables and all(isinstance(value, Mapping | Distribution) for value in given.values())


def _dropped(table: Any) -> bool:
    """True if an entry says that the number does not vary, whatever a base scenario has for it."""
    return isinstance(table, Mapping) and table.get(DISTRIBUTION) == "none"


def _distribution(name: str, table: Any) -> Distribution:
    if isinstance(table, Distribution):
        return table
    if not isinstance(table, Mapping):
        raise UserError(name, "a table { distribution = ..., ... }", table)
    for key in table:
        if is_number(key):
            raise UserError(f"{name}.{key}", f"left out beside {name}, which stands for all its numbers", "given")
        if key not in Distribution.model_fields:
            must = f"one of {', '.join(Distribution.model_fields)}{closest(key, Distribution.model_fields)}"
            raise UserError(f"{name}.{key}", must, "unknown")
    if DISTRIBUTION not in table:
        raise UserError(f"{name}.{DISTRIBUTION}", f"one of {', '.join(_SHAPES)}", "missing")
    try:
        return validate(Distribution, table)
    except UserError as error:
        raise UserError(f"{name}.{error.field}", error.must, error.was, error.more) from None
