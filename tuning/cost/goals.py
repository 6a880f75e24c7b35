"""Requirements as the goals of tuning: soft ones are minimised, as far as hard ones are kept over the robots.

A soft goal is 1 at the limit of its requirement, grows by 1 with each unit of its scale beyond, and dies out inside:

    g(rho) = 1 - rho where the robustness rho < 0, else exp(-rho)

so it is positive, smooth, and asks for ever less of what is kept by far. Of a robot the largest soft goal counts, as
in systune: no weights have to be chosen, scales do that, and what is worst is worked on. The maximum is smooth
(``BLEND``), so that the others are not left lying. The risk of [tuning] makes one number of all robots.

Hard requirements have to be kept by the worst robot, in the mean of the worst ones, or by a share of them, with a
reserve, since the robots of a search are few. What is missing is an exact penalty: beyond some weight its minimum is
that of the constrained problem, and ``PENALTY`` lets a hundredth of a scale count as much as a soft goal at its limit.
Candidates are so ranked by hard requirements first.

>>> float(soft_goal(jnp.array(0.0))), float(soft_goal(jnp.array(-2.0)))
(1.0, 3.0)
"""

from __future__ import annotations

import functools
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from coopmm_jax.scenario.sections.requirements import Requirement
from tuning.cost import required
from tuning.cost.evaluate import Samples
from tuning.cost.objective import Objective
from tuning.cost.required import Required
from tuning.cost.risk import Risk, risk, tail_shares

if TYPE_CHECKING:
    from coopmm_jax.scenario.scenario import Scenario

PENALTY = 100.0  # on a robustness that is missing, in units of the scale
BLEND = 0.1  # differences of soft goals of one robot over which their maximum is smooth
_SMOOTH = 0.02  # likewise of what is missing, for slopes alone


class Assessed(NamedTuple):
    """Goals of C candidates."""

    values: np.ndarray  # (C,)
    kept: np.ndarray  # (C, H) hard requirements that are kept over the robots, as booleans
    lost: np.ndarray  # (C,) whether a rollout failed


@dataclass(frozen=True)
class Goals:
    """Goals of gains, as a function of a vector and of the samples that they are tried on."""

    required: Required
    requirements: tuple[Requirement, ...]  # R of the scenario
    risk: Risk
    over: str  # worst, cvar or fraction
    level: float  # of the last two
    reserve: float  # robustness that hard requirements need, in units of their scales

    @classmethod
    def of(cls, objective: Objective, scenario: Scenario) -> Goals:
        """Goals that [tuning] and [requirements] of a scenario state."""
        settings, stated = scenario.tuning, scenario.requirements.parsed()
        chosen = risk(settings.risk, settings.risk_level, settings.sharpness)
        over = (settings.hard_over, settings.hard_level, settings.hard_reserve)
        return cls(Required.of(objective, scenario), stated, chosen, *over)

    @property
    def hard(self) -> tuple[int, ...]:
        """Positions of the hard requirements (H,)."""
        return tuple(i for i, each in enumerate(self.requirements) if each.hard)

    @property
    def soft(self) -> tuple[int, ...]:
        """Positions of the soft ones; of all where none is soft, which are then driven on beyond their limits."""
        return tuple(i for i, each in enumerate(self.requirements) if not each.hard) or self.hard

    @property
    def numbers(self) -> np.ndarray:
        """Limits, scales and the numbers of sentences, as a program takes them (k,)."""
        return self.required.numbers(self.requirements)

    def assess(self, vectors: np.ndarray, samples: Samples, precision: str = "float64") -> Assessed:
        """Goals of vectors (C, n); what one is worth does not depend on the others."""
        found = required.evaluate(self.required, vectors, samples, self.numbers, precision)
        values, kept = _many(self, jnp.asarray(found.values))
        return Assessed(np.asarray(values), np.asarray(kept), np.any(~found.completed, axis=1))

    def values(self, vectors: np.ndarray, samples: Samples, precision: str = "float64") -> np.ndarray:
        """Goals (C,) of vectors (C, n)."""
        return self.assess(vectors, samples, precision).values

    def outcomes(
        self, vectors: np.ndarray, samples: Samples, precision: str = "float64"
    ) -> tuple[np.ndarray, np.ndarray]:
        """Goals (C,) of vectors (C, n), and whether a rollout failed (C,)."""
        found = self.assess(vectors, samples, precision)
        return found.values, found.lost

    def slopes(self, vectors: np.ndarray, samples: Samples) -> tuple[np.ndarray, np.ndarray]:
        """Goals (C,) of vectors (C, n) and gradients (C, n), of smooth robustness and with smooth maxima."""
        found = required.evaluate(self.required, vectors, samples, self.numbers)
        values, _ = _many(self, jnp.asarray(found.values))
        weights = np.asarray(_weights(self, jnp.asarray(found.values)))  # (C, N, R)
        slopes = required.gradients(self.required, vectors, samples, self.required.numbers(self.requirements, weights))
        return np.asarray(values), np.sum(slopes, axis=1)

    def each(self, vector: np.ndarray, samples: Samples) -> np.ndarray:
        """Goal of a vector (n,) on every sample alone (N,); 1e6 or more of a rollout that fails."""
        found = required.evaluate(self.required, vector[None], samples, self.numbers).values[0]
        return np.asarray(_alone(self, jnp.asarray(found)))

    def by_sample(self, vector: np.ndarray, samples: Samples) -> np.ndarray:
        """Slopes of these goals by every sample's own numbers (N, leaves), of a vector (n,)."""
        found = required.evaluate(self.required, vector[None], samples, self.numbers).values
        weights = np.asarray(_weights_alone(self, jnp.asarray(found[0])))[None]
        numbers = self.required.numbers(self.requirements, weights)
        return required.sensitivities(self.required, vector[None], samples, numbers)[0]

    def total(self, robustness: jax.Array, smoothly: bool = False) -> jax.Array:
        """Goal of a candidate from the robustness of every robot and requirement (N, R) in units of the scales."""
        soft = self.risk(jax.vmap(self._soft)(robustness))
        if not self.hard:
            return soft
        short = jnp.max(self._short(robustness), axis=-1)
        return soft + penalty(self._over_robots(short, smoothly))

    def alone(self, robustness: jax.Array) -> jax.Array:
        """Goal of one robot (R,)."""
        soft = self._soft(robustness)
        return soft + penalty(jnp.max(self._short(robustness[None]))) if self.hard else soft

    def kept(self, robustness: jax.Array) -> jax.Array:
        """Hard requirements that the robots (N, R) keep, each by itself, without a reserve (H,)."""
        kept = [self._over_robots(-robustness[:, i]) <= 0.0 for i in self.hard]
        return jnp.stack(kept) if kept else jnp.zeros((0,), bool)

    def _soft(self, robustness: jax.Array) -> jax.Array:
        goals = soft_goal(jnp.stack([robustness[i] for i in self.soft]))
        return BLEND * (jax.nn.logsumexp(goals / BLEND) - np.log(len(self.soft)))

    def _short(self, robustness: jax.Array) -> jax.Array:
        """Robustness (N, H) that the hard requirements of robots (N, R) miss, the reserve among it."""
        # what has to equal a number cannot be kept by more than nothing
        reserve = (0.0 if self.requirements[i].relation == "==" else self.reserve for i in self.hard)
        return jnp.stack([kept - robustness[:, i] for kept, i in zip(reserve, self.hard, strict=True)], axis=-1)

    def _over_robots(self, short: jax.Array, smoothly: bool = False) -> jax.Array:
        """One number of what the robots miss (N,)."""
        count = short.shape[0]
        if self.over == "cvar":
            return jnp.dot(-jnp.sort(-short), jnp.asarray(tail_shares(count, self.level), short.dtype))
        allowed = int((1.0 - self.level) * count + 1e-9) if self.over == "fraction" else 0
        worst_first = -jnp.sort(-short)[allowed:]
        return _SMOOTH * jax.nn.logsumexp(worst_first / _SMOOTH) if smoothly else worst_first[0]


def soft_goal(robustness: jax.Array) -> jax.Array:
    """Soft goals (...,) from the robustness in units of the scale."""
    return jnp.where(robustness > 0.0, jnp.exp(-jnp.maximum(robustness, 0.0)), 1.0 - robustness)


def penalty(short: jax.Array) -> jax.Array:
    """Penalty on what is missing, in units of the scale [-]; beyond one it grows slowly, so that slopes stay sound."""
    short = jnp.maximum(short, 0.0)
    return PENALTY * jnp.where(short > 1.0, 1.0 + jnp.log(jnp.maximum(short, 1.0)), short)


@functools.partial(jax.jit, static_argnums=0)
def _many(goals: Goals, robustness: jax.Array) -> tuple[jax.Array, jax.Array]:
    return jax.vmap(goals.total)(robustness), jax.vmap(goals.kept)(robustness)


@functools.partial(jax.jit, static_argnums=0)
def _weights(goals: Goals, robustness: jax.Array) -> jax.Array:
    return jax.vmap(jax.grad(functools.partial(goals.total, smoothly=True)))(robustness)


@functools.partial(jax.jit, static_argnums=0)
def _alone(goals: Goals, robustness: jax.Array) -> jax.Array:
    return jax.vmap(goals.alone)(robustness)


@functools.partial(jax.jit, static_argnums=0)
def _weights_alone(goals: Goals, robustness: jax.Array) -> jax.Array:
    return jax.vmap(jax.grad(goals.alone))(robustness)
