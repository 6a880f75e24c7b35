"""Signals that a requirement is about, and the levels that it sets to them, for a figure.

>>> from coopmm_jax.scenario.sections.requirements import parse
>>> presses = parse("presses", "always[0.5, 20] contact_force >= 12")
>>> signals(presses), levels(presses, duration=20.0)
(('contact_force',), [Level(signal='contact_force', value=12.0, begin=0.5, end=20.0, label='limit')])
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

from coopmm_jax.metrics.table import LATE, LATE_FROM, METRICS, SETTLED
from coopmm_jax.scenario.sections.requirements import Requirement
from coopmm_jax.temporal_logic.sentence import Arithmetic, Comparison, Constant, Signal, Temporal, signals_of

MOST = 4  # panels of one figure
_OF_COST = ("contact_force", "tracking_error", "object_error", "torque")
_FORCE, _TORQUE = "contact_force", "torque"
# Signals behind quantities of metrics; other quantities are signals themselves, or squares of errors.
_SIGNALS = {"force_error_squared": "force_error", "torque_size": _TORQUE, "unsettled_until": "tracking_error"}
_SIGNALS |= dict.fromkeys(("contact_lost", "pull", "impact_force"), _FORCE) | dict.fromkeys(
    ("airborne", "landing"), "gap"
)
_SIGNALS |= dict.fromkeys(
    ("torque_squared", "torque_change", "wheel_torque_change", "joint_torque_change", "saturated"), _TORQUE
)
_SIGNALS |= {"persistence": "tracking_error"}
# Reductions whose limit is a level of the signal itself, and what it is a limit of.
_LIMITS = {"max": "limit", "min": "limit", "root_max": "limit", "last": "limit at the end"}
_LIMITS |= {"root_last": "limit at the end", "root_mean": "limit of the root mean square"}
_AT_ZERO = ("contact_lost", "pull", "airborne")  # quantities that count from 0 of their signal on


class Level(NamedTuple):
    """Limit of a signal over some time."""

    signal: str
    value: float  # in the signal's unit
    begin: float  # [s]
    end: float  # [s]
    label: str


def signals(requirement: Requirement | None) -> tuple[str, ...]:
    """Up to ``MOST`` signals that show how a requirement is kept or broken; of the cost if there is none."""
    if requirement is None:
        return _OF_COST
    if requirement.sentence is None:
        return (_behind(requirement.metric),)
    names = [name for name in signals_of(requirement.sentence.form) if name not in ("t", "desired_force")]
    return tuple(names[:MOST]) or (_FORCE,)


def levels(requirement: Requirement, duration: float) -> list[Level]:
    """Levels that a requirement sets to its signals, where it compares one of them with a number.

    Args:
        requirement: on a metric, or a sentence.
        duration: of the run [s].
    """
    if requirement.sentence is not None:
        found = _of_sentence(requirement.sentence.form, requirement.sentence.numbers, (0.0, 0.0))
        return [level._replace(end=min(level.end, duration)) for level in found]
    metric, name = METRICS[requirement.metric], _behind(requirement.metric)
    begin = LATE_FROM * duration if metric.window == LATE else 0.0
    if metric.quantity == "unsettled_until":
        return [Level(name, SETTLED, min(requirement.limit, duration), duration, "limit once it is settled")]
    if metric.quantity in _AT_ZERO:
        return [Level(name, 0.0, begin, duration, "contact lost" if name == _FORCE else "open")]
    label = _LIMITS.get(metric.reduction) if metric.quantity not in ("torque_squared", "persistence") else None
    return [Level(name, requirement.limit, begin, duration, label)] if label else []


def _behind(metric: str) -> str:
    """Signal of a metric's quantity."""
    quantity = METRICS[metric].quantity
    if quantity in _SIGNALS:
        return _SIGNALS[quantity]
    if quantity.startswith("metric "):
        return metric
    stem, square, _ = quantity.partition("_squared")
    if not square:
        return quantity
    kind, _, robot = stem.rpartition("_")
    return f"{kind}_error_{robot}" if robot in ("1", "2") else f"{stem}_error"


def _of_sentence(part: Any, numbers: Sequence[float], window: tuple[float, float]) -> Iterator[Level]:
    """Levels of a part, over the times at which it may be asked about: at first the run's first instant alone."""
    if isinstance(part, Comparison):
        yield from _of_comparison(part, numbers, window)
        return
    if isinstance(part, Temporal):
        end = math.inf if part.end is None else numbers[part.end]
        window = (window[0] + numbers[part.begin], window[1] + end)
    for each in part.operands:
        yield from _of_sentence(each, numbers, window)


def _of_comparison(part: Comparison, numbers: Sequence[float], window: tuple[float, float]) -> Iterator[Level]:
    for one, other in (part.operands, part.operands[::-1]):
        level = _number(other, numbers)
        if math.isnan(level):
            continue
        if isinstance(one, Signal):
            yield Level(one.name, level, *window, "limit")
        elif isinstance(one, Arithmetic) and one.operator == "abs" and isinstance(one.operands[0], Signal):
            yield from (Level(one.operands[0].name, side * level, *window, "limit") for side in (1.0, -1.0))


def _number(part: Any, numbers: Sequence[float]) -> float:
    """Value of a part that is a number, or minus one; NaN of any other."""
    if isinstance(part, Constant):
        return float(numbers[part.slot])
    if isinstance(part, Arithmetic) and part.operator == "negative":
        return -_number(part.operands[0], numbers)
    return math.nan
