"""Result of a tuning as HTML, for a notebook."""

from __future__ import annotations

from collections.abc import Iterator
from html import escape
from typing import Any

from coopmm_jax.sweeps.intervals import success
from tuning.studies.comparison import STATISTICS, ratio


def page(result: Any) -> str:
    """Page of a ``TuningResult``: costs and requirements on untouched samples before and after; tuned gains, folded."""
    count, iterations = result.comparison.costs.shape[1], len(result.history) - 1
    head = f"TuningResult: {len(result.labels)} numbers, {iterations} iterations, {count} untouched samples"
    gains = zip(result.labels, result.before, result.after, strict=True)
    tuned = _table((label, f"{before:.4g}", f"{after:.4g}") for label, before, after in gains)
    return (
        f"<div><b>{head}</b><br>{escape(result.scenario.description)}{_table(_worth(result))}"
        f"<details><summary>tuned gains</summary>{tuned}</details></div>"
    )


def _worth(result: Any) -> Iterator[tuple[str, ...]]:
    for name, statistic in STATISTICS.items():
        change = ratio(result.comparison.costs, statistic)
        interval = f"ratio {change.low:.3g} to {change.high:.3g} (95 %)"
        yield name, f"{change.before:.4g}", f"{change.after:.4g}", interval
    for requirement in result.scenario.requirements.parsed():
        rates = (success(int(met.sum()), len(met)).estimate for met in result.comparison.met(requirement))
        yield str(requirement), *(f"{rate:.3f}" for rate in rates), "success probability"


def _table(rows: Iterator[tuple[str, ...]]) -> str:
    head = "<tr><th></th><th>before</th><th>after</th></tr>"
    body = ("".join(f"<td>{escape(cell)}</td>" for cell in row) for row in rows)
    return f"<table>{head}{''.join(f'<tr>{cells}</tr>' for cells in body)}</table>"
