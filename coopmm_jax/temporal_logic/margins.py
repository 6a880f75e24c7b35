"""Margins of what a sentence says of one instant: by how much a comparison holds, and what joins several.

Elementwise: on scalars while a rollout goes on, and on arrays of all its samples.

>>> from coopmm_jax.temporal_logic.grammar import read
>>> sentence = read("contact_force >= 5 and contact_force <= 60")
>>> float(margin(sentence.form, {"contact_force": 8.0}, sentence.numbers))
3.0
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import jax.numpy as jnp

from coopmm_jax.algebra.types import Scalar
from coopmm_jax.temporal_logic.sentence import Arithmetic, Comparison, Constant, Logic, Signal


class Extremes(NamedTuple):
    """Smaller and larger of two margins, exactly or smoothly."""

    smaller: Callable[[Any, Any], Any]
    larger: Callable[[Any, Any], Any]


EXACT = Extremes(jnp.minimum, jnp.maximum)


def smooth(temperature: Scalar) -> Extremes:
    """Extremes of scalars or arrays (...,), smooth over differences of a temperature > 0 in the unit of the margins."""

    def larger(a: Any, b: Any) -> Any:
        return temperature * jnp.logaddexp(a / temperature, b / temperature)

    return Extremes(lambda a, b: -larger(-a, -b), larger)


def value(part: Any, signals: Mapping[str, Any], numbers: Any) -> Any:
    """Value of what is no condition, of the shape of the signals.

    Args:
        part: constant, signal or arithmetic.
        signals: by name.
        numbers: of the sentence (n,).
    """
    match part:
        case Constant(slot):
            return numbers[slot]
        case Signal(name):
            return signals[name]
        case Arithmetic(operator, operands):
            return _ARITHMETIC[operator](*(value(operand, signals, numbers) for operand in operands))
    raise TypeError(part)


_ARITHMETIC: dict[str, Callable[..., Any]] = {
    "+": lambda a, b: a + b,
    "-": lambda a, b: a - b,
    "*": lambda a, b: a * b,
    "/": lambda a, b: a / b,
    "negative": lambda a: -a,
    "abs": jnp.abs,
}
_MARGINS: dict[str, Callable[[Any, Any], Any]] = {
    ">=": lambda a, b: a - b,
    "<=": lambda a, b: b - a,
    "==": lambda a, b: -jnp.abs(a - b),
}


def margin(part: Any, signals: Mapping[str, Any], numbers: Any, extremes: Extremes = EXACT) -> Any:
    """Margin of a condition of one instant, of the shape of the signals; negative where it does not hold.

    Args:
        part: comparison, or logic of comparisons.
        signals: by name.
        numbers: of the sentence (n,).
        extremes: how margins are joined.
    """
    if isinstance(part, Logic):
        return joined(part, [margin(operand, signals, numbers, extremes) for operand in part.operands], extremes)
    assert isinstance(part, Comparison)
    found = _MARGINS[part.relation](*(value(side, signals, numbers) for side in part.operands))
    return found if part.scale is None else found / numbers[part.scale]


def joined(part: Logic, margins: list[Any], extremes: Extremes) -> Any:
    """Margin of conditions joined by a word, from theirs."""
    match part.operator:
        case "not":
            return -margins[0]
        case "and":
            return extremes.smaller(*margins)
        case "or":
            return extremes.larger(*margins)
        case "implies":
            return extremes.larger(-margins[0], margins[1])
    raise ValueError(part.operator)
