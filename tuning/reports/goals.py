"""Hard and soft requirements in the report of a tuning: those kept on untouched robots, by what margin, how surely."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from coopmm_jax.page import Table
from coopmm_jax.scenario.sections.requirements import Requirement
from coopmm_jax.sweeps.intervals import Interval, success
from coopmm_jax.sweeps.statistics import LOW

_WORDS = {
    "worst": "the worst robot",
    "cvar": "the mean of the worst {tail:g} of the robots",
    "fraction": "{level:g} of the robots",
}
_WHEN = ("before", "after")


class Standing(NamedTuple):
    """One requirement on untouched robots, under the gains before and after."""

    requirement: Requirement
    unit: str
    kept: tuple[Interval, ...]  # share of the robots, with its interval
    worst: tuple[float, ...]  # smallest robustness of the robots that complete; NaN where none does
    low: tuple[float, ...]  # that of 5 % of them
    median: tuple[float, ...]

    @property
    def kind(self) -> str:
        """Word for what the tuner makes of it."""
        return "hard" if self.requirement.hard else "soft"


def standings(result: Any) -> list[Standing]:
    """Every requirement of a tuning's result, in the order of the scenario; robustness in its unit."""
    known, comparison = result.scenario.requirements.metrics(), result.comparison
    found = []
    for each in result.scenario.requirements.parsed():
        values = each.robustness(comparison.metrics[each.metric]) * each.scale
        rows = [row[ok] for row, ok in zip(values, comparison.completed, strict=True)]
        kept = [success(int(met.sum()), len(met)) for met in comparison.met(each)]
        quantiles = [np.quantile(row, [0.0, LOW, 0.5]) if len(row) else np.full(3, np.nan) for row in rows]
        worst, low, median = (tuple(map(float, pair)) for pair in zip(*quantiles, strict=True))
        found.append(Standing(each, known[each.metric].unit, tuple(kept), worst, low, median))
    return found


def all_hard(result: Any) -> tuple[Interval, Interval] | None:
    """Share of the robots that complete and keep all hard requirements, before and after; None where none is hard."""
    comparison = result.comparison
    hard = [comparison.met(each) for each in result.scenario.requirements.parsed() if each.hard]
    if not hard:
        return None
    before, after = np.logical_and.reduce([comparison.completed, *hard])
    return success(int(before.sum()), len(before)), success(int(after.sum()), len(after))


def lines(result: Any) -> list[str]:
    """The block of the report; nothing where the cost was minimised."""
    if result.scenario.tuning.goals != "requirements":
        return []
    text = [
        f"goals: soft requirements, as far as hard ones are kept by {_over(result)}; robustness on untouched robots"
    ]
    stated = standings(result)
    width = max(len(each.requirement.short) for each in stated)
    text.append(f"{'':{width + 5}} {'':6} {'worst':>11} {'5 %':>11} {'median':>11}   kept by (95 % interval)")
    for each in stated:
        for i, when in enumerate(_WHEN):
            name = f"{each.kind} {each.requirement.short}" if i == 0 else ""
            numbers = " ".join(f"{values[i]:11.4g}" for values in (each.worst, each.low, each.median))
            text.append(f"{name:{width + 5}} {when:6} {numbers} {each.unit:>4}   {_share(each.kept[i])}")
    together = all_hard(result)
    if together is not None:
        shares = ", ".join(f"{_share(share)} {when}" for share, when in zip(together, _WHEN, strict=True))
        text.append(f"all hard requirements: kept by {shares}")
    return [*text, *([str(result.conflict)] if result.conflict else []), ""]


def content(result: Any) -> dict[str, Any]:
    """Numbers of the block by name, for report.json; nothing where the cost was minimised."""
    if result.scenario.tuning.goals != "requirements":
        return {}
    rows = [
        {"requirement": str(each.requirement), "hard": each.requirement.hard, "unit": each.unit}
        | {name: dict(zip(_WHEN, getattr(each, name), strict=True)) for name in ("worst", "low", "median")}
        for each in standings(result)
    ]
    together = all_hard(result)
    shares = together and {when: share._asdict() for when, share in zip(_WHEN, together, strict=True)}
    conflict = result.conflict and result.conflict._asdict()
    return {"goals": {"requirements": rows, "all_hard": shares, "conflict": conflict}}


def tables(result: Any) -> list[Table]:
    """Table of the page; none where the cost was minimised."""
    if result.scenario.tuning.goals != "requirements":
        return []
    rows = []
    for each in standings(result):
        pairs = (f"{each.worst[i]:.4g} / {each.low[i]:.4g} / {each.median[i]:.4g}" for i in range(2))
        rows.append((each.kind, str(each.requirement), each.unit, *pairs, _share(each.kept[1])))
    header = ("", "requirement", "unit", "before: worst / 5 % / median", "after", "kept after (95 % interval)")
    return [Table(f"Goals: robustness, hard requirements over {_over(result)}", header, rows)]


def _over(result: Any) -> str:
    settings = result.scenario.tuning
    return _WORDS[settings.hard_over].format(tail=round(1.0 - settings.hard_level, 12), level=settings.hard_level)


def _share(share: Interval) -> str:
    return f"{share.estimate:.4f} ({share.low:.4f} to {share.high:.4f})"
