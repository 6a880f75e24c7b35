"""Types of the controllers' protocol, which ``kinds/controllers.py`` declares: what one sees, and what it answers.

A controller is a NamedTuple of its gains, in ``Parameters.gains``. It computes a generalised force F on all joints; the
torque is B tau = F - J^T lambda_h, and lambda_h = lambda_d less what its ``ForceFeedback`` makes of the force error.
That is linear in the error because with ideal force measurement the error depends on the torque at once: the loop has
to be solved, and is so in one division for each row. Its state is integrated with everything else, in continuous time
or by one Euler step for each sample; the loop asks nothing else of it.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

from coopmm_jax.algebra.types import Pair, PyTree, Scalar, Vector
from coopmm_jax.kinds.controllers import Signal, signals_of
from coopmm_jax.mechanics.constrained_kinematics import Kinematics
from coopmm_jax.mechanics.model import Model
from coopmm_jax.mechanics.partitioning import partition
from coopmm_jax.mechanics.robot import PLATFORM, ROBOTS, per_robot
from coopmm_jax.mechanics.robot_kinematics import actuator_force
from coopmm_jax.parameters import Structure


class Freedom(NamedTuple):
    """Numbers that a controller's state depends on."""

    velocities: int  # n, the independent ones
    rows: int  # m, of the constraints

    @classmethod
    def of(cls, structure: Structure) -> Freedom:
        """Numbers of the rows that the controller takes for in force."""
        return cls(sum(map(len, partition(structure.rows, structure.joints).independent)), len(structure.rows))

    @property
    def arm_joints(self) -> int:
        """Number of independent arm joints of both robots."""
        return self.velocities - ROBOTS * PLATFORM


class Seen(NamedTuple):
    """All that a controller knows at one instant."""

    structure: Structure  # the rows in force, and choices of [law]
    model: Model  # its own: geometry, nominal masses, reference, gains; not the plant's masses, nor what disturbs it
    t: Scalar  # [s]
    k: Kinematics  # at the measured position and velocity
    independent: Vector  # u^1 (n,), as measured


class Command(NamedTuple):
    """Answer of a controller at one instant."""

    force: Pair[Vector]  # F on all joints of each robot (5,)
    rates: Callable[[Vector], PyTree]  # measured force error e_lambda (m,) [N] -> rates of the controller's state
    signals: Mapping[str, Vector | Scalar]  # what it declares as its signals and does not have in its state


def known_to_controller(model: Model) -> Model:
    """The model without the plant's masses, disturbances and devices: None in their places."""
    nothing: Any = None
    return model._replace(plant=nothing, disturbance=nothing, hardware=nothing)


def from_torque(seen: Seen, torque: Pair[Vector]) -> Pair[Vector]:
    """Generalised force B tau (5,) of each robot, for a controller that thinks in torques tau (5,) [N m]."""
    return per_robot(actuator_force, seen.model.geometry, seen.k.bodies.position, torque)


def recorded(gains: Any, state: PyTree, computed: Mapping[str, Vector | Scalar]) -> dict[str, Vector | Scalar]:
    """Signals of a controller by name, numbers or (n,): those that it has computed, and parts of its state.

    Args:
        gains: of the controller.
        state: its own.
        computed: the ``signals`` of its command.
    """
    return {name: computed[name] if name in computed else getattr(state, name) for name in signals_of(gains)}


def estimates_of(gains: Any, state: PyTree) -> Vector:
    """Estimates of the uncertainty (n,); () of a controller without."""
    return gains.estimates(state) if hasattr(gains, "estimates") else ()


def entries_of(signal: Signal, freedom: Freedom) -> int | None:
    """Number of entries of a signal; None where it is one number."""
    if signal.per is None or isinstance(signal.per, tuple):
        return None if signal.per is None else len(signal.per)
    counts = {"independent": freedom.velocities, "independent_arm": freedom.arm_joints, "row": freedom.rows}
    return counts.get(signal.per, {"bound": 5, "robot": ROBOTS}.get(signal.per))
