"""Two cooperating mobile manipulators under robust adaptive force and motion control, in JAX.

    import coopmm_jax as cm

    trajectory = cm.simulate(cm.load_scenario("paper"))

Importing the package sets one XLA option (see ``runtime.use_small_while_loops``) and does not import JAX: the names
below are fetched when they are first used.
"""

from __future__ import annotations

from importlib import import_module
from typing import Any

from coopmm_jax import runtime

__version__ = "0.2.0"

# No module may have the name of a function here: importing it would put the module in the function's place.
_MODULE_OF = {
    "Scenario": "scenario.scenario",
    "Status": "status",
    "Trajectory": "runs.trajectory",
    "UserError": "errors",
    "animate": "animation.film",
    "list_scenarios": "scenario.scenario",
    "load_scenario": "scenario.scenario",
    "read_run": "runs.store",
    "replay": "sweeps.replay",
    "simulate": "runs.simulation",
    "sweep": "sweeps.run",
}
__all__ = list(_MODULE_OF)

runtime.use_small_while_loops()


def __getattr__(name: str) -> Any:
    if name not in _MODULE_OF:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_MODULE_OF[name]}"), name)


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
