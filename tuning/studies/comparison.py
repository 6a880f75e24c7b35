"""Several sets of gains on the same samples: costs, terms and metrics, paired sample by sample."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import TYPE_CHECKING, NamedTuple

import jax
import numpy as np

from coopmm_jax.parameters import Parameters
from coopmm_jax.scenario.sections.requirements import Requirement
from coopmm_jax.scenario.variation import batched
from coopmm_jax.status import Status
from coopmm_jax.sweeps import measure
from coopmm_jax.sweeps.batch import Device, in_batches, slots
from coopmm_jax.sweeps.engine import naming
from coopmm_jax.sweeps.measure import Horizon
from coopmm_jax.temporal_logic.sentence import Sentences
from tuning.cost import evaluate
from tuning.cost.evaluate import BATCH, Samples
from tuning.cost.risk import tail_shares

if TYPE_CHECKING:
    from tuning.cost.problem import Problem

BOOTSTRAPS = 2000
BANDS = 32  # samples whose series are kept for figures


class Comparison(NamedTuple):
    """S sets of gains, as tuning's before (0) and after (1), along the first axis; the N samples are the same."""

    costs: np.ndarray  # (S, N)
    terms: np.ndarray  # (S, N, 9) time averages, in the order of TERMS, of a failed rollout until then
    metrics: dict[str, np.ndarray]  # (S, N) by name
    status: np.ndarray  # (S, N) codes of ``Status``
    times: np.ndarray  # (T,) [s]
    series: dict[str, np.ndarray]  # (S, B, T) of the first samples, by name; NaN from a failure on

    @property
    def completed(self) -> np.ndarray:
        """Rollouts that reached the horizon (S, N), as booleans."""
        return self.status == Status.OK

    def met(self, requirement: Requirement) -> np.ndarray:
        """Rollouts that completed and keep a limit (S, N), as booleans."""
        return self.completed & requirement.met(self.metrics[requirement.metric])


def compare(problem: Problem, vectors: np.ndarray, first: int, count: int) -> Comparison:
    """The gains of S vectors (S, n) on the samples ``first`` to ``first + count - 1``, over the whole duration."""
    cost, samples = problem.cost, problem.samples(first, count)
    found = evaluate.evaluate(cost.objective, vectors, samples)
    horizon = _horizon(problem)
    measured = [_measured(problem, vector, samples, horizon) for vector in vectors]
    names = problem.scenario.requirements.metrics()
    bands = problem.samples(first, min(count, BANDS))
    series = [_series(problem, vector, bands, horizon) for vector in vectors]
    return Comparison(
        costs=found.costs(cost.coefficients),
        terms=found.terms,
        metrics={name: np.stack([one.metrics[:, i] for one in measured]) for i, name in enumerate(names)},
        status=np.stack([one.status for one in measured]),
        times=horizon.times(),
        series={name: np.stack([one[name] for one in series]) for name in series[0]},
    )


def stacked(rows: Sequence[tuple[Comparison, int]]) -> Comparison:
    """One comparison of sets from several on the same samples.

    Args:
        rows: for each set, the comparison that has it, and its place there.
    """

    def row(of: Callable[[Comparison], np.ndarray]) -> np.ndarray:
        return np.stack([of(each)[i] for each, i in rows])

    first = rows[0][0]
    return Comparison(
        costs=row(lambda each: each.costs),
        terms=row(lambda each: each.terms),
        metrics={name: row(lambda each, name=name: each.metrics[name]) for name in first.metrics},
        status=row(lambda each: each.status),
        times=first.times,
        series={name: row(lambda each, name=name: each.series[name]) for name in first.series},
    )


def compile_ahead(problem: Problem) -> None:
    """Compile what ``compare`` runs but the costs."""
    parameters = _with_gains(problem, problem.start, problem.samples(0, 1), np.zeros(BATCH, int))
    measure.compile_ahead(
        problem.variation.structure(), _horizon(problem), slots(BATCH)[0], parameters, _sentences(problem)
    )


def _sentences(problem: Problem) -> Sentences:
    return problem.scenario.requirements.sentences()


def _horizon(problem: Problem) -> Horizon:
    return Horizon(problem.scenario.sample_time, problem.scenario.steps, "float64")


def _with_gains(problem: Problem, vector: np.ndarray, samples: Samples, rows: np.ndarray) -> Parameters:
    """Parameters of some samples (B,) under the gains of a vector, for a batch."""
    return batched(problem.space.applied(samples.parameters(rows), vector), len(rows))


def _measured(problem: Problem, vector: np.ndarray, samples: Samples, horizon: Horizon) -> measure.Measured:
    """Metrics and status of every sample (N)."""

    def compute(device: Device, rows: np.ndarray) -> measure.Measured:
        with jax.enable_x64(True):
            parameters = _with_gains(problem, vector, samples, rows)
        with naming(f"samples {rows[0]} to {rows[-1]}"):
            return measure.measure(problem.variation.structure(), horizon, device, parameters, _sentences(problem))

    return in_batches(compute, len(samples), BATCH)


def _series(problem: Problem, vector: np.ndarray, samples: Samples, horizon: Horizon) -> dict[str, np.ndarray]:
    rows = np.minimum(np.arange(BANDS), len(samples) - 1)
    parameters = _with_gains(problem, vector, samples, rows)
    found = measure.trace(problem.variation.structure(), horizon, slots(BANDS)[0], parameters)
    return {name: values[: len(samples)] for name, values in found.items()}


class Change(NamedTuple):
    """A statistic before and after, and the paired bootstrap's 95 % interval of after / before."""

    before: float
    after: float
    low: float
    high: float


Statistic = Callable[[np.ndarray], np.ndarray]  # of values (..., N), along the last axis
mean: Statistic = partial(np.mean, axis=-1)


def ratio(values: np.ndarray, statistic: Statistic = mean, seed: int = 0) -> Change:
    """Change of a statistic of paired values (2, N).

    >>> ratio(np.array([[2.0, 4.0], [1.0, 2.0]]))
    Change(before=3.0, after=1.5, low=0.5, high=0.5)
    """
    draws = np.random.default_rng(seed).integers(values.shape[1], size=(BOOTSTRAPS, values.shape[1]))
    blocks = np.array_split(draws, 20)  # so that what is drawn never takes much memory
    before, after = (np.concatenate([statistic(row[block]) for block in blocks]) for row in values)
    ratios = after / np.maximum(before, 1e-300)
    low, high = np.quantile(ratios, [0.025, 0.975])
    return Change(float(statistic(values[0])), float(statistic(values[1])), float(low), float(high))


def tail_mean(costs: np.ndarray, level: float) -> np.ndarray:
    """Mean of the worst (1 - level) N of costs (..., N): the conditional value at risk.

    >>> float(tail_mean(np.arange(10.0), 0.8))
    8.5
    """
    return np.sum(np.sort(costs)[..., ::-1] * tail_shares(costs.shape[-1], level), axis=-1)


# What tables say of the costs of many samples, by name.
STATISTICS: dict[str, Statistic] = {
    "cost, mean": mean,
    "cost, CVaR(0.9)": partial(tail_mean, level=0.9),
    "cost, worst": partial(np.max, axis=-1),
}
