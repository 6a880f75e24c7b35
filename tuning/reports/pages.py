"""Reports of tune, compare and falsify as pages of HTML: the numbers of their tables, and their figures."""

from __future__ import annotations

import functools
import shlex
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from coopmm_jax.kinds.software import versions
from coopmm_jax.page import Page, Picture, Table, Text, keep_page, write_page
from coopmm_jax.plotting.style import publish
from coopmm_jax.scenario.scenario import Scenario
from coopmm_jax.scenario.sections.requirements import Requirement
from coopmm_jax.sweeps.intervals import Interval, success
from tuning.cost.objective import FAILED
from tuning.reports import goals
from tuning.reports.owners import entry_owners
from tuning.studies.comparison import Change
from tuning.studies.falsify import said
from tuning.studies.margins import RISE

_CAPTIONS = {
    "convergence": "Course of the search: what is minimised, of the best gains so far, over simulated steps",
    "gains": "Tuned gains before and after",
    "front": "Quality over effort: a point for each weight of effort, named by it; dominated ones are beaten in both",
    "costs": "Costs of all samples: under each set of gains against the first, and the ratio of both",
    "bands": "Median and middle 90 % of the samples over time, with the desired force and with limits",
    "requirements": "What is required, sample by sample: bars from 5 to 95 %, marks at medians, hatched beyond limits",
}


def write_pictures_and_page(folder: Path, drawn: Sequence[Callable[..., Figure]], study: Any, page: Page) -> None:
    """Draw a study's figures into a folder, and write its page with them in it.

    Args:
        folder: of the results.
        drawn: functions of the study that draw.
        study: what they draw.
        page: without the figures, which go behind its first part.
    """
    publish(folder, {f"{draw.__name__}.png": functools.partial(draw, study) for draw in drawn})
    pictures = [Picture(_CAPTIONS[draw.__name__], f"{draw.__name__}.png") for draw in drawn]
    page = page._replace(parts=[*page.parts[:1], *pictures, *page.parts[1:]])
    keep_page(folder, page)
    write_page(folder, page)


def change_table(changes: Mapping[str, Change], names: tuple[str, str]) -> Table:
    """Costs and terms under two sets of gains, with the interval of their ratio."""
    rows = [(name, f"{c.before:.5g}", f"{c.after:.5g}", *_ratio(c)) for name, c in changes.items()]
    return Table("Costs", ("", *names, "ratio", "95 % interval"), rows)


def rate_table(met: Mapping[str, np.ndarray], labels: Sequence[str]) -> Table:
    """Success probabilities under each set of gains.

    Args:
        met: samples (S, N) that meet each requirement, as booleans.
        labels: of the S sets.
    """
    rows = [(name, *(_rate(success(int(row.sum()), len(row))) for row in rows)) for name, rows in met.items()]
    return Table("Success probabilities (95 % interval)", ("requirement", *labels), rows)


def tune_page(result: Any, changes: Mapping[str, Change], notes: Sequence[str], start: Scenario | None) -> Page:
    """Page of a tuning.

    Args:
        result: of it.
        changes: costs before and after.
        notes: lines of its report.
        start: the scenario that was tuned; that with tuned gains if left out.
    """
    scenario, comparison = start or result.scenario, result.comparison
    count = comparison.costs.shape[1]
    about = [scenario.description, f"{count} samples by which no gains were chosen, over the whole duration."]
    met = {str(r): comparison.met(r) for r in scenario.requirements.parsed()}
    if met:
        met["all together"] = np.logical_and.reduce([comparison.completed, *met.values()])
    costs, rates = change_table(changes, ("before", "after")), rate_table(met, ("before", "after"))
    parts = [costs, *goals.tables(result), rates, *_gains(result), Text("Remarks", notes)]
    if result.conflict:
        parts.append(Text("Conflict", [str(result.conflict)]))
    commands = ["coopmm tune scenario.toml --out tuned", "coopmm simulate scenario.toml --gains-file tuned"]
    return Page("Tuning", about, parts, scenario.to_toml(), versions(), commands)


def compare_page(
    compared: Any,
    sources: Sequence[Any],
    changes: Sequence[Mapping[str, Change]],
    switched: Mapping[str, Sequence[str]],
) -> Page:
    """Page of a comparison.

    Args:
        compared: the comparison.
        sources: of the sets of gains, as the user named them.
        changes: costs under the first set and under each of the others.
        switched: changed outcomes of each requirement, a text for each of the others.
    """
    labels, settings = compared.labels, compared.scenario.simulation
    about = [compared.scenario.description]
    about.append(
        f"{compared.samples} samples of {settings.duration:g} s, seed {settings.seed}, the same for every set."
    )
    if not compared.comparison.completed.all():
        about.append(f"A rollout that fails costs {FAILED:g} or more; terms are those of the samples that complete.")
    parts: list[Table] = []
    for label, found in zip(labels[1:], changes, strict=True):
        parts.append(change_table(found, (labels[0], label))._replace(title=f"{label} against {labels[0]}"))
    parts.append(rate_table(compared.outcomes(), labels))
    header = (f"outcomes against {labels[0]}", *labels[1:])
    parts.append(Table("Outcomes that other gains change", header, [(name, *row) for name, row in switched.items()]))
    words = ["coopmm", "compare", *map(str, sources or labels), "--scenario", "scenario.toml"]
    words += ["--samples", str(compared.samples), "--out", "compared"]
    return Page("Comparison of gains", about, parts, compared.scenario.to_toml(), versions(), [shlex.join(words)])


def front_page(front: Any, rows: Sequence[Mapping[str, Any]]) -> Page:
    """Page of a front between quality and effort.

    Args:
        front: of ``tune_front``.
        rows: of its table, the start first.
    """
    scenario, count = front.scenario, len(front.weights)
    samples, duration = scenario.tuning.test_samples, scenario.simulation.duration
    about = [scenario.description, f"{samples} samples of {duration:g} s by which no gains were chosen."]
    about.append(
        "Quality and effort are means over the samples: small is good, and about 1 under the scenario's gains."
    )
    marks = ("", "yes")
    points = [
        (
            row["gains"],
            weight_text(row),
            *(f"{row[name]:.5g}" for name in ("quality", "effort")),
            *(f"{row[f'validation_{name}']:.5g}" for name in ("quality", "effort")),
            marks[row["dominated"]],
        )
        for row in rows
    ]
    header = ("gains", "weight of effort", "quality", "effort", "quality (validation)", "effort (validation)")
    owners = entry_owners(scenario)
    values = [
        (label, owners.get(label.partition("@")[0], ""), *(f"{row[label]:.5g}" for row in rows))
        for label in front.labels
    ]
    parts = [
        Table("Quality and effort", (*header, "dominated"), points),
        Picture(_CAPTIONS["front"], "front.png"),
        Table("Gains", ("gain", "of", *(row["gains"].removesuffix(".toml") for row in rows)), values),
    ]
    commands = [f"coopmm tune scenario.toml --pareto {count} --out front"]
    files = " ".join(f"front/{row['gains']}" for row in rows[1:])
    commands.append(f"coopmm compare scenario {files} --scenario scenario.toml --out compared")
    return Page("Front between quality and effort", about, parts, scenario.to_toml(), versions(), commands)


def weight_text(row: Mapping[str, Any]) -> str:
    """Weight of effort of a row of the front, for a reader; none of the start."""
    return "" if row["weight"] == "" else f"{row['weight']:.4g}"


def falsify_page(found: Any, random: np.ndarray | None, scenario: Scenario, file: str, budget: tuple[int, int]) -> Page:
    """Page of a search for the worst sample.

    Args:
        found: the sample.
        random: costs (N,) of random samples, if there are any to compare with.
        scenario: that was searched.
        file: name of the scenario file of the sample.
        budget: rollouts and starts of the search.
    """
    rows = [("sample found", _height(found, found.cost)), ("scenario itself", _height(found, found.nominal_cost))]
    if random is not None:
        failures = int(np.sum(random >= FAILED))
        worst = f"{failures} fail" if failures else _height(found, float(np.max(random)))
        rows.append((f"worst of {len(random)} random samples", worst))
    climbed = ("Costs", "cost") if found.requirement is None else ("Robustness", str(found.requirement))
    numbers = [(name, f"{found.nominal[name]:.6g}", f"{round(value, 12):.6g}") for name, value in found.numbers.items()]
    parts = [
        Table(climbed[0], ("", climbed[1]), rows),
        Picture(_over_time(found.requirement), Path(file).with_suffix(".png").name),
        Table("Numbers that vary", ("number", "scenario", "found"), numbers),
    ]
    about = [scenario.description, f"{found.rollouts} rollouts, {found.steps} steps. The sample is in {file}."]
    chosen = "" if found.requirement is None else f" --requirement {found.requirement.metric}"
    search = f"coopmm falsify scenario.toml{chosen} {_spending(budget)} --out worst.toml"
    commands = [search, f"coopmm simulate {file}"]
    return Page("The sample that hurts most", about, parts, scenario.to_toml(), versions(), commands)


def modes_page(modes: Any, files: Sequence[str], scenario: Scenario, budget: tuple[int, int]) -> Page:
    """Page of a search for different failures.

    Args:
        modes: the failures.
        files: names of their scenario files.
        scenario: that was searched.
        budget: rollouts for each requirement, and starts.
    """
    names = list(modes.found[0].numbers)
    nominal = (f"{modes.found[0].nominal[name]:.6g}" for name in names)
    rows = [("scenario itself", "", "", *nominal)]
    for file, found, broken in zip(files, modes.found, modes.broken, strict=True):
        values = (f"{round(found.numbers[name], 12):.6g}" for name in names)
        rows.append((file, said(found.requirement, found.cost), ", ".join(broken), *values))
    parts: list[Table | Picture] = [Table("Failures", ("file", "climbed against", "broken in all", *names), rows)]
    for file, found in zip(files, modes.found, strict=True):
        parts.append(Picture(f"{file}: {_over_time(found.requirement)}", Path(file).with_suffix(".png").name))
    about = [scenario.description, f"{modes.rollouts} rollouts, against {', '.join(map(str, modes.searched))}."]
    chosen = f"--requirement {modes.searched[0].metric} " if len(modes.searched) == 1 else ""
    search = f"coopmm falsify scenario.toml {chosen}--modes {len(files)} {_spending(budget)} --out failures"
    commands = [search, "coopmm check failures --gains-file tuned"]
    return Page("Different failures", about, parts, scenario.to_toml(), versions(), commands)


def _spending(budget: tuple[int, int]) -> str:
    return f"--rollouts {budget[0]} --starts {budget[1]}"


def _over_time(requirement: Requirement | None) -> str:
    about = "What the cost is about" if requirement is None else f"What is required by {requirement}"
    return f"{about}, over time: in the sample found, and in the scenario itself"


def _height(found: Any, height: float) -> str:
    """Cost of a sample, or how far it is from the requirement."""
    if found.requirement is not None:
        return said(found.requirement, height)
    return "the rollout fails" if height >= FAILED else f"{height:.6g}"


def _gains(result: Any) -> Iterator[Table]:
    means = result.before.reshape(-1, len(result.margins)).mean(axis=0)
    ends = {"free": " or beyond", "fails": " (a robot fails)", "cost": "", "bound": " (its bound)"}
    owners = entry_owners(result.scenario)
    rows = [
        (
            m.name,
            owners.get(m.name, ""),
            f"{before:.5g}",
            f"{m.value:.5g}",
            f"{m.low:.4g}{ends[m.below]}",
            f"{m.high:.4g}{ends[m.above]}",
        )
        for before, m in zip(means, result.margins, strict=True)
    ]
    minimised = result.scenario.tuning.minimised
    title = f"Gains, and how far each may go alone within its bounds until the {minimised} rises by {RISE:.0%}"
    yield Table(title, ("gain", "of", "before", "after", "down to", "up to"), rows)
    if result.schedule is not None:
        values = zip(result.labels, result.before, result.after, strict=True)
        knots = [(label, f"{before:.5g}", f"{after:.5g}") for label, before, after in values]
        yield Table("Gains at each knot; above: means over the knots", ("gain", "before", "after"), knots)


def _ratio(change: Change) -> tuple[str, str]:
    if not change.before > 0.0:
        return "-", ""
    return f"{change.after / change.before:.4f}", f"{change.low:.4f} to {change.high:.4f}"


def _rate(rate: Interval) -> str:
    return f"{rate.estimate:.3f} ({rate.low:.3f} to {rate.high:.3f})"
