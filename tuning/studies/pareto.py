"""The front between quality and effort: one search for each of several weightings, ``coopmm tune --pareto``.

What is simulated does not depend on the weights, so the screening's and the checks' rollouts serve every weighting:
each is scored for all of them. A search begins at the best that is known for its weighting, mostly the end of the one
before, and whatever one weighting finds may become the point of another.

>>> non_dominated(np.array([[1.0, 3.0], [2.0, 2.0], [2.0, 4.0]]))
array([ True,  True, False])
"""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Executor
from dataclasses import dataclass, replace

import jax
import numpy as np

from coopmm_jax.errors import UserError
from coopmm_jax.kinds.robust_adaptive import Gains
from coopmm_jax.parameters import PhaseSchedule, Schedule
from coopmm_jax.scenario.scenario import Scenario
from coopmm_jax.sweeps.engine import carried_by
from tuning.cost import evaluate
from tuning.cost.evaluate import Evaluated
from tuning.cost.objective import TERMS
from tuning.cost.problem import SCREENING, TEST, Problem, build_problem, unscaled
from tuning.cost.robust_cost import RobustCost
from tuning.cost.trials import DrawnTrials
from tuning.search.stages import plan
from tuning.studies.tune import Driver, Progress, Run

EFFORT = ("effort", "torque_variation", "saturation")  # all other terms are of quality
MOST = 1000  # weightings
WEIGHTS = (0.01, 10.0)  # smallest and largest weight of effort against quality


class SharedTrials(DrawnTrials):
    """The trials of one weighting, whose checks are kept for the others."""

    def __init__(self, problem: Problem, archive: Archive):
        super().__init__(problem)
        self.archive = archive

    def check(self, vectors: np.ndarray) -> np.ndarray:
        """Risks (C,) of vectors (C, n) on the fixed samples."""
        self._count(len(vectors) * self.problem.scenario.tuning.validation_samples)
        return _risks(self.problem.cost, self.archive.add(vectors), self.problem.cost.coefficients[None])[0]


@dataclass
class Archive:
    """All vectors that were checked, and what became of them on the fixed samples."""

    problem: Problem
    vectors: np.ndarray  # (M, n)
    found: list[Evaluated]  # of one vector each (M)

    def add(self, vectors: np.ndarray) -> Evaluated:
        """Run vectors (C, n) on the fixed samples."""
        found = evaluate.evaluate(self.problem.cost.objective, vectors, self.problem.fixed)
        self.vectors = np.concatenate([self.vectors, vectors])
        self.found += [Evaluated(*(array[i : i + 1] for array in found)) for i in range(len(vectors))]
        return found

    def all(self) -> Evaluated:
        """Results of all of them."""
        return Evaluated(*(np.concatenate(arrays) for arrays in zip(*self.found, strict=True)))


@dataclass(frozen=True)
class Front:
    """Gains for K weightings; quality and effort are means over samples and about 1 under the scenario's gains."""

    scenario: Scenario
    labels: list[str]  # of the tuned numbers (n,)
    weights: np.ndarray  # of effort against quality (K,)
    gains: list[Gains]  # (K,)
    schedules: list[Schedule | PhaseSchedule | None]  # (K,) of those that change
    values: np.ndarray  # the tuned numbers (1 + K, n), first the scenario's
    points: np.ndarray  # (quality, effort) on the untouched samples (1 + K, 2)
    validation: np.ndarray  # the same on the samples that chose them (1 + K, 2)
    tried: np.ndarray  # the same of everything that was validated (M, 2)

    @property
    def dominated(self) -> np.ndarray:
        """Weightings (K,) whose gains another's, or the scenario's, beat on the untouched samples, as booleans."""
        return ~non_dominated(self.points)[1:]


def non_dominated(points: np.ndarray) -> np.ndarray:
    """Points of M (M, d), numbers that should be small, that no other equals in all and beats in one, as booleans.

    >>> non_dominated(np.array([[1.0, 1.0], [1.0, 1.0], [1.0, 2.0]]))
    array([ True,  True, False])
    """
    no_worse = np.all(points[:, None] <= points[None], axis=-1)
    better = np.any(points[:, None] < points[None], axis=-1)
    return ~np.any(no_worse & better, axis=0)


def tune_front(
    scenario: Scenario,
    count: int,
    progress: Progress | None = None,
    stage: Callable[[str], None] | None = None,
    executor: Executor | None = None,
) -> Front:
    """Tune gains for ``count`` weightings between quality and effort.

    The cost of a weighting is (quality + w effort) / (1 + w); inside quality and effort the terms have the weights of
    [tuning.weights]. Each weighting may spend tuning.budget.

    Args:
        scenario: needs [uncertainty].
        count: at least 2.
        progress: called with each row of every search's history.
        stage: called with the name of what begins.
        executor: whose workers run the rollouts, see ``coopmm_jax/sweeps/engine.py``; left out, this process does.

    Raises:
        UserError: fewer than two weightings, no weight on quality or on effort, or settings that cannot be met.
    """
    if not 2 <= count <= MOST:
        raise UserError("--pareto", f"from 2 to {MOST} weightings", count)
    say = stage or (lambda name: None)
    with jax.enable_x64(True), carried_by(executor):
        groups = _groups(scenario)
        chosen = plan(unscaled(scenario))
        say("compiling")
        problem = build_problem(scenario)
        weights = np.geomspace(*WEIGHTS, count)
        mix = np.stack([np.ones(count), weights], axis=1) / (1.0 + weights[:, None])  # (K, 2)
        each = mix @ (groups * problem.cost.coefficients)
        say("screening")
        archive = _screened(problem, each)
        for number, coefficients in enumerate(each):
            say(f"weighting {number + 1} of {count}")
            weighted = replace(problem, cost=replace(problem.cost, coefficients=coefficients))
            best = archive.vectors[int(np.argmin(_risks(problem.cost, archive.all(), coefficients[None])[0]))]
            run = Run.at(best, SharedTrials(weighted, archive))
            run.check(best[None])
            driver = Driver(None, weighted, progress, say)
            driver.note(run, "starting", float(run.values[0]), 0, 0.0)
            driver.search(run, chosen, np.inf)
        say("measuring")
        return _front(problem, groups, weights, each, archive)


def _groups(scenario: Scenario) -> np.ndarray:
    """Shares of the terms of quality and of effort in a cost's coefficients (2, 9)."""
    effort = np.array([name in EFFORT for name in TERMS])
    weights = np.array(list(scenario.tuning.weights.of_all().values()))
    groups = np.stack([~effort, effort]).astype(float)
    sums = groups @ weights
    for name, total in zip(("quality", "effort"), sums, strict=True):
        if total == 0.0:
            raise UserError("tuning.weights", f"above 0 for at least one term of {name}", "0 for all of them")
    return groups / sums[:, None]


def _screened(problem: Problem, each: np.ndarray) -> Archive:
    """The scenario's gains, and for each weighting (K, 9) the best of the starting points."""
    s, space = problem.scenario.tuning, problem.space
    starts = space.starts(s.starts, problem.scenario.simulation.seed)
    found = evaluate.evaluate(problem.cost.objective, starts, problem.drawn(s.screening_samples, SCREENING))
    chosen = _risks(problem.cost, found, each).argmin(axis=1)
    archive = Archive(problem, starts[:0], [])
    archive.add(np.concatenate([space.start[None], starts[sorted(set(chosen.tolist()))]]))
    return archive


def _front(problem: Problem, groups: np.ndarray, weights: np.ndarray, each: np.ndarray, archive: Archive) -> Front:
    s, space, cost = problem.scenario.tuning, problem.space, problem.cost
    found, parts = archive.all(), groups * cost.coefficients
    best = _risks(cost, found, each).argmin(axis=1)
    rows = np.concatenate([[0], best])  # the archive's first is the scenario's own
    vectors, tried = archive.vectors[rows], _means(found, parts)
    untouched = evaluate.evaluate(cost.objective, vectors, problem.samples(TEST, s.test_samples))
    return Front(
        scenario=problem.scenario,
        labels=space.labels(),
        weights=weights,
        gains=[space.gains(vector) for vector in vectors[1:]],
        schedules=[space.schedule(vector) for vector in vectors[1:]],
        values=np.stack([np.asarray(space.values(vector)) for vector in vectors]),
        points=_means(untouched, parts),
        validation=tried[rows],
        tried=tried,
    )


def _risks(cost: RobustCost, found: Evaluated, coefficients: np.ndarray) -> np.ndarray:
    """Risk of C candidates under K coefficient vectors (K, 9): (K, C)."""
    return np.array([[float(cost.risk(row)) for row in found.costs(one)] for one in coefficients])


def _means(found: Evaluated, parts: np.ndarray) -> np.ndarray:
    """Means of quality and effort over samples (C, 2), from their coefficients (2, 9); failures count as in a cost."""
    return np.stack([found.costs(one).mean(axis=1) for one in parts], axis=1)
