"""Smooth curves through given points: Fourier series of closed ones, Chebyshev series of open ones and of tables.

Points are joined by a quintic spline over the length of the way between them, and the spline by a series, which is
smooth to all orders, as backstepping needs derivatives up to the fourth.

>>> import numpy as np
>>> angle = np.linspace(0.0, 2.0 * np.pi, 12, endpoint=False)
>>> fit = closed_fit(np.stack([np.cos(angle), np.sin(angle)], axis=1), 3)
>>> fit.deviation < 1e-3
True
"""

from __future__ import annotations

from typing import Any, NamedTuple

from coopmm_jax.algebra.later import np

_FINE = 2048  # points at which spline and series are compared


class Fit(NamedTuple):
    """Series, and its largest distance from the spline through the points."""

    coefficients: Any  # of a closed curve (2, K + 1) complex, else (2, K + 1) or (K + 1,)
    deviation: float


def closed_fit(points: np.ndarray, harmonics: int) -> Fit:
    """Fourier series through points (n, 2) [m] and back to the first; entry k of the coefficients is a_k - i b_k."""
    from scipy.interpolate import make_interp_spline

    way, around = _way(np.concatenate([points, points[:1]]))
    spline = make_interp_spline(2.0 * np.pi * way, around, k=5, bc_type="periodic")
    phase = np.linspace(0.0, 2.0 * np.pi, _FINE, endpoint=False)
    fine = spline(phase)
    series = np.fft.rfft(fine, axis=0)[: harmonics + 1].T * (2.0 / _FINE)
    series[:, 0] *= 0.5
    fitted = (series @ np.exp(1j * np.outer(np.arange(harmonics + 1), phase))).real.T
    return Fit(series, _largest(fitted - fine))


def open_fit(points: np.ndarray, degree: int) -> Fit:
    """Chebyshev series from the first of some points (n, 2) [m] to the last."""
    way, points = _way(points)
    return _chebyshev(2.0 * way - 1.0, points, degree)


def table_fit(times: np.ndarray, values: np.ndarray, degree: int) -> Fit:
    """Chebyshev series between the first and the last of some times (n,) [s]."""
    first, last = times[0], times[-1]
    return _chebyshev((2.0 * times - first - last) / (last - first), values, degree)


def _chebyshev(x: np.ndarray, values: np.ndarray, degree: int) -> Fit:
    from scipy.interpolate import make_interp_spline

    spline = make_interp_spline(x, values, k=min(5, len(x) - 1))
    nodes = np.cos(np.pi * (np.arange(_FINE) + 0.5) / _FINE)
    coefficients = np.polynomial.chebyshev.chebfit(nodes, spline(nodes), degree)
    fitted = np.polynomial.chebyshev.chebval(nodes, coefficients)
    return Fit(coefficients.T, _largest(fitted.T - spline(nodes)))


def _way(points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Share of the way at each point, from 0 to 1, and the points."""
    steps = np.linalg.norm(np.diff(points, axis=0), axis=1)
    way = np.concatenate([[0.0], np.cumsum(steps)])
    return way / way[-1], points


def _largest(errors: np.ndarray) -> float:
    return float(np.max(np.linalg.norm(errors, axis=-1) if errors.ndim > 1 else np.abs(errors)))
