"""Gain tuning through the simulator: ``tuning.tune(scenario)``. Imports coopmm_jax and is not imported by it."""

from tuning.tune import TuningResult, tune

__all__ = ["TuningResult", "tune"]
