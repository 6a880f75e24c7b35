"""Slopes of success probabilities as a text to print and a table to keep."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from pathlib import Path

from coopmm_jax.files import write_csv
from coopmm_jax.sweeps.slopes import ALL, Slope, is_counted
from coopmm_jax.sweeps.statistics import Results

FILE = "slopes.csv"


def text(results: Results, slopes: Sequence[Slope]) -> str:
    """Slopes for a terminal, of each requirement the strongest first; numbers that change nothing are left out."""
    lines = ["slopes of the success probability, by 1 unit of each number (standard error), and by 10 % of it"]
    for requirement, group in itertools.groupby(slopes, lambda slope: slope.requirement):
        rows = sorted(group, key=lambda slope: -abs(slope.slope * slope.value))
        lines.append(f"{requirement} (from {rows[0].samples} of {len(results.index)} samples)")
        moving = [slope for slope in rows if slope.slope or slope.error]
        width = max((len(slope.number) for slope in moving), default=0)
        lines += [
            f"  {slope.number:{width}} {slope.value:9.4g} {slope.slope:+11.4g} ({slope.error:.2g}) "
            f"{0.1 * slope.slope * abs(slope.value):+11.4f}"
            for slope in moving
        ] or ["  none: no sample comes close to it"]
    steps = [each.short for each in results.requirements if is_counted(each)]
    if steps:
        lines.append(
            f"without a slope, as they count samples: {', '.join(steps)}; {ALL} is without what they contribute"
        )
    return "\n".join(lines)


def write(folder: Path, slopes: Sequence[Slope]) -> None:
    """Write slopes.csv into an existing folder, in full precision."""
    write_csv(folder / FILE, list(Slope._fields), slopes)
