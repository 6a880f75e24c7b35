"""Gains as an unconstrained vector: logarithmic inside their bounds, never outside them.

>>> from coopmm_jax.scenario.scenario import load_scenario
>>> space = gain_space(load_scenario("paper", tuning={"channels": "shared"}))
>>> [round(float(g), 3) for g in space.gains(space.start).K_lambda]
[0.3, 0.3, 0.3, 0.3]
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import jax.numpy as jnp
import numpy as np
from scipy.stats import qmc

from coopmm_jax.errors import UserError
from coopmm_jax.parameters import Gains
from coopmm_jax.scenario.sections.controller import GAINS

if TYPE_CHECKING:
    from coopmm_jax.scenario.scenario import Scenario


@dataclass(frozen=True)
class GainSpace:
    """The n numbers that are tuned and what they stand for; hashable.

    A number x stands for the gain exp(x) - offset: one unit of x is a factor of e. The offset is 1 for K_lambda, which
    only has to exceed -1, and 0 for positive gains.
    """

    base: Gains  # the starting gains
    names: tuple[str, ...]  # of the tuned gains
    owner: tuple[int, ...]  # (n,) position in ``names`` of the gain that a number belongs to
    low: tuple[float, ...]  # (n,) log(bound + offset)
    high: tuple[float, ...]  # (n,)
    shared: bool

    @property
    def size(self) -> int:
        """n."""
        return len(self.owner)

    @property
    def start(self) -> np.ndarray:
        """The vector of the starting gains (n,)."""
        values = np.array([value for name in self.names for value in self._entries(name)])
        return np.log(values + self._offsets())

    def inside(self, vectors: np.ndarray) -> np.ndarray:
        """The nearest vectors (..., n) between the bounds."""
        return np.clip(vectors, self.low, self.high)

    def values(self, vector: Any) -> Any:
        """The gains that n numbers stand for (n,), in their own units; differentiable."""
        return jnp.exp(vector) - self._offsets()

    def gains(self, vector: Any) -> Gains:
        """All gains, with the tuned ones from ``vector`` (n,)."""
        values = self.values(vector)
        changed = {}
        for i, name in enumerate(self.names):
            entries = [values[k] for k, owner in enumerate(self.owner) if owner == i]
            before = getattr(self.base, name)
            if isinstance(before, tuple):
                changed[name] = tuple(entries * len(before) if self.shared else entries)
            else:
                changed[name] = entries[0]
        return self.base._replace(**changed)

    def spread(self, fractions: np.ndarray) -> np.ndarray:
        """Vectors (..., n) whose gains lie at ``fractions`` (..., names) of their logarithmic ranges.

        Entries of one gain are alike: with one coordinate per gain, few points cover the space well.
        """
        low, high = np.array(self.low), np.array(self.high)
        return low + (high - low) * fractions[..., list(self.owner)]

    def starts(self, count: int, seed: int) -> np.ndarray:
        """Vectors to begin a search at (count, n): the starting gains, then scrambled Sobol points."""
        engine = qmc.Sobol(len(self.names), scramble=True, rng=seed)
        points = engine.random_base2(max(0, (count - 1).bit_length()))[:count]
        return np.concatenate([self.start[None], self.spread(points)[1:]])

    def labels(self) -> list[str]:
        """Name of each number (n,), as K_I[2]."""
        counts = [self.owner.count(i) for i in self.owner]
        index = [k - self.owner.index(i) for k, i in enumerate(self.owner)]
        return [self.names[i] + (f"[{j}]" if c > 1 else "") for i, j, c in zip(self.owner, index, counts, strict=True)]

    def _entries(self, name: str) -> tuple[float, ...]:
        value = getattr(self.base, name)
        if not isinstance(value, tuple):
            return (value,)
        return value[:1] if self.shared else value

    def _offsets(self) -> np.ndarray:
        return np.array([_offset(self.names[i]) for i in self.owner])


def gain_space(scenario: Scenario) -> GainSpace:
    """The numbers that the scenario's [tuning] wants tuned.

    Raises:
        UserError: a bound that excludes the starting gain, or different entries to be tuned as one.
    """
    base, settings = scenario.parameters().gains, scenario.tuning
    shared = settings.channels == "shared"
    owner, low, high = [], [], []
    for i, name in enumerate(settings.gains):
        value, bounds = getattr(base, name), getattr(settings.bounds, name)
        entries = value if isinstance(value, tuple) else (value,)
        if shared and len(set(entries)) > 1:
            raise UserError(f"gains.{name}", "one number where tuning.channels is shared", list(entries))
        for entry in entries:
            if not bounds[0] <= entry <= bounds[1]:
                must = f"bounds between which the starting gain {entry:g} lies"
                raise UserError(f"tuning.bounds.{name}", must, list(bounds))
        for _ in entries[:1] if shared else entries:
            owner.append(i)
            low.append(float(np.log(bounds[0] + _offset(name))))
            high.append(float(np.log(bounds[1] + _offset(name))))
    return GainSpace(base, settings.gains, tuple(owner), tuple(low), tuple(high), shared)


def _offset(name: str) -> float:
    return GAINS[name].offset
