"""Both robots as they stand at the start, in chained coordinates."""

from __future__ import annotations

from coopmm_jax.algebra.types import Pair, Scalar
from coopmm_jax.control.reference import Desired, desired_motion
from coopmm_jax.mechanics import log_polar
from coopmm_jax.mechanics.coordinates import AnyPosition
from coopmm_jax.mechanics.model import Model
from coopmm_jax.mechanics.robot import per_robot
from coopmm_jax.mechanics.robot_kinematics import standing
from coopmm_jax.parameters import Geometry, Parameters, Pose


def standing_start(model: Model, parameters: Parameters, t: Scalar) -> Pair[AnyPosition]:
    """Both robots at the poses of the start, front axles turned as the desired motion turns if not given.

    Args:
        model: of the rollout.
        parameters: of the rollout.
        t: time of the start [s].
    """

    def at(geometry: Geometry, pose: Pose, desired: Desired | None) -> AnyPosition:
        front, long = geometry.front, desired.long if desired else None
        if front is None or long is None:
            rho = 0.0
        elif front.chart is not None:
            rho = log_polar.turning_radius(front, long.zeta)
        else:
            rho = front.unit * (long.zeta[1] + long.zeta[3])
        return standing(geometry, pose, rho)

    # Of a path it takes long to trace, and differential drives ask for nothing of it.
    turning = any(geometry.front is not None for geometry in model.geometry)
    desired = desired_motion(model.reference, t) if turning else (None, None)
    return per_robot(at, model.geometry, parameters.start, desired)
