"""Desired values and limits that a scenario sets to a quantity over time, drawn where the quantity is."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import jax
import numpy as np
from matplotlib.axes import Axes

from coopmm_jax.control.reference import at_instant, desired_force
from coopmm_jax.metrics.table import LATE_FROM, METRICS
from coopmm_jax.plotting import style

if TYPE_CHECKING:
    from coopmm_jax.scenario.scenario import Scenario

# Metrics whose requirement is a limit of a series at every instant.
_LIMITING = {
    "contact_force": ("force_min", "force_max", "force_min_late", "force_max_late"),
    "tracking_error": ("error_late",),
    "object_error": ("object_max",),
    "relative_tip_error": ("relative_tip_max",),
    "internal_force": ("internal_force_max",),
    "torque": ("torque_peak",),
    "c_hat": ("c_hat_max",),
}
_FARTHEST = 1.5  # spans of what is drawn: a limit farther off would leave no room for the rest


def draw_desired(axes: Axes, scenario: Scenario, t: np.ndarray) -> None:
    """Draw the desired contact force [N] at times (T,) [s]."""
    reference, rows = scenario.parameters().reference, scenario.structure().rows
    with jax.enable_x64(True):
        force = jax.vmap(lambda time: desired_force(at_instant(reference, time), rows, time)[0])(t)
    axes.plot(t, np.broadcast_to(np.asarray(force), t.shape), label="desired", **style.REFERENCE)


def draw_limits(
    axes: Axes, scenario: Scenario, name: str, t: np.ndarray, window: tuple[float, float] = (-np.inf, np.inf)
) -> None:
    """Draw the limits that requirements and motors set to a quantity, over the times at which they count.

    A limit far beyond everything else on a linear axis is left out.

    Args:
        axes: with everything else drawn.
        scenario: with the requirements.
        name: of the quantity, as a sweep's series are called.
        t: times of the run (T,) [s].
        window: first and last time to show [s].
    """
    if not len(t):
        return
    low, high = axes.dataLim.y0, axes.dataLim.y1
    reach = np.inf if axes.get_yscale() == "log" else _FARTHEST * (high - low)
    named: set[str] = set()
    for label, level, since in _limits(scenario, name):
        start, end = max(window[0], t[0], since), min(window[1], t[-1])
        if low - reach <= level <= high + reach and start < end:
            axes.plot([start, end], [level, level], label=f"_{label}" if label in named else label, **style.LIMIT)
            named.add(label)


def _limits(scenario: Scenario, name: str) -> Iterator[tuple[str, float, float]]:
    """Names of limits, the limits, and the time [s] from which on each counts."""
    late = LATE_FROM * scenario.simulation.duration
    for requirement in scenario.requirements.parsed():
        if requirement.metric in _LIMITING.get(name, ()):
            metric = METRICS[requirement.metric]
            yield "limit", requirement.limit, 0.0 if metric.window == "whole" else late
    if name == "torque":
        motors = {"wheels' limit": scenario.actuators.wheel_limit, "joints' limit": scenario.actuators.joint_limit}
        yield from ((label, limit, 0.0) for label, limit in motors.items() if np.isfinite(limit))
