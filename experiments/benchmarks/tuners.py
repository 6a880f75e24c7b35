"""Is the tuner worth its name? The same cost, batches and wall time for ours and for five others, with five seeds each.

    python -m experiments.benchmarks.tuners [--out results/benchmarks]

Judged is what ``coopmm tune sensed`` reports: the mean cost over 128 untouched robots and the whole 20 s, against wall
time; compilation is listed apart. Writes tuners.csv, run by run and seed by seed, and tuners.png; ``--resume`` goes on
with such a table. Needs the extra ``bench``. All of it takes three hours; ``--tuners``, ``--problems``, ``--seeds`` and
``--seconds`` choose. Run it on a quiet machine, or pinned to one core and ahead of everything else: ``nice -n -15
taskset -c 1``. A machine with more cores takes several runs at a time, each pinned to its own and with a folder of its
own; ``--read`` makes one table of all their rows.
"""

from __future__ import annotations

import argparse
import contextlib
import csv
import itertools
import sys
import time
from collections.abc import Iterable, Sequence, Set
from pathlib import Path
from typing import Any, NamedTuple, get_type_hints

import jax
import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import NullFormatter

from coopmm_jax import runtime
from coopmm_jax.plotting.style import panels, pen, save, styled
from coopmm_jax.scenario.scenario import load_scenario
from experiments.benchmarks.tuner_methods import TUNERS, Meter, Spent
from tuning.cost.problem import TEST, Problem, build_problem
from tuning.search.stages import Descents, plan

# problem -> (what it is, settings of [tuning])
PROBLEMS: dict[str, tuple[str, dict[str, Any]]] = {
    "shared": ("4 shared gains", {"channels": "shared"}),
    "separate": ("19 gains", {}),
    "knots": ("19 gains at 8 knots", {"schedule": 8}),
}
SECONDS = 60.0
DURATION = 20.0  # [s]
JUDGED = 8  # improvements of one run whose cost on untouched robots is found, spread over time geometrically
COSTS = (0.4, 8.0)  # drawn


class Judgement(NamedTuple):
    """One improvement of one run."""

    problem: str
    tuner: str
    seed: int
    wall_s: float  # so far, without compilation
    compiling_s: float  # of what the tuner needs
    cost: float  # mean over the untouched robots


def main(argv: Sequence[str] | None = None) -> int:
    """Run the comparison; print the summary."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--out", type=Path, default=Path("results/benchmarks"), help="folder for the results")
    parser.add_argument("--problems", nargs="+", choices=PROBLEMS, default=list(PROBLEMS))
    parser.add_argument("--tuners", nargs="+", choices=TUNERS, default=list(TUNERS))
    parser.add_argument("--seeds", nargs="+", type=int, default=[1, 2, 3, 4, 5])
    parser.add_argument("--seconds", type=float, default=SECONDS, help="wall time of one run")
    parser.add_argument("--resume", action="store_true", help="keep the runs in the table of --out, and do the others")
    parser.add_argument("--read", nargs="+", type=Path, default=[], help="tables of earlier runs: nothing is run")
    options = parser.parse_args(argv)
    if options.read:
        return _show(read(options.read), options.out)
    runtime.use_fast_compilation(batches=not runtime.backend_is_up())
    jax.config.update("jax_enable_x64", True)
    options.out.mkdir(parents=True, exist_ok=True)
    path = options.out / "tuners.csv"
    rows = read([path]) if options.resume and path.exists() else []
    with path.open("a" if rows else "w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        if not rows:
            writer.writerow(Judgement._fields)
        done = {(row.problem, row.tuner, row.seed) for row in rows}
        for run in measure(options.problems, options.tuners, options.seeds, options.seconds, done):
            rows.extend(run)
            writer.writerows(run)
            file.flush()
    return _show(rows, options.out)


def read(tables: Sequence[Path]) -> list[Judgement]:
    """The rows of tables that runs have written."""
    lines = [line for path in tables for line in csv.DictReader(path.read_text(encoding="utf-8").splitlines())]
    kinds = get_type_hints(Judgement)
    return [Judgement(*(kinds[name](line[name]) for name in Judgement._fields)) for line in lines]


def _show(rows: Sequence[Judgement], out: Path) -> int:
    print(table(rows))
    out.mkdir(parents=True, exist_ok=True)
    save(curves(rows), out / "tuners.png")
    return 0


def measure(
    problems: Iterable[str],
    tuners: Sequence[str],
    seeds: Iterable[int],
    seconds: float,
    done: Set[tuple[str, str, int]] = frozenset(),
) -> Iterable[list[Judgement]]:
    """The improvements of one run after the other, seed by seed.

    Args:
        problems: by name.
        tuners: by name.
        seeds: all problems and tuners with the first one, then with the next.
        seconds: for each run [s].
        done: problem, tuner and seed of runs that are left out.
    """
    built = {name: _built(name, tuners) for name in problems}
    for seed, name, tuner in itertools.product(seeds, built, tuners):
        if (name, tuner, seed) not in done:
            meter = Meter(built[name].problem, seconds, seed)
            with contextlib.suppress(Spent):
                TUNERS[tuner](meter)
            slopes = built[name].slopes_s if _descends(meter.problem, tuner) else 0.0
            compiling = built[name].values_s + slopes
            yield list(_judged(meter, name, tuner, compiling))


class Built(NamedTuple):
    """A problem, with its programs compiled."""

    problem: Problem
    values_s: float  # that compiling its costs took, and what is run once to scale them
    slopes_s: float  # that compiling its gradient took, 0 where it was not


def _built(name: str, tuners: Sequence[str]) -> Built:
    settings = PROBLEMS[name][1] | {"tracking_from": min(1.5, DURATION / 2)}
    began = time.monotonic()
    problem = build_problem(load_scenario("sensed", simulation={"duration": DURATION}, tuning=settings))
    problem.costs(problem.start, problem.drawn(1, 0), problem.scenario.tuning.coarse)
    middle = time.monotonic()
    if any(_descends(problem, tuner) for tuner in tuners):
        problem.slopes(problem.start, problem.drawn(1, 0))
    return Built(problem, middle - began, time.monotonic() - middle)


def _descends(problem: Problem, tuner: str) -> bool:
    """True for a tuner that takes gradients."""
    return "lbfgs" in tuner or (tuner == "coopmm" and isinstance(plan(problem).wide, Descents))


def _judged(meter: Meter, problem: str, tuner: str, compiling: float) -> Iterable[Judgement]:
    last = len(meter.trail) - 1
    seconds = np.array([point.seconds for point in meter.trail])
    wanted = meter.seconds * np.geomspace(0.05, 1.0, JUDGED)
    chosen = sorted({0, last, *(int(i) for i in np.searchsorted(seconds, wanted, side="right") - 1 if i >= 0)})
    robots = meter.problem.samples(TEST, meter.problem.scenario.tuning.test_samples)
    costs = meter.problem.costs(np.stack([meter.trail[i].vector for i in chosen]), robots)
    for i, cost in zip(chosen, costs, strict=True):
        taken = round(meter.trail[i].seconds, 2)
        yield Judgement(problem, tuner, meter.seed, taken, round(compiling, 2), float(cost))
    print(f"{problem} {tuner} seed {meter.seed}: {costs[-1]:.4f}", flush=True)


def table(rows: Sequence[Judgement]) -> str:
    """Final costs on untouched robots, and the time to the best other tuner's median."""
    head = f"{'problem':10} {'tuner':14} {'median':>8} {'worst':>8} {'best':>8} {'compiling [s]':>14}"
    lines = [f"{head}   [s] to the best other's median, by seed"]
    for problem in dict.fromkeys(row.problem for row in rows):
        finals = _finals(rows, problem)
        others = [float(np.median(values)) for tuner, values in finals.items() if not tuner.startswith("coopmm")]
        goal = min(others, default=np.inf)
        for tuner, values in finals.items():
            own = [row for row in rows if (row.problem, row.tuner) == (problem, tuner)]
            reached = [_reached(own, seed, goal) for seed in dict.fromkeys(row.seed for row in own)]
            spread = f"{np.median(values):8.4f} {max(values):8.4f} {min(values):8.4f} {own[0].compiling_s:14.0f}"
            lines.append(f"{problem:10} {tuner:14} {spread}   {' '.join(f'{s:.0f}' for s in reached)}")
    return "\n".join(lines)


def _finals(rows: Sequence[Judgement], problem: str) -> dict[str, list[float]]:
    """Last cost of every seed, by tuner."""
    last = {(row.tuner, row.seed): row.cost for row in rows if row.problem == problem}
    return {tuner: [cost for (name, _), cost in last.items() if name == tuner] for tuner, _ in last}


def _reached(own: Sequence[Judgement], seed: int, goal: float) -> float:
    """Time to a cost [s], infinite if never."""
    return next((row.wall_s for row in own if row.seed == seed and row.cost <= goal), np.inf)


@styled
def curves(rows: Sequence[Judgement]) -> Figure:
    """Cost on untouched robots against wall time: the median over seeds, and every seed as a thin line."""
    problems = list(dict.fromkeys(row.problem for row in rows))
    figure, all_axes = panels(None, [problems], 3.4)
    for axes, problem in zip(all_axes, problems, strict=True):
        for k, tuner in enumerate(dict.fromkeys(row.tuner for row in rows)):
            grid, costs = _series([row for row in rows if (row.problem, row.tuner) == (problem, tuner)])
            axes.plot(grid, costs.T, color=pen(k)["color"], alpha=0.35, linewidth=0.5)
            axes.plot(grid, np.median(costs, axis=0), label=tuner.replace("_", " "), **pen(k))
        axes.set(xscale="log", yscale="log", ylim=COSTS, ylabel=f"cost, {PROBLEMS[problem][0]}", xlabel="wall time [s]")
        axes.xaxis.set_minor_formatter(NullFormatter())
        axes.yaxis.set_major_formatter("{x:g}")
    figure.legend(*all_axes[0].get_legend_handles_labels(), loc="outside upper left", ncols=6, handlelength=1.8)
    return figure


def _series(own: Sequence[Judgement]) -> tuple[np.ndarray, np.ndarray]:
    """Best cost so far of every seed (S, G) at times (G,), from the first time that all of them have."""
    runs = [[row for row in own if row.seed == seed] for seed in dict.fromkeys(row.seed for row in own)]
    times = [np.array([row.wall_s for row in run]) for run in runs]
    grid = np.geomspace(max(t[0] for t in times) + 1e-3, max(t[-1] for t in times) + 2e-3, 60)
    index = [np.maximum(np.searchsorted(t, grid, side="right") - 1, 0) for t in times]
    costs = [np.array([row.cost for row in run]) for run in runs]
    return grid, np.stack([c[i] for c, i in zip(costs, index, strict=True)])


if __name__ == "__main__":
    sys.exit(main())
