"""Stand-in for ``coopmm_jax.simulate``, which compiles; as a program, the command line around it."""

import sys
from types import SimpleNamespace

import numpy as np

import coopmm_jax
from coopmm_jax.metrics.table import METRICS


class StandIn:
    """Remembers the scenario, returns a short trajectory."""

    def __init__(self):
        self.scenario = None
        self.outcome = {"status": SimpleNamespace(name="OK", message="completed"), "ok": True, "status_time": None}

    def __call__(self, scenario):
        self.scenario = scenario
        arrays = {"t": np.arange(3.0), "torque": np.ones((3, 2, 5))}
        metrics = dict.fromkeys(METRICS, 0.25) | {"settling_time": float("nan")}
        return SimpleNamespace(**arrays, arrays=tuple(arrays), metrics=metrics, scenario=scenario, **self.outcome)


if __name__ == "__main__":
    from coopmm_jax.cli import main

    coopmm_jax.simulate = StandIn()
    sys.modules["coopmm_jax.plotting"] = SimpleNamespace(style=SimpleNamespace(publish=lambda *_: None))
    sys.exit(main())
