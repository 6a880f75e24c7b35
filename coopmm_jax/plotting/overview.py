"""One sheet that shows a whole run: motion, forces, controller."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from coopmm_jax.plotting import control, force, motion, style
from coopmm_jax.plotting.lines import Run, runs, time_panel

if TYPE_CHECKING:
    from coopmm_jax.runs.trajectory import Trajectory

LAYOUT = (
    ("paths", "errors I", "errors II", "arm yaw"),
    ("contact force", "its start", "constraint forces", "residual"),
    ("torques I", "torques II", "signal", "another signal"),
)


@style.styled
def overview(trajectory: Trajectory, axes: style.GivenAxes = None) -> Figure:
    """Everything about one run at a glance: a row each for its motion, its forces and its controller.

    Args:
        trajectory: the run.
        axes: twelve matplotlib axes to draw on, row by row.

    Returns:
        The figure that was drawn on.

    Raises:
        UserError: axes of the wrong number.

    >>> import coopmm_jax as cm
    >>> short = cm.load_scenario("paper", simulation={"duration": 0.05})
    >>> figure = overview(cm.simulate(short))
    """
    figure, sheet = style.panels(axes, LAYOUT, height=9.0, width=15.0)
    panel = dict(zip((name for row in LAYOUT for name in row), sheet, strict=True))
    group = runs([trajectory], None)
    motion.paths_panel(panel["paths"], group)
    motion.errors_panel(panel["errors I"], group, "I")
    motion.errors_panel(panel["errors II"], group, "II")
    _yaw_panel(panel["arm yaw"], group)
    force.contact_panel(panel["contact force"], group)
    force.contact_start_panel(panel["its start"], group)
    force.multipliers_panel(panel["constraint forces"], group)
    force.residual_panel(panel["residual"], group)
    control.torque_panel(panel["torques I"], group, "I")
    control.torque_panel(panel["torques II"], group, "II")
    control.shown_panels([panel["signal"], panel["another signal"]], group)
    return figure


def _yaw_panel(axes: Axes, group: Sequence[Run]) -> None:
    yaw = {f"a1 of {robot}": lambda run, i=i: run.q[:, i, 3] for i, robot in enumerate(motion.ROBOTS)}
    desired = {
        "desired": lambda run: run.arm_desired[:, 0],
        "_desired": lambda run: run.arm_desired[:, 1],  # looks the same, so one entry in the legend
    }
    time_panel(axes, group, yaw, "arm yaw [rad]", desired, title="Arm yaw: the arms' angle to their platforms")
