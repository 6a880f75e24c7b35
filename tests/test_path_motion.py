"""Motion along paths: figures of the study, kinematics of the reference, proof and energy along a figure of eight."""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import coopmm_jax as cm
from coopmm_jax.control.path_motion import aim_at
from coopmm_jax.control.reference import at_instant, desired_motion
from coopmm_jax.control.robust_adaptive import ControllerState
from coopmm_jax.kinds.courses import Sine, Swing
from coopmm_jax.kinds.paths import Ellipse
from coopmm_jax.kinds.timings import Rate, RestToRest
from coopmm_jax.loop.lookahead import aims_ahead
from coopmm_jax.loop.rollout import Plan, rollout
from coopmm_jax.loop.state import State
from coopmm_jax.mechanics.disturbance import disturbing
from coopmm_jax.mechanics.model import build_model
from coopmm_jax.parameters import Gains, PathReference
from tests import path_results
from tests.beside_a_path import ALONG, CIRCLE, EIGHT, ELLIPSE, FULL, at_level, eight, ellipse, round_about, scenario
from tests.oracles import lagrangian
from tests.samples import poses, rate_of_V1

# z1 z2 z3 a1 a2 a3 of both robots after one second.
ON_THE_ELLIPSE = [
    [0.907935, 2.121566, -0.512508, 1.297555, -0.778111, 1.556222],
    [0.906732, 0.729848, -0.521399, 1.582614, 2.320033, 1.643119],
]


def coordinates(run, sample=1000):
    return np.array([[x[sample] for x in position] for position in run.signals.position])


def forces(run, sample=1000):
    return np.array([x[sample] for x in run.signals.constraint_force])


def assert_figures(actual, expected):
    """To the six decimals given, and what rounding the start to as many leaves of them."""
    np.testing.assert_allclose(actual, expected, rtol=3e-7, atol=2e-6)


@pytest.fixture(scope="module")
def along_the_ellipse(programs):
    """By the program of test_surfaces.py, as the eight."""
    return programs(FULL)(at_level(ellipse()))


@pytest.fixture(scope="module")
def along_the_eight(programs):
    return programs(FULL)(at_level(eight()))


def test_figures_on_the_ellipse(along_the_ellipse):
    run = along_the_ellipse
    assert_figures(coordinates(run), ON_THE_ELLIPSE)
    assert_figures(forces(run), [18.569496, 0.200791, -6.157551, 1.578100])
    c_hat = [x[1000] for x in run.signals.controller.c_hat]
    assert_figures(c_hat, [0.998828, 0.726964, 0.841748, 0.679515, 1.069660])
    assert_figures([x[1000] for x in run.signals.torque[0]], [4.543676, 1.571735, -0.392420, 3.787823, -5.279081])
    assert_figures(run.signals.carriage[0][1000], 0.723785)


def test_ellipse_over_three_turns(along_the_ellipse):
    """20 s: the contact holds, force and object settle, headings err by less than 1e-3 in whatever turn they are."""
    run, late = along_the_ellipse, along_the_ellipse.t > 15.0
    force = run.signals.constraint_force[0]
    assert [force.min(), force.max()] == [pytest.approx(9.80, abs=5e-3), pytest.approx(20.35, abs=5e-3)]
    assert np.sqrt(np.mean(run.signals.force_error[0][late] ** 2)) == pytest.approx(0.28, abs=5e-3)
    assert run.signals.carriage[0][-1] > 3 * 2 * np.pi
    errors = np.array([p.z1 for p in run.signals.position]) - run.signals.aim.heading
    errors = errors - 2 * np.pi * np.round(errors / (2 * np.pi))
    assert np.abs(errors[:, late]).max() < 1e-3


def test_desired_motion_on_the_ellipse():
    one, _ = jax.jit(desired_motion)(ellipse().reference, 1.0)
    assert_figures([*one[:6]], [0.901931, 2.113348, -0.499097, 1.060837, 0.064398, -0.580816])


def test_moving_guide(short_programs):
    run = short_programs(FULL)(ellipse("moving"))
    assert_figures(coordinates(run)[0, :4], [0.907880, 2.121532, -0.512494, 1.297607])
    assert_figures(forces(run), [19.531240, 0.039170, -0.091095, 0.090293])
    assert max(np.abs(phi).max() for phi in run.signals.constraint_residual) < 1e-11


def test_free_object():
    """As a batch has it, which does not compute its desired motion ahead."""
    gains = Gains(delta_floor=0.1, K_sigma=(0.5,) * 9, K_lambda=(0.3,), K_I=(1.5,))
    start = ellipse("free", away=0.05)._replace(gains=gains)
    structure = FULL._replace(rows=("contact_normal",))
    run = jax.jit(lambda start: rollout(structure, start, 1e-3, 1000, Plan.batch(1000), record=True).record)
    _, signals = run(start)
    assert_figures([x[-1] for x in signals.position[0]], [0.904677, 2.117298, -0.505915, 1.295563, -0.796942, 1.598500])
    assert_figures(signals.constraint_force[0][-1], 19.548342)


def test_without_a_soft_start_the_contact_pulls(programs):
    """The point to be followed starts at 1.6 m/s while the robots stand."""
    run = programs(FULL)(at_level(ellipse(ramp=0.0)), steps=1000)
    assert_figures(coordinates(run)[0, :4], [1.334501, 1.942158, -0.287297, 1.301044])
    np.testing.assert_allclose(forces(run), [22.358257, -0.462215, -18.018071, 4.768437], rtol=2e-6)
    worst = run.signals.constraint_force[0].argmin()
    assert run.signals.constraint_force[0][worst] == pytest.approx(-35, abs=0.5)
    assert run.t[worst] == pytest.approx(0.11, abs=5e-3)


def test_figures_on_the_eight(along_the_eight):
    """The law is stiff here: lambda depends on the start's seventh digit by 1e-4 N."""
    run = along_the_eight
    expected = [
        [-1.847892, -1.067598, 1.939329, 1.294299, -0.795952, 1.591905],
        [-1.847988, -2.467283, 1.940584, 1.570533, 2.346459, 1.590268],
    ]
    assert_figures(coordinates(run), expected)
    np.testing.assert_allclose(forces(run), [18.05301, 0.30363, -1.68191, 0.36471], rtol=0, atol=2e-4)
    torque = [x[1000] for x in run.signals.torque[0]]
    np.testing.assert_allclose(torque, [-4.38269, 3.59762, -1.23831, 3.24859, -5.34361], rtol=0, atol=2e-4)
    assert_figures(run.signals.carriage[0][1000], 0.899960)


def test_eight_over_its_crossing(along_the_eight):
    """20 s, twice round: a rail that crosses itself is no problem, nor is a yaw rate of both signs."""
    run = along_the_eight
    force, guide = run.signals.constraint_force[0], run.signals.constraint_force[2:]
    assert [force.min(), force.max()] == [pytest.approx(9.35, abs=0.01), pytest.approx(22.3, abs=0.05)]
    turn = run.signals.aim.turn.value
    assert turn.min() < -1.0
    assert turn.max() > 1.0
    assert np.abs(guide[0][run.t > 1.0]).max() < 2.5
    assert max(np.abs(phi).max() for phi in run.signals.constraint_residual) < 2e-8


REFERENCES = {
    "sway": PathReference(EIGHT, Rate(0.7, 0.5, 0.4, 2.0), (0.7, -0.6), Swing(swing=0.4, rate=1.3), Sine(15.0, 5.0)),
    "turning back": PathReference(EIGHT, RestToRest(2.0, -1.0, 3.0), contact=Sine(0.1, 0.05, 0.7)),
}


@pytest.mark.parametrize("name", REFERENCES)
def test_desired_motion_obeys_the_chained_form(name):
    """(8) at u_d, in particular z_d2' = u_d1 z_d3: no side slip; also that a known instant has the right rates."""
    reference, t = REFERENCES[name], 0.9

    def with_rates(reference, t):
        return jax.jvp(lambda t: desired_motion(reference, t), (t,), (1.0,))

    @jax.jit
    def as_given_and_known(reference, t):
        return with_rates(reference, t), with_rates(at_instant(reference, t), t)

    (both, rates), (again, known_rates) = as_given_and_known(reference, t)
    np.testing.assert_allclose(jax.tree.leaves(again), jax.tree.leaves(both), rtol=1e-15)
    np.testing.assert_allclose(jax.tree.leaves(known_rates), jax.tree.leaves(rates), rtol=1e-12, atol=1e-14)
    for desired, rate in zip(both, rates, strict=True):
        np.testing.assert_allclose(rate[:3], [desired.u1, desired.u1 * desired.z3, desired.u2], rtol=1e-13, atol=1e-15)
        np.testing.assert_allclose(rate.u1, desired.u1_rate, rtol=1e-13)
        np.testing.assert_allclose(desired.arm_rate, rate.arm, rtol=1e-13, atol=1e-15)


def test_lyapunov_rate_where_the_yaw_rate_changes_sign(along_the_eight):
    """(32) along the figure of eight."""
    chosen = jax.tree.map(lambda x: x[:9000:600], along_the_eight.signals)
    independent = (*chosen.velocity[0][:3], *chosen.velocity[1][:3])
    states = State(chosen.position, independent, ControllerState(*chosen.controller), carriage=chosen.carriage)
    V1_rate, decay, cross = rate_of_V1(FULL, at_level(eight()), along_the_eight.t[:9000:600], states)
    turn = chosen.aim.turn.value
    assert turn.min() < 0.0 < turn.max()
    assert np.abs(V1_rate + decay - cross).max() < 1e-15


def test_energy_balance_on_the_rail(along_the_eight):
    """d(T + U)/dt is the power of actuators and disturbances; the rail does no work."""
    parameters, step = eight(), 1e-3
    t, signals = jax.tree.map(lambda x: x[:301], (along_the_eight.t, along_the_eight.signals))
    q, plant, energy, power = poses(signals.position), parameters.plant, 0.0, 0.0
    for i in range(2):
        u = np.array(signals.velocity[i]).T
        own = partial(lagrangian.energy, plant.geometry[i], plant.inertia[i], plant.gravity)
        B = jax.vmap(partial(lagrangian.input_matrix, plant.geometry[i]))(q[:, i])
        torque = np.array(signals.torque[i]) - np.array(disturbing(parameters.disturbance, t).torque[i])
        energy = energy + np.asarray(jax.vmap(own)(q[:, i], u))
        power = power + np.einsum("ti,tij,jt->t", u, B, torque)
    weights = np.array([-1, 9, -45, 0, 45, -9, 1]) / (60 * step)
    rate = np.convolve(energy, weights[::-1], mode="valid")
    assert np.abs(rate - power[3:-3]).max() < 1e-8 * np.abs(power).max()


def simulated(path, delta_floor, **overrides):
    """Under the law as in the paper, from a scenario, over 1 s."""
    reference = ALONG | {"path": {"kind": "fourier"} | path._asdict()} | overrides.pop("reference", {})
    law = {"feedforward": "projected", "delta_floor": delta_floor}
    return cm.simulate(scenario(law=law, reference=reference, simulation={"duration": 1.0}, **overrides))


@pytest.fixture(scope="module")
def simulated_ellipse():
    return simulated(ELLIPSE, 0.1)


def test_projected_law_moves_the_same_and_pulls(simulated_ellipse, along_the_ellipse):
    run, signals = simulated_ellipse, along_the_ellipse.signals
    np.testing.assert_allclose(run.q[:201], poses(signals.position)[:201], rtol=0, atol=1e-12)
    np.testing.assert_allclose(run.carriage[:201, 0], signals.carriage[0][:201], rtol=1e-12, atol=1e-16)
    assert_figures(np.hstack([run.zeta[-1], run.q[-1, :, 3:]]), ON_THE_ELLIPSE)
    assert_figures(run.constraint_force[-1], [44.905342, -2.617624, 67.380666, -12.304889])
    assert run.constraint_force[:, 0].min() == pytest.approx(-186, abs=0.5)


def test_simulated_ellipse(simulated_ellipse):
    """Desired force and headings are recorded over time."""
    run = simulated_ellipse
    assert run.carriage.shape == (1001, 1)
    np.testing.assert_allclose(run.constraint_force_desired[:, 0], 15.0 + 5.0 * np.sin(run.t), rtol=1e-14)
    assert np.abs(run.zeta[..., 0] - run.zeta_desired[..., 0]).max() < 0.2
    assert run.to_xarray().carriage.dims == ("t", "rail")
    slow = 1.0 - 0.5 * (1.0 - np.exp(-2.0))
    object_error = np.linalg.norm(run.tip[-1, 1, :2] - Ellipse().point(slow + 0.3 * np.sin(slow)))
    assert run.metrics["object_final"] == pytest.approx(object_error, rel=1e-9)


def test_aims_computed_ahead_are_those_of_each_stage():
    """A rollout alone reads the desired motion from a table, a batch computes it stage by stage; a sample has one."""

    @jax.jit
    def all_three(reference):
        t = (300.0 + jnp.arange(4.0)[:, None] + jnp.array([[0.0, 0.5, 1.0]])) * 1e-3
        stages = jax.vmap(jax.vmap(lambda t: aim_at(reference, t)))(t)
        continuous, sampled = (
            aims_ahead(reference, 1e-3, float, sampled)(300, 4).unpack() for sampled in (False, True)
        )
        return continuous, sampled, stages

    found = all_three(build_model(round_about()).reference)
    for continuous, sampled, stage in zip(*map(jax.tree.leaves, found), strict=True):
        np.testing.assert_allclose(continuous, stage, rtol=1e-14)
        np.testing.assert_allclose(sampled, stage[:, :1], rtol=1e-14)


def test_path_and_rail_along_a_circle_are_the_circle(simulated_paper):
    steady = {"timing": {"kind": "rate", "ramp": 0.0}, "force": {"kind": "sine", "mean": 15.0, "amplitude": 0.0}}
    run = simulated(CIRCLE, 0.0, reference=steady, initial=simulated_paper.scenario.initial)
    assert_figures(run.q, simulated_paper.q)
    np.testing.assert_allclose(run.constraint_force[-1], simulated_paper.constraint_force[-1], rtol=1e-9)


@pytest.mark.parametrize(
    ("function", "by"),
    [
        (path_results.start, {"path", "rail", "offset", "curvature", "wheelbase"}),
        (path_results.rates, set(path_results.CHANGES) - {"force"}),
        (path_results.aims, {"path", "rate", "offset", "curvature", "force"}),
    ],
    ids=["start", "loop", "aims ahead"],
)
def test_gradients_by_path_rail_timing_gains_fronts_and_state(function, by):
    """Reverse mode against differences of sixth order; with ideal sensing the desired force changes no motion.

    Of the start, of one evaluation of the loop, and of what a rollout computes ahead; test_gradients.py goes through
    rollouts.
    """
    for name, (exact, difference) in path_results.results(function).items():
        if name in by:
            assert exact != 0.0
            assert exact == pytest.approx(difference, rel=1e-9), name
        else:
            assert exact == 0.0
