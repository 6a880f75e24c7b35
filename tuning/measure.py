"""Two sets of gains on the same samples: costs, terms and metrics, paired sample by sample."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import jax
import numpy as np

from coopmm_jax import sweep_tiles
from coopmm_jax.distributed import concurrently, slots
from coopmm_jax.metric_table import METRICS
from coopmm_jax.sweep_tiles import Horizon
from tuning import tiles
from tuning.tiles import TILE, Samples

if TYPE_CHECKING:
    from tuning.problem import Problem

BOOTSTRAPS = 2000
BANDS = 32  # samples whose series are kept for figures


class Comparison(NamedTuple):
    """Before (0) and after (1), along the first axis of every array; the samples are the same."""

    costs: np.ndarray  # (2, N)
    terms: np.ndarray  # (2, N, 9) time averages, in the order of TERMS
    metrics: dict[str, np.ndarray]  # (2, N) by name
    completed: np.ndarray  # (2, N)
    times: np.ndarray  # (T,) [s]
    series: dict[str, np.ndarray]  # (2, B, T) of the first samples, by name


def compare(problem: Problem, vectors: np.ndarray, first: int, count: int) -> Comparison:
    """The gains of two vectors (2, n) on the samples ``first`` to ``first + count - 1``, over the whole duration."""
    search, samples = problem.validation, problem.samples(first, count)
    found = tiles.evaluate(search.objective, vectors, samples)
    scenario = problem.scenario
    horizon = Horizon(scenario.sample_time, scenario.steps, "float64")
    measured = [_measured(problem, vector, samples, horizon) for vector in vectors]
    bands = problem.samples(first, min(count, BANDS))
    series = [_series(problem, vector, bands, horizon) for vector in vectors]
    return Comparison(
        costs=found.costs(search.coefficients),
        terms=found.terms,
        metrics={name: np.stack([table[:, i] for table in measured]) for i, name in enumerate(METRICS)},
        completed=found.completed,
        times=horizon.times(),
        series={name: np.stack([one[name] for one in series]) for name in series[0]},
    )


def _with_gains(problem: Problem, vector: np.ndarray, samples: Samples, rows: np.ndarray) -> object:
    """Parameters of some samples under the gains of a vector, every leaf (B,)."""
    gains = jax.tree.map(lambda x: np.broadcast_to(np.asarray(x), len(rows)), problem.space.gains(vector))
    parameters = jax.tree.unflatten(samples.structure, list(samples.rows[rows].T))
    return parameters._replace(gains=gains)


def _measured(problem: Problem, vector: np.ndarray, samples: Samples, horizon: Horizon) -> np.ndarray:
    """Metrics of every sample (N, M)."""
    results: dict[int, np.ndarray] = {}

    def compute(device: jax.Device, start: int) -> None:
        rows = np.minimum(np.arange(start, start + TILE), len(samples) - 1)
        with jax.enable_x64(True):
            parameters = _with_gains(problem, vector, samples, rows)
        results[start] = sweep_tiles.measure(problem.variation.structure(), horizon, device, parameters).metrics

    for _ in concurrently(compute, range(0, len(samples), TILE), slots()):
        pass
    return np.concatenate([results[start] for start in sorted(results)])[: len(samples)]


def _series(problem: Problem, vector: np.ndarray, samples: Samples, horizon: Horizon) -> dict[str, np.ndarray]:
    rows = np.minimum(np.arange(BANDS), len(samples) - 1)
    parameters = _with_gains(problem, vector, samples, rows)
    found = sweep_tiles.trace(problem.variation.structure(), horizon, slots()[0], parameters)
    return {name: values[: len(samples)] for name, values in found.items()}


class Change(NamedTuple):
    """A statistic before and after, and the paired bootstrap's 95 % interval of after / before."""

    before: float
    after: float
    low: float
    high: float


def ratio(values: np.ndarray, statistic: object = np.mean, seed: int = 0) -> Change:
    """How a statistic of paired values (2, N) changed.

    >>> ratio(np.array([[2.0, 4.0], [1.0, 2.0]]))
    Change(before=3.0, after=1.5, low=0.5, high=0.5)
    """
    draws = np.random.default_rng(seed).integers(values.shape[1], size=(BOOTSTRAPS, values.shape[1]))
    before, after = (np.array([statistic(row[draw]) for draw in draws]) for row in values)
    ratios = after / np.maximum(before, 1e-300)
    low, high = np.quantile(ratios, [0.025, 0.975])
    return Change(float(statistic(values[0])), float(statistic(values[1])), float(low), float(high))
