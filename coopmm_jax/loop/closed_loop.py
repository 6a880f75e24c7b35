"""The closed loop of Theorem 3.1 as one vector field: the controller runs in continuous time."""

from __future__ import annotations

from coopmm_jax.algebra.types import Scalar
from coopmm_jax.control.controller import motion_control
from coopmm_jax.loop.devices import device_rates
from coopmm_jax.loop.force_loop import Instant, act, observe
from coopmm_jax.loop.state import Signals, State
from coopmm_jax.mechanics.constrained_kinematics import kinematics
from coopmm_jax.mechanics.model import Model
from coopmm_jax.mechanics.plant import plant_kinematics, rates_without_drift
from coopmm_jax.parameters import Structure


def closed_loop(structure: Structure, model: Model, t: Scalar, state: State) -> tuple[State, Signals]:
    """Rates of the state, (11) under (12)-(24), and the loop's signals.

    Args:
        structure: static choices.
        model: pytree of scalars, from ``build_model``.
        t: time [s].
        state: of the loop.

    Returns:
        The time derivative, as a ``State``, and the ``Signals`` at t.
    """
    truth = plant_kinematics(structure, model, t, state.position, state.velocity)
    seen = truth
    if structure.features.surface_motion:
        seen = kinematics(model, structure.rows, state.position, state.velocity)
    now = Instant(structure, model, t, truth, seen, state)
    command = motion_control(structure, model, t, seen, state.velocity, state.controller)
    action = act(now, command)
    rates = State(
        rates_without_drift(truth),
        action.moved.independent,
        command.rates(action.measured_error),
        device_rates(structure, model, action.target, action.moved.multipliers, state.devices),
    )
    return rates, observe(now, command.sigma, action)
