"""Margins of a sentence's comparisons, made such that they can be weighed against each other; known without JAX.

Margins in one unit keep it. Where a sentence has several, each is divided by its limit, or by what is typical of its
unit where the limit is 0 or computed.
"""

from __future__ import annotations

import math
import operator
from collections.abc import Sequence
from typing import Any

from coopmm_jax.temporal_logic.sentence import Arithmetic, Comparison, Constant, Formula, signals_of, walk
from coopmm_jax.temporal_logic.signals import SIGNALS, typical_size

_COMPUTED = {"+": operator.add, "-": operator.sub, "*": operator.mul, "negative": operator.neg, "abs": abs}


def weighed(form: Formula, numbers: tuple[float, ...]) -> tuple[Any, tuple[float, ...], str, float]:
    """Form and numbers (n,) with what margins are divided by, the unit of the robustness, and a scale for it."""
    comparisons = [part for part in walk(form) if isinstance(part, Comparison)]
    units = dict.fromkeys(map(_unit, comparisons))
    if len(units) == 1:
        return form, numbers, next(iter(units)), max(_size(each, numbers) for each in comparisons)
    longer = list(numbers)
    return _divided(form, longer), tuple(longer), "-", 1.0


def limit_of(part: Any, numbers: Sequence[float]) -> float | None:
    """Value of a part that is a plain one of the numbers (n,); None of what is computed."""
    if isinstance(part, Arithmetic) and part.operator == "negative":
        inner = limit_of(part.operands[0], numbers)
        return None if inner is None else -inner
    return numbers[part.slot] if isinstance(part, Constant) else None


def value_of(part: Any, numbers: Sequence[float]) -> float:
    """Value of a part without signals, computed from the numbers (n,); NaN where it divides by zero.

    >>> value_of(Arithmetic("-", (Constant(0), Constant(0))), (2.0,))
    0.0
    """
    if isinstance(part, Constant):
        return numbers[part.slot]
    first, *others = (value_of(each, numbers) for each in part.operands)
    if part.operator == "/":
        return first / others[0] if others[0] else math.nan
    return float(_COMPUTED[part.operator](first, *others))


def _divided(part: Any, numbers: list[float]) -> Any:
    """A part whose comparisons divide their margins, by numbers that are added."""
    if isinstance(part, Comparison):
        numbers.append(_size(part, numbers))
        return part._replace(scale=len(numbers) - 1)
    return part._replace(operands=tuple(_divided(each, numbers) for each in part.operands))


def _size(comparison: Comparison, numbers: Sequence[float]) -> float:
    limits = (limit_of(side, numbers) for side in comparison.operands)
    return next((abs(limit) for limit in limits if limit), typical_size(_unit(comparison)))


def _unit(comparison: Comparison) -> str:
    """Unit of a comparison's first signal."""
    return SIGNALS[signals_of(comparison)[0]].unit
