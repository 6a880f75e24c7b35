"""Throughput of large batches of rollouts on whatever device JAX finds: a GPU, or this machine's processor.

    python -m experiments.benchmarks.accelerator [--batches 16384 131072] [--steps 200] [--metrics]

Every element has a gain of its own, so nothing is computed once for all. Times are medians of three runs after one to
warm up; the number that is printed tells whether another device computes the same.

With ``--metrics`` it is a sweep's batches: all parameters are the elements' own, all metrics are gathered, and numbers
go to the device and come back, which is a tenth of the time at 2,000 steps. Without that tenth one H100 takes, in
float64, for a step (JAX 0.11.2):

    rollouts              1,024   4,096  16,384  65,536  131,072
    sensed      [ms]      0.221   0.237   0.278   0.599    1.172
                [M/s]       4.6    17.3    59.0   109.4    111.8
    paper_full  [ms]              0.529   0.694            1.895
                [M/s]               7.7    23.6             69.2
"""

from __future__ import annotations

import argparse
import statistics
import sys
import time
from collections.abc import Callable, Sequence
from typing import Any

from coopmm_jax import runtime

if __name__ == "__main__":
    runtime.use_fast_compilation(batches=True)

import jax
import jax.numpy as jnp
import numpy as np

import coopmm_jax as cm
from coopmm_jax.algebra.types import Scalar
from coopmm_jax.loop.rollout import Plan, rollout
from coopmm_jax.metrics.table import METRICS
from coopmm_jax.parameters import Parameters
from coopmm_jax.scenario.scenario import Scenario
from coopmm_jax.scenario.variation import vary
from coopmm_jax.sweeps.measure import Horizon, Measured, measure

MASSES = {"distribution": "uniform", "low": 0.8, "high": 1.2, "relative": True}
ROUNDS = 3


def main(argv: Sequence[str] | None = None) -> int:
    """Print one line for each scenario, precision and batch."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--batches", nargs="+", type=int, default=[16384, 131072], help="rollouts in a batch")
    parser.add_argument("--steps", type=int, default=200, help="of each rollout")
    parser.add_argument("--scenarios", nargs="+", default=["paper_full", "sensed"])
    parser.add_argument("--metrics", action="store_true", help="of a sweep: all metrics, parameters of each rollout")
    parser.add_argument("--precisions", nargs="+", choices=("float64", "float32"), default=["float64", "float32"])
    options = parser.parse_args(argv)
    print(f"JAX {jax.__version__} on {jax.devices()[0].device_kind}")
    with jax.enable_x64(True):
        for name in options.scenarios:
            for precision in options.precisions:
                for size in options.batches:
                    kind = swept if options.metrics else measured
                    print(kind(name, precision, size, options.steps), flush=True)
    return 0


def measured(name: str, precision: str, size: int, steps: int) -> str:
    """Compilation time, throughput and one result of a batch of rollouts, in words.

    Args:
        name: of the scenario.
        precision: of all numbers.
        size: elements of the batch.
        steps: samples of each rollout.
    """
    scenario = cm.load_scenario(name)
    parameters = jax.tree.map(lambda x: jnp.asarray(x, precision), scenario.parameters())
    factors = jnp.linspace(0.9, 1.1, size, dtype=precision)
    began = time.perf_counter()
    compiled = jax.jit(jax.vmap(_last(scenario, steps), in_axes=(0, None))).lower(factors, parameters).compile()
    compiling = time.perf_counter() - began
    first = np.asarray(compiled(factors, parameters))[0]
    seconds = statistics.median(_seconds(lambda: compiled(factors, parameters)) for _ in range(ROUNDS))
    rate = size * steps * max(scenario.structure().substeps, 1) / seconds
    return _told(name, precision, size, compiling, rate, f"z2 {first:.12f}")


def swept(name: str, precision: str, size: int, steps: int) -> str:
    """The same of a sweep's batch, arguments as ``measured``."""
    simulation = {"precision": precision, "duration": steps * cm.load_scenario(name).sample_time}
    scenario = cm.load_scenario(name, simulation=simulation, uncertainty={"plant.masses": MASSES})
    variation = vary(scenario)
    points = np.repeat(np.linspace(0.1, 0.9, size)[:, None], len(variation.draws), axis=1)
    parameters = variation.batch(points, range(size))
    horizon = Horizon(scenario.sample_time, scenario.steps, precision)

    def run() -> Measured:
        return measure(variation.structure(), horizon, jax.devices()[0], parameters)

    began = time.perf_counter()
    first = run().metrics[0, list(METRICS).index("torque_rms")]
    compiling = time.perf_counter() - began
    seconds = statistics.median(_seconds(run) for _ in range(ROUNDS))
    rate = size * steps * max(scenario.structure().substeps, 1) / seconds
    return _told(name, precision, size, compiling - seconds, rate, f"torque_rms {first:.12f}")


def _told(name: str, precision: str, size: int, compiling: float, rate: float, result: str) -> str:
    label = f"{name:12} {precision} {size:8} rollouts"
    return f"{label}  compiled in {compiling:5.1f} s  {rate / 1e6:8.2f} M steps/s  {result}"


def _last(scenario: Scenario, steps: int) -> Callable[[jax.Array, Parameters], Scalar]:
    """Last z2 of robot I [m] as a function of a factor on k1."""

    def last(factor: jax.Array, parameters: Parameters) -> Scalar:
        gains = parameters.gains._replace(k1=factor * parameters.gains.k1)
        run = rollout(
            scenario.structure(), parameters._replace(gains=gains), scenario.sample_time, steps, Plan.batch(steps)
        )
        return run.state.position[0].z2

    return last


def _seconds(run: Callable[[], Any]) -> float:
    began = time.perf_counter()
    jax.block_until_ready(run())
    return time.perf_counter() - began


if __name__ == "__main__":
    sys.exit(main())
