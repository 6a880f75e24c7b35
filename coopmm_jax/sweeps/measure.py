"""Rollouts of a batch of samples: their metrics, or series of a few quantities over time."""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from coopmm_jax.algebra.types import Scalar
from coopmm_jax.control.controller import estimates_of
from coopmm_jax.loop.health import Health
from coopmm_jax.loop.rollout import Plan, rollout
from coopmm_jax.loop.state import Signals
from coopmm_jax.metrics import observer
from coopmm_jax.metrics.sample import internal_force, largest_size, squared_errors
from coopmm_jax.metrics.table import METRICS, check_finite, registered
from coopmm_jax.parameters import Parameters, Structure
from coopmm_jax.status import Status
from coopmm_jax.sweeps.batch import Device, Program, prepare, run
from coopmm_jax.temporal_logic.sentence import NO_SENTENCES, Sentences

SEGMENT = 64  # steps; a horizon is rounded up to a whole number of segments
POINTS = 400  # of a kept series, at most one more

# name -> (unit, meaning) of what is kept over time of a few samples
SERIES: dict[str, tuple[str, str]] = {
    "tracking_error": ("rad, m", "norm of all heading, position and arm errors"),
    "object_error": ("m", "distance of the object from its desired point"),
    "relative_tip_error": ("m", "distance of tip I from its desired point on the object's surface"),
    "contact_force": ("N", "normal contact force"),
    "internal_force": ("N", "largest size of the other constraint forces"),
    "torque": ("N m", "largest size of all actuators' torques"),
    "c_hat": ("-", "largest estimate of an uncertainty bound"),
}


class Horizon(NamedTuple):
    """Extent of a rollout: sample time [s], number of samples after the first, floating point numbers."""

    step: float
    steps: int
    precision: str

    @property
    def stride(self) -> int:
        """Steps from one point of a kept series to the next."""
        return max(1, -(-self.steps // POINTS))

    def points(self) -> np.ndarray:
        """Steps at which a kept series has its points (T,)."""
        return np.arange(0, self.steps + 1, self.stride)

    def times(self) -> np.ndarray:
        """Times of these points (T,) [s]."""
        return self.points() * self.step


class Measured(NamedTuple):
    """Results of the B samples of a batch after their rollouts."""

    metrics: np.ndarray  # (B, M), in the order of METRICS, then of the sentences; NaN where a window was not reached
    status: np.ndarray  # (B,) codes of ``Status``
    status_time: np.ndarray  # (B,) of a failure [s]; NaN for none


def measure(
    structure: Structure,
    horizon: Horizon,
    device: Device,
    parameters: Parameters,
    sentences: Sentences = NO_SENTENCES,
) -> Measured:
    """Metrics and status of a batch.

    Args:
        structure: static choices.
        horizon: of the rollouts.
        device: to run on; compiled once for each.
        parameters: every leaf of shape (B,).
        sentences: of the scenario's requirements.
    """
    plan = Plan.batch(horizon.steps, SEGMENT)
    measured, health = _run(_metrics_of, structure, plan, horizon, device, parameters, sentences)
    spoken = [name for name, _ in sentences.forms]
    check_finite(measured, health.status == Status.OK, spoken)
    table = np.stack([measured[name] for name in (*METRICS, *spoken)], axis=1).astype(float)
    time = np.where(health.status == Status.OK, np.nan, health.step * horizon.step)
    return Measured(table, health.status.astype(np.int8), time)


def trace(structure: Structure, horizon: Horizon, device: Device, parameters: Parameters) -> dict[str, np.ndarray]:
    """Series of a batch by name, each (B, T) at ``horizon.times()``; NaN from a failure on."""
    plan = Plan.batch(horizon.steps, horizon.stride)
    series, health = _run(_series_of, structure, plan, horizon, device, parameters)
    lost = (health.status != Status.OK)[:, None] & (horizon.points() >= health.step[:, None])
    return {name: np.where(lost, np.nan, series[name]) for name in SERIES}


def kept_of_every_sample(structure: Structure, horizon: Horizon, parameters: Parameters, sentences: Sentences) -> int:
    """Count of numbers that ``measure`` keeps of every sample of a rollout, for sentences that need all of them.

    Args:
        structure: static choices.
        horizon: of the rollout.
        parameters: scalars.
        sentences: of the scenario's requirements.
    """
    gather = observer.observer(structure, parameters, horizon.step * horizon.steps, horizon.step, sentences)
    return len(jax.tree.leaves(gather.kept(gather.start))) if gather.kept else 0


def compile_ahead(
    structure: Structure,
    horizon: Horizon,
    device: Device,
    parameters: Parameters,
    sentences: Sentences = NO_SENTENCES,
) -> None:
    """Compile what ``measure`` and ``trace`` run, with their arguments."""
    place = (horizon, device, parameters)
    prepare(*_call(_metrics_of, structure, Plan.batch(horizon.steps, SEGMENT), *place, sentences))
    prepare(*_call(_series_of, structure, Plan.batch(horizon.steps, horizon.stride), *place))


def _run(function: Callable, *arguments: Any) -> Any:
    """Results of a program for all numbers, and for all horizons of one plan, with the arguments of ``_call``."""
    return run(*_call(function, *arguments))


def _call(
    function: Callable,
    structure: Structure,
    plan: Plan,
    horizon: Horizon,
    device: Device,
    parameters: Parameters,
    sentences: Sentences = NO_SENTENCES,
) -> tuple[Program, Device, tuple, tuple]:
    """Arguments of ``batch.run``."""
    dtype = np.dtype(horizon.precision)
    parameters, numbers = jax.tree.map(lambda x: np.array(x, dtype, order="C"), (parameters, sentences.numbers))
    shared = (np.asarray(horizon.step, dtype), np.asarray(horizon.steps, np.int32), numbers)
    fixed = (structure, plan, (registered(), sentences.forms))
    return Program(function, fixed), device, (parameters,), shared


def _metrics_of(
    structure: Structure, plan: Plan, measured: Any, parameters: Parameters, step: Scalar, steps: Scalar, numbers: Any
) -> tuple[dict[str, Scalar], Health]:
    horizon = {"duration": steps * step, "step": step, "sentences": Sentences(measured[1], numbers)}
    result = rollout(structure, parameters, step, steps, plan, observer.observer(structure, parameters, **horizon))
    return observer.finish(result.total, **horizon, kept=result.kept, loop=(structure, parameters)), result.health


def _series_of(
    structure: Structure, plan: Plan, measured: Any, parameters: Parameters, step: Scalar, steps: Scalar, numbers: Any
) -> tuple[dict[str, Scalar], Health]:
    result = rollout(structure, parameters, step, steps, plan, record=True)
    return jax.vmap(functools.partial(_point, structure, parameters))(*result.record), result.health


def _point(structure: Structure, parameters: Parameters, t: Scalar, signals: Signals) -> dict[str, Scalar]:
    """The entries of ``SERIES`` at one sample."""
    errors = squared_errors(parameters.reference, parameters.plant.surface, t, signals)
    return {
        "tracking_error": jnp.sqrt(errors.tracking),
        "object_error": jnp.sqrt(errors.object),
        "relative_tip_error": jnp.sqrt(errors.relative_tip),
        "contact_force": signals.constraint_force[structure.rows.index("contact_normal")],
        "internal_force": internal_force(structure, signals),
        "torque": largest_size((*signals.torque[0], *signals.torque[1])),
        "c_hat": largest_size(estimates_of(parameters.gains, signals.controller)) + 0.0 * t,
    }
