"""Readings of the force sensor, and gains for which the force loop around it is stable."""

import functools

import jax
import numpy as np
import pytest

from coopmm_jax.loop.closed_loop import closed_loop
from coopmm_jax.loop.devices import Noise, initial_devices, sense
from coopmm_jax.loop.rollout import as_scalars
from coopmm_jax.loop.start import initial_state
from coopmm_jax.loop.state import State
from coopmm_jax.mechanics.model import build_model
from coopmm_jax.parameters import Features, Hardware, Parameters, Structure
from coopmm_jax.scenario.scenario import load_scenario
from tests.programs import Program

PERIOD = 1e-4  # short, so that the robots hardly move while torques are held
LAG = 5e-4
KEEP = float(np.exp(-PERIOD / LAG))
SENSED = load_scenario("sensed").structure()


def shown(structure, forces, errors=None):
    """Readings of the sensor at the samples 0, 1, ... while the normal force is ``forces``."""
    model = as_scalars(build_model(Parameters(hardware=Hardware(force_lag=LAG))), float)
    devices, values = initial_devices(structure, 0.0), []
    for sample, force in enumerate(forces):
        values.append(devices.force[0])
        noise = None if errors is None else Noise((), (), (errors[sample],))
        devices = sense(structure, model, sample, PERIOD, devices, (force,), noise)
    return np.array(values, float)


@pytest.mark.parametrize("delay", [1, 2, 5])
def test_delay_is_a_number_of_samples(delay):
    forces = np.arange(1.0, 11.0)
    structure = Structure(rows=("contact_normal",), substeps=1, force_delay=delay)
    assert shown(structure, forces).tolist() == [*[0.0] * delay, *forces[:-delay]]


@pytest.mark.parametrize("delay", [0, 1, 3])
def test_lag_is_exact_for_a_force_that_changes_at_samples(delay):
    forces = np.random.default_rng(0).uniform(-20, 20, 12)
    structure = Structure(rows=("contact_normal",), substeps=1, force_delay=delay, features=Features(force_lag=True))
    expected = [0.0]
    for arriving in [*[0.0] * delay, *forces][: len(forces) - 1]:
        expected.append(arriving + (expected[-1] - arriving) * KEEP)
    np.testing.assert_allclose(shown(structure, forces), expected, rtol=0, atol=1e-14)


def test_noise_is_of_the_force_before_delay_and_lag():
    forces, errors = np.random.default_rng(0).uniform(-20, 20, (2, 12))
    structure = Structure(
        rows=("contact_normal",), substeps=1, force_delay=2, features=Features(force_lag=True, noise=True)
    )
    np.testing.assert_array_equal(shown(structure, forces, errors), shown(structure, forces + errors))


@pytest.mark.parametrize("further", [(), ("actuator_lag",), ("torque_limits",)])
def test_ideal_sensor_shows_the_force_its_own_torque_causes_with_its_bias(further):
    features = Features(force_bias=True, **dict.fromkeys(further, True))
    hardware = Hardware(force_bias=2.5, actuator_lag=0.01, wheel_limit=5.0, joint_limit=1.0)
    parameters, structure = as_scalars(Parameters(hardware=hardware), float), Structure(features=features)
    model = build_model(parameters)
    state, *_ = initial_state(structure, model, parameters)
    moving = State(state.position, tuple(0.1 * k for k in range(6)), state.controller, state.devices)
    rates, signals = closed_loop(structure, model, 0.3, as_scalars(moving, float))
    expected = np.array(signals.force_error) + 2.5
    np.testing.assert_allclose(np.array(rates.controller.force_integral), expected, rtol=0, atol=1e-12)


@pytest.mark.parametrize("further", [(), ("actuator_lag",)])
def test_motion_behind_a_sensor_that_lags_is_known_at_once_in_continuous_time(further):
    """Only over a control period is it found later."""
    features = Features(force_lag=True, **dict.fromkeys(further, True))
    parameters, structure = as_scalars(Parameters(), float), Structure(features=features)
    model = build_model(parameters)
    state, *_ = jax.eval_shape(lambda: initial_state(structure, model, parameters))
    rates, _ = jax.eval_shape(lambda state: closed_loop(structure, model, 0.3, state), state)
    assert jax.tree.structure(rates) == jax.tree.structure(state)


def test_program_does_not_grow_with_the_delay():
    def traced(delay):
        structure, model = SENSED._replace(force_delay=delay), build_model(Parameters())
        devices = initial_devices(structure, 0.0)
        return jax.make_jaxpr(lambda *now: sense(structure, model, *now, None))(7, PERIOD, devices, (1.0,) * 4)

    short, long = (str(traced(delay)).count(" = ") for delay in (2, 1000))
    assert long == short > 4


LAG_BOUND = (1.0 + KEEP) / (1.0 - KEEP)
LOOPS = {  # name -> force lag [s], gain, factor of the force's error from one sample to the next
    # A sample is itself seen one sample later: all that is left without a lag, in the program of the loops with one.
    **{f"delay {gain}": (0.0, gain, -gain) for gain in (0.99, 1.01, -0.99, -1.01)},
    **{
        f"lag {name}": (LAG, gain, KEEP - (1.0 - KEEP) * gain)
        for name, gain in {
            "0.99": 0.99 * LAG_BOUND,
            "1.01": 1.01 * LAG_BOUND,
            "-0.99": -0.99,
            "-1.01": -1.01,
        }.items()
    },
}
STEPS, LONG = 300, 500
LATE = 3  # samples


@pytest.fixture(scope="module")
def runs():
    """`sensed` by its delay, and each of LOOPS with a desired contact force of 15 and of 16 N and no integral gain."""
    paper, sensed = Parameters(), load_scenario("sensed").parameters()
    jobs = {0: (SENSED, sensed, 1e-3, LONG), LATE: (SENSED._replace(force_delay=LATE), sensed, 1e-3, LONG)}
    for name, (lag, gain, _) in LOOPS.items():
        gains = paper.gains._replace(K_lambda=(gain,) * 4, K_I=(0.0,) * 4)
        for wanted in (15.0, 16.0):
            reference = paper.reference._replace(contact_force=wanted)
            parameters = paper._replace(gains=gains, reference=reference, hardware=Hardware(force_lag=lag))
            jobs[name, wanted] = (SENSED, parameters, PERIOD, STEPS)
    programs = functools.cache(lambda structure: Program(structure, 10_000))  # room for as many as test_real_loop.py
    return {name: programs(structure)(*job) for name, (structure, *job) in jobs.items()}


@pytest.mark.parametrize("delay", [0, LATE])
def test_sensor_in_the_loop_follows_the_contact_forces(runs, delay):
    """Force that the controller took in, from the steps of its integral, is the lag of the recorded forces."""
    signals, period = runs[delay].signals, 1e-3
    desired = np.array(signals.constraint_force) - np.array(signals.force_error)
    taken_in = desired[:, :-1] + np.diff(np.array(signals.controller.force_integral)) / period
    keep, expected = np.exp(-period / 5e-3), [np.zeros(4)]
    arriving = np.concatenate([np.zeros((delay, 4)), np.array(signals.constraint_force).T])
    for force in arriving[: taken_in.shape[1] - 1]:
        expected.append(keep * expected[-1] + (1 - keep) * force)
    np.testing.assert_allclose(taken_in.T, expected, rtol=0, atol=1e-10)


@pytest.mark.parametrize("loop", LOOPS)
def test_force_loop_is_stable_exactly_within_its_bounds(runs, loop):
    """One sample of delay: |K_lambda| < 1. Sampled lag: |a - (1 - a) K_lambda| < 1, so -1 < K < (1 + a) / (1 - a).

    When one newton more is wanted and the sensor has not seen anything yet, the normal force at sample k is
    K factor^k off its new value: the closed form of lambda = ... - K (shown - lambda_d) with the sensor's recursion.
    Torque held between samples presses along the last sample's normal, hence the tolerance.
    """
    _, gain, factor = LOOPS[loop]
    assert runs[loop, 15.0].health.status == runs[loop, 16.0].health.status == 0
    change = np.subtract(*(np.array(runs[loop, wanted].signals.constraint_force) for wanted in (16.0, 15.0)))
    off = gain * factor ** np.arange(STEPS + 1)
    np.testing.assert_allclose(change[0] - 1.0, off, rtol=0, atol=1e-5 * np.abs(off).max())
    assert np.abs(change[1:]).max() < 1e-5 * np.abs(off).max()

    grown = abs(change[0, -1] - 1.0) / abs(change[0, 0] - 1.0)
    assert grown == pytest.approx(abs(factor) ** STEPS, rel=3e-4)
    assert (grown < 1.0) == ("0.99" in loop)
