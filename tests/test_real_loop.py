"""The shipped scenarios of the real loop, and constraint rows of one robot alone, as full simulations."""

import functools

import jax
import numpy as np
import pytest

from coopmm_jax.control.reference import desired_motion
from coopmm_jax.loop.devices import draw_noise
from coopmm_jax.loop.rollout import as_scalars
from coopmm_jax.mechanics import robot_kinematics
from coopmm_jax.mechanics.model import build_model
from coopmm_jax.parameters import ALL_ROWS, Parameters
from coopmm_jax.scenario.scenario import load_scenario
from tests.oracles import hardware, lagrangian
from tests.programs import Program
from tests.samples import poses

NORMAL, _, *GUIDE = ALL_ROWS
SCENARIOS = {
    "sensed": load_scenario("sensed"),
    "free": load_scenario("free"),
    "rough": load_scenario("rough"),
    "no groove": load_scenario("sensed", coupling={"rows": [NORMAL, *GUIDE]}),
}
NOISY = SCENARIOS["rough"].parameters()
LIMITS = np.array([100.0, 100.0, 60.0, 60.0, 60.0])  # [N m]
PERIOD, STEPS, SETTLED = 1e-3, 10_000, 5000  # [s], samples
SHORT = 1e-4  # [s], control period of runs whose energy is balanced: shorter for a closer sum of its work


class Real:
    """A run on arrays: q (T, 2, 6), u (T, 10), torques (T, 2, 5), constraint forces (T, m)."""

    def __init__(self, scenario, run):
        self.parameters, self.rows, self.run, signals = scenario.parameters(), scenario.coupling.rows, run, run.signals
        self.t, self.q = run.t, poses(signals.position)
        self.u = np.concatenate([np.array(u) for u in signals.velocity]).T
        self.torque, self.commanded = (np.moveaxis(np.array(x), -1, 0) for x in (signals.torque, signals.commanded))
        self.force = np.array(signals.constraint_force).T


@pytest.fixture(scope="module")
def runs():
    """Over 10 s and of short periods; of ``rough``, which has all that is real, also with other noise."""
    jobs, programs = {}, functools.cache(functools.partial(Program, room=STEPS))
    for name, scenario in SCENARIOS.items():
        jobs[name] = (scenario.structure(), scenario.parameters(), PERIOD, STEPS)
        jobs[name, "short"] = (*jobs[name][:2], SHORT, 3000)
    for name, change in {"again": {}, "seed": {"noise_seed": (0.0, 1.0)}, "stream": {"noise_stream": 1.0}}.items():
        parameters = NOISY._replace(hardware=NOISY.hardware._replace(**change))
        jobs["rough", name] = (jobs["rough"][0], parameters, PERIOD, 200)
    return {name: programs(structure)(*job) for name, (structure, *job) in jobs.items()}


@pytest.fixture(scope="module", params=SCENARIOS)
def real(request, runs):
    return Real(SCENARIOS[request.param], runs[request.param])


@pytest.fixture(scope="module")
def rough(runs):
    return Real(SCENARIOS["rough"], runs["rough"])


def test_runs_to_its_horizon_on_its_constraints(real):
    assert real.run.health.status == 0
    assert np.abs(real.run.signals.constraint_residual).max() < 1e-11


def test_no_applied_torque_exceeds_its_limit(real):
    assert np.all(np.abs(real.torque) <= LIMITS)
    assert np.any(np.abs(real.commanded) > LIMITS)


def test_multipliers_are_those_of_the_applied_torques(real):
    """Residual of the constrained dynamics: the Lagrangian's, under the applied torques and their friction."""
    saturated = np.flatnonzero(np.any(np.abs(real.commanded) > LIMITS, axis=(1, 2)))
    for k in [*saturated[:3], *range(0, STEPS, STEPS // 8)]:
        residual = hardware.constraint_residual(
            real.parameters, real.rows, real.t[k], real.q[k], real.u[k], real.torque[k], real.force[k]
        )
        assert np.abs(residual).max() < 5e-13


@pytest.mark.parametrize("name", SCENARIOS)
def test_energy_balance(runs, name):
    """Energy gained is the work of actuators, disturbance, friction and moving surface; other constraints do none."""
    real = Real(SCENARIOS[name], runs[name, "short"])
    lagging = real.parameters.hardware.actuator_lag > 0.0
    held = real.torque[1:] if lagging else real.torque[:-1]
    power = jax.vmap(hardware.power, in_axes=(None, 0, 0, 0, 0, 0))
    first = power(real.parameters, real.t[:-1], real.q[:-1], real.u[:-1], real.torque[:-1], real.force[:-1, 0])
    last = power(real.parameters, real.t[1:], real.q[1:], real.u[1:], held, real.force[1:, 0])
    work = SHORT * np.cumsum(np.asarray(first + last)) / 2
    energy = np.asarray(jax.vmap(hardware.energy, in_axes=(None, 0, 0))(real.parameters.plant, real.q, real.u))
    gained = energy[1:] - energy[0]
    # Behind a lag of 2 ms the torque bends within a period, which the trapezoidal rule for the work does not see.
    assert np.abs(gained - work).max() < (5e-5 if lagging else 3e-9) * np.abs(gained).max()


@pytest.mark.parametrize("t", [0.0, 1.0, 4.0])
def test_free_joints_hold_the_posture_that_meets_every_row(t):
    """With both robots on their references; elbows as at the start."""
    parameters = Parameters()
    postures, desired = build_model(parameters).posture, desired_motion(parameters.reference, t)
    q = np.array(
        [
            robot_kinematics.unchained(robot_kinematics.Position(d.z1, d.z2, d.z3, *d.arm, *posture))
            for d, posture in zip(desired, postures, strict=True)
        ]
    )
    np.testing.assert_allclose(lagrangian.all_constraints(parameters.plant, q), np.zeros(4), rtol=0, atol=1e-14)
    assert [np.sign(a3) for _, a3 in postures] == [np.sign(start.a3) for start in parameters.start]


@pytest.mark.parametrize("name", [name for name in SCENARIOS if name != "rough"])
def test_object_follows_its_circle_and_the_contact_settles(runs, name):
    """With a model 20 % too light: 5 mm and 1 N rms, guide or not."""
    real = Real(SCENARIOS[name], runs[name])
    tip = jax.vmap(lambda q: lagrangian.bodies(real.parameters.plant.geometry[1], q).tip)
    circle = np.stack([1.7 * np.cos(real.t), 1.7 * np.sin(real.t), np.ones_like(real.t)], axis=1)
    error = (np.asarray(tip(real.q[:, 1])) - circle)[SETTLED:]
    assert np.sqrt(np.mean(np.sum(error**2, axis=1))) < 5e-3
    assert np.sqrt(np.mean((real.force[SETTLED:, 0] - 15.0) ** 2)) < 1.0


def test_torques_follow_their_commands_behind_the_actuators_lag(rough):
    """In each period the torque moves towards its held, limited command by one RK4 step of a first-order lag."""
    z = -PERIOD / rough.parameters.hardware.actuator_lag
    keep = 1.0 + z + z**2 / 2 + z**3 / 6 + z**4 / 24
    target = np.clip(rough.commanded, -LIMITS, LIMITS)[:-1]
    np.testing.assert_allclose(rough.torque[1:], target + keep * (rough.torque[:-1] - target), rtol=0, atol=1e-11)


def test_noise_of_a_run_depends_on_its_seed_and_stream_alone(runs):
    base = np.array(runs["rough"].signals.constraint_force)[:, :201]
    again, seed, stream = (
        np.array(runs["rough", name].signals.constraint_force) for name in ("again", "seed", "stream")
    )
    assert np.array_equal(again, base)
    for other in (seed, stream):
        assert np.all(other[:, 1:] != base[:, 1:])


def test_noise_reaches_the_force_sensor(rough):
    """Force taken in, from the steps of the controller's integral: the lag of force plus the noise of its sample."""
    signals, steps = rough.run.signals, 20
    desired = np.array([15.0, 0.0, 0.0, 0.0])
    shown = desired + np.diff(np.array(signals.controller.force_integral).T[: steps + 2], axis=0) / PERIOD
    keep = np.exp(-PERIOD / rough.parameters.hardware.force_lag)
    arrived = (shown[1:] - keep * shown[:-1]) / (1 - keep)
    model, structure = build_model(as_scalars(rough.parameters, float)), SCENARIOS["rough"].structure()
    draw = jax.jit(jax.vmap(lambda sample: draw_noise(structure, model, sample).force))
    noise = np.array(draw(np.arange(steps))).T
    assert np.std(noise) == pytest.approx(0.2, rel=0.2)
    np.testing.assert_allclose(arrived - rough.force[:steps], noise, rtol=0, atol=1e-10)
