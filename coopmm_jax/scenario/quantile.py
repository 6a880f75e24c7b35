"""Quantiles of the distributions of [uncertainty]: the number at a point of the unit interval, NumPy's or JAX's.

>>> from coopmm_jax.scenario.sections.uncertainty import Distribution
>>> quantile(Distribution(distribution="uniform", low=1.0, high=3.0), 0.25)
1.5
"""

from __future__ import annotations

from typing import Any

import numpy as np

from coopmm_jax.scenario.sections.uncertainty import Distribution


def quantile(law: Distribution, u: Any) -> Any:
    """Number with this share of the distribution below it.

    Args:
        law: of the number.
        u: share in (0, 1), an array (...) of NumPy or JAX, or a float.

    Returns:
        Of shape (...), in the field's units or as a factor or offset on it.
    """
    low, high = law.bounds()
    if law.distribution == "uniform":
        return low + (high - low) * u
    if law.distribution == "log_uniform":
        return low * (high / low) ** u
    mean, std = law.moments()
    if law.distribution == "truncated_normal":
        from scipy.special import ndtr  # as below: few scenarios need what takes long to import

        below, above = (float(ndtr((x - mean) / std)) for x in (low, high))
        u = below + (above - below) * u
    return mean + std * _normal_quantile(u)


def _normal_quantile(u: Any) -> Any:
    if isinstance(u, np.ndarray | np.floating):
        from scipy.special import ndtri
    else:
        from jax.scipy.special import ndtri
    return ndtri(u)
