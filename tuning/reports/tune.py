"""Report on a tuning: a table and figures of its gains on samples by which nothing was chosen."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from coopmm_jax.files import write_csv, write_json, write_text
from coopmm_jax.metrics.table import as_text
from coopmm_jax.scenario.sections.requirements import Requirement
from coopmm_jax.sweeps.intervals import success
from tuning.cost.objective import TERMS
from tuning.reports import goals, tune_figures
from tuning.reports.owners import entry_owners, with_owner
from tuning.reports.pages import tune_page, write_pictures_and_page
from tuning.studies.comparison import STATISTICS, Change, ratio
from tuning.studies.margins import RISE

if TYPE_CHECKING:
    from coopmm_jax.scenario.scenario import Scenario
    from tuning.studies.chatter import Slopes
    from tuning.studies.result import TuningResult


def write_report(folder: Path, result: TuningResult, start: Scenario | None = None) -> None:
    """Write report.txt, report.json, CSV files of its tables, figures, and report.html with page.json behind it.

    Args:
        folder: of the results.
        result: of the tuning.
        start: the scenario that was tuned, for the settings in report.html.
    """
    write_text(folder / "report.txt", table(result))
    content = {"costs": {name: change._asdict() for name, change in changes(result).items()}}
    content |= {"requirements": [_requirement(result, r) for r in result.scenario.requirements.parsed()]}
    content |= {"robots": {"count": _count(result), "all_met": dict(zip(("before", "after"), _all_met(result)))}}
    content |= {"margins": [margin._asdict() for margin in result.margins], "at_bounds": result.at_bounds}
    content |= {"slopes": result.slopes._asdict() | {"chattering": result.slopes.chattering}}
    content |= {"stopped": result.stopped} | goals.content(result)
    content |= {"gains": dict(zip(result.labels, np.stack([result.before, result.after], 1).tolist(), strict=True))}
    write_json(folder / "report.json", content)
    _write_tables(folder, result)
    drawn = (tune_figures.convergence, tune_figures.gains, tune_figures.bands)
    write_pictures_and_page(folder, drawn, result, tune_page(result, changes(result), remarks(result), start))


def _write_tables(folder: Path, result: TuningResult) -> None:
    """Write costs.csv, requirements.csv and gains.csv, in full precision."""
    costs = [[name, *change] for name, change in changes(result).items()]
    write_csv(folder / "costs.csv", ["cost", "before", "after", "ratio_low", "ratio_high"], costs)
    rates = [
        [str(requirement), when, *success(int(met.sum()), len(met))]
        for requirement in result.scenario.requirements.parsed()
        for when, met in zip(("before", "after"), result.comparison.met(requirement), strict=True)
    ]
    write_csv(folder / "requirements.csv", ["requirement", "gains", "probability", "low", "high"], rates)
    means = result.before.reshape(-1, len(result.margins)).mean(axis=0)
    owners = entry_owners(result.scenario)
    both = zip(means.tolist(), result.margins, strict=True)
    rows = [[margin.name, owners.get(margin.name, ""), before, *margin[1:]] for before, margin in both]
    write_csv(folder / "gains.csv", ["gain", "of", "before", "after", "low", "high", "below", "above"], rows)


def changes(result: TuningResult) -> dict[str, Change]:
    """Costs and terms before and after, with 95 % intervals of the ratio by paired bootstrap."""
    comparison = result.comparison
    found = {name: ratio(comparison.costs, statistic) for name, statistic in STATISTICS.items()}
    for i, (name, (unit, _)) in enumerate(TERMS.items()):
        found[f"{name} [{unit}]"] = ratio(comparison.terms[:, :, i])
    return found


def table(result: TuningResult) -> str:
    """Table of costs, requirements and gains before and after, as text."""
    lines = [f"{_count(result)} untouched samples over the whole duration", ""]
    lines.append(f"{'':28} {'before':>12} {'after':>12} {'ratio':>9}   95 % interval of the ratio")
    for name, change in changes(result).items():
        lines.append(f"{name:28} {change.before:12.5g} {change.after:12.5g} {_ratio(change)}")
    lines += ["", _losses(result), ""]
    for requirement in result.scenario.requirements.parsed():
        rates = _requirement(result, requirement)["success"].items()
        parts = (f"{when} {p['estimate']:.3f} ({p['low']:.3f} to {p['high']:.3f})" for when, p in rates)
        lines.append(f"requirement {requirement}: success {', '.join(parts)}")
    if result.scenario.requirements.parsed():
        before, after = _all_met(result)
        lines.append(f"samples that meet every requirement: {before} before, {after} after, of {_count(result)}")
    lines += ["", *goals.lines(result), *_gains(result), "", *remarks(result)[1:]]
    return "\n".join(lines) + "\n"


def remarks(result: TuningResult) -> list[str]:
    """Sentences on lost contact, the largest force, bounds, chattering and the end of the search."""
    bounds = [f"at a bound of [tuning.bounds]: {', '.join(result.at_bounds)}"] if result.at_bounds else []
    end = [f"search ended: {result.stopped}"] if result.stopped else []
    return [_losses(result), *_peaks(result), *bounds, _slopes(result.slopes, result.scenario.tuning.minimised), *end]


def _gains(result: TuningResult) -> list[str]:
    """Every tuned gain, and how far it may go alone; then its values at the knots, if it has them."""
    minimised = result.scenario.tuning.minimised
    head = f"may be alone within its bounds, until the {minimised} rises by {RISE:.0%} or a robot fails (!)"
    owners = entry_owners(result.scenario)
    names = [with_owner(margin.name, owners) for margin in result.margins]
    width = max(16, *map(len, names))
    lines = [f"{'gain':{width}} {'before':>12} {'after':>12}   {head}"]
    means = result.before.reshape(-1, len(result.margins)).mean(axis=0)
    for name, before, margin in zip(names, means, result.margins, strict=True):
        low, high = (_end(*end) for end in ((margin.low, margin.below), (margin.high, margin.above)))
        lines.append(f"{name:{width}} {before:12.5g} {margin.value:12.5g}   {low} to {high}")
    if result.schedule is not None:
        lines += ["", "above: means over the knots; all knots of a gain are moved together. At each knot:"]
        values = zip(result.labels, result.before, result.after, strict=True)
        lines += [f"{label:24} {before:12.5g} {after:12.5g}" for label, before, after in values]
    return lines


def _slopes(found: Slopes, minimised: str) -> str:
    """The line on chattering, with its figures."""
    text = f"slope of the {minimised} over small steps {found.small:.3g}, over steps of 5 % {found.large:.3g}"
    if found.chattering:
        return f"{text}: the gains chatter, exact gradients mislead here"
    return f"{text}: no chattering"


def _end(value: float, beyond: str) -> str:
    return f"{value:.4g}" + {"free": " or beyond", "fails": "!", "cost": "", "bound": " (bound)"}[beyond]


def _ratio(change: Change) -> str:
    if change.before == 0.0:
        return f"{'-':>9}"
    return f"{change.after / change.before:9.4f}   {change.low:.4f} to {change.high:.4f}"


def _losses(result: TuningResult) -> str:
    lost = [row[~np.isnan(row)] for row in result.comparison.metrics["contact_loss_fraction"]]
    before, after = (int(np.sum(row > 0.0)) for row in lost)
    shares = [as_text(float(np.mean(row)) if len(row) else math.nan, ".2g") for row in lost]
    failed = [int(np.sum(~row)) for row in result.comparison.completed]
    return (
        f"samples that lose contact: {before} before, {after} after (mean share of time {shares[0]} before, "
        f"{shares[1]} after); samples that fail: {failed[0]} before, {failed[1]} after"
    )


def _peaks(result: TuningResult) -> list[str]:
    """The line on the largest contact force, which means over 20 s hide where it is a spike at the start."""
    peaks = result.comparison.metrics.get("force_max")
    if peaks is None or not np.isfinite(peaks).any(axis=1).all():
        return []
    before, after = np.nanmedian(peaks, axis=1)
    return [f"largest contact force, median over the samples: {before:.3g} N before, {after:.3g} N after"]


def _count(result: TuningResult) -> int:
    return result.comparison.costs.shape[1]


def _all_met(result: TuningResult) -> list[int]:
    """Samples that complete and meet every requirement, before and after."""
    met = result.comparison.completed
    for requirement in result.scenario.requirements.parsed():
        met = met & result.comparison.met(requirement)
    return met.sum(axis=1).tolist()


def _requirement(result: TuningResult, requirement: Requirement) -> dict[str, Any]:
    rates = (success(int(met.sum()), len(met))._asdict() for met in result.comparison.met(requirement))
    return {"requirement": str(requirement), "success": dict(zip(("before", "after"), rates, strict=True))}
