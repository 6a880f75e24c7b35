"""The section [requirements] of a scenario: limits that metrics have to keep.

    [requirements]
    force_error_rms_late = "<= 2.0"
    contact_loss_fraction = "== 0"

>>> import numpy as np
>>> RequirementsSection.model_validate({"force_min": ">= 0"}).parsed()[0].met(np.array([1.0, -1.0]))
array([ True, False])
"""

from __future__ import annotations

import math
import operator
import re
from collections.abc import Mapping
from typing import Any, NamedTuple

from pydantic import Field, model_validator

from coopmm_jax.errors import UserError
from coopmm_jax.scenario.fields import Section

_OPERATORS = {"<=": operator.le, ">=": operator.ge, "==": operator.eq, "<": operator.lt, ">": operator.gt}
_FORM = re.compile(rf"\s*({'|'.join(_OPERATORS)})\s*(\S+)\s*")


def relations() -> tuple[str, ...]:
    """Forms of a limit."""
    return tuple(_OPERATORS)


class Requirement(NamedTuple):
    """A metric, and the limit it has to keep."""

    metric: str
    relation: str  # of _OPERATORS
    limit: float

    def met(self, values: Any) -> Any:
        """True if a value keeps the limit, or booleans for many (N,); one that is not a number does not."""
        return _OPERATORS[self.relation](values, self.limit)

    @property
    def low_is_bad(self) -> bool:
        """True if the worst value is the smallest."""
        return self.relation.startswith(">")

    def __str__(self) -> str:
        return f"{self.metric} {self.relation} {self.limit:g}"


class RequirementsSection(Section, extra="allow"):
    """[requirements]: metric = "<= limit" (or >=, ==, <, >), which every sample has to meet; "none" drops a base's."""

    # pydantic checks the fields that are allowed against this type
    __pydantic_extra__: dict[str, str] = Field(init=False)  # pyright: ignore[reportIncompatibleVariableOverride]

    @model_validator(mode="before")
    @classmethod
    def _table(cls, data: Any) -> Any:
        if not isinstance(data, Mapping):
            raise UserError("", 'a table of metric = "<= limit"', data)
        kept = {metric: text for metric, text in data.items() if text != "none"}
        for metric, text in kept.items():
            parse(metric, text)
        return kept

    def parsed(self) -> tuple[Requirement, ...]:
        """The lines in the order of the file."""
        return tuple(parse(metric, text) for metric, text in self.__pydantic_extra__.items())


def parse(metric: str, text: Any) -> Requirement:
    """One line of the section.

    Raises:
        UserError: the text is not a relation and a number.

    >>> str(parse("force_min", ">=0"))
    'force_min >= 0'
    """
    match = _FORM.fullmatch(text) if isinstance(text, str) else None
    try:
        limit = float(match[2]) if match else math.nan
    except ValueError:
        limit = math.nan
    if match is None or not math.isfinite(limit):
        must = f'one of {", ".join(_OPERATORS)} and a number, as in "<= 2.0"'
        raise UserError(metric, must, f'"{text}"' if isinstance(text, str) else text)
    return Requirement(metric, match[1], limit)
