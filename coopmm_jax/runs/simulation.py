"""Simulate a scenario: one compiled rollout, whatever its gains, parameters and horizon."""

from __future__ import annotations

import functools
from pathlib import Path
from typing import Any

import jax
import numpy as np

from coopmm_jax.algebra.sincos import sincos, wrapped
from coopmm_jax.algebra.types import Pair, Scalar, Vector
from coopmm_jax.control.controller import recorded
from coopmm_jax.control.reference import AnyReference, Desired, at_instant, desired_force, desired_motion
from coopmm_jax.errors import UserError
from coopmm_jax.kinds.controllers import signals_of
from coopmm_jax.loop.health import Health
from coopmm_jax.loop.rollout import Plan, rollout
from coopmm_jax.loop.state import Signals
from coopmm_jax.mechanics.coordinates import Position
from coopmm_jax.mechanics.robot import CHAINED, per_robot
from coopmm_jax.mechanics.robot_kinematics import in_world, unchained
from coopmm_jax.memory import check_memory
from coopmm_jax.metrics import observer
from coopmm_jax.metrics.table import check_finite, registered
from coopmm_jax.parameters import Parameters, Reference, Structure
from coopmm_jax.runs.beginning import AIMED_AT, beginning, told, warn_of_distant_start
from coopmm_jax.runs.reach import missed
from coopmm_jax.runs.trajectory import Trajectory
from coopmm_jax.scenario import plausible
from coopmm_jax.scenario.feasible import check_reference
from coopmm_jax.scenario.scenario import Scenario, load_scenario
from coopmm_jax.status import Status
from coopmm_jax.temporal_logic.sentence import Formula, Numbers, Sentences

_SHORTEST = 1024  # samples a compiled rollout has room for, at least
_PER_SAMPLE = {"float64": 2000.0, "float32": 1000.0}  # [byte] at the peak, measured over 400,000 recorded samples


def simulate(scenario: Scenario | str | Path, precision: str | None = None) -> Trajectory:
    """Simulate a scenario by RK4 from its start to its horizon, or to a failure.

    Args:
        scenario: a scenario, or the name or path of one.
        precision: "float64" or "float32"; by default the scenario's own.

    Returns:
        Recorded samples, status and metrics. A run that fails is cut before the failure, and says so in
        its ``status``.

    Raises:
        UserError: a scenario that cannot be read, another precision, more samples than fit into memory, or a start out
            of the arms' reach.

    >>> simulate(load_scenario("paper", simulation={"duration": 0.01}))
    <Trajectory: 11 samples to 0.01 s, float64, OK>
    """
    if not isinstance(scenario, Scenario):
        scenario = load_scenario(scenario)
    if precision is not None:
        scenario = scenario.with_overrides({"simulation.precision": precision})
    settings, structure, parameters = scenario.simulation, scenario.structure(), scenario.parameters()
    steps, step, sentences = scenario.steps, scenario.sample_time, scenario.requirements.sentences()
    plan = _plan(steps, settings.record_every)
    must = "larger, or simulation.duration shorter"
    needed = _PER_SAMPLE[settings.precision] * plan.segments
    check_memory(needed, "simulation.record_every", must, settings.record_every)
    plausible.warn_of(scenario)
    check_reference(scenario)
    with jax.enable_x64(settings.precision == "float64"):
        outcome = _compiled(
            structure, plan, parameters, step, steps, (registered(), sentences.forms), sentences.numbers
        )
        series, measured, health = jax.device_get(outcome)
    status = Status(int(health.status))
    if status is Status.UNREACHABLE:
        must = "poses from which both arms reach what [coupling] asks of them; the reference begins at"
        short = missed(structure, parameters)
        lacking = "".join(f"arm {robot} {distance:.3g} m out of reach, " for robot, distance in short.items())
        lacking = lacking or "first guesses of the joints that lead elsewhere, "
        raise UserError("initial", f"{must} {told(beginning(parameters), AIMED_AT)}", lacking + told(parameters.start))
    failed = status is not Status.OK
    if failed:
        warn_of_distant_start(parameters)
    values = {name: np.asarray(value) for name, value in measured.items()}
    check_finite(values, np.asarray(not failed), [name for name, _ in sentences.forms])
    end = int(health.step) if failed else steps + 1  # the first step that is not part of the run
    own = series["controller"]
    kept = -(-end // settings.record_every)
    return Trajectory(
        **{name: _stacked(values, series["t"])[:kept] for name, values in series.items() if name != "controller"},
        controller={name: _stacked(own[name], series["t"])[:kept] for name in signals_of(parameters.gains)},
        status=status,
        status_time=end * step if failed else None,
        metrics={name: float(measured[name]) for name in scenario.requirements.metrics()},
        scenario=scenario,
    )


def _plan(steps: int, record_every: int) -> Plan:
    """Room for a few more samples than asked for, at most an eighth, so that horizons of about one length share it."""
    samples = steps // record_every + 1
    unit = max(_SHORTEST, 2 ** (samples.bit_length() - 4))
    room = -(-samples // unit) * unit * record_every
    return Plan.alone(room - 1, record_every)


@functools.partial(jax.jit, static_argnames=("structure", "plan", "measured"))
def _compiled(
    structure: Structure,
    plan: Plan,
    parameters: Parameters,
    step: Scalar,
    steps: Scalar,
    measured: tuple[tuple[tuple[str, type], ...], tuple[tuple[str, Formula], ...]],
    numbers: tuple[Numbers, ...],
) -> tuple[dict[str, Any], dict[str, Scalar], Health]:
    """Recorded series, metrics and health of one rollout; ``steps`` of length ``step`` [s] follow its first sample.

    ``measured`` are the metrics that are registered, and the forms of sentences: others are another program.
    """
    horizon = {"duration": steps * step, "step": step, "sentences": Sentences(measured[1], numbers)}
    result = rollout(
        structure, parameters, step, steps, plan, observer.observer(structure, parameters, **horizon), record=True
    )
    series = jax.vmap(functools.partial(_sample, structure, parameters))(*result.record)
    return (
        series,
        observer.finish(result.total, **horizon, kept=result.kept, loop=(structure, parameters)),
        result.health,
    )


def _sample(structure: Structure, parameters: Parameters, t: Scalar, signals: Signals) -> dict[str, Any]:
    """The entries of ``Trajectory`` at one sample, as nested tuples of scalars."""
    reference = at_instant(parameters.reference, t, signals.aim)
    desired = _on_the_same_turn(reference, desired_motion(reference, t), signals.position)
    return {
        "t": t,
        "q": _alike(per_robot(unchained, signals.position)),
        "zeta": per_robot(lambda p: p[:CHAINED], signals.position),
        "zeta_desired": tuple((d.z1, d.z2, d.z3) for d in desired),
        "arm": tuple(p.a1 for p in signals.position),
        "arm_desired": tuple(d.arm[0] for d in desired),
        "velocity": _alike(signals.velocity),
        "controller": recorded(parameters.gains, signals.controller, signals.computed),
        "constraint_force": signals.constraint_force,
        "constraint_force_desired": desired_force(reference, structure.rows, t),
        "torque": _alike(signals.torque),
        "torque_commanded": _alike(signals.commanded),
        "constraint_residual": signals.constraint_residual,
        "tip": per_robot(_in_world, signals.position, signals.tip),
        "contact_point": signals.contact_point,
        "carriage": signals.carriage,
        "steering": signals.steering,
    }


def _alike(both: Pair[Vector]) -> Pair[Vector]:
    """Values of both robots, with zeros for joints that only the other one has."""
    longest = max(map(len, both))
    return per_robot(lambda values: (*values, *(0.0 * values[0],) * (longest - len(values))), both)


def _on_the_same_turn(reference: AnyReference, desired: Pair[Desired], position: Pair[Position]) -> Pair[Desired]:
    """Desired motion with headings that count turns as the platforms do: along a path they are known modulo a turn."""
    if isinstance(reference, Reference):
        return desired
    return per_robot(lambda d, p: d._replace(z1=p.z1 - wrapped(p.z1 - d.z1)), desired, position)


def _in_world(position: Position, point: Vector) -> Vector:
    """World coordinates of a point given along the platform's lateral and forward axes, and its height."""
    lateral, forward, height = point
    return (*in_world(lateral, forward, sincos(position.z1)), height)


def _stacked(series: Any, t: np.ndarray) -> np.ndarray:
    """Nested tuples of series (T,) as one array (T, ...), of the times' dtype if there are none."""
    if not isinstance(series, tuple):
        return series
    return np.stack([_stacked(entry, t) for entry in series], axis=1) if series else np.empty((len(t), 0), t.dtype)
