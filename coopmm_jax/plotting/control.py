"""Figures of the controller: input torques (Fig. 6, 9), filtered error sigma, adapted bounds chat_k."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from coopmm_jax.algebra.types import Pair
from coopmm_jax.errors import UserError
from coopmm_jax.kinds.controllers import shown, signals_of
from coopmm_jax.mechanics.partitioning import partition
from coopmm_jax.mechanics.robot import YAW, per_robot
from coopmm_jax.plotting import style
from coopmm_jax.plotting.lines import Quantity, Run, runs, time_panel
from coopmm_jax.plotting.motion import ROBOTS, robot_index
from coopmm_jax.plotting.style import plain

if TYPE_CHECKING:
    from coopmm_jax.runs.trajectory import Trajectory
    from coopmm_jax.scenario.scenario import Scenario

SIGMA = "\N{GREEK SMALL LETTER SIGMA}"
_PLATFORM = ("u1 turning", "u2 driving", "a1 yaw rate")
_WHEELS = ("right wheel", "left wheel")
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
    values = _torques(robot, group)
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
        UserError: nothing to draw, a controller without it, or labels or axes of the wrong number.

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
        UserError: nothing to draw, a controller without it, or labels or axes of the wrong number.

    >>> import coopmm_jax as cm
    >>> short = cm.load_scenario("paper", simulation={"duration": 0.05})
    >>> figure = adaptation(cm.simulate(short))
    """
    figure, (panel,) = style.panels(axes, [["bounds"]], height=3.2)
    bounds_panel(panel, runs(trajectories, labels))
    return figure


def torque_panel(axes: Axes, group: Sequence[Run], robot: str) -> None:
    """Draw all torques of one robot [N m]."""
    time_panel(
        axes, group, dict(_torques(robot, group)), f"torques of {robot} [N m]", title=f"Motor torques of robot {robot}"
    )


def sigma_panel(axes: Axes, group: Sequence[Run], robot: str) -> None:
    """Draw the filtered error sigma of one robot [rad/s, m/s].

    Raises:
        UserError: a controller that does not record it.
    """
    _check_recorded(group, "sigma")
    title = f"{SIGMA}: filtered velocity errors of robot {robot}, which (18) drives to 0"
    time_panel(axes, group, _of_robot("sigma", group, robot), f"{SIGMA} of {robot} [rad/s, m/s]", title=title)


def bounds_panel(axes: Axes, group: Sequence[Run]) -> None:
    """Draw the five estimates chat_k.

    Raises:
        UserError: a controller that does not record it.
    """
    _check_recorded(group, "c_hat")
    title = "ĉ: estimated bounds of the uncertainty, by what they bound"
    time_panel(axes, group, _entries("c_hat", BOUNDS), "ĉ [N m per unit of f]", title=title)


def shown_panels(panels: Sequence[Axes], group: Sequence[Run]) -> None:
    """Draw the signals that a controller wants to be seen; where each velocity has an entry, those of robot I."""
    law = group[0].trajectory.law
    for panel, name in zip(panels, shown(law)):
        signal = signals_of(law)[name]
        label, bracket, unit = (signal.label or f"{plain(name)} [{signal.unit}]").partition(" [")
        of, quantities = "", {plain(name): lambda run, name=name: getattr(run, name)}
        if signal.per == "independent":
            of, quantities = " of I", _of_robot(name, group, "I")
        elif signal.per is not None:
            entries = BOUNDS if signal.per == "bound" else group[0].trajectory.entries_of(name)
            quantities = _entries(name, entries)
        title = f"{label}{of}: {plain(signal.meaning)}"
        time_panel(panel, group, quantities, f"{label}{of}{bracket}{unit}", title=title)


def _entries(name: str, labels: Sequence[str]) -> dict[str, Quantity]:
    return {label: lambda run, k=k: getattr(run, name)[:, k] for k, label in enumerate(labels)}


def _of_robot(name: str, group: Sequence[Run], robot: str) -> dict[str, Quantity]:
    """Entries of one robot of a signal that has one for each independent velocity."""
    scenario, i = group[0].trajectory.scenario, robot_index(robot)
    independent = partition(scenario.coupling.rows, scenario.arm.joints).independent
    first = 0 if i == 0 else len(independent[0])
    names = velocities(scenario)[i]
    return {names[j]: lambda run, k=first + k: getattr(run, name)[:, k] for k, j in enumerate(independent[i])}


def velocities(scenario: Scenario) -> Pair[list[str]]:
    """Velocities u of each robot in words; each entry of sigma is the error of one of them."""

    def of_one(joints: int, lifted: bool) -> list[str]:
        further = (f"a{i} {'lift' if lifted and i == YAW else 'pitch'} rate" for i in range(YAW, joints - YAW + 1))
        return [*_PLATFORM, *further]

    return per_robot(of_one, scenario.arm.joints, scenario.arm.lifted)


def _check_recorded(group: Sequence[Run], name: str) -> None:
    for run in group:
        if name not in run.trajectory.controller:
            chosen = run.trajectory.scenario.law.controller
            raise UserError("trajectories", f"of a controller that records {name}", chosen)


def _torques(robot: str, group: Sequence[Run]) -> list[tuple[str, Quantity]]:
    i = robot_index(robot)
    joints = range(1, group[0].trajectory.scenario.arm.joints[i] - len(_WHEELS) + 1)
    names = (*_WHEELS, *(f"joint {joint}" for joint in joints))
    return [(name, lambda run, j=j: run.torque[:, i, j]) for j, name in enumerate(names)]
