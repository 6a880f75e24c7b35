"""Estimates with confidence intervals."""

from __future__ import annotations

from typing import NamedTuple

CONFIDENCE = 0.95


class Interval(NamedTuple):
    """An estimate with its confidence interval."""

    estimate: float
    low: float
    high: float


def success(passed: int, samples: int) -> Interval:
    """Success probability with its Clopper-Pearson interval, which covers the truth at least 95 % of the time.

    >>> success(10, 10).low > 0.69
    True
    """
    from scipy.stats import binomtest

    interval = binomtest(passed, samples).proportion_ci(CONFIDENCE, method="exact")
    return Interval(passed / samples, float(interval.low), float(interval.high))
