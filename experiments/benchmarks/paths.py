"""Speed along a path against the speed on the paper's circle: one rollout, a batch, a gradient; compile times.

    python -m experiments.benchmarks.paths [--rounds 7]

All programs are compiled first, run once to warm up, and then timed in turn in the process's own CPU time, so that
neither a busy machine nor one that slows down favours one of them; the table gives medians, and their ratio to the
circle's.
"""

from __future__ import annotations

import argparse
import statistics
import sys
import time
from collections.abc import Callable, Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from coopmm_jax import load_scenario, runtime
from coopmm_jax.loop.rollout import Observer, Plan, as_scalars, rollout
from coopmm_jax.parameters import Parameters, Structure
from coopmm_jax.scenario.scenario import Scenario
from coopmm_jax.sweeps.measure import Horizon, measure

STEP, ALONE, BATCHED, GRADIENT = 1e-3, 20000, 1000, 4000  # [s], steps
BATCH = 64


def scenarios() -> dict[str, Scenario]:
    """The circle and two paths under the continuous, ideal law of ``paper_full``."""
    ideal = ("law", "reference", "initial")
    found = {"circle": load_scenario("paper_full", law={"delta_floor": 0.1})}
    for name in ("ellipse", "eight"):
        tables = load_scenario(name).model_dump(exclude_none=True)
        found[name] = load_scenario("paper_full", **{section: tables[section] for section in ideal})
    return found


def _programs(scenario: Scenario) -> dict[str, tuple[float, Callable[[], Any]]]:
    """Seconds of CPU time to compile, and one run, of each program by name."""
    structure, parameters = scenario.structure(), as_scalars(scenario.parameters(), jnp.float64)
    force = Observer(jnp.zeros(()), lambda total, t, s: total + s.force_error[0] ** 2)

    def cost(parameters: Parameters, plan: Plan, steps: int) -> Any:
        return rollout(structure, parameters, STEP, steps, plan, force).total

    def by_gains(gains: Any) -> Any:
        return cost(parameters._replace(gains=gains), Plan.gradient(GRADIENT), GRADIENT)

    return {
        "one rollout": _compiled(lambda p: cost(p, Plan.alone(ALONE), ALONE), parameters),
        "gradient": _compiled(jax.value_and_grad(by_gains), parameters.gains),
        "batch of a sweep": _swept(structure, scenario),
    }


def _compiled(function: Callable, argument: Any) -> tuple[float, Callable[[], Any]]:
    """Seconds of CPU time to compile a function, and its run."""
    start = time.process_time()
    executable = jax.jit(function).lower(argument).compile()
    return time.process_time() - start, lambda: jax.block_until_ready(executable(argument))


def _swept(structure: Structure, scenario: Scenario) -> tuple[float, Callable[[], Any]]:
    """Seconds of CPU time until the first batch of a sweep has run, and one batch of 1 s."""
    from coopmm_jax.scenario.variation import vary

    masses = {"distribution": "uniform", "low": 0.8, "high": 1.2, "relative": True}
    varied = vary(scenario.with_overrides({"uncertainty": {"plant.masses": masses}}))
    batch = varied.batch(np.full((BATCH, len(varied.draws)), 0.5), range(BATCH))
    horizon = Horizon(STEP, BATCHED, "float64")

    def run() -> Any:
        return measure(structure, horizon, jax.devices()[0], batch)

    start = time.process_time()
    run()
    return time.process_time() - start, run


def main(arguments: Sequence[str] | None = None) -> int:
    """Print the table."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--rounds", type=int, default=7, help="runs of each program (default 7)")
    rounds = parser.parse_args(arguments).rounds
    runtime.use_fast_compilation(batches=True)
    with jax.enable_x64(True):
        made = {name: _programs(scenario) for name, scenario in scenarios().items()}
        times: dict[tuple[str, str], list[float]] = {}
        for _ in range(rounds + 1):
            for name, each in made.items():
                for program, (_, run) in each.items():
                    start = time.process_time()
                    run()
                    times.setdefault((name, program), []).append(time.process_time() - start)
    median = {key: statistics.median(values[1:]) for key, values in times.items()}
    print(f"{'program':18} {'path':8} {'compile [s]':>11} {'ratio':>6} {'run [s]':>8} {'ratio':>6}")
    for name, each in made.items():
        for program, (seconds, _) in each.items():
            circle = made["circle"][program][0], median["circle", program]
            run = median[name, program]
            ratios = f"{seconds:11.2f} {seconds / circle[0]:6.2f} {run:8.4f} {run / circle[1]:6.2f}"
            print(f"{program:18} {name:8} {ratios}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
