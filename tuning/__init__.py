"""Gain tuning through the simulator. Imports coopmm_jax and is not imported by it.

    tuning.tune("sensed")                       # all of it: search, choose, measure
    problem = tuning.build_problem("sensed")    # the cost alone, for an optimiser of your own: see cost/problem.py

Importing the package does not import JAX: the names below are fetched when they are first used.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from tuning.cost.problem import Problem, build_problem
    from tuning.studies.result import TuningResult, report
    from tuning.studies.tune import tune

_PLACES = {
    "Problem": "cost.problem",
    "TuningResult": "studies.result",
    "build_problem": "cost.problem",
    "report": "studies.result",
    "tune": "studies.tune",
}
__all__ = ["Problem", "TuningResult", "build_problem", "report", "tune"]


def __getattr__(name: str) -> Any:
    if name not in _PLACES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"tuning.{_PLACES[name]}"), name)
