"""Several different failures of a scenario, not the same one several times: ``falsify --modes``.

Each requirement is climbed against by itself. Two of the samples that break one are different failures if they break
different requirements, or lie apart in the unit cube of the draws: by more than ``APART`` in the root mean square of
the coordinates' differences, each weighted by what the coordinate matters for either failure. That is by how much the
shortfall changes when the coordinate alone is moved to the middle of the cube.

>>> distance(np.array([0.0, 0.3]), np.array([0.5, 0.8]), weights=np.array([1.0, 0.0]))
0.5
"""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import Executor
from itertools import zip_longest
from pathlib import Path
from typing import NamedTuple

import numpy as np

from coopmm_jax.errors import UserError
from coopmm_jax.scenario.scenario import Scenario, load_scenario
from coopmm_jax.scenario.sections.requirements import Requirement
from coopmm_jax.sweeps.engine import carried_by
from tuning.cost.problem import Problem, check_count, unscaled
from tuning.cost.shortfall import Shortfall
from tuning.search.ascent import Ascent, Peak
from tuning.studies.falsify import ROLLOUTS, STARTS, Falsification, SampleCost, climbed, requirement_of, sample_found

APART = 0.25  # half as far as two random points of the cube are on average
_OFFERED = 4  # samples that break a requirement, for each failure that is asked for


class Failure(NamedTuple):
    """A sample that breaks requirements."""

    peak: Peak  # where it lies, and its shortfall
    requirement: Requirement  # that was climbed against
    broken: tuple[str, ...]  # all that it breaks, in the order of the scenario
    influence: np.ndarray  # of each draw on the shortfall (D,), the largest 1
    search: Ascent


class Modes(NamedTuple):
    """Different failures, and what it took to find them."""

    found: list[Falsification]
    broken: list[tuple[str, ...]]  # requirements that each breaks
    searched: tuple[Requirement, ...]
    rollouts: int  # spent


def modes(
    scenario: Scenario | str | Path,
    count: int,
    requirement: str | None = None,
    rollouts: int = ROLLOUTS,
    starts: int = STARTS,
    executor: Executor | None = None,
) -> Modes:
    """Up to ``count`` different failures, of different requirements first, the worst of each first.

    Args:
        scenario: a scenario, or the name or path of one; needs [uncertainty] and [requirements].
        count: failures to look for.
        requirement: the only one to climb against; each in turn if left out.
        rollouts: budget of the climbs against one requirement.
        starts: of these climbs.
        executor: whose workers run the rollouts, see ``coopmm_jax/sweeps/engine.py``; left out, this process does.

    Raises:
        UserError: fewer than one failure asked for, nothing required, or as ``falsify``.
    """
    if not isinstance(scenario, Scenario):
        scenario = load_scenario(scenario)
    check_count(count, "--modes")
    check_count(starts, "starts")
    searched = scenario.requirements.parsed()
    if requirement is not None:
        searched = (requirement_of(scenario, requirement),)
    if not searched:
        raise UserError("--modes", "of a scenario with [requirements]", count)
    with carried_by(executor):
        problem = unscaled(scenario)
        by_requirement, spent = [], 0
        for each in searched:
            failures, price = _failures(problem, each, _OFFERED * count, rollouts, starts)
            by_requirement.append(failures)
            spent += price
        in_turn = [failure for rank in zip_longest(*by_requirement) for failure in rank if failure is not None]
        chosen = different(in_turn, count)
        found = [sample_found(problem, each.peak, each.search, each.requirement) for each in chosen]
    return Modes(found, [each.broken for each in chosen], searched, spent)


def _failures(
    problem: Problem, requirement: Requirement, count: int, rollouts: int, starts: int
) -> tuple[list[Failure], int]:
    """Samples that break a requirement, the worst first, and the rollouts that it took to find out."""
    vector = problem.space.start
    shortfall = Shortfall.of(problem, requirement)
    search = climbed(problem, vector, rollouts, starts, shortfall)
    peaks = [peak for peak in search.peaks if peak.value > 0.0][:count]
    if not peaks:
        return [], search.spent
    landscape = SampleCost(shortfall, problem.variation, vector)
    points = np.stack([peak.point for peak in peaks])
    names = [each.metric for each in shortfall.requirements]
    every = shortfall.every(vector, landscape.samples(points)) > 0.0
    influences = _influence(landscape, points, np.array([peak.value for peak in peaks]))
    broken = [tuple(name for name, lost in zip(names, row, strict=True) if lost) for row in every]
    failures = [
        Failure(peak, requirement, lost, influence, search)
        for peak, lost, influence in zip(peaks, broken, influences, strict=True)
    ]
    return failures, search.spent + points.size + len(points)


def _influence(landscape: SampleCost, points: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Influence of each draw (N, D) on the shortfalls (N,) at points (N, D); the largest of each point is 1."""
    dimensions = points.shape[1]
    middle = np.where(np.eye(dimensions, dtype=bool), 0.5, points[:, None])  # (N, D, D)
    moved = landscape.values(middle.reshape(-1, dimensions)).reshape(points.shape)
    change = np.abs(moved - values[:, None])
    largest = change.max(axis=1, keepdims=True)
    return np.where(largest > 0.0, change / np.where(largest > 0.0, largest, 1.0), 1.0)


def different(failures: Sequence[Failure], count: int) -> list[Failure]:
    """Up to ``count`` of the failures, each different from those before it; first those that break something new.

    Args:
        failures: in the order in which they are wanted.
        count: of them.
    """
    chosen: list[Failure] = []
    for new_alone in (True, False):
        for failure in failures:
            known = {name for each in chosen for name in each.broken}
            new = failure.requirement.metric not in known
            if len(chosen) < count and (new or not new_alone) and all(_differ(failure, each) for each in chosen):
                chosen.append(failure)
    return chosen


def _differ(one: Failure, other: Failure) -> bool:
    if set(one.broken) != set(other.broken):
        return True
    return distance(one.peak.point, other.peak.point, np.maximum(one.influence, other.influence)) > APART


def distance(one: np.ndarray, other: np.ndarray, weights: np.ndarray) -> float:
    """Weighted root mean square of the differences between two points (D,) of the cube, weights (D,)."""
    return float(np.sqrt(np.sum(weights * (one - other) ** 2) / np.sum(weights)))
