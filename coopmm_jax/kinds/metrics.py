"""Metrics as kinds: the protocol that built-in metrics (``metrics/table.py``) and those of plugins follow."""

from __future__ import annotations

from coopmm_jax.kinds.protocol import Attribute, Group, Kind, Method
from coopmm_jax.kinds.registry import declare, known

WHOLE, LATE = "whole", "late"
# How a quantity of all samples becomes one number; ``metrics/observer.py`` computes them.
REDUCTIONS = (
    *("max", "min", "mean", "time", "root_mean", "root_max", "root_last", "last"),
    *("variation", "count", "time_if_complete"),
)

declare(
    Group(
        "metric",
        "a number that says how good a rollout was",
        (Method("quantity", ("sample",), "what is reduced along the rollout, a number", 0.0),),
        (
            Attribute("unit", "of the metric, as text", str),
            Attribute("meaning", "of the metric, in a few words", str),
            Attribute("reduction", "how the quantity of all samples becomes one number", REDUCTIONS),
            Attribute("window", "the samples that count: all, or those of the last quarter", (WHOLE, LATE), WHOLE),
            Attribute("low_is_bad", "whether the smallest value is the worst", bool, False),
            Attribute("shown", "whether it is among those that commands print", bool, True),
        ),
    )
)


def of_plugins() -> dict[str, Kind]:
    """Metrics that plugins have registered, by name."""
    return {name: kind for name, kind in known("metric").items() if kind.plugin}
