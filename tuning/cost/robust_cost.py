"""One number for a vector of gains: the risk, over samples, of the cost of a rollout."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tuning.cost import evaluate
from tuning.cost.evaluate import Samples
from tuning.cost.objective import Objective
from tuning.cost.risk import Risk, weighted


@dataclass(frozen=True)
class RobustCost:
    """The risk of gains, as a function of a vector and of the samples that they are tried on."""

    objective: Objective
    coefficients: np.ndarray  # of the terms (9,)
    risk: Risk

    def values(self, vectors: np.ndarray, samples: Samples, precision: str = "float64") -> np.ndarray:
        """Risks (C,) of vectors (C, n); what one is worth does not depend on the others."""
        return self.outcomes(vectors, samples, precision)[0]

    def outcomes(
        self, vectors: np.ndarray, samples: Samples, precision: str = "float64"
    ) -> tuple[np.ndarray, np.ndarray]:
        """Risks (C,) of vectors (C, n), and whether a rollout failed (C,)."""
        found = evaluate.evaluate(self.objective, vectors, samples, precision)
        risks = np.array([float(self.risk(row)) for row in found.costs(self.coefficients)])
        return risks, np.any(~found.completed, axis=1)

    def slopes(self, vectors: np.ndarray, samples: Samples) -> tuple[np.ndarray, np.ndarray]:
        """Risks (C,) of vectors (C, n) and their gradients (C, n)."""
        costs, gradients = evaluate.gradients(self.objective, vectors, samples, self.coefficients)
        risks = [weighted(self.risk, row) for row in costs]
        slopes = [np.sum(weights[:, None] * rows, axis=0) for (_, weights), rows in zip(risks, gradients, strict=True)]
        return np.array([value for value, _ in risks]), np.array(slopes)

    def each(self, vector: np.ndarray, samples: Samples) -> np.ndarray:
        """Costs (N,) of one vector (n,) on every sample; at least ``FAILED`` of a rollout that fails."""
        return evaluate.evaluate(self.objective, vector[None], samples).costs(self.coefficients)[0]

    def by_sample(self, vector: np.ndarray, samples: Samples) -> np.ndarray:
        """Slopes of these costs by every sample's own numbers (N, leaves), by reverse mode."""
        return evaluate.sensitivities(self.objective, vector[None], samples, self.coefficients)[1][0]
