"""The cost of one rollout: weighted terms, accumulated inside the scan, as a plain differentiable function.

>>> import jax
>>> from coopmm_jax.scenario.scenario import load_scenario
>>> scenario = load_scenario("paper", simulation={"duration": 0.01}, tuning={"tracking_from": 0.0})
>>> objective = Objective.of(scenario, scenario.structure(), horizon=0.01)
>>> jax.eval_shape(objective.cost, objective.space.start, scenario.parameters(), jnp.ones(len(TERMS))).shape
()
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, NamedTuple

import jax.numpy as jnp
import numpy as np

from coopmm_jax.algebra.types import Bool, Scalar, Vector
from coopmm_jax.control.reference import at_instant, desired_force
from coopmm_jax.errors import UserError
from coopmm_jax.kinds.cost_terms import terms
from coopmm_jax.kinds.probe import number_of
from coopmm_jax.loop.devices import torque_limits
from coopmm_jax.loop.rollout import Observer, Plan, Rollout, rollout
from coopmm_jax.loop.state import Signals
from coopmm_jax.metrics.sample import Sample, squared_errors
from coopmm_jax.parameters import Parameters, Structure
from tuning.cost.gain_space import GainSpace, gain_space

if TYPE_CHECKING:
    from coopmm_jax.scenario.scenario import Scenario


class _Terms(Mapping[str, tuple[str, float]]):
    """Terms by name: unit of the time average, and the least value that it is scaled by; plugins' come last."""

    def __getitem__(self, name: str) -> tuple[str, float]:
        made = terms()[name].made
        return made.unit, made.floor

    def __iter__(self) -> Iterator[str]:
        return iter(terms())

    def __len__(self) -> int:
        return len(terms())


TERMS = _Terms()


def _registered() -> tuple[tuple[str, type], ...]:
    """Names and kinds of all terms: what a compiled cost depends on."""
    return tuple((name, kind.made) for name, kind in terms().items())


# A rollout that fails costs this, and up to twice as much the earlier it fails: more than any that completes.
FAILED = 1e6
_SEGMENT = 50  # steps between checkpoints of the reverse pass
# A batch of 32 keeps 50 kB of each RK4 step for the reverse pass: half a gigabyte of so many. Checkpoints instead
# compile half as long again.
_KEPT = 10_000
_SMOOTHING = 1e-3  # [N m], of the absolute torque changes


class Total(NamedTuple):
    """Sums along a rollout."""

    terms: Vector  # sums over samples, in the order of TERMS
    torque: Vector  # of the last sample, all actuators (10,) [N m]


class Evaluation(NamedTuple):
    """One rollout's terms, and whether it completed."""

    terms: Vector  # time averages, in the order of TERMS
    completed: Scalar
    survived: Scalar  # share of the horizon before a failure


@dataclass(frozen=True)
class Objective:
    """Cost of one rollout as a function of the tuned numbers; hashable, so that it can be static under jit."""

    space: GainSpace
    structure: Structure
    step: float  # time between samples [s]
    steps: int  # of the horizon
    tracking_from: float  # [s]; earlier errors are the start's, which no gain can undo, and would drown the later ones
    terms: tuple[tuple[str, type], ...] = field(default_factory=_registered)  # in the order of TERMS

    @classmethod
    def of(cls, scenario: Scenario, structure: Structure, horizon: float) -> Objective:
        """The objective of a scenario over a horizon [s]; ``structure`` has every effect that varies."""
        step = scenario.sample_time
        return cls(gain_space(scenario), structure, step, round(horizon / step), scenario.tuning.tracking_from)

    def evaluate(self, vector: Any, parameters: Parameters, for_gradient: bool = False) -> Evaluation:
        """Terms of the rollout with the gains of ``vector`` (n,).

        Args:
            vector: numbers of the gain space (n,).
            parameters: of one sample, scalars.
            for_gradient: static; the form that ``jax.grad`` runs twice as fast, and a batch without it a fifth slower.
        """
        parameters = self.space.applied(parameters, vector)
        plan = self.plan(for_gradient)
        result = rollout(self.structure, parameters, self.step, self.steps, plan, self._observer(parameters))
        completed, survived = self.outcome(result)
        return Evaluation(tuple(total / (self.steps + 1) for total in result.total.terms), completed, survived)

    def plan(self, for_gradient: bool) -> Plan:
        """Form of a rollout over the horizon, for a batch or for gradients."""
        long = self.steps * max(1, self.structure.substeps) > _KEPT
        return Plan.gradient(self.steps, _SEGMENT, long) if for_gradient else Plan.batch(self.steps, _SEGMENT)

    def outcome(self, result: Rollout) -> tuple[Bool, Scalar]:
        """Completion of a rollout, a scalar, and the share of the horizon before a failure [-]."""
        completed = result.health.status == 0
        return completed, jnp.where(completed, 1.0, result.health.step / (self.steps + 1))

    def cost(self, vector: Any, parameters: Parameters, coefficients: Any, for_gradient: bool = False) -> Scalar:
        """Weighted sum of the terms; finite for every rollout, and at least ``FAILED`` for one that fails.

        Args:
            vector: numbers of the gain space (n,).
            parameters: of one sample; ``jax.vmap`` over them for many.
            coefficients: weight over scale of each term (9,), in the order of ``TERMS``.
            for_gradient: as in ``evaluate``.
        """
        averages, completed, survived = self.evaluate(vector, parameters, for_gradient)
        cost = sum(coefficients[i] * term for i, term in enumerate(averages))
        return jnp.where(completed, cost, FAILED * (2.0 - survived))

    def sample_terms(self, parameters: Parameters, t: Scalar, signals: Signals) -> dict[str, Scalar]:
        """The terms of one sample at t [s] by name, all but the torque variation; another cost replaces this alone."""
        return _terms(self.structure, parameters, t, signals)

    def _observer(self, parameters: Parameters) -> Observer:
        zero = jnp.zeros((), jnp.result_type(float))

        def update(total: Total, t: Scalar, signals: Signals) -> Total:
            torque = (*signals.torque[0], *signals.torque[1])
            change = sum(_size(now - before) for now, before in zip(torque, total.torque, strict=True))
            first = t < 0.5 * self.step
            own = self.sample_terms(parameters, t, signals)
            own["torque_variation"] = jnp.where(first, 0.0, change / self.step)
            sample = Sample(self.structure, parameters, t, self.step, signals, {}, own)
            counts = t > self.tracking_from - 0.5 * self.step
            values = (self._value(name, made, sample, counts) for name, made in self.terms)
            return Total(tuple(old + value for old, value in zip(total.terms, values, strict=True)), torque)

        return Observer(Total((zero,) * len(self.terms), (zero,) * sum(self.structure.joints)), update)

    def _value(self, name: str, made: Any, sample: Sample, counts: Bool) -> Scalar:
        """One term of a sample; ``counts`` says whether it counts for those that leave out the start."""
        value = made().value(sample) if name in sample.terms else number_of(terms()[name], "value", sample)
        return jnp.where(counts, value, 0.0) if made.after_start else value


def _terms(structure: Structure, parameters: Parameters, t: Scalar, signals: Signals) -> dict[str, Scalar]:
    """One sample's terms, all but the torque variation."""
    errors = squared_errors(parameters.reference, parameters.plant.surface, t, signals)
    contact = structure.rows.index("contact_normal")
    desired = desired_force(at_instant(parameters.reference, t, signals.aim), structure.rows, t)
    others = [x - d for i, (x, d) in enumerate(zip(signals.constraint_force, desired, strict=True)) if i != contact]
    return {
        "object": errors.object,
        "relative": errors.relative_tip,
        "posture": errors.tracking,
        "force": signals.force_error[contact] ** 2,
        "internal": sum((x**2 for x in others), 0.0 * t),
        "contact_loss": jnp.maximum(-signals.constraint_force[contact], 0.0) ** 2,
        "effort": sum(x**2 for robot in signals.torque for x in robot),
        "saturation": _excess(structure, parameters, signals) + 0.0 * t,
    }


def _excess(structure: Structure, parameters: Parameters, signals: Signals) -> Scalar:
    """Squared torque asked for beyond the limits [N^2 m^2]; 0 without limits."""
    if not structure.features.limits:
        return 0.0
    beyond = (
        jnp.abs(x) - limit
        for robot in signals.commanded
        for x, limit in zip(robot, torque_limits(parameters.hardware, len(robot)), strict=True)
    )
    return sum(jnp.maximum(x, 0.0) ** 2 for x in beyond)


def _size(x: Scalar) -> Scalar:
    """|x|, smooth at 0."""
    return jnp.sqrt(x * x + _SMOOTHING**2) - _SMOOTHING


def check_finite(found: np.ndarray, completed: np.ndarray) -> None:
    """Refuse a plugin's term that is not finite in a rollout that completes.

    Args:
        found: time averages (..., terms), in the order of ``TERMS``.
        completed: whether each rollout completed (...,).

    Raises:
        UserError: one is not.
    """
    for i, kind in enumerate(terms().values()):
        wrong = completed & ~np.isfinite(found[..., i])
        if kind.plugin and wrong.any():
            must = "finite in every rollout that completes"
            raise UserError(f"{kind.label}: value", must, found[..., i][wrong][0])


def coefficients(weights: Mapping[str, float], scales: Mapping[str, float]) -> np.ndarray:
    """Weight over scale of each term (9,), in the order of ``TERMS``, from both by name."""
    return np.array([weights[name] / scales[name] for name in TERMS])
