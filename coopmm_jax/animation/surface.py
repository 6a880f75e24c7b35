"""The object's surface as a film draws it, in the object's frame: e along arm II, n across it [m]."""

from __future__ import annotations

from typing import TYPE_CHECKING

import jax
import jax.numpy as jnp
import numpy as np

from coopmm_jax.mechanics.contact_surface import surface_motion
from coopmm_jax.mechanics.surfaces import shape_of
from coopmm_jax.parameters import Surface

if TYPE_CHECKING:
    from coopmm_jax.runs.trajectory import Trajectory

THICKNESS = 0.12  # of the object behind its surface [m]
_POINTS = 41
_MARGIN, _LEAST = 0.12, 0.4  # beyond the places where the tip touches, and of the half width [m]
_ARC_MARGIN, _ARC_LEAST = 0.15, 0.7  # likewise of an arc, whose points are known by their angle [rad]


class DrawnSurface:
    """A piece of a run's surface, as wide as the tip of robot I slides, and more.

    Args:
        run: of any length.
        touched: places of its tip I from the object (F, 2) [m].
    """

    def __init__(self, run: Trajectory, touched: np.ndarray):
        surface = run.scenario.parameters().plant.surface
        self._points = _arc(surface, touched) if surface.shape is None else _level(surface, touched)
        self._normals = normals(surface, self._points)

    def outline(self, shift: float) -> np.ndarray:
        """Corners of the object (k, 2), its surface first, where that has given way by ``shift`` [m]."""
        inner = self._points + shift * self._normals
        return np.concatenate([inner, (inner + THICKNESS * self._normals)[::-1]])


def normals(surface: Surface, points: np.ndarray) -> np.ndarray:
    """Unit vectors (k, 2) out of the surface at points (k, 2) [m] of it or near it, away from robot I."""
    level, (e, n) = shape_of(surface).level, points.T
    one = np.ones_like(e)
    slopes = jax.jvp(lambda e: level(e, n), (e,), (one,))[1], jax.jvp(lambda n: level(e, n), (n,), (one,))[1]
    gradient = -np.stack(slopes, axis=-1)
    return gradient / np.linalg.norm(gradient, axis=-1, keepdims=True)


def shifts(run: Trajectory, t: np.ndarray) -> np.ndarray:
    """Distances (F,) [m] by which the surface has given way at times t (F,) [s]."""
    if not run.scenario.structure().features.surface_motion:
        return np.zeros(len(t))
    return np.asarray(surface_motion(run.scenario.parameters().hardware, jnp.asarray(t)).shift)


def _arc(surface: Surface, touched: np.ndarray) -> np.ndarray:
    radius = float(surface.contact_radius)
    swept = np.abs(np.arctan2(touched[:, 1], touched[:, 0] + radius)).max(initial=0.0)
    half = np.clip(swept + _ARC_MARGIN, _ARC_LEAST, np.pi)
    angle = np.linspace(-half, half, _POINTS)
    return radius * np.stack([np.cos(angle) - 1.0, np.sin(angle)], axis=-1)


def _level(surface: Surface, touched: np.ndarray) -> np.ndarray:
    """Points of the branch through the object, as far as it reaches."""
    half = max(np.abs(touched[:, 1]).max(initial=0.0) + _MARGIN, _LEAST)
    n = np.linspace(-half, half, _POINTS)
    e = np.asarray(jax.vmap(shape_of(surface).along)(n))
    there = np.isfinite(e)
    return np.stack([e[there], n[there]], axis=-1)
