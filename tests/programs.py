"""Rollouts compiled once and shared by many tests: compiling takes seconds, running a tenth of one."""

from typing import NamedTuple

import jax
import numpy as np

from coopmm_jax.loop.health import Health
from coopmm_jax.loop.rollout import Plan, rollout
from coopmm_jax.loop.state import Signals, State


class Run(NamedTuple):
    """A rollout on NumPy arrays: its end, and t and signals at each sample up to the horizon."""

    state: State
    health: Health
    t: np.ndarray  # (steps + 1,)
    signals: Signals  # every leaf (steps + 1,)


class Program:
    """The rollout of one structure for any parameters, step and horizon; takes time for ``room`` steps in any case.

    Compiled in a third of the time that the command line's options take, to code that is a third as fast.
    """

    STEPS = 20_000  # the paper's 20 s at 1 ms

    def __init__(self, structure, room=STEPS):
        def run(parameters, step, steps):
            self.traces += 1
            return rollout(structure, parameters, step, steps, Plan.alone(room), record=True)

        self.room = room
        self.traces = 0  # how often JAX has traced the rollout: once per compilation
        self._run = jax.jit(run)

    def __call__(self, parameters, step=1e-3, steps=None):
        steps = self.room if steps is None else steps
        result = jax.device_get(self._run(parameters, step, steps))
        t, signals = jax.tree.map(lambda x: x[: steps + 1], result.record)
        return Run(result.state, result.health, t, signals)
