"""Descents along exact gradients, with line search: L-BFGS on the host, and the optimisers of optax.

>>> method("lbfgs", 0.1, "constant", None, 10).ladder[0]
2.0
"""

from __future__ import annotations

from typing import Any, NamedTuple, Protocol

import jax
import numpy as np
import optax

from coopmm_jax.errors import UserError
from tuning.cost.objective import FAILED

PAIRS = 10  # of L-BFGS
REACH = 1.0  # longest step of one number before the ladder: a factor of e on a gain


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


def method(name: str, learning_rate: float, decay: str, clip: float | None, steps: int) -> LBFGS | Optax:
    """Optimiser of [tuning].

    Args:
        name: lbfgs, or a function of optax.
        learning_rate: of optax's optimisers.
        decay: constant or cosine.
        clip: largest global norm of the gradient.
        steps: over which a cosine schedule falls to zero.

    Raises:
        UserError: optax has no such optimiser, or it needs more than a learning rate.
    """
    if name == "lbfgs":
        return LBFGS()
    rate = optax.cosine_decay_schedule(learning_rate, steps) if decay == "cosine" else learning_rate
    try:
        chosen = getattr(optax, name)(rate)
        _try(chosen)
    except Exception:  # optax's functions refuse what they cannot use in many ways
        scheduled = ", that takes a schedule of the learning rate" if decay == "cosine" else ""
        must = f"auto, cma, lbfgs or an optimiser of optax, as adam{scheduled}"
        raise UserError("tuning.optimiser", must, name) from None
    return Optax(chosen if clip is None else optax.chain(optax.clip_by_global_norm(clip), chosen))


def _try(chosen: Any) -> None:
    """Let an optimiser take a step with nothing but a gradient."""
    if not isinstance(chosen, optax.GradientTransformation):
        raise TypeError(chosen)
    with jax.enable_x64(True):
        ones = np.ones(2)
        chosen.update(ones, chosen.init(ones), ones)


class Trials(Protocol):
    """Risks on samples, as a search asks for them; every draw is a set of samples, the same for all candidates."""

    low: np.ndarray  # bounds of vectors (n,)
    high: np.ndarray

    def values(self, vectors: np.ndarray, count: int, draw: int, precision: str = "float64") -> np.ndarray:
        """Risks (C,) of vectors (C, n) on ``count`` samples, computed in float32 or float64."""
        ...
        ...

    def slopes(self, vectors: np.ndarray, count: int, draw: int) -> tuple[np.ndarray, np.ndarray]:
        """Risks (C,) and their gradients (C, n)."""
        ...
        ...


class Candidate(NamedTuple):
    """One descent under way."""

    vector: np.ndarray  # (n,)
    memory: Any  # of the method
    reach: float = REACH


def descend(
    trials: Trials, chosen: LBFGS | Optax, candidate: Candidate, samples: int, draw: int, steps: int
) -> tuple[Candidate, float, int]:
    """A few steps on the same samples.

    Returns:
        The candidate, at a vector (n,), its risk, and how many steps were rejected or shortened because rollouts
        failed, nothing improved, or a gradient was not finite: then the next step may reach half as far.
    """
    rejected = 0
    value, slope = _slope(trials, candidate.vector, samples, draw)
    for _ in range(steps):
        proposed, memory, taken = candidate.vector[None], candidate.memory, None
        if np.all(np.isfinite(slope)):
            proposed, memory = _propose(chosen, candidate, slope, trials.low, trials.high)
            taken = _pick(chosen, value, trials.values(proposed, samples, draw))
        rejected += taken is None or (taken > 0 and not chosen.descends)
        moved = _moved(chosen, candidate, memory, proposed, taken)
        value, new_slope = _slope(trials, moved.vector, samples, draw)
        memory = chosen.learn(moved.memory, moved.vector - candidate.vector, new_slope - slope)
        candidate, slope = moved._replace(memory=memory), new_slope
    return candidate, value, rejected


def _slope(trials: Trials, vector: np.ndarray, samples: int, draw: int) -> tuple[float, np.ndarray]:
    """Risk of a vector and its gradient, without what would leave the bounds."""
    (value,), (slope,) = trials.slopes(vector[None], samples, draw)
    blocked = ((vector <= trials.low) & (slope > 0.0)) | ((vector >= trials.high) & (slope < 0.0))
    return float(value), np.where(blocked, 0.0, slope)


def _propose(
    chosen: LBFGS | Optax, candidate: Candidate, slope: np.ndarray, low: np.ndarray, high: np.ndarray
) -> tuple[np.ndarray, Any]:
    """Trial vectors (ladder, n) between the bounds, longest step first, and the method's memory after them."""
    vector, memory = candidate.vector, candidate.memory
    direction, memory = chosen.direction(memory, vector, slope)
    if chosen.descends and np.sum(direction * slope) >= 0.0:
        direction, memory = chosen.direction(chosen.start(vector), vector, slope)
    longest = float(np.max(np.abs(direction)))
    direction = direction * min(1.0, candidate.reach / max(longest, 1e-300))
    return np.clip(vector + np.array(chosen.ladder)[:, None] * direction, low, high), memory


def _pick(chosen: LBFGS | Optax, value: float, outcome: np.ndarray) -> int | None:
    """Trial to take; None for none of them."""
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
