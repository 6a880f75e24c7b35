"""Figures of the motion: platforms (Fig. 3, 4, 7), arms (Fig. 5, 8), tracking errors of the chained form."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from coopmm_jax.errors import UserError
from coopmm_jax.mechanics.robot import PLATFORM
from coopmm_jax.mechanics.robot_kinematics import in_world
from coopmm_jax.plotting import style
from coopmm_jax.plotting.curves import guide_curve
from coopmm_jax.plotting.lines import Run, longest, runs, time_panel

if TYPE_CHECKING:
    from coopmm_jax.runs.trajectory import Trajectory

ROBOTS = ("I", "II")
ERRORS = ("e1 angle", "e2 lateral", "e3 forward")  # of the chained form (6)


def robot_index(robot: str) -> int:
    """Index of robot "I" or "II" along the second axis of a trajectory's arrays.

    Raises:
        UserError: it is neither.
    """
    if robot not in ROBOTS:
        raise UserError("robot", "one of I, II", robot)
    return ROBOTS.index(robot)


@style.styled
def platform_paths(
    *trajectories: Trajectory, labels: Sequence[str] | None = None, axes: style.GivenAxes = None
) -> Figure:
    """Paths of both axle midpoints [m] and their references (Fig. 3); a dot marks each start.

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
    >>> figure = platform_paths(cm.simulate(short))
    """
    figure, (panel,) = style.panels(axes, [["paths"]], height=5.0)
    paths_panel(panel, runs(trajectories, labels))
    return figure


@style.styled
def platform_angle(
    *trajectories: Trajectory, robot: str, labels: Sequence[str] | None = None, axes: style.GivenAxes = None
) -> Figure:
    """Platform angle theta of one robot, its reference, and the error between them [rad] (Fig. 4 and 7).

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
    >>> figure = platform_angle(cm.simulate(short), robot="I")
    """
    i, group = robot_index(robot), runs(trajectories, labels)
    figure, (angle, error) = style.panels(axes, [["angle"], ["error"]], height=4.4)
    reference = {"θ desired": lambda run: run.zeta_desired[:, i, 0]}
    time_panel(angle, group, {"θ": lambda run: run.zeta[:, i, 0]}, f"θ of {robot} [rad]", reference)
    difference = {"θ - θ desired": lambda run: run.zeta[:, i, 0] - run.zeta_desired[:, i, 0]}
    time_panel(error, group, difference, "error [rad]")
    return figure


@style.styled
def arm_angles(
    *trajectories: Trajectory, robot: str, labels: Sequence[str] | None = None, axes: style.GivenAxes = None
) -> Figure:
    """Arm joints of one robot [rad] (Fig. 5 and 8): yaw a1 with its reference; a2 and a3, set by the constraints.

    Arms of [arm] have as many as it says, a lift [m] among them.

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
    >>> figure = arm_angles(cm.simulate(short), robot="I")
    """
    i, group = robot_index(robot), runs(trajectories, labels)
    figure, (yaw, pitch) = style.panels(axes, [["yaw"], ["pitch"]], height=4.4)
    reference = {"a1 desired": lambda run: run.arm_desired[:, i]}
    time_panel(yaw, group, {"a1": lambda run: run.q[:, i, 3]}, f"yaw of {robot} [rad]", reference)
    count = group[0].trajectory.scenario.arm.joints[i] - PLATFORM
    joints = {f"a{j}": lambda run, j=j: run.q[:, i, 2 + j] for j in range(2, count + 1)}
    time_panel(pitch, group, joints, f"pitch of {robot} [rad]")
    return figure


@style.styled
def chained_errors(
    *trajectories: Trajectory, labels: Sequence[str] | None = None, axes: style.GivenAxes = None
) -> Figure:
    """Tracking errors zeta - zeta_d of both platforms in chained form (6): e1 [rad], e2 and e3 [m].

    Args:
        trajectories: one, or several to compare.
        labels: one for each trajectory.
        axes: two matplotlib axes to draw on.

    Returns:
        The figure that was drawn on.

    Raises:
        UserError: nothing to draw, or labels or axes of the wrong number.

    >>> import coopmm_jax as cm
    >>> short = cm.load_scenario("paper", simulation={"duration": 0.05})
    >>> figure = chained_errors(cm.simulate(short))
    """
    group = runs(trajectories, labels)
    figure, both = style.panels(axes, [["robot I"], ["robot II"]], height=4.4)
    for panel, robot in zip(both, ROBOTS, strict=True):
        errors_panel(panel, group, robot)
    return figure


def paths_panel(axes: Axes, group: Sequence[Run]) -> None:
    """Draw the paths of both platforms of every run [m]."""
    for k, (run, i) in enumerate((run, i) for run in group for i in range(len(ROBOTS))):
        x, y = run.trajectory.q[:, i, 0], run.trajectory.q[:, i, 1]
        kept, pen = _evenly(len(x)), style.pen(k)
        label = ", ".join(filter(None, (f"robot {ROBOTS[i]}", run.label)))
        axes.plot(x[kept], y[kept], label=label, **pen)
        axes.plot(x[:1], y[:1], "o", color=pen["color"], label="_start")
    reference = longest(group)
    kept = _evenly(len(reference.t))
    for i in range(len(ROBOTS)):
        x, y = midpoints(reference.zeta_desired[kept, i]).T
        axes.plot(x, y, label="desired" if i == 0 else "_desired", **style.REFERENCE)
    guide = guide_curve(reference.rows, reference.scenario.parameters())
    if guide is not None:
        axes.plot(*guide.T, label="guide of the object", color="0.75", linewidth=0.9, linestyle=(0, (4, 3)))
    axes.set_aspect("equal", adjustable="datalim")
    axes.set_xlabel("x [m]")
    axes.set_ylabel("y [m]")
    style.legend(axes, title="Paths of the platforms, from above")


def errors_panel(axes: Axes, group: Sequence[Run], robot: str) -> None:
    """Draw the errors of the chained form of one robot [rad, m]."""
    i = robot_index(robot)
    errors = {name: lambda run, j=j: run.zeta[:, i, j] - run.zeta_desired[:, i, j] for j, name in enumerate(ERRORS)}
    title = f"Platform {robot}: angle and place less the desired ones"
    time_panel(axes, group, errors, f"errors of {robot} [rad, m]", title=title)


def midpoints(zeta: np.ndarray) -> np.ndarray:
    """Axle midpoint x, y (..., 2) [m] from chained coordinates (..., 3): the inverse of (6)."""
    th, lateral, forward = np.moveaxis(zeta, -1, 0)
    return np.stack(in_world(lateral, forward, (np.sin(th), np.cos(th))), axis=-1)


def _evenly(samples: int, points: int = 1000) -> np.ndarray:
    return np.linspace(0, samples - 1, min(samples, points)).astype(int)
