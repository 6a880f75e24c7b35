"""Cost of one requirement: how far a rollout falls short of keeping it, for a search for the robot that breaks it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from coopmm_jax.scenario.sections.requirements import Requirement
from tuning.cost import required
from tuning.cost.evaluate import Samples
from tuning.cost.required import Required

if TYPE_CHECKING:
    from tuning.cost.problem import Problem


@dataclass(frozen=True)
class Shortfall:
    """Minus the robustness of a requirement in units of its scale; positive where a rollout breaks it.

    One program computes all requirements of a scenario, whichever is asked for.
    """

    required: Required
    requirements: tuple[Requirement, ...]  # R of the scenario
    chosen: int  # which of them

    @classmethod
    def of(cls, problem: Problem, requirement: Requirement) -> Shortfall:
        """Shortfall of one of a scenario's requirements; the problem need not be scaled."""
        every = problem.scenario.requirements.parsed()
        return cls(Required.of(problem.cost.objective, problem.scenario), every, every.index(requirement))

    def each(self, vector: np.ndarray, samples: Samples) -> np.ndarray:
        """Shortfall with the gains of a vector (n,) on every sample (N,); 1e6 or more of a rollout that fails."""
        return self.every(vector, samples)[:, self.chosen]

    def every(self, vector: np.ndarray, samples: Samples) -> np.ndarray:
        """Shortfall of all requirements, likewise (N, R)."""
        numbers = self.required.numbers(self.requirements)
        return -required.evaluate(self.required, vector[None], samples, numbers).values[0]

    def by_sample(self, vector: np.ndarray, samples: Samples) -> np.ndarray:
        """Slopes by every sample's own numbers (N, leaves), of the smooth robustness; the vector is (n,)."""
        weights = -np.eye(len(self.requirements))[self.chosen]
        numbers = self.required.numbers(self.requirements, weights)
        return required.sensitivities(self.required, vector[None], samples, numbers)[0]
