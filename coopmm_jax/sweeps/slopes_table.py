"""Slopes of success probabilities as a text to print, a table to keep, and tables of the report's page."""

from __future__ import annotations

import csv
import itertools
from collections.abc import Iterator, Sequence
from pathlib import Path

from coopmm_jax.files import write_csv
from coopmm_jax.page import Table
from coopmm_jax.sweeps.slopes import ALL, Slope, is_counted, slopes
from coopmm_jax.sweeps.statistics import Results

FILE = "slopes.csv"


def text(results: Results, slopes: Sequence[Slope]) -> str:
    """Slopes for a terminal, of each requirement the strongest first; numbers that change nothing are left out."""
    lines = ["slopes of the success probability, by 1 unit of each number (standard error), and by 10 % of it"]
    for requirement, samples, moving in _strongest_first(slopes):
        lines.append(f"{requirement} (from {samples} of {len(results.index)} samples)")
        width = max((len(slope.number) for slope in moving), default=0)
        lines += [
            f"  {slope.number:{width}} {slope.value:9.4g} {slope.slope:+11.4g} ({slope.error:.2g}) "
            f"{0.1 * slope.slope * abs(slope.value):+11.4f}"
            for slope in moving
        ] or ["  none: no sample comes close to it"]
    return "\n".join([*lines, *remarks(results)])


def remarks(results: Results) -> list[str]:
    """The line on requirements without slopes, if there are any."""
    steps = [each.short for each in results.requirements if is_counted(each)]
    if not steps:
        return []
    return [f"without a slope, as they count samples: {', '.join(steps)}; {ALL} is without what they contribute"]


def tables(slopes: Sequence[Slope]) -> Iterator[Table]:
    """A table for each requirement, as ``text`` has them."""
    header = ("number", "value", "slope by 1 unit", "its error", "by 10 % of it")
    for requirement, samples, moving in _strongest_first(slopes):
        rows = [
            (
                slope.number,
                f"{slope.value:.4g}",
                f"{slope.slope:+.4g}",
                f"{slope.error:.2g}",
                f"{0.1 * slope.slope * abs(slope.value):+.4f}",
            )
            for slope in moving
        ]
        title = f"Slopes of the probability of {requirement}, from {samples} samples near its limit"
        yield Table(title, header, rows or [("none: no sample comes close to it", "", "", "", "")])


def _strongest_first(slopes: Sequence[Slope]) -> Iterator[tuple[str, int, list[Slope]]]:
    """Each requirement, the samples under its kernel, and its slopes but those by numbers that change nothing."""
    for requirement, group in itertools.groupby(slopes, lambda slope: slope.requirement):
        rows = sorted(group, key=lambda slope: -abs(slope.slope * slope.value))
        yield requirement, rows[0].samples, [slope for slope in rows if slope.slope or slope.error]


def compute_and_print(folder: Path, results: Results) -> None:
    """Compute the slopes of a sweep, print them, and write slopes.csv into an existing folder.

    Raises:
        UserError: as ``slopes``.
    """
    found = slopes(results)
    write(folder, found)
    print(f"\n{text(results, found)}", flush=True)


def read(folder: Path, results: Results) -> list[Slope]:
    """Slopes from slopes.csv of a folder; none if there is no such file, or it is damaged or of other requirements.

    >>> read(Path("nowhere"), None)
    []
    """
    path = folder / FILE
    if not path.exists():
        return []
    try:
        with path.open(encoding="utf-8", newline="") as file:
            rows = [_parsed(row) for row in csv.DictReader(file)]
    except (KeyError, TypeError, ValueError):
        return []
    asked = {*(str(each) for each in results.requirements if not is_counted(each)), ALL}
    return rows if {row.requirement for row in rows} == asked else []


def _parsed(row: dict[str, str]) -> Slope:
    value, slope, error = (float(row[name]) for name in ("value", "slope", "error"))
    return Slope(row["requirement"], row["number"], value, slope, error, int(row["samples"]))


def write(folder: Path, slopes: Sequence[Slope]) -> None:
    """Write slopes.csv into an existing folder, in full precision."""
    write_csv(folder / FILE, list(Slope._fields), slopes)
