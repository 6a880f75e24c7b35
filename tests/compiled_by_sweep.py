"""A few steps of 64 robots, compiled with the options that ``coopmm sweep`` sets; run by test_sweep.py.

python -m tests.compiled_by_sweep FILE
"""

import os
import sys

import jax
import jax.numpy as jnp
import numpy as np

from coopmm_jax.cli import main as coopmm
from coopmm_jax.loop.closed_loop import closed_loop
from coopmm_jax.loop.integrate import rk4_step
from coopmm_jax.mechanics.model import build_model
from coopmm_jax.parameters import Parameters, Structure
from coopmm_jax.sweeps import run
from tests.samples import random_states

ROBOTS, STEPS, STEP = 64, 20, 1e-3


def moved():
    """Numbers of the states (n, 64) after the steps, without the start and the metrics of a sweep's own program."""
    _, states = random_states(np.random.default_rng(0), ROBOTS, at=0.0)
    model = build_model(Parameters())

    def advance(state, t):
        return rk4_step(lambda t, state: closed_loop(Structure(), model, t, state), t, STEP, state)[0], None

    with jax.enable_x64(True):
        times = jnp.asarray(STEP * np.arange(STEPS))
        end, _ = jax.jit(jax.vmap(lambda state: jax.lax.scan(advance, state, times)))(states)
        return np.stack(jax.tree.leaves(end))


def main():
    """In the place of the sweep, when the command has set its options, which it does in a process of its own."""
    file = sys.argv[1]

    def sweep(*_, **__):
        np.savez(file, moved=moved(), options=os.environ["XLA_FLAGS"])
        sys.exit()

    run.sweep = sweep
    sys.argv[1:] = ["sweep", "uncertain"]
    coopmm()


if __name__ == "__main__":
    main()
