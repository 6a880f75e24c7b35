"""The sampled loop: its limit as period and lags vanish, what it holds, its noise, what is ideal adds nothing."""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy import stats
from scipy.integrate import solve_ivp

from coopmm_jax.loop.devices import draw_noise
from coopmm_jax.loop.form import Scalars
from coopmm_jax.loop.integrate import rk4_hold
from coopmm_jax.loop.rollout import as_scalars
from coopmm_jax.loop.sampled_loop import sampled_step
from coopmm_jax.loop.start import initial_state
from coopmm_jax.mechanics.disturbance import disturbing
from coopmm_jax.mechanics.model import build_model
from coopmm_jax.parameters import ALL_ROWS, Features, Hardware, Parameters, Structure
from coopmm_jax.scenario.scenario import load_scenario
from tests.oracles import lagrangian
from tests.samples import poses

PAPER = Parameters()
HORIZON = 0.5
SAMPLED = Structure(substeps=1)
LAGGING = Structure(features=Features(force_lag=True, actuator_lag=True))
DELAYED = Structure(substeps=1, force_delay=1, feedforward="full")
NOISY = DELAYED._replace(features=Features(noise=True))


def orders(sizes, runs, exact):
    """Orders of convergence of motion, controller's state and constraint forces at the end: slopes of log error."""

    def at_end(run):
        forces = [x[-1] for x in run.signals.constraint_force]
        parts = ((run.state.position, run.state.velocity), run.state.controller, forces)
        return [np.array(jax.tree.leaves(part)) for part in parts]

    errors = [[np.abs(x - y).max() for x, y in zip(at_end(run), at_end(exact), strict=True)] for run in runs]
    return np.polyfit(np.log(sizes), np.log(errors), 1)[0]


STEPS = (1000, 2000, 4000)  # control periods in the horizon
LAGS = (1e-3, 5e-4, 2.5e-4)  # [s]
SHARES = ((1.0, 0.1), (0.1, 1.0))  # of the lag, for force sensor and actuators


@pytest.fixture(scope="module")
def runs(programs):
    """Those of a finite control period and lag, and the ideal loop, integrated so finely that only that counts."""
    fine = (HORIZON / 20_000, 20_000)
    jobs = {"ideal": (Structure(), PAPER, *fine)} | {n: (SAMPLED, PAPER, HORIZON / n, n) for n in STEPS}
    for share in SHARES:
        for lag in LAGS:
            hardware = Hardware(force_lag=share[0] * lag, actuator_lag=share[1] * lag)
            jobs[share, lag] = (LAGGING, PAPER._replace(hardware=hardware), *fine)
    return {name: programs(structure)(*job) for name, (structure, *job) in jobs.items()}


def test_ideal_loop_is_the_limit_of_short_control_periods(runs):
    """Order one: torque is held and the controller's state makes Euler steps."""
    found = orders(1.0 / np.array(STEPS), [runs[n] for n in STEPS], runs["ideal"])
    assert found == pytest.approx([1.0] * 3, abs=0.03)


@pytest.mark.parametrize("share", SHARES, ids=["force", "actuators"])
def test_ideal_loop_is_the_limit_of_short_lags(runs, share):
    found = orders(LAGS, [runs[share, lag] for lag in LAGS], runs["ideal"])
    assert found == pytest.approx([1.0] * 3, abs=0.05)


def test_force_integral_makes_one_euler_step_per_sample(runs):
    run = runs[STEPS[0]]
    integral, errors = np.array(run.signals.controller.force_integral), np.array(run.signals.force_error)
    np.testing.assert_allclose(np.diff(integral), HORIZON / STEPS[0] * errors[:, :-1], rtol=0, atol=1e-14)


NOW, PERIOD = 0.3, 1e-3  # [s]


@pytest.fixture(scope="module")
def moving():
    """Parameters, and a state in which robots move and the force sensor shows something."""
    parameters = as_scalars(load_scenario("sensed").parameters()._replace(hardware=Hardware()), float)
    start, *_ = initial_state(DELAYED, build_model(parameters), parameters)
    velocity = tuple(0.1 * k - 0.3 for k in range(len(start.velocity)))
    devices = start.devices._replace(force=(10.0, 1.0, 2.0, 3.0))
    return parameters, as_scalars(start._replace(velocity=velocity, devices=devices), float)


def one_period(structure, moving):
    """State after one period and signals, operation by operation, so that equal arithmetic gives equal bits."""
    parameters, state = moving
    with jax.disable_jit():
        now, period = jnp.asarray(NOW), jnp.asarray(PERIOD)
        return sampled_step(structure, Scalars(), build_model(parameters), jnp.int32(7), now, period, state)


@pytest.fixture(scope="module")
def ideal_period(moving):
    return one_period(DELAYED, moving)


def oracle_rates(plant, disturbance, torque, t, state):
    """qdot (12,) and udot (10,) under constant actuator torques (10,), from the Lagrangian with multipliers."""
    q, u = state[:12].reshape(2, 6), state[12:]
    terms = lagrangian.coupled_terms(plant, ALL_ROWS, q, u)
    opposing = np.ravel(disturbing(disturbance, t).torque)
    u_dot, _ = lagrangian.multiplier_solution(terms, terms.B @ (torque - opposing))
    q_dot = [lagrangian.chained_basis(q_i) @ u_i for q_i, u_i in zip(q, u.reshape(2, 5), strict=True)]
    return np.concatenate([*map(np.ravel, q_dot), u_dot])


def test_torque_is_held_for_a_period(moving):
    """Two steps of RK4 in one period, against an adaptive integrator of the Lagrangian under the sample's torque."""
    parameters, start = moving
    parameters = parameters._replace(hardware=parameters.hardware._replace(force_bias=jnp.asarray(2.5)))
    structure = DELAYED._replace(substeps=2, features=Features(force_bias=True))
    end, signals = one_period(structure, (parameters, start))
    rates = partial(oracle_rates, parameters.plant, parameters.disturbance, np.ravel(signals.torque))
    before = np.concatenate([poses(start.position).ravel(), np.ravel(signals.velocity)])
    exact = solve_ivp(rates, (NOW, NOW + PERIOD), before, method="DOP853", rtol=1e-12, atol=1e-13).y[:, -1]
    np.testing.assert_allclose(poses(end.position).ravel(), exact[:12], rtol=0, atol=5e-11)
    independent = [i for i in range(10) if i not in lagrangian.dependent_joints(ALL_ROWS)]
    np.testing.assert_allclose(end.velocity, exact[12:][independent], rtol=0, atol=5e-11)
    desired = np.subtract(signals.constraint_force, signals.force_error)
    moved = PERIOD * (np.array(start.devices.force) + 2.5 - desired)  # one Euler step, however many of RK4
    integral = np.array(start.controller.force_integral) + moved
    np.testing.assert_allclose(end.controller.force_integral, integral, rtol=0, atol=1e-15)


def test_hold_keeps_the_first_signals_and_passes_time_on():
    """RK4 is exact for cubic polynomials of t: 4 t^3 from 1 to 3."""
    state, signals = rk4_hold(lambda t, x: (4.0 * t**3, (t, x)), 1.0, 0.5, 4, jnp.asarray(2.0))
    assert state == pytest.approx(2.0 + 3.0**4 - 1.0, rel=1e-15)
    assert tuple(map(float, signals)) == (1.0, 2.0)


@pytest.mark.parametrize("limits", ["torque_limits", "smooth_limits"])
def test_features_with_ideal_numbers_change_no_bit(moving, ideal_period, limits):
    others = ("force_bias", "noise", "friction", "tip_friction", "surface_motion")
    features = Features(**dict.fromkeys((limits, *others), True))
    with_features = one_period(DELAYED._replace(features=features), moving)
    assert np.array_equal(jax.tree.leaves(with_features), jax.tree.leaves(ideal_period))


@jax.jit
def draw(hardware, streams, sample):
    """Errors of one sample (streams, 22)."""

    def of_one(stream):
        noisy = as_scalars(build_model(PAPER._replace(hardware=hardware._replace(noise_stream=stream))), float)
        return jnp.stack(jax.tree.leaves(draw_noise(NOISY, noisy, sample)))

    return jax.vmap(of_one)(streams)


def noise_of(streams, seed=(0.0, 0.0), sample=0):
    """Unit errors of the given noise streams, one row each: encoders, velocities, forces."""
    hardware = Hardware(encoder_noise=1.0, velocity_noise=1.0, force_noise=1.0, noise_seed=seed)
    return np.array(draw(hardware, np.array(streams, float), sample))


def test_noise_of_a_stream_is_the_same_in_any_batch():
    batch = noise_of(range(8))
    assert batch.shape == (8, 12 + 6 + 4)
    assert np.array_equal(noise_of([5, 0, 3]), batch[[5, 0, 3]])
    assert np.array_equal(noise_of([7]), batch[[7]])


def test_seed_stream_and_sample_each_change_all_noise():
    noises = [
        noise_of([0]),
        noise_of([1]),
        noise_of([0], sample=1),
        noise_of([0], (1.0, 0.0)),
        noise_of([0], (0.0, 1.0)),
    ]
    assert len(np.unique(noises)) == 5 * 22


@pytest.mark.parametrize("seed", [0, 1, 2**24, 2**24 + 1, 2**32 - 1])
def test_seeds_are_exact_even_in_single_precision(seed):
    upper, lower = load_scenario("rough", simulation={"seed": seed}).parameters().hardware.noise_seed
    assert int(np.float32(upper)) * 2**16 + int(np.float32(lower)) == seed


def test_noise_is_standard_normal_and_independent():
    draws = noise_of(range(4000))
    assert stats.kstest(draws.ravel(), "norm").pvalue > 0.01
    correlation = np.corrcoef(draws.T) - np.eye(draws.shape[1])
    assert np.abs(correlation).max() < 5 / np.sqrt(4000)


def test_each_noise_has_its_own_size():
    hardware = Hardware(force_noise=1e3, encoder_noise=1.0, velocity_noise=1e-3)
    sizes = np.repeat([1.0, 1e-3, 1e3], [12, 6, 4])
    np.testing.assert_allclose(draw(hardware, np.zeros(1), 0)[0], sizes * noise_of([0])[0], rtol=1e-15)


@pytest.mark.parametrize("rows", [ALL_ROWS[:1], ALL_ROWS[1:]])
def test_noise_has_as_many_entries_as_is_measured(rows):
    structure, hardware = NOISY._replace(rows=rows), as_scalars(Hardware(), float)
    noise = jax.eval_shape(lambda: draw_noise(structure, build_model(PAPER._replace(hardware=hardware)), 0))
    assert (len(noise.velocity), len(noise.force)) == (10 - len(rows), len(rows))
    assert len(jax.tree.leaves(noise.position)) == 12
