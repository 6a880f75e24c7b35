"""The front between quality and effort: descents for several weightings at once, ``coopmm tune --pareto``.

What is simulated does not depend on the weights, so the race's and the validation's rollouts serve every weighting:
each is scored for all of them, and whatever one weighting finds may become the point of another.

>>> non_dominated(np.array([[1.0, 3.0], [2.0, 2.0], [2.0, 4.0]]))
array([ True,  True, False])
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import jax
import numpy as np

from coopmm_jax.errors import UserError
from coopmm_jax.parameters import Gains
from coopmm_jax.scenario.scenario import Scenario
from tuning.cost import evaluate
from tuning.cost.evaluate import Evaluated
from tuning.cost.objective import TERMS
from tuning.cost.problem import RACE, TEST, TRAINING, VALIDATION, Problem, build_problem
from tuning.search import method
from tuning.search.method import Candidate

EFFORT = ("effort", "torque_variation", "saturation")  # all other terms are of quality
WEIGHTS = (0.01, 10.0)  # smallest and largest weight of effort against quality

Progress = Callable[["Round"], None]


class Round(NamedTuple):
    """One iteration of all descents."""

    iteration: int
    improved: int  # weightings whose validation risk fell
    rejected: int  # steps that were rejected or shortened


@dataclass
class Progressing:
    """What changes from iteration to iteration."""

    candidates: list[Candidate]  # of the first weighting, then of the second, ...
    best: np.ndarray  # vector of the lowest validation risk of each weighting (K, n)
    risks: np.ndarray  # that risk (K,)
    tried: list[np.ndarray]  # means of quality and effort of all that was validated, each (2,)


@dataclass(frozen=True)
class Front:
    """Gains for K weightings; quality and effort are means over samples and about 1 under the scenario's gains."""

    scenario: Scenario
    labels: list[str]  # of the tuned numbers (n,)
    weights: np.ndarray  # of effort against quality (K,)
    gains: list[Gains]  # (K,)
    values: np.ndarray  # the tuned numbers (1 + K, n), first the scenario's
    points: np.ndarray  # (quality, effort) on the untouched samples (1 + K, 2)
    validation: np.ndarray  # the same on the samples that chose them (1 + K, 2)
    tried: np.ndarray  # the same of everything that was validated (M, 2)

    @property
    def dominated(self) -> np.ndarray:
        """Which weightings (K,) end in gains that another's, or the scenario's, beat on the untouched samples."""
        return ~non_dominated(self.points)[1:]


def non_dominated(points: np.ndarray) -> np.ndarray:
    """Which of M points (M, d), all of whose numbers should be small, no other is as good as in all and better in one.

    >>> non_dominated(np.array([[1.0, 1.0], [1.0, 1.0], [1.0, 2.0]]))
    array([ True,  True, False])
    """
    no_worse = np.all(points[:, None] <= points[None], axis=-1)
    better = np.any(points[:, None] < points[None], axis=-1)
    return ~np.any(no_worse & better, axis=0)


def tune_front(scenario: Scenario, count: int, progress: Progress | None = None) -> Front:
    """Tune gains for ``count`` weightings between quality and effort, side by side.

    The cost of a weighting is (quality + w effort) / (1 + w); inside quality and effort the terms have the weights of
    [tuning.weights]. Each weighting descends from its own tuning.survivors of a common race.

    Args:
        scenario: needs [uncertainty]. count: at least 2. progress: called after every iteration.

    Raises:
        UserError: fewer than two weightings, no weight on quality or on effort, or settings that cannot be met.
    """
    if count < 2:
        raise UserError("--pareto", "at least 2 weightings", count)
    s = scenario.tuning
    with jax.enable_x64(True):
        chosen = method.method(s.optimiser, s.learning_rate, s.schedule, s.clip, s.iterations * s.steps)
        groups = _groups(scenario)
        problem = build_problem(scenario, descends=True)
        weights = np.geomspace(*WEIGHTS, count)
        mix = np.stack([np.ones(count), weights], axis=1) / (1.0 + weights[:, None])  # (K, 2)
        run = _start(problem, chosen, groups, mix)
        _iterate(problem, chosen, groups, mix, run, progress)
        return _front(problem, groups, weights, run)


def _groups(scenario: Scenario) -> np.ndarray:
    """What quality and effort make of a cost's coefficients (2, 9): the share of each term of either."""
    effort = np.array([name in EFFORT for name in TERMS])
    weights = np.array([getattr(scenario.tuning.weights, name) for name in TERMS])
    groups = np.stack([~effort, effort]).astype(float)
    sums = groups @ weights
    for name, total in zip(("quality", "effort"), sums, strict=True):
        if total == 0.0:
            raise UserError("tuning.weights", f"above 0 for at least one term of {name}", "0 for all of them")
    return groups / sums[:, None]


def _start(problem: Problem, chosen: method.LBFGS | method.Optax, groups: np.ndarray, mix: np.ndarray) -> Progressing:
    """Race the scenario's gains against scrambled Sobol points, once for all weightings."""
    s, space = problem.scenario.tuning, problem.space
    starts = problem.starts()
    raced = evaluate.evaluate(problem.training.objective, starts, problem.samples(RACE, s.race_samples))
    risks = _risks(problem.training, raced, mix @ (groups * problem.training.coefficients))
    order = np.argsort(risks, axis=1, kind="stable")[:, : s.survivors]
    candidates = [Candidate(vector, chosen.start(vector)) for vector in starts[order.ravel()]]
    run = Progressing(candidates, np.repeat(space.start[None], len(mix), axis=0), np.full(len(mix), np.inf), [])
    _validate(problem, groups, mix, run, space.start[None])
    return run


def _iterate(
    problem: Problem,
    chosen: method.LBFGS | method.Optax,
    groups: np.ndarray,
    mix: np.ndarray,
    run: Progressing,
    progress: Progress | None,
) -> None:
    """Descend until no weighting improves any more or a budget ends it."""
    s, began, stale = problem.scenario.tuning, time.monotonic(), 0
    training = problem.training
    each = np.repeat(mix @ (groups * training.coefficients), len(run.candidates) // len(mix), axis=0)
    search = method.Search(training.objective, each, training.risk)
    for number in range(1, s.iterations + 1):
        if stale >= s.patience or time.monotonic() - began >= s.time_budget:
            break
        samples = problem.samples(TRAINING + (number - 1) * s.samples, s.samples)
        run.candidates, _, rejected = method.descend(search, chosen, run.candidates, samples, s.steps)
        improved = _validate(problem, groups, mix, run, np.stack([c.vector for c in run.candidates]))
        stale = 0 if improved else stale + 1
        if progress is not None:
            progress(Round(number, improved, rejected))


def _validate(problem: Problem, groups: np.ndarray, mix: np.ndarray, run: Progressing, vectors: np.ndarray) -> int:
    """Offer vectors (C, n) to every weighting; returns how many of them take one."""
    search = problem.validation
    found = evaluate.evaluate(
        search.objective, vectors, problem.samples(VALIDATION, problem.scenario.tuning.validation_samples)
    )
    run.tried.extend(_means(found, groups * search.coefficients))
    risks = _risks(search, found, mix @ (groups * search.coefficients))
    best, which = risks.min(axis=1), risks.argmin(axis=1)
    better = best < run.risks
    run.best[better], run.risks[better] = vectors[which[better]], best[better]
    return int(better.sum())


def _front(problem: Problem, groups: np.ndarray, weights: np.ndarray, run: Progressing) -> Front:
    s, space, search = problem.scenario.tuning, problem.space, problem.validation
    vectors = np.concatenate([space.start[None], run.best])
    parts = groups * search.coefficients
    sets = (problem.samples(VALIDATION, s.validation_samples), problem.samples(TEST, s.test_samples))
    chosen, untouched = (_means(evaluate.evaluate(search.objective, vectors, samples), parts) for samples in sets)
    return Front(
        scenario=problem.scenario,
        labels=space.labels(),
        weights=weights,
        gains=[space.gains(vector) for vector in run.best],
        values=np.stack([np.asarray(space.values(vector)) for vector in vectors]),
        points=untouched,
        validation=chosen,
        tried=np.stack(run.tried),
    )


def _risks(search: method.Search, found: Evaluated, coefficients: np.ndarray) -> np.ndarray:
    """Risk of C candidates under K coefficient vectors (K, 9): (K, C)."""
    return np.array([[float(search.risk(row)) for row in found.costs(one)] for one in coefficients])


def _means(found: Evaluated, parts: np.ndarray) -> np.ndarray:
    """Means of quality and effort over samples (C, 2), from their coefficients (2, 9); failures count as in a cost."""
    return np.stack([found.costs(one).mean(axis=1) for one in parts], axis=1)
