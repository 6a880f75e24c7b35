"""The report of a sweep as a page of HTML, from the numbers that ``report`` prints and its figures."""

from __future__ import annotations

import json
import shlex
from collections.abc import Iterator, Sequence

from coopmm_jax.page import Page, Picture, Table, Text
from coopmm_jax.sweeps import slopes_table
from coopmm_jax.sweeps.slopes import Slope
from coopmm_jax.sweeps.statistics import (
    Results,
    damaged,
    failures,
    outcomes,
    robustness,
    sensitivities,
    spread,
    telling,
)

_FAILED = 100  # samples that are listed; failed.csv has them all


def page(results: Results, slopes: Sequence[Slope] = ()) -> Page:
    """Page of a sweep's results; its figures are those of ``report.drawings``.

    Args:
        results: of the sweep.
        slopes: of its success probabilities, if they were asked for.
    """
    attributes, settings = results.data.attrs, results.scenario.simulation
    options = {"samples": results.total, "sampling": attributes["sampling"]}
    options |= {name: attributes[name] for name in ("keep", "batch")}
    words = [word for name, value in options.items() for word in (f"--{name}", str(value))]
    asked = ["--slopes"] if slopes else []
    again = shlex.join(["coopmm", "sweep", "scenario.toml", *words, *asked, "--out", "sweep.zarr"])
    versions = {name: str(version) for name, version in json.loads(attributes["versions"]).items()}
    count = f"{len(results.index)} of {results.total} samples of {settings.duration:g} s, seed {settings.seed}"
    about = [results.scenario.description, count, *damaged(results.data)]
    title = f"Sweep: {results.scenario.description.partition(':')[0] or 'a scenario'}"
    return Page(title, about, [*_parts(results, slopes)], results.scenario.to_toml(), versions, [again])


def _parts(results: Results, slopes: Sequence[Slope]) -> Iterator[Table | Picture | Text]:
    if not results.completed.any():
        yield Text("All samples failed", ["None reached the end of its run, so there are no metrics to show."])
    rows = [
        (
            row.requirement,
            f"{row.passed} of {row.samples}",
            f"{row.success.estimate:.4f}",
            _interval(row.success, ".4f"),
        )
        for row in outcomes(results)
    ]
    yield Table("Requirements", ("requirement", "met", "probability", "95 % interval"), rows)
    yield Picture("Distributions of what is required; hatched beyond the limit", "requirements.png")
    known = results.scenario.requirements.metrics()
    distances = [
        (str(each), known[each.metric].unit, *(f"{x:.4g}" for x in table[:4]), str(table.worst_sample))
        for each in results.requirements
        if (table := robustness(results, each))
    ]
    if distances:
        header = ("requirement", "unit", "median", "5 %", "95 %", "worst", "of sample")
        yield Table("Robustness: distance from the limit, negative where it is broken", header, distances)
    found = [(known[name], table) for name in results.metrics if (table := spread(results, name))]
    numbers = [
        (m.name, m.unit, *(f"{x:.4g}" for x in table[:4]), str(table.worst_sample), m.meaning) for m, table in found
    ]
    if numbers:
        header = ("metric", "unit", "median", "5 %", "95 %", "worst", "of sample", "meaning")
        yield Table("Metrics of the samples that completed", header, numbers)
    yield Picture(
        "Samples over time: median, middle 90 % and whole range, with the desired force and with limits", "bands.png"
    )
    matters = [
        (metric, draw, f"{interval.estimate:+.2f}", _interval(interval, "+.2f"))
        for metric in telling(results)
        for draw, interval in sensitivities(results, metric).items()
    ]
    if matters:
        header = ("metric", "what varies", "rank correlation", "95 % interval")
        yield Table("What matters", header, matters)
    yield Picture("Rank correlations and their intervals", "importance.png")
    yield Picture("Where the worst samples lie in the ranges of what varies", "worst.png")
    yield from slopes_table.tables(slopes)
    if slopes and (lines := slopes_table.remarks(results)):
        yield Text("Requirements without slopes", [line[0].upper() + line[1:] + "." for line in lines])
    failed = failures(results)
    listed = [
        (str(index), status, "" if time is None else f"{time:g}", "; ".join(broken))
        for index, status, time, broken in failed[:_FAILED]
    ]
    if listed:
        header = ("sample", "status", "time [s]", "not met")
        yield Table(f"Samples without success: {len(failed)}, the first {len(listed)}", header, listed)


def _interval(interval: object, form: str) -> str:
    low, high = (format(getattr(interval, end), form) for end in ("low", "high"))
    return f"{low} to {high}"
