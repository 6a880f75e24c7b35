"""Statistics of a sweep: success probabilities, quantiles, worst samples, and the parameters that matter.

>>> rank_correlation(np.arange(20.0), np.arange(20.0) ** 3).estimate
1.0
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from scipy.stats import norm, rankdata

from coopmm_jax.errors import UserError
from coopmm_jax.metrics.table import low_is_bad, shown
from coopmm_jax.scenario.sampling import sampler
from coopmm_jax.scenario.scenario import Scenario
from coopmm_jax.scenario.sections.requirements import Requirement
from coopmm_jax.scenario.variation import vary
from coopmm_jax.status import Status
from coopmm_jax.sweeps import store
from coopmm_jax.sweeps.intervals import CONFIDENCE, Interval, success

if TYPE_CHECKING:
    import xarray

COMPLETED = "completed"  # stands where a metric's name does for "the rollout reached its horizon"
_OK = 0  # Status.OK; -1 is a sample that has not been computed
_COLUMNS = 4  # read at a time
LOW, HIGH = 0.05, 0.95  # quantiles that tables and bands show


@dataclass(frozen=True, eq=False)
class Results:
    """The n computed samples of a sweep, as far as its report needs them."""

    scenario: Scenario
    total: int  # samples the sweep is to have
    index: np.ndarray  # (n,) of each computed sample
    status: np.ndarray  # (n,) codes of ``Status``
    status_time: np.ndarray  # (n,) of a failure [s]; NaN for none
    metrics: dict[str, np.ndarray]  # (n,) of those shown and of those with a requirement
    draws: dict[str, str]  # name of each draw -> the number that stands for it
    data: xarray.Dataset

    @property
    def completed(self) -> np.ndarray:
        """Samples that reached the horizon (n,), as booleans."""
        return self.status == _OK

    def quantiles(self, positions: np.ndarray) -> dict[str, np.ndarray]:
        """Quantile of each draw in its distribution, for the computed samples at some positions (k,)."""
        points = sampler(self.data.attrs["sampling"], self.scenario.simulation.seed, len(self.draws))
        return dict(zip(self.draws, points(self.index[positions].tolist()).T, strict=True))

    @cached_property
    def correlations(self) -> dict[str, dict[str, Interval]]:
        """Rank correlation of each ``telling`` metric with each draw, in one pass over the draws."""
        measured = {metric: _of(self, metric) for metric in telling(self)}
        ranks = {metric: (which, rankdata(values)) for metric, (which, values) in measured.items()}
        found: dict[str, dict[str, Interval]] = {metric: {} for metric in ranks}
        for draw, x in _columns(self.data.parameters, self.draws, self.index):
            for metric, (which, y_ranks) in ranks.items():
                found[metric][draw] = _correlation(rankdata(x[which]), y_ranks)
        return found

    @property
    def requirements(self) -> tuple[Requirement, ...]:
        """Requirements of the scenario."""
        return self.scenario.requirements.parsed()

    def met(self, requirement: Requirement) -> np.ndarray:
        """Samples that completed and keep a limit (n,), as booleans."""
        return self.completed & requirement.met(self.metrics[requirement.metric])

    def low_is_bad(self, metric: str) -> bool:
        """True if the smallest value of a metric is the worst: as a requirement says, if there is one."""
        for requirement in self.requirements:
            if requirement.metric == metric:
                return requirement.low_is_bad
        return low_is_bad(metric)


class Outcome(NamedTuple):
    """Success probability of a requirement."""

    requirement: str
    passed: int
    samples: int
    success: Interval


class Spread(NamedTuple):
    """Distribution of a metric over the completed samples."""

    median: float
    low: float  # 5 %
    high: float  # 95 %
    worst: float
    worst_sample: int


def read_results(data: xarray.Dataset, scenario: Scenario | None = None) -> Results:
    """Read from a sweep's data set what its report needs.

    Args:
        data: the data set.
        scenario: with other requirements than those the sweep was made with.

    Raises:
        UserError: no sample has been computed yet, or a chunk is corrupt.
    """
    swept = store.scenario_of(data)
    scenario = swept if scenario is None else scenario
    required = [requirement.metric for requirement in scenario.requirements.parsed()]
    kept = set(map(str, data.metric.values))
    for name in required:
        if name not in kept:
            raise UserError(f"requirements.{name}", "a metric that the sweep has measured", "not measured")
    _check_sentences(scenario, swept)
    chosen = [name for name in dict.fromkeys([*required, *shown()]) if name in kept]
    draws: dict[str, str] = {}
    for number in vary(scenario).numbers:
        draws.setdefault(number.draw, number.name)
    status = store.values(data.status)
    index = np.flatnonzero(status >= 0)
    if not len(index):
        raise UserError("store", "a sweep with at least one computed batch", "empty")
    return Results(
        scenario=scenario,
        total=len(status),
        index=index,
        status=status[index],
        status_time=store.values(data.status_time)[index],
        metrics=dict(_columns(data.metrics, {name: name for name in chosen}, index)),
        draws=draws,
        data=data,
    )


def _check_sentences(scenario: Scenario, swept: Scenario) -> None:
    """Refuse sentences that are not those of the sweep, whose robustness it has kept.

    Raises:
        UserError: one is another.
    """
    kept = {each.metric: each.sentence for each in swept.requirements.parsed()}
    for each in scenario.requirements.parsed():
        if each.sentence is not None and each.sentence != kept.get(each.metric):
            before = kept.get(each.metric)
            must = f'"{before.text}", as swept' if before else "a metric that the sweep has measured"
            raise UserError(f"requirements.{each.metric}", must, f'"{each.sentence.text}"')


def _columns(table: xarray.DataArray, names: Mapping[str, str], index: np.ndarray) -> Iterator[tuple[str, np.ndarray]]:
    """Columns (n,) of a table (sample, name), by what ``names`` calls them; a few are read at a time."""
    wanted = list(names.items())
    for first in range(0, len(wanted), _COLUMNS):
        some = wanted[first : first + _COLUMNS]
        read = store.values(table.sel({table.dims[1]: [column for _, column in some]}))
        for i, (name, _) in enumerate(some):
            yield name, read[index, i]


def as_results(sweep: xarray.Dataset | Results) -> Results:
    """Results of a data set, unless they are given already."""
    return sweep if isinstance(sweep, Results) else read_results(sweep)


def outcomes(results: Results) -> list[Outcome]:
    """Success probability of completing at all, of each requirement, and of all of them together."""
    each = {COMPLETED: results.completed} | {str(r): results.met(r) for r in results.requirements}
    each["all together"] = np.logical_and.reduce(list(each.values()))
    n = len(results.index)
    return [Outcome(name, int(met.sum()), n, success(int(met.sum()), n)) for name, met in each.items()]


def spread(results: Results, metric: str) -> Spread | None:
    """Quantiles and worst sample of a metric; None if no sample was completed."""
    return _spread(results, results.metrics[metric], results.low_is_bad(metric))


def robustness(results: Results, requirement: Requirement) -> Spread | None:
    """Distribution of the distance from a limit, in the metric's unit and negative where it is broken."""
    distance = requirement.robustness(results.metrics[requirement.metric]) * requirement.scale
    return _spread(results, distance, low_is_bad=True)


def _spread(results: Results, values: np.ndarray, low_is_bad: bool) -> Spread | None:
    values, index = values[results.completed], results.index[results.completed]
    if not len(values):
        return None
    worst = values.argmin() if low_is_bad else values.argmax()
    median, low, high = map(float, np.quantile(values, [0.5, LOW, HIGH]))
    return Spread(median, low, high, float(values[worst]), int(index[worst]))


def worst_samples(results: Results, metric: str, count: int) -> np.ndarray:
    """Positions (k,), k <= ``count``, among the computed samples of the worst values of a metric, worst first.

    Of ``COMPLETED``: of samples that did not complete.
    """
    if metric == COMPLETED:
        return np.flatnonzero(~results.completed)[:count]
    which, values = _of(results, metric)
    order = np.argsort(values if results.low_is_bad(metric) else -values, kind="stable")
    return which[order[:count]]


def sensitivities(results: Results, metric: str) -> dict[str, Interval]:
    """Rank correlation of a metric with each draw over the completed samples, strongest first; {} if not ``telling``.

    Args:
        results: of the sweep.
        metric: or ``COMPLETED``, which counts in every sample, as 1 or 0.
    """
    found = results.correlations.get(metric, {})
    return dict(sorted(found.items(), key=lambda item: -abs(item[1].estimate)))


def telling(results: Results) -> list[str]:
    """Completion and the required metrics, as far as they differ between samples: worth a panel on their causes."""
    required = [requirement.metric for requirement in results.requirements] or list(results.metrics)
    return list(dict.fromkeys(name for name in (COMPLETED, *required) if _differ(_of(results, name)[1])))


def _differ(values: np.ndarray) -> bool:
    """True if there is anything to correlate; an interval needs four samples."""
    return len(values) >= 4 and bool(np.any(values != values[0]))


def _of(results: Results, metric: str) -> tuple[np.ndarray, np.ndarray]:
    """Positions among the computed samples for which a metric counts, and its values there."""
    if metric == COMPLETED:
        return np.arange(len(results.index)), results.completed.astype(float)
    which = np.flatnonzero(results.completed)
    return which, results.metrics[metric][which]


def rank_correlation(x: np.ndarray, y: np.ndarray) -> Interval:
    """Spearman's rank correlation of x (N,) and y (N,), N >= 4, with its 95 % interval.

    Fisher's transformation with the variance of Bonett and Wright (2000), (1 + r^2 / 2) / (n - 3).
    """
    return _correlation(rankdata(x), rankdata(y))


def _correlation(x_ranks: np.ndarray, y_ranks: np.ndarray) -> Interval:
    r = float(np.corrcoef(x_ranks, y_ranks)[0, 1])
    if abs(r) >= 1.0:
        return Interval(r, r, r)
    half = norm.ppf(0.5 + CONFIDENCE / 2) * np.sqrt((1.0 + r**2 / 2.0) / (len(x_ranks) - 3))
    return Interval(r, float(np.tanh(np.arctanh(r) - half)), float(np.tanh(np.arctanh(r) + half)))


def damaged(data: xarray.Dataset) -> list[str]:
    """Batches of a store that are not as they were written, with their samples and the file at fault."""
    return list(json.loads(data.attrs.get("damaged", "{}")).values())


def failures(results: Results) -> list[tuple[int, str, float | None, list[str]]]:
    """Index, status, time [s] and broken requirements of samples without success; those not completed come first."""
    met = {requirement.short: results.met(requirement) for requirement in results.requirements}
    completed, rows = results.completed, []
    for i in np.flatnonzero(~np.logical_and.reduce([completed, *met.values()])).tolist():
        time = None if completed[i] else float(results.status_time[i])
        broken = [name for name, kept in met.items() if not kept[i]] if completed[i] else []
        rows.append((int(results.index[i]), Status(int(results.status[i])).name, time, broken))
    return sorted(rows, key=lambda row: row[1] == Status.OK.name)
