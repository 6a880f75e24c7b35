"""CPU time of a simulated second: the sampled loop against the continuous one, and each part of the real loop.

    python -m experiments.benchmarks.loops [--out results/benchmarks] [--rounds 9]

All programs are compiled and run once, and then timed in turn in the process's own CPU time, so that neither a busy
machine nor one that slows down favours one of them; the table gives medians. "operations" are the jaxpr's scalar
equations of one simulated millisecond, loops unrolled: a measure, free of noise, of the work that XLA is given.
"""

from __future__ import annotations

import argparse
import csv
import functools
import statistics
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from coopmm_jax import runtime

if __name__ == "__main__":
    runtime.use_fast_compilation()

import jax
import jax.numpy as jnp

from coopmm_jax import load_scenario
from coopmm_jax.loop.rollout import Plan, as_scalars, rollout
from coopmm_jax.scenario.scenario import Scenario
from experiments.benchmarks.rollout import print_table

DURATIONS = {1: 20.0, 64: 1.0}  # elements of a batch -> simulated time [s]
IDEAL = "continuous, ideal"
CONTINUOUS = {"loop.control_period": 0.0}


def loops() -> dict[str, Scenario]:
    """Loops that are compared, all with RK4 steps of 1 ms."""
    paper, sensed = load_scenario("paper"), load_scenario("sensed")
    return {
        IDEAL: paper,
        "sampled at 1 kHz, ideal": paper.with_overrides({"loop.control_period": 1e-3}),
        "sampled at 250 Hz, ideal": paper.with_overrides({"loop.control_period": 4e-3}),
        "continuous, sensed": sensed.with_overrides(CONTINUOUS),
        "sensed": sensed,
        "free": load_scenario("free"),
        "rough": load_scenario("rough"),
    }


class Program(NamedTuple):
    """One compiled loop and the extent of one run of it."""

    loop: str
    elements: int  # of the batch
    seconds: float  # simulated, by each element
    operations: float  # of one element in a simulated millisecond
    run: Callable[[], Any]


def compiled(loop: str, scenario: Scenario, elements: int) -> Program:
    """Loop for a batch of ``elements`` rollouts, compiled."""
    structure, step, seconds = scenario.structure(), scenario.sample_time, DURATIONS[elements]
    steps = round(seconds / step)
    parameters = as_scalars(scenario.parameters(), jnp.float64)

    plan = Plan.alone(steps) if elements == 1 else Plan.batch(steps)

    def final(parameters: Any, steps: Any) -> Any:
        return rollout(structure, parameters, step, steps, plan).state

    def advanced(parameters: Any, count: int) -> Any:
        return rollout(structure, parameters, step, count - 1, Plan(1, count)).state

    # Of two horizons, so that the start's own operations drop out.
    one, two = (operations(functools.partial(advanced, count=n), parameters) for n in (1, 2))
    batched = final if elements == 1 else jax.vmap(final, in_axes=(0, None))
    arguments = parameters if elements == 1 else jax.tree.map(lambda x: jnp.full(elements, x), parameters)
    executable = jax.jit(batched).lower(arguments, steps).compile()
    return Program(
        loop, elements, seconds, 1e-3 / step * (two - one), lambda: jax.block_until_ready(executable(arguments, steps))
    )


def operations(function: Callable, *arguments: Any) -> int:
    """Number of scalar equations of a function's jaxpr, each counted as often as its loops run it."""

    def count(jaxpr: Any) -> int:
        total = 0
        for equation in jaxpr.eqns:
            values = [x for value in equation.params.values() for x in (value if type(value) is tuple else (value,))]
            inner = [count(x) for x in values if hasattr(x, "eqns")]
            total += equation.params.get("length", 1) * sum(inner) if inner else 1
        return total

    return count(jax.make_jaxpr(function)(*arguments).jaxpr)


def measure(programs: Sequence[Program], rounds: int) -> list[dict[str, Any]]:
    """Median CPU seconds of each program over rounds that run all of them once; ratios to the ideal continuous loop."""
    for program in programs:
        program.run()
    times: list[list[float]] = [[] for _ in programs]
    for _ in range(rounds):
        for program, own in zip(programs, times, strict=True):
            start = time.process_time()
            program.run()
            own.append((time.process_time() - start) / (program.elements * program.seconds))
    cost = {(p.loop, p.elements): statistics.median(own) for p, own in zip(programs, times, strict=True)}
    return [
        {
            "loop": program.loop,
            "rollouts": program.elements,
            "CPU ms per simulated s": round(1e3 * cost[program.loop, program.elements], 4),
            "ratio": round(cost[program.loop, program.elements] / cost[IDEAL, program.elements], 3),
            "operations": round(program.operations),
        }
        for program in programs
    ]


def main(argv: Sequence[str] | None = None) -> int:
    """Measure, print the table, write ``loops.csv``."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=Path("results/benchmarks"))
    parser.add_argument("--rounds", type=int, default=9)
    options = parser.parse_args(argv)
    with jax.enable_x64(True):
        programs = [compiled(name, scenario, elements) for elements in DURATIONS for name, scenario in loops().items()]
        rows = measure(programs, options.rounds)
    print_table(rows)
    options.out.mkdir(parents=True, exist_ok=True)
    with (options.out / "loops.csv").open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, rows[0])
        writer.writeheader()
        writer.writerows(rows)
    return 0


if __name__ == "__main__":
    sys.exit(main())
