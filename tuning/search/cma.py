"""CMA-ES: a cloud of points that learns from their order alone where to move, how far, and along which directions.

The (mu / mu_w, lambda) strategy with negative weights of N. Hansen, The CMA Evolution Strategy: A Tutorial, 2016,
arXiv:1604.00772, whose symbols the comments name.

>>> place = begin(np.array([3.0, -2.0]), spread=1.0)
>>> for generation in range(60):
...     points = ask(place, 8, np.random.default_rng(generation))
...     place = tell(place, points, np.sum(points**2, axis=1))
>>> bool(np.abs(place.mean).max() < 1e-3)
True
"""

from __future__ import annotations

from functools import cache
from typing import NamedTuple

import numpy as np


class Cloud(NamedTuple):
    """The normal distribution that the next generation is drawn from, and what it remembers."""

    mean: np.ndarray  # (n,)
    spread: float  # sigma, the overall standard deviation
    shape: np.ndarray  # C (n, n): the covariance is sigma^2 C
    drift: np.ndarray  # p_sigma (n,): steps of the mean, as if C were round
    path: np.ndarray  # p_c (n,): steps of the mean
    generation: int


class Rates(NamedTuple):
    """Constants of the strategy for n numbers and a population."""

    weights: np.ndarray  # w (population,) of the points, the best first
    parents: int  # mu: how many of them move the mean
    mass: float  # mu_eff
    path: float  # c_c
    drift: float  # c_sigma
    one: float  # c_1
    many: float  # c_mu
    damping: float  # d_sigma
    length: float  # of a standard normal vector, expected


def begin(mean: np.ndarray, spread: float) -> Cloud:
    """A round cloud around ``mean`` (n,), of a standard deviation in every number."""
    zero = np.zeros(mean.size)
    return Cloud(mean, spread, np.eye(mean.size), zero, zero, 0)


def ask(cloud: Cloud, population: int, rng: np.random.Generator) -> np.ndarray:
    """Points of the next generation, each (n,)."""
    lengths, axes = _axes(cloud.shape)
    return cloud.mean + cloud.spread * (rng.normal(size=(population, cloud.mean.size)) * lengths) @ axes.T


def tell(cloud: Cloud, points: np.ndarray, values: np.ndarray) -> Cloud:
    """The cloud after a generation of points, each (n,), whose costs are ``values`` (C,)."""
    k = rates(cloud.mean.size, len(points))
    lengths, axes = _axes(cloud.shape)
    round_again = (axes / lengths) @ axes.T  # C^(-1/2)
    steps = (points[np.argsort(values, kind="stable")] - cloud.mean) / cloud.spread
    moved = k.weights[: k.parents] @ steps[: k.parents]
    drift = (1.0 - k.drift) * cloud.drift + np.sqrt(k.drift * (2.0 - k.drift) * k.mass) * round_again @ moved
    known = 1.0 - (1.0 - k.drift) ** (2 * (cloud.generation + 1))
    calm = np.linalg.norm(drift) / np.sqrt(known) < (1.4 + 2.0 / (cloud.mean.size + 1)) * k.length  # h_sigma
    path = (1.0 - k.path) * cloud.path + calm * np.sqrt(k.path * (2.0 - k.path) * k.mass) * moved
    far = cloud.mean.size / np.maximum(np.sum((steps @ round_again) ** 2, axis=1), 1e-12)
    weights = np.where(k.weights >= 0.0, k.weights, k.weights * far)
    kept = 1.0 - k.one - k.many * k.weights.sum() + (not calm) * k.one * k.path * (2.0 - k.path)
    shape = kept * cloud.shape + k.one * np.outer(path, path) + k.many * (steps.T * weights) @ steps
    growth = np.exp(min(1.0, k.drift / k.damping * (np.linalg.norm(drift) / k.length - 1.0)))
    spread = float(cloud.spread * growth)
    return Cloud(cloud.mean + cloud.spread * moved, spread, shape, drift, path, cloud.generation + 1)


@cache
def rates(n: int, population: int) -> Rates:
    """The tutorial's defaults for n numbers."""
    raw = np.log((population + 1) / 2) - np.log(np.arange(1, population + 1))
    parents = population // 2
    mass, against = (part.sum() ** 2 / np.sum(part**2) for part in (raw[:parents], raw[parents:]))
    path = (4.0 + mass / n) / (n + 4.0 + 2.0 * mass / n)
    drift = (mass + 2.0) / (n + mass + 5.0)
    one = 2.0 / ((n + 1.3) ** 2 + mass)
    many = min(1.0 - one, 2.0 * (0.25 + mass + 1.0 / mass - 2.0) / ((n + 2.0) ** 2 + mass))
    damping = 1.0 + 2.0 * max(0.0, np.sqrt((mass - 1.0) / (n + 1.0)) - 1.0) + drift
    negative = min(1.0 + one / many, 1.0 + 2.0 * against / (mass + 2.0), (1.0 - one - many) / (n * many))
    weights = np.where(raw > 0.0, raw / raw[raw > 0.0].sum(), negative * raw / -raw[raw < 0.0].sum())
    length = np.sqrt(n) * (1.0 - 1.0 / (4.0 * n) + 1.0 / (21.0 * n * n))
    return Rates(weights, parents, mass, path, drift, one, many, damping, length)


def _axes(shape: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Standard deviations (n,) along the principal axes (n, n) of a covariance."""
    variances, axes = np.linalg.eigh(shape)
    return np.sqrt(np.maximum(variances, 1e-20)), axes
