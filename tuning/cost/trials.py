"""Rollouts that a search may ask for: on samples drawn anew, the same for all candidates, and counted."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from tuning.cost.evaluate import Samples
from tuning.cost.problem import Problem

GRADIENT = 20  # rollouts in a batch of 32 that an exact gradient in a batch of 4 costs (19 on ``sensed``)


class Kept(NamedTuple):
    """Sets of hard requirements that some candidate has kept together, each a tuple of booleans (H,)."""

    drawn: set[tuple[bool, ...]]  # on the samples of a generation or scan
    fixed: set[tuple[bool, ...]]  # on those that candidates are chosen by


class DrawnTrials:
    """Risks and slopes of vectors on Sobol sets of a problem's samples; counts what is simulated."""

    def __init__(self, problem: Problem, spent: int = 0, worst: np.ndarray | None = None, kept: Kept | None = None):
        """Begin, or go on.

        Args:
            problem: whose cost is minimised.
            spent: steps simulated so far.
            worst: samples (W, leaves) that every set is extended by, see ``Samples.rows``.
            kept: hard requirements so far.
        """
        self.problem, self.spent, self.worst = problem, spent, worst
        self.kept = kept or Kept(set(), set())
        self.low, self.high = problem.low, problem.high

    def values(self, vectors: np.ndarray, count: int, draw: int, precision: str = "float64") -> np.ndarray:
        """Risks (C,) of vectors (C, n) on the set ``draw`` of ``count`` samples."""
        samples = self._samples(count, draw)
        self._count(len(vectors) * len(samples))
        return self._tried(vectors, samples, precision, self.kept.drawn)

    def slopes(self, vectors: np.ndarray, count: int, draw: int) -> tuple[np.ndarray, np.ndarray]:
        """Risks (C,) and their gradients (C, n), likewise."""
        samples = self._samples(count, draw)
        self._count(GRADIENT * len(vectors) * len(samples))
        return self.problem.slopes(vectors, samples)

    def check(self, vectors: np.ndarray) -> np.ndarray:
        """Risks (C,) of vectors (C, n) on the fixed samples that choose among them."""
        self._count(len(vectors) * self.problem.scenario.tuning.validation_samples)
        return self._tried(vectors, self.problem.fixed, "float64", self.kept.fixed)

    def _tried(self, vectors: np.ndarray, samples: Samples, precision: str, kept: set) -> np.ndarray:
        if self.problem.goals is None:
            return self.problem.costs(vectors, samples, precision)
        found = self.problem.goals.assess(self.problem.space.inside(vectors), samples, precision)
        kept.update(map(tuple, found.kept.tolist()))
        return found.values

    def _samples(self, count: int, draw: int) -> Samples:
        samples = self.problem.drawn(count, draw)
        return samples if self.worst is None else samples.extended(self.worst)

    def _count(self, rollouts: int) -> None:
        self.spent += rollouts * steps_of(self.problem)


def steps_of(problem: Problem) -> int:
    """Integration steps of one rollout."""
    objective = problem.cost.objective
    return objective.steps * max(1, objective.structure.substeps)
