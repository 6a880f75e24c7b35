"""Figures of the controller: input torques (Fig. 6, 9), filtered error sigma, adapted bounds chat_k."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from coopmm_jax.mechanics.partitioning import partition
from coopmm_jax.plotting import style
from coopmm_jax.plotting.lines import Quantity, Run, runs, time_panel
from coopmm_jax.plotting.motion import ROBOTS, robot_index

if TYPE_CHECKING:
    from coopmm_jax.runs.trajectory import Trajectory

SIGMA = "\N{GREEK SMALL LETTER SIGMA}"
VELOCITIES = ("u1", "u2", "a1", "a2", "a3")  # of one robot; each entry of sigma is the error of one of them
ACTUATORS = ("right wheel", "left wheel", "joint 1", "joint 2", "joint 3")
BOUNDS = ("inertia", "Coriolis", "Coriolis rate", "gravity", "disturbance")  # what each c_k bounds


@style.styled
def torques(
    *trajectories: Trajectory, robot: str, labels: Sequence[str] | None = None, axes: style.GivenAxes = None
) -> Figure:
    """Input torques of one robot [N m], wheels and joints (Fig. 6 and 9).

    Args:
        trajectories: one, or several to compare.
        robot: "I" or "II".
        labels: one for each trajectory.
        axes: two matplotlib axes to draw on.

    Returns:
        The figure that was drawn on.

    Raises:
        UserError: nothing to draw, no such robot, or labels or axes of the wrong number.

    >>> import coopmm_jax as cm
    >>> short = cm.load_scenario("paper", simulation={"duration": 0.05})
    >>> figure = torques(cm.simulate(short), robot="II")
    """
    group = runs(trajectories, labels)
    figure, (wheels, joints) = style.panels(axes, [["wheels"], ["joints"]], height=4.4)
    values = _torques(robot)
    time_panel(wheels, group, dict(values[:2]), f"wheels of {robot} [N m]")
    time_panel(joints, group, dict(values[2:]), f"joints of {robot} [N m]")
    return figure


@style.styled
def filtered_error(
    *trajectories: Trajectory, labels: Sequence[str] | None = None, axes: style.GivenAxes = None
) -> Figure:
    """Filtered error sigma below (15), which the law (18) drives to zero [rad/s, m/s].

    One line for each independent velocity.

    Args:
        trajectories: one, or several to compare.
        labels: one for each trajectory.
        axes: two matplotlib axes to draw on, for robot I and II.

    Returns:
        The figure that was drawn on.

    Raises:
        UserError: nothing to draw, or labels or axes of the wrong number.

    >>> import coopmm_jax as cm
    >>> short = cm.load_scenario("paper", simulation={"duration": 0.05})
    >>> figure = filtered_error(cm.simulate(short))
    """
    group = runs(trajectories, labels)
    figure, both = style.panels(axes, [["robot I"], ["robot II"]], height=4.4)
    for panel, robot in zip(both, ROBOTS, strict=True):
        sigma_panel(panel, group, robot)
    return figure


@style.styled
def adaptation(*trajectories: Trajectory, labels: Sequence[str] | None = None, axes: style.GivenAxes = None) -> Figure:
    """Estimates chat_k of the bounds on the uncertainty, (20)-(24) [in the units of each bound].

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
    >>> figure = adaptation(cm.simulate(short))
    """
    figure, (panel,) = style.panels(axes, [["bounds"]], height=3.2)
    bounds_panel(panel, runs(trajectories, labels))
    return figure


def torque_panel(axes: Axes, group: Sequence[Run], robot: str) -> None:
    """Draw all five torques of one robot [N m]."""
    time_panel(axes, group, dict(_torques(robot)), f"torques of {robot} [N m]")


def sigma_panel(axes: Axes, group: Sequence[Run], robot: str) -> None:
    """Draw the filtered error sigma of one robot [rad/s, m/s]."""
    independent = partition(group[0].trajectory.rows).independent
    i = robot_index(robot)
    first = 0 if i == 0 else len(independent[0])
    values = {VELOCITIES[j]: lambda run, k=first + k: run.sigma[:, k] for k, j in enumerate(independent[i])}
    time_panel(axes, group, values, f"{SIGMA} of {robot} [rad/s, m/s]")


def bounds_panel(axes: Axes, group: Sequence[Run]) -> None:
    """Draw the five estimates chat_k."""
    values = {name: lambda run, k=k: run.c_hat[:, k] for k, name in enumerate(BOUNDS)}
    time_panel(axes, group, values, "ĉ [N m per unit of f]")


def _torques(robot: str) -> list[tuple[str, Quantity]]:
    i = robot_index(robot)
    return [(name, lambda run, j=j: run.torque[:, i, j]) for j, name in enumerate(ACTUATORS)]
