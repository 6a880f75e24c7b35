"""Margins: the change of each gain, one at a time, at which the cost rises by a tenth or a robot fails."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from tuning.cost.problem import CHOICE, Problem

RISE = 0.1  # of the cost, relative
FACTORS = (1.1, 1.2, 1.35, 1.5, 2.0, 3.0, 5.0)  # on a gain (on 1 + K_lambda)
SAMPLES = 8  # robots that margins are found on
NEAR = 0.01  # relative difference within which costs are as good as equal
NUDGE = 1.25  # factor on a gain by which near-equal gains are told apart


class Margin(NamedTuple):
    """Range of one tuned gain, the others as they are."""

    name: str  # as K_I[2]
    value: float
    low: float  # the lowest and highest of the values tried at which the cost has not risen by RISE
    high: float
    below: str  # beyond: "cost", "fails", "bound" of [tuning.bounds], "free" where even the largest factor does neither
    above: str


def margins(problem: Problem, vector: np.ndarray) -> list[Margin]:
    """The margin of every gain of a vector (n,): by bisection over ``FACTORS``, all gains at once.

    One that changes over time is moved at all its knots together, and described by its mean over them.
    """
    moves = problem.space.moves
    n = len(moves)
    signs, index = np.repeat([-1.0, 1.0], n), np.tile(np.arange(n), 2)
    along = signs[:, None] * moves[index]
    samples, precision = problem.drawn(SAMPLES, CHOICE), problem.scenario.tuning.coarse
    # No further than the search may go: to the bounds, or to gains of the scenario that lie outside of them.
    low, high = np.minimum(problem.space.low, vector), np.maximum(problem.space.high, vector)
    limit = (1.0 + RISE) * problem.aim.values(vector[None], samples, precision)[0]
    steps = np.log(np.concatenate([[1.0], FACTORS]))
    good, bad = np.zeros(2 * n, int), np.full(2 * n, len(steps))
    failing = np.zeros(2 * n, bool)
    while np.any(bad - good > 1):
        middle = (good + bad) // 2
        moved = np.clip(vector + steps[middle, None] * along, low, high)
        risks, lost = problem.aim.outcomes(moved, samples, precision)
        kept = ~lost & (risks <= limit)
        good = np.where(kept, middle, good)
        failing = np.where(kept, failing, lost)
        bad = np.where(kept, bad, middle)
    ends = vector + steps[good, None] * along
    values = np.stack([_means(problem, row) for row in np.clip(ends, low, high)])[np.arange(2 * n), index]
    stopped = np.where(np.any((ends < low) | (ends > high), axis=1), "bound", "free")
    beyond = np.where(bad == len(steps), stopped, np.where(failing, "fails", "cost"))
    own = _means(problem, vector)
    return [
        Margin(name, float(own[i]), float(values[i]), float(values[n + i]), str(beyond[i]), str(beyond[n + i]))
        for i, name in enumerate(problem.space.entry_labels())
    ]


def _means(problem: Problem, vector: np.ndarray) -> np.ndarray:
    """Gains of a vector (n,), averaged over their knots (G,)."""
    return np.asarray(problem.space.values(vector)).reshape(problem.space.knots, -1).mean(axis=0)


def sturdiest(problem: Problem, vectors: np.ndarray, values: np.ndarray) -> np.ndarray:
    """The vector (n,) to keep: of those within ``NEAR`` of the best, the one of least cost with and without changes.

    Its own cost and the mean over changes of one gain by ``NUDGE`` weigh the same. Next to a cliff that mean rises by
    far more than ``NEAR``; elsewhere it differs by less than the costs do, and alone would choose by chance.

    Args:
        problem: whose cost it is.
        vectors: (F, n), the best first.
        values: their risks (F,).
    """
    alike = values <= (1.0 + NEAR) * values[0]
    near = vectors[alike]
    if len(near) == 1:
        return near[0]
    moves, step = problem.space.moves, np.log(NUDGE)
    nudges = np.concatenate([-step * moves, step * moves])
    moved = (near[:, None] + nudges).reshape(-1, near.shape[1])
    precision = problem.scenario.tuning.coarse
    risks = problem.aim.values(moved, problem.drawn(SAMPLES, CHOICE), precision).reshape(len(near), -1)
    return near[int(np.argmin(values[alike] + risks.mean(axis=1)))]
