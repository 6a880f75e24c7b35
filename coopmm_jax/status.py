"""How a rollout ended: failure is data, one code per rollout, so that no NaN spreads through a batch or gradient."""

from __future__ import annotations

import enum
from typing import NamedTuple

import jax.numpy as jnp

from coopmm_jax.algebra.matrix import Scalar
from coopmm_jax.loop.closed_loop import Signals, State

# Limits that no working loop comes near, reached long before anything overflows, so that the values handed to the next
# step, and their gradients, are still finite.
SPEED_LIMIT = 1e3  # [rad/s, m/s]
MEMORY_LIMIT = 1e6  # controller states
# Fraction of the starting determinant of J_dep's blocks below which an arm counts as singular.
SINGULAR_FRACTION = 1e-2


class Status(enum.IntEnum):
    """Outcome of a rollout; everything but ``OK`` stops it at the last good state."""

    OK = 0
    SPEED = 1
    CONTROLLER = 2
    SINGULAR_CONTACT = 3
    SINGULAR_GUIDE = 4
    UNREACHABLE = 5

    @property
    def message(self) -> str:
        """One line for a person, naming the quantity."""
        return _MESSAGES[self]


_MESSAGES = {
    Status.OK: "completed",
    Status.SPEED: f"a velocity u left +-{SPEED_LIMIT:g} (rad/s, m/s) or is not finite",
    Status.CONTROLLER: f"a controller state (eta, c_hat or a force integral) left +-{MEMORY_LIMIT:g} or is not finite",
    Status.SINGULAR_CONTACT: "arm of robot I became singular for its contact rows (determinant of J_dep)",
    Status.SINGULAR_GUIDE: "arm of robot II became singular for its guide rows (determinant of J_dep)",
    Status.UNREACHABLE: "no start configuration meets the constraint rows: an arm cannot reach its contact or guide",
}


class Health(NamedTuple):
    """Status code of a running rollout and the step at which it left OK."""

    status: Scalar
    step: Scalar


def within(values: tuple[Scalar, ...], limit: float) -> Scalar:
    """Whether all scalars are finite and within +-limit (a comparison with NaN is false)."""
    ok = jnp.abs(values[0]) < limit
    for value in values[1:]:
        ok = ok & (jnp.abs(value) < limit)
    return ok


def judge(proposed: State, signals: Signals, start_determinants: tuple[Scalar, ...]) -> Scalar:
    """Status code (a scalar) of one step from the state it proposes and the signals at its start."""
    memory = proposed.memory
    states = (*memory.integral, *memory.eta, *memory.c_hat, *memory.force_integral)
    code = jnp.where(within(states, MEMORY_LIMIT), Status.OK.value, Status.CONTROLLER.value)
    code = jnp.where(within(proposed.velocity, SPEED_LIMIT), code, Status.SPEED.value)
    singular = (Status.SINGULAR_CONTACT.value, Status.SINGULAR_GUIDE.value)
    for now, start, which in zip(signals.determinants, start_determinants, singular, strict=False):
        code = jnp.where(now / start > SINGULAR_FRACTION, code, which)
    return code.astype(jnp.int32)
