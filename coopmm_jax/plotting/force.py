"""Figures of the constraints: contact force (Fig. 10), all multipliers, residual phi."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from coopmm_jax.plotting import style
from coopmm_jax.plotting.limits import draw_limits
from coopmm_jax.plotting.lines import Quantity, Run, longest, runs, samples, time_panel

if TYPE_CHECKING:
    from coopmm_jax.runs.trajectory import Trajectory

START = 1.0  # [s] shown of a run's start, or a twentieth of the run if that is less
FEWEST = 20  # samples shown of a run's start, unless the run has less
LOST: dict[str, Any] = style.BEYOND | {"zorder": 1.0}  # unlike a reference, even in grey
SMALLEST = 1e-16  # [m], rounding of the lengths here, so that zero has a place on a logarithmic axis


@style.styled
def contact_force(
    *trajectories: Trajectory, labels: Sequence[str] | None = None, axes: style.GivenAxes = None
) -> Figure:
    """Normal contact force [N] and its desired value (Fig. 10): the whole run, its start, and its settled part.

    Hatched where the force is negative: there the contact would have opened. Hatched over the whole height where a
    compliant contact has opened.

    Args:
        trajectories: one, or several to compare.
        labels: one for each trajectory.
        axes: three matplotlib axes to draw on.

    Returns:
        The figure that was drawn on.

    Raises:
        UserError: nothing to draw, or labels or axes of the wrong number.

    >>> import coopmm_jax as cm
    >>> short = cm.load_scenario("paper", simulation={"duration": 0.05})
    >>> figure = contact_force(cm.simulate(short))
    """
    group = runs(trajectories, labels)
    layout = [["whole", "whole"], ["start", "settled"]]
    figure, (whole, start, settled) = style.panels(axes, layout, height=5.0)
    contact_panel(whole, group)
    contact_start_panel(start, group)
    contact_settled_panel(settled, group)
    return figure


@style.styled
def constraint_forces(
    *trajectories: Trajectory, labels: Sequence[str] | None = None, axes: style.GivenAxes = None
) -> Figure:
    """Multipliers lambda of (9) [N], one line for each constraint row: the contact, and the guide of the object.

    Args:
        trajectories: one, or several to compare.
        labels: one for each trajectory.
        axes: one matplotlib axes to draw on.

    Returns:
        The figure that was drawn on.

    Raises:
        UserError: nothing to draw, or labels or axes of the wrong number.

    >>> import coopmm_jax as cm
    >>> short = cm.load_scenario("paper", simulation={"duration": 0.05})
    >>> figure = constraint_forces(cm.simulate(short))
    """
    figure, (panel,) = style.panels(axes, [["forces"]], height=3.2)
    multipliers_panel(panel, runs(trajectories, labels))
    return figure


@style.styled
def constraint_residual(
    *trajectories: Trajectory, labels: Sequence[str] | None = None, axes: style.GivenAxes = None
) -> Figure:
    """Largest |phi| of each constraint row so far [m], on a logarithmic axis.

    Args:
        trajectories: one, or several to compare.
        labels: one for each trajectory.
        axes: one matplotlib axes to draw on.

    Returns:
        The figure that was drawn on.

    Raises:
        UserError: nothing to draw, or labels or axes of the wrong number.

    >>> import coopmm_jax as cm
    >>> short = cm.load_scenario("paper", simulation={"duration": 0.05})
    >>> figure = constraint_residual(cm.simulate(short))
    """
    figure, (panel,) = style.panels(axes, [["residual"]], height=3.2)
    residual_panel(panel, runs(trajectories, labels))
    return figure


def contact_panel(axes: Axes, group: Sequence[Run], window: tuple[float, float] = (-np.inf, np.inf)) -> None:
    """Draw lambda_n of every run and its desired value [N] between two times [s]."""
    desired = {"desired": lambda run: run.constraint_force_desired[:, 0]}
    time_panel(axes, group, {"normal": _normal}, "contact force [N]", desired, window)
    draw_limits(axes, group[0].trajectory.scenario, "contact_force", group[0].trajectory.t, window)
    label = "contact lost"
    for run in group:
        t, force = samples(run.trajectory, _normal, window)
        if force.min(initial=0.0) < 0.0:
            axes.fill_between(t, force, 0.0, where=force < 0.0, interpolate=True, label=label, **LOST)
            label = "_lost"  # one entry in the legend
        if hatch_open(axes, run.trajectory, window, label=label, **LOST):
            label = "_lost"
    style.legend(axes, title="Contact force, along the surface's normal")


def hatch_open(axes: Axes, run: Trajectory, window: tuple[float, float] = (-np.inf, np.inf), **look: Any) -> bool:
    """Hatch the times [s] at which a compliant contact is open, over the whole height of the axes; True if any are."""
    if run.scenario.contact.model != "compliant":
        return False
    t, gap = samples(run, lambda run: run.constraint_residual[:, 0], window)
    if gap.max(initial=0.0) <= 0.0:
        return False
    axes.fill_between(t, 0.0, 1.0, where=gap > 0.0, transform=axes.get_xaxis_transform(), **look)
    return True


def contact_start_panel(axes: Axes, group: Sequence[Run]) -> None:
    """Draw the contact force at the start, where the transient is; the legend is the contact panel's."""
    t = longest(group).t
    last = min(max(len(t) // 20, FEWEST), len(t) - 1)
    contact_panel(axes, group, (0.0, min(START, t[last]) if len(t) else 0.0))
    _titled(axes, "the same at the start")


def contact_settled_panel(axes: Axes, group: Sequence[Run]) -> None:
    """Draw the contact force from the first quarter on, on its own scale; the legend is the contact panel's."""
    t = longest(group).t
    contact_panel(axes, group, (t[len(t) // 4] if len(t) else 0.0, np.inf))
    _titled(axes, "the same from a quarter on")


def multipliers_panel(axes: Axes, group: Sequence[Run]) -> None:
    """Draw the multipliers of every row [N]."""
    title = "Constraint forces λ of (9), by constraint"
    forces = _by_row(group, lambda run: run.constraint_force)
    time_panel(axes, group, forces, "constraint forces [N]", title=title)


def residual_panel(axes: Axes, group: Sequence[Run]) -> None:
    """Draw the largest |phi| of every row so far [m]; |phi| itself dips to zero wherever phi changes sign."""
    sizes = _by_row(group, lambda run: np.maximum.accumulate(np.abs(run.constraint_residual)) + SMALLEST)
    axes.set_yscale("log")
    time_panel(axes, group, sizes, "residual so far [m]", title="Largest |φ| so far, by constraint")


def _titled(axes: Axes, title: str) -> None:
    """Say what part of a run a panel shows, in the place of a legend that stands beside another panel."""
    if (legend := axes.get_legend()) is not None:
        legend.remove()
    axes.set_title(title, loc="left", fontsize=8)


def _normal(run: Trajectory) -> np.ndarray:
    return run.constraint_force[:, 0]


def _by_row(group: Sequence[Run], values: Quantity) -> dict[str, Quantity]:
    """One quantity for each constraint row, from an array (T, m) of a run."""
    names = group[0].trajectory.rows
    return {name.replace("_", " "): lambda run, k=k: values(run)[:, k] for k, name in enumerate(names)}
