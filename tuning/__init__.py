"""Gain tuning through the simulator: ``tuning.tune(scenario)``. Imports coopmm_jax and is not imported by it.

Importing the package does not import JAX: the names below are fetched when they are first used.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from tuning.studies.tune import TuningResult, tune

__all__ = ["TuningResult", "tune"]


def __getattr__(name: str) -> Any:
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module("tuning.studies.tune"), name)


def __dir__() -> list[str]:
    return __all__
