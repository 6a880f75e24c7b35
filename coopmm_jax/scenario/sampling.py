"""Points of the unit cube by sample index: independent, or scrambled Sobol for smoother statistics of few samples.

A sample's point depends on the seed and its index alone, so a sweep grown from N to 2 N keeps its first N.

>>> points = sampler("independent", seed=0, dimensions=3)
>>> bool(np.all(points([7]) == points([3, 7])[1]))
True
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from coopmm_jax.errors import UserError
from coopmm_jax.scenario.variation import HIGHEST, LOWEST

METHODS = ("independent", "sobol")
SOBOL_LIMIT = 2**30  # points of scipy's sequence, at its default of 30 bits

Points = Callable[[Sequence[int]], np.ndarray]


def sampler(method: str, seed: int, dimensions: int) -> Points:
    """A function from sample indices (B,) to points (B, D) in the open unit cube, float64.

    Sobol points are generated in order: quick for indices that rise from call to call, slow for those that jump back.
    They are not independent, so a Clopper-Pearson interval from them is wider than need be, as a rule.

    Raises:
        UserError: another method.
    """
    if method not in METHODS:
        raise UserError("sampling", " or ".join(METHODS), method)
    raw = _independent(seed, dimensions) if method == "independent" else _sobol(seed, dimensions)
    return lambda indices: np.clip(raw(indices), LOWEST, HIGHEST)


def _independent(seed: int, dimensions: int) -> Points:
    def points(indices: Sequence[int]) -> np.ndarray:
        rows = [np.random.default_rng((seed, int(index))).random(dimensions) for index in indices]
        return np.reshape(rows, (len(rows), dimensions))

    return points


def _sobol(seed: int, dimensions: int) -> Points:
    from scipy.stats import qmc  # takes 0.7 s, and other samples do without

    engine = qmc.Sobol(dimensions, scramble=True, rng=seed)

    def point(index: int) -> np.ndarray:
        if index < engine.num_generated:
            engine.reset()
        if index > engine.num_generated:  # scipy cannot go forward by nothing
            engine.fast_forward(index - engine.num_generated)
        return engine.random(1)[0]

    return lambda indices: np.reshape([point(int(index)) for index in indices], (len(indices), dimensions))
