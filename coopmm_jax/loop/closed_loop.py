"""The closed loop of Theorem 3.1 as one vector field: the controller runs in continuous time."""

from __future__ import annotations

import functools
from typing import Any

from coopmm_jax.algebra.types import PyTree, Scalar
from coopmm_jax.control.controller import Seen, known_to_controller
from coopmm_jax.control.gain_schedule import in_force
from coopmm_jax.control.reference import at_instant
from coopmm_jax.loop.devices import device_rates
from coopmm_jax.loop.force_loop import Instant, act, independent_velocity, observe
from coopmm_jax.loop.form import Form, Packed
from coopmm_jax.loop.integrate import rk4_step
from coopmm_jax.loop.lookahead import informed
from coopmm_jax.loop.state import Signals, State
from coopmm_jax.mechanics.model import Model
from coopmm_jax.mechanics.plant import carriage_rate, expected_kinematics, plant_kinematics, rates_without_drift
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
    model = model._replace(reference=at_instant(model.reference, t), gains=in_force(model, t))
    truth = plant_kinematics(structure, model, t, state.position, state.velocity, state.carriage)
    seen, independent = truth, independent_velocity(structure, truth, state)
    if structure.features.surface_motion or structure.compliant:
        seen = expected_kinematics(structure, model, t, state.position, independent, state.carriage)
    now = Instant(structure, model, t, truth, seen, state)
    command = model.gains.command(Seen(structure, known_to_controller(model), t, seen, independent), state.controller)
    action = act(now, command)
    rates = State(
        rates_without_drift(truth),
        action.moved.independent,
        command.rates(action.measured_error),
        device_rates(structure, model, action.target, action.moved.multipliers, state.devices),
        carriage_rate(structure, model, truth),
    )
    return rates, observe(now, command, action)


def continuous_step(
    structure: Structure,
    form: Form,
    model: PyTree,
    number: Scalar,
    t: Scalar,
    step: Scalar,
    state: PyTree,
    aims: Packed | None = None,
) -> tuple[PyTree, PyTree]:
    """One RK4 step of the closed loop, with the arguments of ``sampled_step``.

    Args:
        structure: static choices.
        form: of ``model`` (a ``Model``), of ``state`` (a ``State``) and of what comes back.
        model: of the rollout.
        number: of this step; continuous control does not ask.
        t: its time [s].
        step: its length [s].
        state: at t.
        aims: of a path at the begin, in the middle and at the end of the step (3, ...), if they are known ahead.

    Returns:
        The state at t + step, and the signals at t.
    """
    field = form.field(functools.partial(closed_loop, structure))

    def at_stage(t: Scalar, state: PyTree, aim: Any = None) -> tuple[PyTree, PyTree]:
        return field(informed(model, aim, t), t, state)

    return rk4_step(at_stage, t, step, state, aims)
