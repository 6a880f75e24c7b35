"""Report on a comparison of gains: a table to print, files to keep.

    coopmm compare scenario tuned/gains.toml --scenario sensed --out compared

prints ``table`` and writes compare.txt, compare.json, compare.csv and figures.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from scipy.stats import binomtest

from coopmm_jax.files import write_csv, write_json, write_text
from coopmm_jax.status import Status
from coopmm_jax.sweeps.intervals import success
from tuning.cost.objective import FAILED, TERMS
from tuning.reports import compare_figures
from tuning.reports.pages import compare_page, write_pictures_and_page
from tuning.studies.compare import ComparedGains
from tuning.studies.comparison import STATISTICS, Change, ratio


class Switches(NamedTuple):
    """Samples whose outcome another set of gains changes, and how likely chance alone would split them so unevenly."""

    won: int  # met under the other set only
    lost: int  # met under the first set only
    p: float  # of McNemar's exact test


def write_report(folder: Path, compared: ComparedGains, sources: Sequence[str | Path] = ()) -> None:
    """Write compare.txt, .json and .csv, its tables as CSV files, figures, and report.html with page.json behind it.

    Args:
        folder: of the results.
        compared: the comparison.
        sources: of the sets of gains, as the user named them; their labels if left out.
    """
    write_text(folder / "compare.txt", table(compared))
    write_json(folder / "compare.json", summary(compared))
    _write_csv(folder / "compare.csv", compared)
    _write_tables(folder, compared)
    drawn = [compare_figures.costs, compare_figures.bands]
    if compared.scenario.requirements.parsed():
        drawn.append(compare_figures.requirements)
    pairs = [changes(compared, i) for i in range(1, len(compared.labels))]
    moved = {name: [_switched(one) for one in switches(met)] for name, met in compared.outcomes().items()}
    write_pictures_and_page(folder, drawn, compared, compare_page(compared, sources, pairs, moved))


def changes(compared: ComparedGains, other: int) -> dict[str, Change]:
    """Costs and terms of the first set and of another, with 95 % intervals of the ratio by paired bootstrap.

    A failed rollout counts in the costs; terms are averaged over the samples that complete under both.

    Args:
        compared: the comparison.
        other: position of the other set.
    """
    comparison, pair = compared.comparison, [0, other]
    found = {name: ratio(comparison.costs[pair], statistic) for name, statistic in STATISTICS.items()}
    both = comparison.completed[pair].all(axis=0)
    for i, name in enumerate(_term_names()):
        values = comparison.terms[pair][:, both, i]
        found[name] = ratio(values) if both.any() else Change(*[np.nan] * 4)
    return found


def switches(met: np.ndarray) -> list[Switches]:
    """Samples won and lost against the first of S sets, for each of the others (S - 1).

    Args:
        met: rollouts (S, N) that meet a requirement.

    >>> switches(np.array([[True, False, False], [False, True, True]]))
    [Switches(won=2, lost=1, p=1.0)]
    """
    counts = [(int((~met[0] & row).sum()), int((met[0] & ~row).sum())) for row in met[1:]]
    return [Switches(w, n, float(binomtest(w, w + n).pvalue) if w + n else 1.0) for w, n in counts]


def summary(compared: ComparedGains) -> dict[str, Any]:
    """Numbers of the report by name."""
    labels, outcomes = compared.labels, compared.outcomes()
    return {
        "samples": compared.samples,
        "values": {name: dict(zip(labels, row, strict=True)) for name, row in _values(compared).items()},
        "ratios": {
            label: {name: change._asdict() for name, change in changes(compared, i).items()}
            for i, label in enumerate(labels[1:], 1)
        },
        "requirements": {
            name: {label: success(int(row.sum()), len(row))._asdict() for label, row in zip(labels, met, strict=True)}
            for name, met in outcomes.items()
        },
        "switches": {
            name: {label: one._asdict() for label, one in zip(labels[1:], switches(met), strict=True)}
            for name, met in outcomes.items()
        },
    }


def table(compared: ComparedGains) -> str:
    """Costs, ratios, success probabilities and changed outcomes, for a terminal."""
    labels, scenario, outcomes = compared.labels, compared.scenario, compared.outcomes()
    settings, first = scenario.simulation, labels[0]
    head = [f"{compared.samples} samples of {settings.duration:g} s, seed {settings.seed}, the same for every column"]
    if not compared.comparison.completed.all():
        head.append(f"a rollout that fails costs {FAILED:g} or more; terms are those of the samples that complete")
    values = {name: ["-" if np.isnan(x) else f"{x:.5g}" for x in row] for name, row in _values(compared).items()}
    pairs = [changes(compared, i) for i in range(1, len(labels))]
    ratios = {name: [_ratio(pair[name]) for pair in pairs] for name in values}
    rates = {name: [_rate(row) for row in met] for name, met in outcomes.items()}
    moved = {name: [_switched(one) for one in switches(met)] for name, met in outcomes.items()}
    parts = [
        head,
        _lines("", labels, values),
        _lines(f"ratio to {first} (95 % interval)", labels[1:], ratios),
        _lines("success probability (95 % interval)", labels, rates),
        _lines(f"outcomes against {first}", labels[1:], moved),
    ]
    return "\n\n".join("\n".join(part) for part in parts) + "\n"


def _values(compared: ComparedGains) -> dict[str, list[float]]:
    """Costs over all samples, terms over those that complete (S,), by name; NaN for no sample."""
    comparison = compared.comparison
    found = {name: [float(statistic(row)) for row in comparison.costs] for name, statistic in STATISTICS.items()}
    for i, name in enumerate(_term_names()):
        rows = zip(comparison.terms[:, :, i], comparison.completed, strict=True)
        found[name] = [float(row[ok].mean()) if ok.any() else np.nan for row, ok in rows]
    return found


def _term_names() -> list[str]:
    return [f"{name} [{unit}]" for name, (unit, _) in TERMS.items()]


def _lines(title: str, columns: Sequence[str], rows: Mapping[str, Sequence[str]]) -> list[str]:
    """Block of the table; every column as wide as it needs."""
    first = max(map(len, (title, *rows)))
    widths = [max(map(len, column)) for column in zip(columns, *rows.values(), strict=True)]
    body = ((name, cells) for name, cells in rows.items())
    return [
        f"{name:{first}}" + "".join(f"   {cell:>{width}}" for cell, width in zip(cells, widths, strict=True))
        for name, cells in ((title, columns), *body)
    ]


def _ratio(change: Change) -> str:
    if not change.before > 0.0:
        return "-"
    return f"{change.after / change.before:.4g} ({change.low:.4g} to {change.high:.4g})"


def _rate(met: np.ndarray) -> str:
    rate = success(int(met.sum()), len(met))
    return f"{rate.estimate:.3f} ({rate.low:.3f} to {rate.high:.3f})"


def _switched(found: Switches) -> str:
    if not found.won + found.lost:
        return "none changed"
    return f"{found.won} won, {found.lost} lost (p = {found.p:.2g})"


def _write_tables(folder: Path, compared: ComparedGains) -> None:
    """Write costs.csv and requirements.csv: the tables of the page, a line for each set of gains."""
    nothing = Change(*[np.nan] * 4)
    pairs = [{}, *(changes(compared, i) for i in range(1, len(compared.labels)))]
    costs = [
        [name, label, value, *pair.get(name, nothing)[2:]]
        for name, values in _values(compared).items()
        for label, value, pair in zip(compared.labels, values, pairs, strict=True)
    ]
    header = ["cost", "gains", "value", "ratio_to_first_low", "ratio_to_first_high"]
    write_csv(folder / "costs.csv", header, costs)
    rates = [
        [name, label, *success(int(row.sum()), len(row)), changed.won, changed.lost, changed.p]
        for name, met in compared.outcomes().items()
        for label, row, changed in zip(compared.labels, met, [Switches(0, 0, 1.0), *switches(met)], strict=True)
    ]
    header = ["requirement", "gains", "probability", "low", "high", "won", "lost", "p"]
    write_csv(folder / "requirements.csv", header, rates)


def _write_csv(path: Path, compared: ComparedGains) -> None:
    """One line for each sample and set of gains."""
    comparison, met = compared.comparison, compared.outcomes()["all together"]
    header = ["sample", "gains", "status", "requirements_met", "cost"]
    header += [*(f"{name}_term" for name in TERMS), *comparison.metrics]
    rows = []
    for sample in range(compared.samples):
        for i, label in enumerate(compared.labels):
            status = Status(int(comparison.status[i, sample])).name
            metrics = (values[i, sample] for values in comparison.metrics.values())
            numbers = (comparison.costs[i, sample], *comparison.terms[i, sample], *metrics)
            rows.append([sample, label, status, int(met[i, sample]), *(repr(float(x)) for x in numbers)])
    write_csv(path, header, rows)
