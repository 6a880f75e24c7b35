"""Correctness of the gradient over the whole of a long run: reverse mode against central differences.

    python -m experiments.benchmarks.gradients [--duration 20] [--controllers robust_adaptive pid] [--out FOLDER]

Cost of ``sensed`` over 20 s, differentiated by each gain that can be tuned, its entries moved as one, under the paper's
controller or others. The differences are of fourth order at several steps: small ones show rounding, large ones
curvature, and the best of them counts. Writes gradients.csv.
"""

from __future__ import annotations

import argparse
import csv
import sys
from collections.abc import Sequence
from pathlib import Path

import jax
import numpy as np

from coopmm_jax import runtime
from coopmm_jax.kinds.controllers import DEFAULT, controller
from coopmm_jax.scenario.scenario import load_scenario
from tuning.cost import evaluate
from tuning.cost.problem import build_problem
from tuning.cost.robust_cost import RobustCost

LIMIT = 1e-6  # relative, of each gain's derivative
STEPS = (3e-3, 1e-3, 3e-4, 1e-4, 3e-5)  # the last for delta_floor: the cost has a bend at each sample that it covers
# of a derivative by four evaluations at -2, -1, 1 and 2 steps
OFFSETS, WEIGHTS = np.array([-2.0, -1.0, 1.0, 2.0]), np.array([1.0, -8.0, 8.0, -1.0]) / 12.0


def main(argv: Sequence[str] | None = None) -> int:
    """Compare; exit code 0 if every derivative is within the limit, else 1."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--duration", type=float, default=20.0, help="of the rollout [s] (%(default)g)")
    parser.add_argument("--out", type=Path, default=Path("results/benchmarks"), help="folder for gradients.csv")
    parser.add_argument("--controllers", nargs="+", default=[DEFAULT], help="whose gains (%(default)s)")
    options = parser.parse_args(argv)
    runtime.use_fast_compilation()
    jax.config.update("jax_enable_x64", True)
    found = []
    for name in options.controllers:
        rows = compared(name, options.duration)
        print(name)
        for gain, derivative, error in rows:
            print(f"  {gain:12} {derivative:14.6g}   {error:.1e}", flush=True)
        found += [(name, *row) for row in rows]
    options.out.mkdir(parents=True, exist_ok=True)
    with (options.out / "gradients.csv").open("w", newline="", encoding="utf-8") as file:
        csv.writer(file).writerows([("controller", "gain", "derivative", "relative_error"), *found])
    worst = max(error for *_, error in found)
    print(f"largest relative error {worst:.1e}, to be at most {LIMIT:g}")
    return int(worst > LIMIT)


def compared(name: str, duration: float) -> list[tuple[str, float, float]]:
    """Gain, derivative and its relative error, for every gain of a controller.

    Args:
        name: of the controller.
        duration: of the rollout [s].
    """
    cost, names, samples = _problem(name, duration)
    start = cost.objective.space.start
    reverse = _reverse(cost, start, samples)
    central = np.stack([_differences(cost, start, samples, step) for step in STEPS])
    errors = np.min(np.abs(central / reverse - 1.0), axis=0)
    return list(zip(names, reverse, errors, strict=True))


def _problem(name: str, duration: float) -> tuple[RobustCost, tuple[str, ...], evaluate.Samples]:
    """Cost over the whole run, gains, and one sample."""
    tuned = [gain for gain in controller(name).made._fields if gain != "k4"]  # which differential drives do without
    settings = {"gains": tuned, "channels": "shared"}
    settings |= {"tracking_from": 0.0, "validation_samples": 1}
    changes = {"simulation": {"duration": duration}, "tuning": settings}
    problem = build_problem(load_scenario("sensed", law={"controller": name}, **changes))
    return problem.cost, problem.space.names, problem.samples(0, 1)


def _reverse(cost: RobustCost, start: np.ndarray, samples: evaluate.Samples) -> np.ndarray:
    """Derivative by every number (n,), by reverse mode."""
    return evaluate.gradients(cost.objective, start[None], samples, cost.coefficients)[1][0, 0]


def _differences(cost: RobustCost, start: np.ndarray, samples: evaluate.Samples, step: float) -> np.ndarray:
    """Derivative by every number (n,), by differences."""
    moved = start + step * (OFFSETS[:, None, None] * np.eye(start.size)).reshape(-1, start.size)
    costs = cost.values(moved, samples).reshape(len(OFFSETS), start.size)
    return WEIGHTS @ costs / step


if __name__ == "__main__":
    sys.exit(main())
