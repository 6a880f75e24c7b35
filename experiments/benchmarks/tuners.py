"""Comparison of tuners: the same cost, robots and budget for ours and for five others, with five seeds each.

    python -m experiments.benchmarks.tuners [--out results/benchmarks]

The measure is the mean cost over held-out robots (``tuner_problem``), against simulated steps, with a gradient counted
as the rollouts that it costs, and against time, compilation included: CPU time in the picture, as it does not depend on
the work of others. Writes tuners.csv, row by row as runs end, and tuners.png. Needs the extra ``bench``. It takes half
an hour on two cores; ``--tuners``, ``--problems`` and ``--seeds`` choose.
"""

from __future__ import annotations

import argparse
import csv
import sys
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import NamedTuple

import jax
import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import NullFormatter

from coopmm_jax import runtime
from coopmm_jax.plotting.style import panels, pen, save, styled
from experiments.benchmarks.tuner_methods import TUNERS
from experiments.benchmarks.tuner_problem import ROBOTS, Clock, Meter, build
from tuning.cost.evaluate import Samples
from tuning.search.method import Search

# problem -> (description, evaluations on all training robots that a tuner may spend)
PROBLEMS = {"shared": ("4 shared gains", 40), "separate": ("19 gains", 60)}
SEEDS = 5
COSTS = (0.5, 60.0)  # drawn; gains under which rollouts fail cost up to two million
JUDGED = 8  # improvements of one run whose held-out cost is found, spread over the budget geometrically


class Judgement(NamedTuple):
    """One improvement of one run."""

    problem: str
    tuner: str
    seed: int
    steps: float  # simulated so far
    wall_s: float  # so far, the programs' compilation included
    cpu_s: float  # likewise, of all cores
    held_out: float  # mean cost over the held-out robots


def main(argv: Sequence[str] | None = None) -> int:
    """Run the comparison; print the summary."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=Path("results/benchmarks"), help="folder for the results")
    parser.add_argument("--problems", nargs="+", choices=PROBLEMS, default=list(PROBLEMS))
    parser.add_argument("--tuners", nargs="+", choices=TUNERS, default=list(TUNERS))
    parser.add_argument("--seeds", type=int, default=SEEDS)
    options = parser.parse_args(argv)
    runtime.use_fast_compilation()
    jax.config.update("jax_enable_x64", True)
    options.out.mkdir(parents=True, exist_ok=True)
    rows: list[Judgement] = []
    with (options.out / "tuners.csv").open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(Judgement._fields)
        for row in measure(options.problems, options.tuners, range(options.seeds)):
            rows.append(row)
            writer.writerow(row)
            file.flush()
    print(table(rows))
    save(curves(rows), options.out / "tuners.png")
    return 0


def measure(problems: Iterable[str], tuners: Sequence[str], seeds: range) -> Iterable[Judgement]:
    """Judgements of all runs, one improvement after the other."""
    for problem in problems:
        search, training, held_out = build(problem)
        compiling = _compile(search, training)
        budget = PROBLEMS[problem][1] * ROBOTS * search.objective.steps
        for seed in seeds:
            for tuner in tuners:
                meter = Meter(search, budget)
                TUNERS[tuner](meter, training, seed)
                yield from _judged(meter, problem, tuner, seed, held_out, compiling)


def _compile(search: Search, robots: Samples) -> tuple[Clock, Clock]:
    """Compile; time taken without and with gradients."""
    start, began = search.objective.space.start[None], Clock.now()
    search.values(start, robots)
    without = Clock.now() - began
    search.slopes(start, robots)
    return without, Clock.now() - began


def _judged(
    meter: Meter, problem: str, tuner: str, seed: int, held_out: Samples, compiling: tuple[Clock, Clock]
) -> Iterable[Judgement]:
    last = len(meter.trail) - 1
    wanted = meter.budget * np.geomspace(0.02, 1.0, JUDGED)
    steps = np.array([point.steps for point in meter.trail])
    chosen = sorted({0, last, *(int(i) for i in np.searchsorted(steps, wanted, side="right") - 1 if i >= 0)})
    costs = meter.search.values(np.stack([meter.trail[i].vector for i in chosen]), held_out)
    for i, cost in zip(chosen, costs, strict=True):
        point = meter.trail[i]
        before = compiling[point.differentiated]
        wall, cpu = (round(a + b, 2) for a, b in zip(point.taken, before, strict=True))
        yield Judgement(problem, tuner, seed, point.steps, wall, cpu, float(cost))
    print(f"{problem} {tuner} seed {seed}: {costs[-1]:.3f} after {meter.steps / 1e6:.0f} M steps", flush=True)


def table(rows: Sequence[Judgement]) -> str:
    """Table of final held-out costs, and of the steps to the best baseline's median."""
    head = f"{'problem':10} {'tuner':20} {'median':>8} {'worst':>8} {'best':>8}"
    lines = [f"{head}   [M steps] to the best baseline's median, by seed"]
    for problem in dict.fromkeys(row.problem for row in rows):
        finals = _finals(rows, problem)
        baselines = [float(np.median(values)) for tuner, values in finals.items() if tuner != "coopmm"]
        goal = min(baselines, default=np.inf)
        for tuner, values in finals.items():
            reached = [_reached(rows, problem, tuner, seed, goal) / 1e6 for seed in range(len(values))]
            spread = f"{np.median(values):8.3f} {max(values):8.3f} {min(values):8.3f}"
            lines.append(f"{problem:10} {tuner:20} {spread}   {' '.join(f'{steps:.0f}' for steps in reached)}")
    return "\n".join(lines)


def _finals(rows: Sequence[Judgement], problem: str) -> dict[str, list[float]]:
    """Last held-out cost of every seed, by tuner."""
    last = {(row.tuner, row.seed): row.held_out for row in rows if row.problem == problem}
    return {tuner: [cost for (name, _), cost in last.items() if name == tuner] for tuner, _ in last}


def _reached(rows: Sequence[Judgement], problem: str, tuner: str, seed: int, goal: float) -> float:
    """Simulated steps to a held-out cost, infinite if never."""
    own = (row for row in rows if (row.problem, row.tuner, row.seed) == (problem, tuner, seed))
    return next((row.steps for row in own if row.held_out <= goal), np.inf)


@styled
def curves(rows: Sequence[Judgement]) -> Figure:
    """Held-out cost against simulated steps and CPU time: the median over seeds, and every seed as a thin line."""
    problems = list(dict.fromkeys(row.problem for row in rows))
    figure, all_axes = panels(None, [[f"{p}, steps", f"{p}, time"] for p in problems], 0.6 + 2.8 * len(problems))
    for i, axes in enumerate(all_axes):
        problem, against = problems[i // 2], ("steps", "cpu_s")[i % 2]
        for k, tuner in enumerate(dict.fromkeys(row.tuner for row in rows)):
            grid, costs = _series(rows, problem, tuner, against)
            if not len(grid):
                continue
            axes.plot(grid, costs.T, color=pen(k)["color"], alpha=0.35, linewidth=0.5)
            axes.plot(grid, np.median(costs, axis=0), label=tuner.replace("_", " "), **pen(k))
        axes.set(xscale="log", yscale="log", ylim=COSTS, ylabel=f"held-out cost, {PROBLEMS[problem][0]}")
        axes.set_xlabel("simulated steps" if against == "steps" else "CPU time with compilation [s]")
        axes.xaxis.set_minor_formatter(NullFormatter())
        axes.yaxis.set_major_formatter("{x:g}")
    figure.legend(*all_axes[0].get_legend_handles_labels(), loc="outside upper left", ncols=6, handlelength=1.8)
    return figure


def _series(rows: Sequence[Judgement], problem: str, tuner: str, against: str) -> tuple[np.ndarray, np.ndarray]:
    """Best cost so far of every seed (S, G) at grid points (G,), from the first point that all of them have."""
    own = [row for row in rows if (row.problem, row.tuner) == (problem, tuner)]
    runs = [[row for row in own if row.seed == seed] for seed in dict.fromkeys(row.seed for row in own)]
    if not runs:
        return np.empty(0), np.empty((0, 0))
    places = [np.array([getattr(row, against) for row in run]) for run in runs]
    grid = np.geomspace(max(place[0] for place in places), max(place[-1] for place in places), 60)
    index = [np.maximum(np.searchsorted(place, grid * (1 + 1e-9), side="right") - 1, 0) for place in places]
    best = [np.array([row.held_out for row in run]) for run in runs]
    return grid, np.stack([costs[i] for costs, i in zip(best, index, strict=True)])


if __name__ == "__main__":
    sys.exit(main())
