"""Curves in the plane that stand still in a picture: what the platforms should drive along, and the object's guide."""

from __future__ import annotations

import jax
import numpy as np

from coopmm_jax.kinds.paths import Path, frame, span
from coopmm_jax.parameters import Parameters, PathReference

_POINTS = 361  # of a curve


def platform_curves(parameters: Parameters) -> list[np.ndarray]:
    """Desired paths of both platforms, points (k, 2) each [m].

    >>> [curve.shape for curve in platform_curves(Parameters())]
    [(361, 2), (361, 2)]
    """
    reference = parameters.reference
    if not isinstance(reference, PathReference):
        return [_circle(float(radius)) for radius in reference.radius]
    return [_beside(reference.path, float(offset)) for offset in reference.offset]


def guide_curve(rows: tuple[str, ...], parameters: Parameters) -> np.ndarray | None:
    """Points (k, 2) of the object's guide [m]; None without one."""
    if "guide_radial" not in rows:
        return None
    guide = parameters.plant.guide
    return _circle(float(parameters.plant.surface.guide_radius)) if guide is None else _beside(guide.path, 0.0)


def _circle(radius: float) -> np.ndarray:
    angle = np.linspace(0.0, 2.0 * np.pi, _POINTS)
    return radius * np.stack([np.cos(angle), np.sin(angle)], axis=-1)


def _beside(path: Path, offset: float) -> np.ndarray:
    """Points to the right of a path, at a distance from it [m]."""
    at = jax.vmap(lambda phase: frame(path, phase))(np.linspace(*span(path), _POINTS))
    return np.stack([np.asarray(p + offset * n) for p, n in zip(at.point, at.lateral, strict=True)], axis=-1)
