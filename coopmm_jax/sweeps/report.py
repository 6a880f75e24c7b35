"""The report of a sweep: a text to print, files to keep.

    coopmm report sweep.zarr

prints ``text`` and writes a folder with report.html, report.txt, summary.json, a CSV file of each table, and figures.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from coopmm_jax.errors import one_line
from coopmm_jax.files import write_csv, write_json, write_text
from coopmm_jax.page import write_page
from coopmm_jax.sweeps import page
from coopmm_jax.sweeps.intervals import Interval
from coopmm_jax.sweeps.statistics import (
    Results,
    Spread,
    damaged,
    failures,
    outcomes,
    read_results,
    robustness,
    sensitivities,
    spread,
    telling,
)
from coopmm_jax.sweeps.store import values

if TYPE_CHECKING:
    import xarray
    from matplotlib.figure import Figure

_WIDEST = 1000  # characters of a description that are printed
_LISTED = 10  # failed samples that are printed; failed.csv has them all
_STRONGEST = 3  # parameters that are printed for each requirement


def text(results: Results) -> str:
    """Success probabilities, quantiles, what matters, and which samples failed, for a terminal."""
    n, settings = len(results.index), results.scenario.simulation
    computed = f"{n} samples" if n == results.total else f"{n} of {results.total} samples (the rest is not there yet)"
    head = [
        one_line(results.scenario.description, _WIDEST),
        f"{computed} of {settings.duration:g} s, seed {settings.seed}",
    ]
    head += [f"damaged, and not counted: {text}" for text in damaged(results.data)]
    if not results.completed.any():
        head.insert(0, f"all {n} samples failed: none reached {settings.duration:g} s")
    parts = [head, _requirements(results), _robustness(results), _metrics(results), _matters(results), _failed(results)]
    return "\n\n".join("\n".join(part) for part in parts if part)


def write_report(folder: Path, data: xarray.Dataset, results: Results | None = None) -> None:
    """Write the report of a sweep's data set into an existing folder."""
    from coopmm_jax.plotting.style import publish  # imports matplotlib

    results = read_results(data) if results is None else results
    write_numbers(folder, results)
    publish(folder, drawings(data, results))
    write_page(folder, page.page(results))


def write_numbers(folder: Path, results: Results) -> None:
    """Write report.txt, summary.json and the tables of the report as CSV files into an existing folder."""
    write_text(folder / "report.txt", text(results) + "\n")
    write_json(folder / "summary.json", summary(results))
    _write_tables(folder, results)
    _write_failed(folder / "failed.csv", results)


def drawings(data: xarray.Dataset, results: Results) -> dict[str, Callable[[], Figure]]:
    """The figures that the results have something to show in: how to draw each, by the name of its file."""
    from coopmm_jax.sweeps import figures

    found: dict[str, Callable[[], Figure]] = {}
    if results.completed.any():
        found["requirements.png"] = lambda: figures.sweep_requirements(results)
    if telling(results):
        found["importance.png"] = lambda: figures.sweep_importance(results)
        found["worst.png"] = lambda: figures.sweep_worst(results)
    if data.sizes["kept"] and np.isfinite(values(data.contact_force)).any():
        found["bands.png"] = lambda: figures.sweep_bands(data)
    return found


def summary(results: Results) -> dict:
    """The numbers of the report by name."""
    tables = {metric: spread(results, metric) for metric in results.metrics}
    return {
        "samples": results.total,
        "computed": len(results.index),
        "requirements": {
            row.requirement: {"passed": row.passed, "samples": row.samples, **row.success._asdict()}
            for row in outcomes(results)
        },
        "robustness": {
            str(each): {**table._asdict(), "scale": each.scale}
            for each in results.requirements
            if (table := robustness(results, each))
        },
        "metrics": {metric: table._asdict() for metric, table in tables.items() if table},
        "rank_correlation": {
            metric: {draw: interval._asdict() for draw, interval in sensitivities(results, metric).items()}
            for metric in telling(results)
        },
    }


def _requirements(results: Results) -> list[str]:
    rows = outcomes(results)
    width = max(len(row.requirement) for row in rows)
    lines = [f"{'requirement':{width}}  {'met':>15}  {'probability':>11}  95 % interval"]
    for row in rows:
        met = f"{row.passed} of {row.samples}"
        interval = f"{row.success.low:.4f} to {row.success.high:.4f}"
        lines.append(f"{row.requirement:{width}}  {met:>15}  {row.success.estimate:11.4f}  {interval}")
    return lines


def _robustness(results: Results) -> list[str]:
    rows = [(str(each), each.metric, robustness(results, each)) for each in results.requirements]
    return _spreads(results, "robustness", rows)


def _metrics(results: Results) -> list[str]:
    return _spreads(results, "metric", [(metric, metric, spread(results, metric)) for metric in results.metrics])


def _spreads(results: Results, title: str, rows: list[tuple[str, str, Spread | None]]) -> list[str]:
    """Table of distributions, each with its label and the metric whose unit it has."""
    width, known = max((len(label) for label, *_ in rows), default=0), results.scenario.requirements.metrics()
    lines = [f"{title:{width}} {'median':>11} {'5 %':>11} {'95 %':>11} {'worst':>11}  unit    of sample"]
    for label, metric, table in rows:
        if table:
            numbers = " ".join(f"{x:11.4g}" for x in table[:4])
            lines.append(f"{label:{width}} {numbers}  {known[metric].unit:7} {table.worst_sample}")
    return lines if len(lines) > 1 else []


def _matters(results: Results) -> list[str]:
    """The strongest rank correlations of what is required."""
    wanted = telling(results)
    width = max(map(len, wanted), default=0)
    lines = []
    for metric in wanted:
        strongest = list(sensitivities(results, metric).items())[:_STRONGEST]
        if strongest:
            lines.append(f"{metric:{width}}  " + ", ".join(_signed(draw, interval) for draw, interval in strongest))
    return ["what matters (rank correlation and its 95 % interval)", *lines] if lines else []


def _signed(draw: str, interval: Interval) -> str:
    return f"{draw} {interval.estimate:+.2f} ({interval.low:+.2f} to {interval.high:+.2f})"


def _failed(results: Results) -> list[str]:
    rows = failures(results)
    if not rows:
        return []
    lines = [f"failed samples: {len(rows)}"]
    for index, status, time, broken in rows[:_LISTED]:
        reason = f"{status} at t = {time:g} s" if time is not None else "; ".join(broken)
        lines.append(f"  {index:8}  {reason}")
    if len(rows) > _LISTED:
        lines.append(f"  and {len(rows) - _LISTED} more")
    return lines


def _write_tables(folder: Path, results: Results) -> None:
    """Write requirements.csv, metrics.csv and importance.csv, in full precision."""
    met = [[row.requirement, row.passed, row.samples, *row.success] for row in outcomes(results)]
    write_csv(folder / "requirements.csv", ["requirement", "met", "samples", "probability", "low", "high"], met)
    tables, known = (
        {metric: spread(results, metric) for metric in results.metrics},
        results.scenario.requirements.metrics(),
    )
    spreads = [[metric, known[metric].unit, *table] for metric, table in tables.items() if table]
    header = ["metric", "unit", "median", "quantile_05", "quantile_95", "worst", "worst_sample"]
    write_csv(folder / "metrics.csv", header, spreads)
    causes = [
        [metric, draw, *interval]
        for metric in telling(results)
        for draw, interval in sensitivities(results, metric).items()
    ]
    write_csv(folder / "importance.csv", ["metric", "draw", "rank_correlation", "low", "high"], causes)


def _write_failed(path: Path, results: Results) -> None:
    rows = (
        [index, status, "" if time is None else time, "; ".join(broken)]
        for index, status, time, broken in failures(results)
    )
    write_csv(path, ["sample", "status", "time_s", "not_met"], rows)
