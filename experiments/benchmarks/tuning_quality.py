"""Quality of ``coopmm tune`` with its defaults: the command as a user runs it, once for each seed.

    python -m experiments.benchmarks.tuning_quality [--scenario sensed] [--seeds 1 2 3 4 5] [--budget-factor 2]

Costs and requirements are those of the command's own report, on robots by which nothing was chosen. Run it on a quiet
machine; where others use the cores, CPU seconds over the number of cores say what a quiet one would take. ``--cold``
compiles everything anew, with an empty compilation cache for each seed. A seed has robots of its own: the last lines
are the costs of all gains on the robots of the scenario's own seed. Writes tuning_SCENARIO.csv, row by row, and the
gains.
"""

from __future__ import annotations

import argparse
import csv
import json
import os
import resource
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import jax
import numpy as np

from coopmm_jax import runtime
from coopmm_jax.scenario.scenario import load_scenario
from tuning.studies.compare import OWN, compare_gains


class Quality(NamedTuple):
    """One tuning."""

    seed: int
    before: float  # mean cost on untouched robots
    after: float
    met_before: str  # robots that meet every requirement, of all
    met_after: str
    wall_s: float
    cpu_s: float
    steps: int  # simulated by the search


def main(argv: Sequence[str] | None = None) -> int:
    """Tune with every seed; print the table."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--out", type=Path, default=Path("results/benchmarks"), help="folder for the table")
    parser.add_argument("--scenario", default="sensed")
    parser.add_argument("--seeds", nargs="+", type=int, default=[1, 2, 3, 4, 5])
    parser.add_argument("--budget-factor", type=float, default=1.0, help="times the scenario's own tuning.budget")
    parser.add_argument("--cold", action="store_true", help="with an empty compilation cache for each seed")
    options = parser.parse_args(argv)
    budget = options.budget_factor * load_scenario(options.scenario).tuning.budget
    options.out.mkdir(parents=True, exist_ok=True)
    rows: list[Quality] = []
    with (options.out / f"tuning_{Path(options.scenario).stem}.csv").open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(Quality._fields)
        print("".join(f"{name:>13}" for name in Quality._fields), flush=True)
        for seed in options.seeds:
            rows.append(measure(options, seed, budget))
            writer.writerow(rows[-1])
            file.flush()
            print("".join(f"{_shown(value):>13}" for value in rows[-1]), flush=True)
    print(f"cost after: {_spread([row.after for row in rows])}")
    runtime.use_fast_compilation(batches=True)
    runtime.use_compilation_cache()
    with jax.enable_x64(True):
        found = compare_gains(options.scenario, [OWN, *(gains_path(options, seed) for seed in options.seeds)])
    before, *after = found.comparison.costs.mean(axis=1).tolist()
    met = found.outcomes()["all together"].sum(axis=1).tolist()
    shown = ", ".join(f"{cost:.4f}" for cost in after)
    print(f"on the same {found.samples} robots: {before:.4f} before, {shown} after: {_spread(after)}; all met {met}")
    return 0


def gains_path(options: argparse.Namespace, seed: int) -> Path:
    """Place of the gains that a seed has found."""
    return options.out / f"tuned_{Path(options.scenario).stem}_{seed}.toml"


def measure(options: argparse.Namespace, seed: int, budget: float) -> Quality:
    """One tuning in a process of its own; budget [million steps]."""
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "tuned"
        line = ["tune", options.scenario, "--seed", str(seed), "--tuning.budget", f"{budget:g}", "--out", str(out)]
        environment = os.environ | ({"COOPMM_CACHE_DIR": str(Path(folder) / "cache")} if options.cold else {})
        began, used = time.monotonic(), _cpu()
        subprocess.run(
            [sys.executable, "-m", "coopmm_jax.cli", *line], check=True, capture_output=True, env=environment
        )
        wall, cpu = time.monotonic() - began, _cpu() - used
        report = json.loads((out / "report.json").read_text(encoding="utf-8"))
        shutil.copy(out / "gains.toml", gains_path(options, seed))
        history = list(csv.DictReader((out / "history.csv").read_text(encoding="utf-8").splitlines()))
    cost, robots = report["costs"]["cost, mean"], report["robots"]
    met = [f"{robots['all_met'][when]}/{robots['count']}" for when in ("before", "after")]
    return Quality(seed, cost["before"], cost["after"], *met, round(wall, 1), round(cpu, 1), int(history[-1]["steps"]))


def _cpu() -> float:
    """CPU time of processes that this one has waited for [s]."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def _spread(costs: Sequence[float]) -> str:
    return f"median {np.median(costs):.4f}, worst {max(costs):.4f}, best {min(costs):.4f}"


def _shown(value: float | str) -> str:
    return f"{value:.4f}" if isinstance(value, float) else str(value)


if __name__ == "__main__":
    sys.exit(main())
