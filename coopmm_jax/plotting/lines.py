"""Lines over time: runs with their labels, and the few points that show a line faithfully.

>>> extremes(np.array([0.0, 5.0, 0.0, 0.0, -5.0, 0.0]), 2).tolist()
[0, 1, 4, 5]
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D

from coopmm_jax.errors import UserError
from coopmm_jax.plotting import style

if TYPE_CHECKING:
    from coopmm_jax.runs.trajectory import Trajectory

POINTS = 2000  # of one line; more than a page has pixels
TIME = "time [s]"
_BLACK: dict[str, Any] = {"color": "black"}
Quantity = Callable[["Trajectory"], np.ndarray]  # (T,) of one run


class Run(NamedTuple):
    """One of the runs in a figure, with its name in the legend (empty when it is alone)."""

    trajectory: Trajectory
    label: str


def runs(trajectories: Sequence[Trajectory], labels: Sequence[str] | None) -> list[Run]:
    """Runs with their labels; by default, the settings in which their scenarios differ.

    Raises:
        UserError: no trajectory, or not one label for each.
    """
    if not trajectories:
        raise UserError("trajectories", "at least one Trajectory", "none")
    labels = _differences(trajectories) if labels is None else labels
    if len(labels) != len(trajectories):
        raise UserError("labels", f"{len(trajectories)}, one for each trajectory", len(labels))
    return [Run(trajectory, label) for trajectory, label in zip(trajectories, labels, strict=True)]


def _differences(trajectories: Sequence[Trajectory]) -> list[str]:
    if len(trajectories) == 1:
        return [""]
    settings = [_settings(trajectory.scenario.model_dump(exclude={"description"})) for trajectory in trajectories]
    names = [name for name in settings[0] if any(other.get(name) != settings[0][name] for other in settings)]
    if not 0 < len(names) <= 2:  # alike, or too many for a legend
        return [f"run {number}" for number in range(1, len(trajectories) + 1)]
    return [", ".join(f"{name} {each[name]}" for name in names) for each in settings]


def _settings(tables: Mapping[str, Any], section: str = "") -> dict[str, Any]:
    flat = {}
    for name, value in tables.items():
        flat |= _settings(value, f"{section}{name}.") if isinstance(value, Mapping) else {f"{section}{name}": value}
    return flat


def extremes(y: np.ndarray, points: int = POINTS) -> np.ndarray:
    """Indices of at most ``points + 2`` samples that keep every peak of y: lowest and highest of each stretch.

    Args:
        y: samples (T,).
        points: even.
    """
    stretch = -(-len(y) // (points // 2))
    if stretch <= 2:
        return np.arange(len(y))
    padded = np.pad(y, (0, -len(y) % stretch), mode="edge").reshape(-1, stretch)
    starts = stretch * np.arange(len(padded))
    last = len(y) - 1
    kept = np.concatenate([starts + padded.argmin(1), starts + padded.argmax(1), [0, last]])
    return np.unique(np.minimum(kept, last))


def time_panel(
    axes: Axes,
    group: Sequence[Run],
    quantities: Mapping[str, Quantity],
    unit: str,
    reference: Mapping[str, Quantity] | None = None,
    window: tuple[float, float] = (-np.inf, np.inf),
    title: str = "",
) -> None:
    """Draw quantities of every run over time, with references, and a mark where a run failed.

    With several quantities of several runs, the dash pattern tells the quantity and the colour the run.

    Args:
        axes: the panel to draw on.
        group: runs with their labels.
        quantities: legend entry -> values (T,) of a run.
        unit: label of the vertical axis, with its unit.
        reference: like ``quantities``, taken from the longest run.
        window: first and last time to show [s].
        title: what the panel shows, above its legend.
    """
    crossed = len(group) > 1 and len(quantities) > 1
    for i, run in enumerate(group):
        for j, (name, quantity) in enumerate(quantities.items()):
            pen = style.pen(i, j) if crossed else style.pen(i + j)
            label = "_crossed" if crossed else run.label or name
            axes.plot(*samples(run.trajectory, quantity, window), label=label, **pen)
    for name, quantity in (reference or {}).items():
        axes.plot(*samples(longest(group), quantity, window), label=name, **style.REFERENCE)
    mark_failures(axes, group, window)
    axes.set_xlabel(TIME)
    axes.set_ylabel(unit)
    key = _key(list(quantities), [run.label for run in group]) if crossed else []
    style.legend(axes, [*key, *axes.get_legend_handles_labels()[0]], title)


def _key(dashes: Sequence[str], colours: Sequence[str]) -> list[Line2D]:
    """Legend entries that explain the dash patterns, in black, and the colours, solid."""
    by_dash = [Line2D([], [], label=name, **style.pen(0, j) | _BLACK) for j, name in enumerate(dashes)]
    return by_dash + [Line2D([], [], label=name, **style.pen(i, 0)) for i, name in enumerate(colours)]


def samples(
    trajectory: Trajectory, quantity: Quantity, window: tuple[float, float] = (-np.inf, np.inf)
) -> tuple[np.ndarray, np.ndarray]:
    """Times [s] and values of a quantity within a window, thinned to the points that a line needs."""
    shown = (trajectory.t >= window[0]) & (trajectory.t <= window[1])
    t, y = trajectory.t[shown], quantity(trajectory)[shown]
    kept = extremes(y)
    return t[kept], y[kept]


def longest(group: Sequence[Run]) -> Trajectory:
    """Trajectory with the most samples."""
    return max((run.trajectory for run in group), key=lambda trajectory: len(trajectory.t))


def mark_failures(axes: Axes, group: Sequence[Run], window: tuple[float, float]) -> None:
    """Draw a vertical line where a run failed within a window [s], named in the legend after its status."""
    for run in group:
        time = run.trajectory.status_time
        if time is not None and window[0] <= time <= window[1]:
            label = ", ".join(filter(None, (f"{run.trajectory.status.name} at {time:.3g} s", run.label)))
            axes.axvline(time, label=label, **style.FAILURE)
