"""Slopes of the cost over small and large steps, which disagree where the controller chatters.

Torques that switch from sample to sample put ripples on the cost: the slope of a ripple is exact and large, and useless
for a descent. So slopes over small steps are compared with those over steps as a descent takes them.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from tuning.cost.objective import FAILED
from tuning.cost.problem import CHOICE, Problem

SMALL, LARGE = 1e-4, 0.05  # steps of a logarithm: factors on a gain
SAMPLES = 4  # robots that slopes are found on
WRONG = 0.01  # share of the cost by which the slope may mispredict a large step


class Slopes(NamedTuple):
    """The cost's slope along n numbers by central differences over two lengths."""

    small: float  # its length [1/unit of a logarithm]
    large: float
    error: float  # of a large step along the difference of both slopes, as a share of the cost

    @property
    def chattering(self) -> bool:
        """True where exact gradients mislead."""
        return self.error > WRONG


def slopes(problem: Problem, vector: np.ndarray) -> Slopes:
    """Slopes at a vector (n,), along the numbers of which no step makes a robot fail."""
    moves = problem.space.moves
    steps = np.concatenate([0.0 * moves[:1], *(size * moves for size in (SMALL, -SMALL, LARGE, -LARGE))])
    costs = problem.aim.values(vector + steps, problem.drawn(SAMPLES, CHOICE))
    own, around = costs[0], costs[1:].reshape(2, 2, len(moves))
    small, large = (around[:, 0] - around[:, 1]) / (2.0 * np.array([[SMALL], [LARGE]]))
    usable = np.all(around < 1e-3 * FAILED, axis=(0, 1))
    small, large = small[usable], large[usable]
    error = LARGE * np.linalg.norm(small - large) / max(own, 1e-300)
    return Slopes(float(np.linalg.norm(small)), float(np.linalg.norm(large)), float(error))
