"""Is the paper's adaptation worth it? All controllers, tuned with equal effort, on more uncertainty than they were for.

    python -m experiments.controllers --out results/controllers

Each controller is tuned for the same cost, with the same budget and robots, on each scenario; then all run on the same
untouched robots, whose masses and disturbances lie once, twice and four times as far from the nominal ones as those
that they were tuned for. A run that was interrupted goes on where it stood. docs/controllers_study.md
says what came out.
"""

from __future__ import annotations

import argparse
import functools
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from coopmm_jax import load_scenario, runtime

if __name__ == "__main__":
    runtime.use_fast_compilation(batches=True)

import jax
import numpy as np
from matplotlib.figure import Figure

from coopmm_jax.files import write_csv, write_text
from coopmm_jax.metrics.table import METRICS
from coopmm_jax.plotting.style import panels, pen, publish, styled
from coopmm_jax.scenario.scenario import Scenario
from coopmm_jax.scenario.sections.controller import all_controllers
from tuning.reports.compare import switches, table
from tuning.studies import state
from tuning.studies.compare import ComparedGains, compare_scenarios
from tuning.studies.controllers import tune_controllers

SCENARIOS, FACTORS = ("sensed", "rough", "ellipse"), (1.0, 2.0, 4.0)
_MEDIANS = ("force_error_rms_late", "error_late", "object_rms", "contact_loss_fraction", "torque_rms")


class Row(NamedTuple):
    """One controller on the robots of a scenario, at one multiple of its uncertainty."""

    scenario: str
    uncertainty: float  # times that which it was tuned for
    controller: str
    cost: float  # mean
    cost_worst_tenth: float  # mean of it
    failed: int  # robots
    met: int  # robots that meet every requirement
    robots: int
    won: int  # robots that meet all here and not under the first controller
    lost: int
    p: float  # of McNemar's test of these
    medians: tuple[float, ...]  # of ``_MEDIANS`` over robots that complete


def main(argv: Sequence[str] | None = None) -> int:
    """Tune, compare, and write the table and the figure."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--out", type=Path, default=Path("results/controllers"), help="folder for all results")
    parser.add_argument("--scenarios", nargs="+", default=list(SCENARIOS))
    parser.add_argument("--controllers", nargs="+", default=all_controllers())
    parser.add_argument("--budget", type=float, help="million simulated steps each (default: the scenario's)")
    parser.add_argument("--samples", type=int, help="robots to compare on (default: the scenario's)")
    options = parser.parse_args(argv)
    runtime.use_compilation_cache()
    rows: list[Row] = []
    for name in options.scenarios:
        changes: dict[str, Any] = {} if options.budget is None else {"tuning.budget": options.budget}
        rows += study(load_scenario(name, **changes), name, options)
    write_csv(
        options.out / "controllers.csv",
        [*Row._fields[:-1], *(f"{metric}_median" for metric in _MEDIANS)],
        ([*row[:-1], *row.medians] for row in rows),
    )
    publish(options.out, {"controllers.png": functools.partial(picture, rows)})
    return 0


def study(scenario: Scenario, name: str, options: argparse.Namespace) -> list[Row]:
    """Rows of one scenario; what is found is printed on the way."""
    folder = options.out / name
    begun = any((folder / one / state.NAME).exists() for one in options.controllers)
    tuned = tune_controllers(
        scenario, options.controllers, folder, begun, stage=lambda stage: print(f"{name}: {stage}")
    )
    rows = []
    for factor in FACTORS:
        wide = widened(tuned.compared.scenario, factor)  # with the cost's scales
        with jax.enable_x64(True):
            sets = [wide.with_overrides(gains_of(result.scenario)) for result in tuned.results.values()]
            compared = compare_scenarios(wide, sets, options.controllers, options.samples)
        write_text(folder / f"compare_{factor:g}.txt", table(compared))
        print(f"\n{name}, {factor:g} times the uncertainty\n\n{table(compared)}", flush=True)
        rows += _rows(compared, name, factor)
    return rows


def gains_of(scenario: Scenario) -> dict[str, Any]:
    """Sections that make a scenario's controller, to be laid over another."""
    return {name: table for name, table in scenario.model_dump().items() if name in ("law", "gains", "schedule")}


def widened(scenario: Scenario, factor: float) -> Scenario:
    """The scenario with uniform distributions whose ends are ``factor`` times as far from the nominal value.

    A range that begins at nothing, as that of a disturbance, keeps beginning there.

    >>> wide = widened(load_scenario("sensed"), 2.0)
    >>> [(entry.distribution.low, entry.distribution.high) for entry in wide.uncertainty.entries()]
    [(0.6, 1.4), (0.0, 8.0)]
    """
    changes: dict[str, Any] = {}
    for entry in scenario.uncertainty.entries():
        law = entry.distribution
        if law.distribution != "uniform" or law.low is None or law.high is None:
            raise ValueError(f"{entry.name} is not uniform")
        centre = 0.0 if law.low == 0.0 else 1.0
        ends = {end: round(centre + factor * (getattr(law, end) - centre), 12) for end in ("low", "high")}
        changes[f"uncertainty.{entry.name}"] = law.model_dump(exclude_none=True) | ends
    return scenario.with_overrides(changes)


def _rows(compared: ComparedGains, name: str, factor: float) -> list[Row]:
    comparison, met = compared.comparison, compared.outcomes()["all together"]
    moved = [(0, 0, 1.0), *switches(met)]
    rows = []
    for i, label in enumerate(compared.labels):
        ok, costs = comparison.completed[i], np.sort(comparison.costs[i])
        medians = tuple(
            float(np.median(comparison.metrics[metric][i, ok])) if ok.any() else np.nan for metric in _MEDIANS
        )
        worst = float(costs[-max(1, len(costs) // 10) :].mean())
        counts = (int((~ok).sum()), int(met[i].sum()), len(ok))
        rows.append(Row(name, factor, label, float(costs.mean()), worst, *counts, *moved[i], medians))
    return rows


@styled
def picture(rows: Sequence[Row], axes: Any = None) -> Figure:
    """Share of robots that meet all requirements, and median late force error, over the multiple of the uncertainty."""
    names = list(dict.fromkeys(row.scenario for row in rows))
    layout = [[f"{kind} {name}" for name in names] for kind in ("met", "force")]
    figure, all_axes = panels(axes, layout, height=5.2)
    by: Mapping[str, Any] = dict(zip((panel for line in layout for panel in line), all_axes, strict=True))
    unit = METRICS["force_error_rms_late"].unit
    for name in names:
        share, force = by[f"met {name}"], by[f"force {name}"]
        for i, label in enumerate(dict.fromkeys(row.controller for row in rows)):
            own = [row for row in rows if (row.scenario, row.controller) == (name, label)]
            factors = [row.uncertainty for row in own]
            share.plot(factors, [row.met / row.robots for row in own], label=label, **pen(i))
            force.plot(factors, [row.medians[0] for row in own], label=label, **pen(i))
        share.set(title=name, ylim=(-0.03, 1.03), xscale="log")
        force.set(xscale="log", yscale="log")
        for panel in (share, force):
            panel.set_xticks(FACTORS, [f"{factor:g}" for factor in FACTORS])
            panel.minorticks_off()
    by[f"met {names[0]}"].set_ylabel("robots that meet all")
    by[f"force {names[0]}"].set_ylabel(f"late force error [{unit}]")
    figure.supxlabel("uncertainty, times that which was tuned for", fontsize="medium")
    handles, labels = by[f"met {names[0]}"].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper center", ncols=3)
    return figure


if __name__ == "__main__":
    sys.exit(main())
