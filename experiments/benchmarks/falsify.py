"""Test of ``falsify``: a sample at least as bad as the worst of 4,096 random ones, in a tenth of their rollouts.

    python -m experiments.benchmarks.falsify [--out results/benchmarks] [--samples 4096] [--seeds 5] [--requirement]

On ``sensed`` with its own two uncertain numbers, and with 27 of them. Climbed is the cost or, with ``--requirement``,
against a sentence on the contact force: a found sample is then as bad if its robustness is no larger. A seed decides
the random samples, the starts of the climbs and the samples that scale the cost. Rollouts of a gradient count as
simulated, and all take 3 s.
"""

from __future__ import annotations

import argparse
import csv
import sys
import time
from pathlib import Path
from typing import Any, NamedTuple

from coopmm_jax import runtime

if __name__ == "__main__":
    runtime.use_fast_compilation()
    runtime.use_compilation_cache()

from coopmm_jax.scenario.scenario import Scenario, load_scenario
from tuning.cost.objective import FAILED
from tuning.cost.problem import build_problem, unscaled
from tuning.studies.falsify import falsify, random_costs, requirement_of

HORIZON = 3.0  # [s]
NAME, PRESSES = "presses", "always[0.5, inf] contact_force >= 5"
SHARE = 0.1  # of the random samples' rollouts that the search may spend


def _uniform(low: float, high: float, **more: bool) -> dict[str, Any]:
    return {"distribution": "uniform", "low": low, "high": high, **more}


# Every mass and inertia by itself, the disturbance, the force sensor, and where the robots start: 27 numbers.
MANY = {
    "plant.masses": _uniform(0.8, 1.2, relative=True, each=True),
    "disturbance.scale": _uniform(0.0, 4.0),
    "disturbance.frequency": _uniform(0.5, 3.0),
    "disturbance.phase": _uniform(0.0, 6.283185307179586),
    "sensing.force_lag": _uniform(0.002, 0.01),
    "initial.x": _uniform(-0.03, 0.03, offset=True, each=True),
    "initial.th": _uniform(-0.03, 0.03, offset=True, each=True),
}


class Measurement(NamedTuple):
    """One search against random samples."""

    uncertain: int  # draws
    seed: int
    samples: int
    worst_random: float
    rollouts: int  # spent by the search
    found: float  # cost, or minus the robustness in units of its scale
    ratio: float  # found over the worst of the random ones
    level_after: int  # rollouts after which the search had found as bad a sample; -1: never
    worst_of_as_many: float  # the worst of as many random samples as rollouts were spent
    search_cpu_s: float
    random_cpu_s: float


def main() -> int:
    """Measure; exit code 0 if every search kept its promise, else 1."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=Path("results/benchmarks"), help="folder for falsify.csv")
    parser.add_argument("--samples", type=int, default=4096, help="random ones (default %(default)d)")
    parser.add_argument("--seeds", type=int, default=5, help="number of seeds (default %(default)d)")
    parser.add_argument("--requirement", action="store_true", help=f"climb against: {PRESSES}")
    options = parser.parse_args()
    print(" ".join(f"{name:>16}" for name in Measurement._fields))
    rows = []
    for uncertainty in (None, MANY):
        for seed in range(options.seeds):
            rows.append(measure(scenario(uncertainty, seed, options.requirement), options.samples, options.requirement))
            print(" ".join(f"{value:16.6g}" for value in rows[-1]), flush=True)
    options.out.mkdir(parents=True, exist_ok=True)
    name = "falsify_requirement.csv" if options.requirement else "falsify.csv"
    with (options.out / name).open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(Measurement._fields)
        writer.writerows(rows)
    kept = sum(row.found >= row.worst_random and row.rollouts <= SHARE * row.samples for row in rows)
    print(
        f"at least as bad as the worst random sample within {SHARE:g} of the rollouts: {kept} of {len(rows)} searches"
    )
    return int(kept < len(rows))


def scenario(uncertainty: dict[str, Any] | None, seed: int, required: bool = False) -> Scenario:
    """``sensed``, with its own uncertainty or another; simulated no further than the search goes."""
    tables = load_scenario("sensed").model_dump(exclude_none=True)
    if uncertainty is not None:
        tables["uncertainty"] = uncertainty
    settings = {"tracking_from": min(0.5 * HORIZON, tables["tuning"]["tracking_from"])}
    changes = {"simulation.duration": HORIZON, "simulation.seed": seed}
    if required:
        changes |= {f"requirements.{NAME}": PRESSES}
    return Scenario.model_validate(tables).with_overrides(changes | {"tuning": settings})


def measure(scenario: Scenario, samples: int, against_requirement: bool = False) -> Measurement:
    """Search and random samples on one scenario, whose programs are compiled before the clock starts."""
    name = NAME if against_requirement else None
    requirement = requirement_of(scenario, name) if name else None
    problem = unscaled(scenario) if requirement else build_problem(scenario)
    random_costs(problem, 1, requirement)
    start = time.process_time()
    found = falsify(scenario, int(SHARE * samples), problem=problem, requirement=name)
    searched = time.process_time()
    random = random_costs(problem, samples, requirement)
    end = time.process_time()
    worst = float(random.max())
    level = [mark.spent for mark in found.trail if mark.value >= worst]
    if worst >= FAILED:
        print(f"{int((random >= FAILED).sum())} random samples fail")
    return Measurement(
        uncertain=len(problem.variation.draws),
        seed=scenario.simulation.seed,
        samples=samples,
        worst_random=worst,
        rollouts=found.rollouts,
        found=found.cost,
        ratio=found.cost / worst,
        level_after=level[0] if level else -1,
        worst_of_as_many=float(random[: found.rollouts].max()),
        search_cpu_s=round(searched - start, 3),
        random_cpu_s=round(end - searched, 3),
    )


if __name__ == "__main__":
    sys.exit(main())
