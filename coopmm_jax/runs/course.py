"""Signals of one run at every sample, under the names that sentences call them by, for figures of requirements.

>>> from coopmm_jax.scenario.scenario import load_scenario
>>> found = course(load_scenario("paper", simulation={"duration": 0.01}), ["contact_force"])
>>> len(found.t) == len(found.values["contact_force"]) == 11
True
"""

from __future__ import annotations

import functools
from collections.abc import Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from coopmm_jax.algebra.types import Scalar
from coopmm_jax.loop.health import Health
from coopmm_jax.loop.rollout import Plan, rollout
from coopmm_jax.metrics import observer, watching
from coopmm_jax.metrics.table import WHOLE, registered
from coopmm_jax.parameters import Parameters, Structure
from coopmm_jax.scenario.scenario import Scenario
from coopmm_jax.status import Status
from coopmm_jax.temporal_logic.grammar import read
from coopmm_jax.temporal_logic.sentence import Formula, Numbers, Sentences


class Course(NamedTuple):
    """Some signals along a run, up to its end or its failure."""

    t: np.ndarray  # (T,) [s]
    values: dict[str, np.ndarray]  # (T,) by name
    status: Status


def course(scenario: Scenario, names: Sequence[str]) -> Course:
    """Signals of a scenario's run, without its uncertainty.

    Args:
        scenario: that is run; one compiled program serves all of a structure.
        names: of signals, as ``temporal_logic.signals.SIGNALS`` has them.
    """
    forms = tuple((name, read(f"always {name} >= 0").form) for name in names)
    plan = Plan.alone(scenario.steps)
    with jax.enable_x64(scenario.simulation.precision == "float64"):
        outcome = _compiled(
            scenario.structure(),
            plan,
            (registered(), forms),
            scenario.parameters(),
            scenario.sample_time,
            scenario.steps,
        )
        values, health = jax.device_get(outcome)
    status = Status(int(health.status))
    count = int(health.step) if status is not Status.OK else scenario.steps + 1
    cut = {name: np.asarray(values[name], float)[:count] for name in names}
    return Course(np.arange(count) * scenario.sample_time, cut, status)


@functools.partial(jax.jit, static_argnames=("structure", "plan", "kinds_and_forms"))
def _compiled(
    structure: Structure,
    plan: Plan,
    kinds_and_forms: tuple[tuple[tuple[str, type], ...], tuple[tuple[str, Formula], ...]],
    parameters: Parameters,
    step: Scalar,
    steps: Scalar,
) -> tuple[dict[str, Any], Health]:
    """Signals (N,) of the room of a plan, and the run's health."""
    forms = kinds_and_forms[1]
    sentences = Sentences(forms, tuple(Numbers((), 1.0) for _ in forms))
    horizon = {"duration": steps * step, "step": step, "sentences": sentences}
    gather = observer.observer(structure, parameters, **horizon, smoothly=True, names=())
    result = rollout(structure, parameters, step, steps, plan, gather)
    count = result.total.samples[WHOLE]
    ran = watching.Ran(structure, parameters, step, count, jnp.ones_like(count), count > 0)
    return watching.signals_kept(result.total.watching, result.kept, ran), result.health
