"""Two cooperating mobile manipulators under robust adaptive force and motion control, in JAX.

    import coopmm_jax as cm

    trajectory = cm.simulate(cm.load_scenario("paper"))

Importing the package sets one XLA option (see ``runtime.use_small_while_loops``) and does not import JAX: the names
below are fetched when they are first used.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

from coopmm_jax import runtime

if TYPE_CHECKING:  # for editors; at run time ``__getattr__`` fetches each of them from the same place
    from coopmm_jax.animation.film import animate
    from coopmm_jax.errors import UserError
    from coopmm_jax.kinds.plugins import load_plugin
    from coopmm_jax.kinds.protocol import quantity
    from coopmm_jax.kinds.registry import register
    from coopmm_jax.plotting import overview
    from coopmm_jax.runs.simulation import simulate
    from coopmm_jax.runs.store import read_run
    from coopmm_jax.runs.trajectory import Trajectory
    from coopmm_jax.scenario.scenario import Scenario, list_scenarios, load_scenario
    from coopmm_jax.status import Status
    from coopmm_jax.sweeps.replay import replay
    from coopmm_jax.sweeps.run import sweep
    from coopmm_jax.sweeps.store import open_sweep
    from tuning.studies.compare import compare_gains as compare
    from tuning.studies.falsify import falsify
    from tuning.studies.tune import tune

__version__ = "0.3.0"
__all__ = [
    "Scenario",
    "Status",
    "Trajectory",
    "UserError",
    "animate",
    "compare",
    "falsify",
    "list_scenarios",
    "load_plugin",
    "load_scenario",
    "open_sweep",
    "overview",
    "quantity",
    "read_run",
    "register",
    "replay",
    "simulate",
    "sweep",
    "tune",
]

# No module may have the name of a function here: importing it would put the module in the function's place.
_MODULE_OF = {
    "Scenario": "scenario.scenario",
    "Status": "status",
    "Trajectory": "runs.trajectory",
    "UserError": "errors",
    "animate": "animation.film",
    "list_scenarios": "scenario.scenario",
    "load_plugin": "kinds.plugins",
    "load_scenario": "scenario.scenario",
    "open_sweep": "sweeps.store",
    "overview": "plotting",
    "quantity": "kinds.protocol",
    "read_run": "runs.store",
    "register": "kinds.registry",
    "replay": "sweeps.replay",
    "simulate": "runs.simulation",
    "sweep": "sweeps.run",
}
# Studies of the package tuning, which builds on this one: nothing here imports it before one of them is asked for.
_STUDIES = {
    "compare": ("tuning.studies.compare", "compare_gains"),
    "falsify": ("tuning.studies.falsify", "falsify"),
    "tune": ("tuning.studies.tune", "tune"),
}

runtime.use_small_while_loops()


def __getattr__(name: str) -> Any:
    if name in _STUDIES:
        module, function = _STUDIES[name]
        return getattr(import_module(module), function)
    if name not in _MODULE_OF:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_MODULE_OF[name]}"), name)


def __dir__() -> list[str]:
    return sorted([*__all__, "__version__"])
