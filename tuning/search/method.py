"""The search: a race of Sobol starts on few samples, then local descent with curvature from several survivors at once.

Measured on a cost with several valleys (4 shared gains): the race finds a good valley with the rollouts of one full
evaluation, since few samples over a short horizon rank gains almost as the whole does; and L-BFGS with exact gradients
by reverse mode then needs fewer rollouts than Gauss-Newton as soon as there are more than a handful of gains.

>>> method("lbfgs", 0.1, "constant", None, 10).ladder[0]
2.0
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import jax
import numpy as np
import optax

from coopmm_jax.errors import UserError
from tuning.cost import evaluate
from tuning.cost.evaluate import Samples
from tuning.cost.objective import FAILED, Objective
from tuning.cost.risk import Risk, weighted

PAIRS = 10  # of L-BFGS
REACH = 1.0  # longest step of one number before the ladder: a factor of e on a gain


@dataclass(frozen=True)
class Search:
    """What is minimised: the risk, over samples, of the cost."""

    objective: Objective
    coefficients: np.ndarray  # of the terms (9,), or one row for each candidate (C, 9)
    risk: Risk

    def values(self, vectors: np.ndarray, samples: Samples) -> np.ndarray:
        """Risks (L,) of vectors (L, n); with coefficients of their own, each candidate has L / C of them in turn."""
        rows = np.atleast_2d(self.coefficients)
        rows = np.repeat(rows, len(vectors) // len(rows), axis=0)
        costs = evaluate.evaluate(self.objective, vectors, samples).costs(rows[:, None, :])
        return np.array([float(self.risk(row)) for row in costs])

    def slopes(self, vectors: np.ndarray, samples: Samples) -> tuple[np.ndarray, np.ndarray]:
        """Risk of each candidate (C,) and its gradient (C, n)."""
        costs, gradients = evaluate.gradients(self.objective, vectors, samples, self.coefficients)
        risks = [weighted(self.risk, row) for row in costs]
        slopes = [np.sum(weights[:, None] * rows, axis=0) for (_, weights), rows in zip(risks, gradients, strict=True)]
        return np.array([value for value, _ in risks]), np.array(slopes)


class Pairs(NamedTuple):
    """Curvature known to L-BFGS: the latest pairs, the newest last; rows of zeros are unused."""

    steps: np.ndarray  # (PAIRS, n)
    changes: np.ndarray  # of the gradient (PAIRS, n)


class LBFGS:
    """Limited-memory BFGS on the host: a dozen vectors of some 20 numbers need no compiler."""

    ladder = (2.0, 1.0, 0.5, 0.25, 0.1, 0.02)  # step lengths tried at once: together as dear as one gradient
    descends = True  # a step is taken only if it lowers the risk

    def start(self, vector: np.ndarray) -> Pairs:
        """No curvature yet, for vectors (n,)."""
        return Pairs(np.zeros((PAIRS, vector.size)), np.zeros((PAIRS, vector.size)))

    def direction(self, memory: Pairs, vector: np.ndarray, gradient: np.ndarray) -> tuple[np.ndarray, Pairs]:
        """Minus the inverse Hessian times the gradient (n,), by the two-loop recursion."""
        pairs = [(s, y) for s, y in zip(*memory, strict=True) if s.any()]
        towards, shares = gradient, []
        for s, y in reversed(pairs):
            shares.append(np.sum(s * towards) / np.sum(s * y))
            towards = towards - shares[-1] * y
        if pairs:
            s, y = pairs[-1]
            towards = towards * (np.sum(s * y) / np.sum(y * y))
        else:
            towards = towards / max(1.0, np.max(np.abs(gradient)))
        for (s, y), share in zip(pairs, reversed(shares), strict=True):
            towards = towards + (share - np.sum(y * towards) / np.sum(s * y)) * s
        return -towards, memory

    def learn(self, memory: Pairs, step: np.ndarray, change: np.ndarray) -> Pairs:
        """Add a pair (n,), (n,) whose curvature is positive."""
        if np.sum(step * change) <= 1e-10 * np.sum(step * step):
            return memory
        return Pairs(*(np.vstack([old[1:], new]) for old, new in zip(memory, (step, change), strict=True)))


class Optax:
    """An optimiser of optax: its update is the step, shortened only where rollouts fail."""

    ladder = (1.0, 0.5, 0.25, 0.125)
    descends = False

    def __init__(self, transformation: optax.GradientTransformation):
        self.transformation = transformation

    def start(self, vector: np.ndarray) -> Any:
        """The optimiser's state at a vector (n,)."""
        return jax.device_get(self.transformation.init(vector))

    def direction(self, memory: Any, vector: np.ndarray, gradient: np.ndarray) -> tuple[np.ndarray, Any]:
        """The optimiser's update (n,), and its next state."""
        return jax.device_get(self.transformation.update(gradient, memory, vector))

    def learn(self, memory: Any, step: np.ndarray, change: np.ndarray) -> Any:
        """Nothing of step and change (n,): optax's optimisers learn from the gradient alone."""
        return memory


def method(name: str, learning_rate: float, schedule: str, clip: float | None, steps: int) -> LBFGS | Optax:
    """The optimiser of [tuning].

    Args:
        steps: over which a cosine schedule falls to zero. clip: largest global norm of the gradient.

    Raises:
        UserError: optax has no such optimiser, or it needs more than a learning rate.
    """
    if name == "lbfgs":
        return LBFGS()
    rate = optax.cosine_decay_schedule(learning_rate, steps) if schedule == "cosine" else learning_rate
    try:
        chosen = getattr(optax, name)(rate)
        known = isinstance(chosen, optax.GradientTransformation)
    except (AttributeError, TypeError):
        known = False
    if not known:
        raise UserError("tuning.optimiser", "lbfgs or an optimiser of optax, as adam", name)
    return Optax(chosen if clip is None else optax.chain(optax.clip_by_global_norm(clip), chosen))


class Candidate(NamedTuple):
    """One descent under way."""

    vector: np.ndarray  # (n,)
    memory: Any  # of the method
    reach: float = REACH


def race(search: Search, starts: np.ndarray, samples: Samples, survivors: int) -> np.ndarray:
    """The best of many starting points (C, n) -> (survivors, n), best first."""
    order = np.argsort(search.values(starts, samples), kind="stable")
    return starts[order[:survivors]]


def descend(
    search: Search, chosen: LBFGS | Optax, candidates: list[Candidate], samples: Samples, steps: int
) -> tuple[list[Candidate], np.ndarray, int]:
    """A few steps of every candidate on the same samples; what one does depends on no other.

    Returns:
        The candidates, their risks (C,), and how many steps were rejected or shortened because rollouts failed, nothing
        improved, or a gradient was not finite: then the next step may reach half as far.
    """
    rejected = 0
    values, slopes = search.slopes(np.stack([c.vector for c in candidates]), samples)
    for _ in range(steps):
        proposals = [_propose(chosen, c, g) for c, g in zip(candidates, slopes, strict=True)]
        tried = search.values(np.concatenate([trials for trials, _ in proposals]), samples)
        moved = []
        for c, value, (trials, memory), outcome in zip(
            candidates, values, proposals, tried.reshape(len(candidates), -1), strict=True
        ):
            taken = _pick(chosen, value, outcome)
            rejected += taken is None or (taken > 0 and not chosen.descends)
            moved.append(_moved(chosen, c, memory, trials, taken))
        new_values, new_slopes = search.slopes(np.stack([c.vector for c in moved]), samples)
        candidates = [
            new._replace(memory=chosen.learn(new.memory, new.vector - old.vector, g1 - g0))
            for old, new, g0, g1 in zip(candidates, moved, slopes, new_slopes, strict=True)
        ]
        values, slopes = new_values, new_slopes
    return candidates, values, rejected


def better_half(candidates: list[Candidate], values: np.ndarray) -> list[Candidate]:
    """The half of the candidates that is worth more rollouts, best first; values (C,). The last one is never dropped.

    Measured: which valley is deep shows after a few steps, and what the others would cost buys the better ones twice
    the samples.
    """
    order = np.argsort(values, kind="stable")[: max(1, len(candidates) // 2)]
    return [candidates[i] for i in order]


def _propose(chosen: LBFGS | Optax, candidate: Candidate, slope: np.ndarray) -> tuple[np.ndarray, Any]:
    """Trial vectors (ladder, n), longest step first, and the method's memory after them."""
    vector, memory = candidate.vector, candidate.memory
    if not np.all(np.isfinite(slope)):
        return np.repeat(vector[None], len(chosen.ladder), axis=0), memory
    direction, memory = chosen.direction(memory, vector, slope)
    if chosen.descends and np.sum(direction * slope) >= 0.0:
        direction, memory = chosen.direction(chosen.start(vector), vector, slope)
    longest = float(np.max(np.abs(direction)))
    direction = direction * min(1.0, candidate.reach / max(longest, 1e-300))
    return vector + np.array(chosen.ladder)[:, None] * direction, memory


def _pick(chosen: LBFGS | Optax, value: float, outcome: np.ndarray) -> int | None:
    """Which trial to take; None for none of them."""
    if chosen.descends:
        best = int(np.argmin(outcome))
        return best if outcome[best] < value else None
    usable = np.flatnonzero(outcome < FAILED * 1e-3)
    return int(usable[0]) if len(usable) else None


def _moved(
    chosen: LBFGS | Optax, candidate: Candidate, memory: Any, trials: np.ndarray, taken: int | None
) -> Candidate:
    """The candidate after its step; without one it keeps no memory and half its reach."""
    if taken is None:
        return Candidate(candidate.vector, chosen.start(candidate.vector), 0.5 * candidate.reach)
    return Candidate(trials[taken], memory, min(REACH, 2.0 * candidate.reach))
