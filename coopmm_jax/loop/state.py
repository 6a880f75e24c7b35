"""State of the closed loop, and its signals at one instant."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

from coopmm_jax.algebra.types import Pair, PyTree, Scalar, Vector
from coopmm_jax.control.path_motion import Aim
from coopmm_jax.loop.devices import Devices
from coopmm_jax.mechanics.constrained_dynamics import Accelerations
from coopmm_jax.mechanics.coordinates import AnyPosition, Position


class State(NamedTuple):
    """State of one closed loop: 31 scalars with all four rows in force and ideal devices."""

    position: Pair[AnyPosition]
    velocity: Vector  # u^1 (n,)
    controller: PyTree  # the controller's own
    devices: Devices = Devices()
    carriage: Vector = ()  # (1,) of a rail that guides the object, a phase of its path


class Signals(NamedTuple):
    """Quantities of the loop at one instant, as an observer sees them."""

    position: Pair[Position]  # in the coordinates of (6)
    velocity: Pair[Vector]  # u of each robot (5,)
    computed: Mapping[str, Vector | Scalar]  # by the controller, its own signals by name
    controller: PyTree  # its state
    constraint_force: Vector  # lambda (m,) [N]
    force_error: Vector  # lambda - lambda_d (m,) [N]
    torque: Pair[Vector]  # applied, (right wheel, left wheel, joints 1-3) of each robot [N m]
    commanded: Pair[Vector]  # likewise, before limits and lag
    constraint_residual: Vector  # phi (m,) [m]
    tip: Pair[Vector]  # lateral, forward (from the world's origin, platform axes) and height of each tip [m]
    contact_point: Vector  # tip I from the arc's centre, else from the object, along arm II and across it [m]
    determinants: tuple[Scalar, ...]  # singular arm where one vanishes
    carriage: Vector = ()  # (1,) of a rail
    aim: Aim | None = None  # desired motion along a path; None of a circle
    steering: Vector = ()  # of each platform on two axles: angle of its front axle [rad]


class Action(NamedTuple):
    """One decision of the force controller, and the robots' motion under it."""

    measured_error: Vector  # e_lambda as the controller sees it (m,) [N]
    commanded: Pair[Vector]  # torques of each robot [N m]
    target: Pair[Vector]  # likewise, within limits
    applied: Pair[Vector]  # likewise, behind the actuators' lag
    moved: Accelerations
