"""Speed of the closed loop: RK4 steps per second, compile times, cost of a gradient.

    python -m experiments.benchmarks.rollout [--out results/benchmarks] [--rounds 7]

Every program is compiled first (tracing included in the time), run once to warm up, and then timed in turn with all the
others of its part, so that a machine that slows down slows them all; the table gives medians. The parts run one after
the other in processes of their own, as sweeps and tuning do, because they set other options of the compiler. "gradient"
is of a cost with respect to K_sigma (6), gamma (5), K_lambda and K_I, by reverse mode or by one forward-mode direction.
"""

from __future__ import annotations

import argparse
import csv
import statistics
import sys
import time
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from multiprocessing import get_context
from pathlib import Path
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp

from coopmm_jax import load_scenario, runtime
from coopmm_jax.loop.rollout import Observer, Plan, as_scalars, rollout
from coopmm_jax.parameters import Parameters, Structure

STEP = 1e-3
BATCH = 64  # elements: fastest here; smaller batches loop more, larger ones leave the first-level cache
GRADIENT_BATCH = 16  # the reverse pass has several times as many live values
TUNED = ("K_sigma", "gamma", "K_lambda", "K_I")


class Program(NamedTuple):
    """One compiled program and the extent of one run of it."""

    name: str
    precision: str
    elements: int  # of the batch
    steps: int
    compile_seconds: float
    temporary_megabytes: float
    run: Callable[[], Any]


def tuned_cost(structure: Structure, parameters: Parameters, steps: int, plan: Plan) -> Callable[[dict], Any]:
    """Force error and effort of one rollout as a function of the tuned gains."""
    observer = Observer(
        jnp.zeros(()),
        lambda total, t, s: total + s.force_error[0] ** 2 + 1e-3 * sum(x * x for torque in s.torque for x in torque),
    )

    def cost(gains: dict) -> Any:
        changed = parameters._replace(gains=parameters.gains._replace(**gains))
        return rollout(structure, changed, STEP, steps, plan, observer).total

    return cost


def _compiled(name: str, precision: str, elements: int, steps: int, function: Callable, *arguments: Any) -> Program:
    start = time.perf_counter()
    executable = jax.jit(function).lower(*arguments).compile()
    seconds = time.perf_counter() - start
    memory = executable.memory_analysis().temp_size_in_bytes / 1e6
    return Program(
        name, precision, elements, steps, seconds, memory, lambda: jax.block_until_ready(executable(*arguments))
    )


def _batched(tree: Any, count: int) -> Any:
    return jax.tree.map(lambda x: jnp.broadcast_to(x, (count,)), tree)


def forward_programs(precision: str) -> list[Program]:
    """One rollout of 20 s and a batch of 1 s, in the scenario ``paper``."""
    scenario = load_scenario("paper")
    structure, dtype = scenario.structure(), jnp.dtype(precision)
    parameters = as_scalars(scenario.parameters(), dtype)

    def final(parameters: Parameters, plan: Plan) -> Any:
        steps = plan.segments - 1
        return rollout(structure, parameters, STEP, steps, plan).state

    def batch(parameters: Parameters) -> Any:
        return jax.vmap(lambda p: final(p, Plan.batch(1000)))(parameters)

    return [
        _compiled("one rollout", precision, 1, 20000, lambda p: final(p, Plan.alone(20000)), parameters),
        _compiled("batch, one thread", precision, BATCH, 1000, batch, _batched(parameters, BATCH)),
    ]


def on_two_threads(program: Program) -> Program:
    """Same executable on two batches at once, as sweeps run it."""
    pool = ThreadPoolExecutor(2)
    return program._replace(
        name="batch, two threads",
        elements=2 * program.elements,
        compile_seconds=0.0,
        run=lambda: list(pool.map(lambda _: program.run(), range(2))),
    )


def gradient_programs() -> list[Program]:
    """Cost, reverse-mode gradient and one forward-mode direction, of one rollout and of a batch, over 4 s.

    Each in the form that is fastest for it; the gradient with all steps kept, and with checkpoints.
    """
    scenario = load_scenario("paper", law={"delta_floor": 0.01})
    structure, steps = scenario.structure(), 4000
    parameters = as_scalars(scenario.parameters(), jnp.float64)
    gains = {name: getattr(parameters.gains, name) for name in TUNED}
    scalars, kept = Plan.batch(steps), Plan.gradient(steps, steps + 1, checkpoint=False)
    checkpoints = Plan.gradient(steps)

    def cost(plan: Plan) -> Callable:
        return lambda gains, parameters: tuned_cost(structure, parameters, steps, plan)(gains)

    def mean(plan: Plan) -> Callable:
        return lambda gains, parameters: jax.vmap(lambda p: cost(plan)(gains, p))(parameters).mean()

    def along(gains: dict, parameters: Parameters) -> Any:
        return jax.jvp(lambda g: cost(kept)(g, parameters), (gains,), (gains,))

    alone, batch = ("float64", 1, steps), ("float64", GRADIENT_BATCH, steps)
    many = _batched(parameters, GRADIENT_BATCH)
    return [
        _compiled("cost", *alone, cost(kept), gains, parameters),
        _compiled("cost, one direction", *alone, along, gains, parameters),
        _compiled("gradient", *alone, jax.value_and_grad(cost(kept)), gains, parameters),
        _compiled("gradient, checkpoints", *alone, jax.value_and_grad(cost(checkpoints)), gains, parameters),
        _compiled("cost, batch", *batch, mean(scalars), gains, many),
        _compiled("gradient, batch", *batch, jax.value_and_grad(mean(checkpoints)), gains, many),
    ]


def measure(programs: Sequence[Program], rounds: int) -> list[dict[str, Any]]:
    """Median seconds of each program over ``rounds`` rounds, each round running all of them once."""
    for program in programs:
        program.run()
    seconds: list[list[float]] = [[] for _ in programs]
    for _ in range(rounds):
        for program, times in zip(programs, seconds, strict=True):
            start = time.perf_counter()
            program.run()
            times.append(time.perf_counter() - start)
    return [
        {
            "program": program.name,
            "precision": program.precision,
            "rollouts": program.elements,
            "steps": program.steps,
            "compile [s]": round(program.compile_seconds, 1),
            "temporary [MB]": round(program.temporary_megabytes, 2),
            "run [s]": round(statistics.median(times), 5),
            "steps per second": round(program.elements * program.steps / statistics.median(times)),
        }
        for program, times in zip(programs, seconds, strict=True)
    ]


def all_forward_programs() -> list[Program]:
    """Rollouts in both precisions; float32 is traced outside the float64 context."""
    with jax.enable_x64(True):
        double = forward_programs("float64")
    with jax.enable_x64(False):
        single = forward_programs("float32")
    return [*double, on_two_threads(double[1]), *single, on_two_threads(single[1])]


def all_gradient_programs() -> list[Program]:
    """Cost and gradients in float64."""
    with jax.enable_x64(True):
        return gradient_programs()


PARTS = {  # programs, and True for the compiler's options for batches
    "forward": (all_forward_programs, True),
    "gradients": (all_gradient_programs, False),
}


def measure_part(name: str, rounds: int) -> list[dict[str, Any]]:
    """Rows of one of ``PARTS``."""
    programs, _ = PARTS[name]
    return measure(programs(), rounds)


def apart(batches: bool, function: Callable, *arguments: Any) -> Any:
    """Result of ``function(*arguments)`` in a new process with fast compilation, for ``batches`` or not."""
    with ProcessPoolExecutor(1, get_context("spawn"), runtime.use_fast_compilation, (batches,)) as pool:
        return pool.submit(function, *arguments).result()


def ratios(rows: Sequence[dict[str, Any]]) -> dict[str, float]:
    """Times of gradients over those of cost evaluations (scalars), alone and in a batch."""
    run = {row["program"]: row["run [s]"] for row in rows if row["precision"] == "float64"}
    return {
        "gradient / cost": run["gradient"] / run["cost"],
        "gradient / cost, checkpoints": run["gradient, checkpoints"] / run["cost"],
        "one forward direction / cost": run["cost, one direction"] / run["cost"],
        "gradient / cost, batch": run["gradient, batch"] / run["cost, batch"],
    }


def main(argv: Sequence[str] | None = None) -> int:
    """Measure, print the table, write ``rollout.csv``."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=Path("results/benchmarks"))
    parser.add_argument("--rounds", type=int, default=7)
    options = parser.parse_args(argv)
    rows = [row for name, (_, batches) in PARTS.items() for row in apart(batches, measure_part, name, options.rounds)]
    print_table(rows)
    for name, value in ratios(rows).items():
        print(f"{name}: {value:.1f}")
    options.out.mkdir(parents=True, exist_ok=True)
    with (options.out / "rollout.csv").open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, rows[0])
        writer.writeheader()
        writer.writerows(rows)
    return 0


def print_table(rows: Sequence[dict[str, Any]]) -> None:
    """Rows as aligned columns."""
    widths = {key: max(len(key), *(len(f"{row[key]}") for row in rows)) for key in rows[0]}
    print("  ".join(f"{key:>{width}}" for key, width in widths.items()))
    for row in rows:
        print("  ".join(f"{row[key]!s:>{width}}" for key, width in widths.items()))


if __name__ == "__main__":
    sys.exit(main())
