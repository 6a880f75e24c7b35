"""The controlled pair of robots: model.md's figures, energy balance, constraints, and what the study shows."""

from functools import partial

import jax
import numpy as np
import pytest

from coopmm_jax.control.reference import desired_motion
from coopmm_jax.control.robust_adaptive import ControllerState
from coopmm_jax.kinds.disturbances import Disturbance, Sine
from coopmm_jax.loop.closed_loop import closed_loop
from coopmm_jax.loop.state import State
from coopmm_jax.mechanics.disturbance import disturbing
from coopmm_jax.mechanics.model import build_model
from coopmm_jax.mechanics.plant import DRIFT_RATE
from coopmm_jax.parameters import ALL_ROWS, Parameters, Plant, Structure
from tests.oracles import control_law, lagrangian
from tests.samples import admissible, assert_close, poses, positions, random_inertia, random_pair

PAPER = Parameters()
ROBOT = PAPER.plant.geometry[0], PAPER.plant.inertia[0]
# A plant that differs from the paper's wherever it can, and a controller that knows little of it.
OTHER_GEOMETRY = ROBOT[0]._replace(d=0.4, l=0.45, r=0.4, l2=0.27, mount_offset=0.05)
OTHER = PAPER._replace(
    plant=Plant(
        (OTHER_GEOMETRY, ROBOT[0]._replace(mount_offset=-0.05)),
        (ROBOT[1]._replace(m_obj=0.2, I2=0.4), PAPER.plant.inertia[1]._replace(m_p=6.0, I_w=0.8)),
    ),
    disturbance=(Disturbance(Sine(phase=0.5), scale=3.0),),
)


@pytest.fixture(scope="module")
def full_run(programs):
    """The paper's 20 s with the full force feed-forward."""
    return programs(Structure(feedforward="full"))(PAPER)


def coordinates(signals, sample):
    return np.array([[x[sample] for x in position] for position in signals.position])


def forces(signals, sample):
    return np.array([x[sample] for x in signals.constraint_force])


def tracking_errors(run):
    """z1, z2, z3 and a1 of both robots less what is desired of them, (8, T)."""
    desired = jax.vmap(partial(desired_motion, PAPER.reference), out_axes=0)(run.t)
    return np.array(
        [
            actual - np.broadcast_to(target, actual.shape)
            for p, d in zip(run.signals.position, desired, strict=True)
            for actual, target in zip(p[:4], (d.z1, d.z2, d.z3, *d.arm), strict=True)
        ]
    )


def test_start_angles(paper_run):
    """Newton projects the printed start onto the constraints."""
    start = coordinates(paper_run.signals, 0)
    np.testing.assert_allclose(start[:, 4:], [[-0.731919, 1.463837], [2.094395, 2.094395]], rtol=0, atol=1e-6)
    assert start[:, :4].tolist() == [[0.0, 2.5, 0.0, 0.5253], [0.0, 1.2, 0.0, 1.57]]
    assert max(np.abs(x[0]) for x in paper_run.signals.constraint_residual) < 1e-15
    assert all(np.all(u == 0) for robot in paper_run.signals.velocity for u in np.array(robot)[:, 0])


def test_figures_at_the_start(paper_run):
    np.testing.assert_allclose(forces(paper_run.signals, 0), [8.01362, 4.75186, -3.76017, 12.27700], rtol=2e-6)


def test_figures_after_one_second(paper_run):
    signals = paper_run.signals
    expected = [
        [0.993068, 2.405048, -0.023436, 1.232574, -0.794428, 1.588857],
        [0.995697, 1.032931, -0.080464, 1.596680, 2.299786, 1.683614],
    ]
    np.testing.assert_allclose(coordinates(signals, 1000), expected, rtol=0, atol=1e-6)
    np.testing.assert_allclose(forces(signals, 1000), [-6.67759, 5.45729, -76.73173, 18.35874], rtol=2e-6)
    c_hat = [x[1000] for x in signals.controller.c_hat]
    np.testing.assert_allclose(c_hat, [2.036303, 0.817932, 1.111726, 0.726273, 1.828628], rtol=2e-6)
    torque = [x[1000] for x in signals.torque[0]]
    np.testing.assert_allclose(torque, [16.8394, 2.1743, 1.4629, 0.1992, 1.4369], rtol=0, atol=1e-4)


def test_full_feedforward_changes_the_forces_and_not_the_motion(paper_run, full_run):
    np.testing.assert_allclose(forces(full_run.signals, 1000), [12.88939, 0.55850, -12.58989, 3.73742], rtol=2e-5)
    for mine, other in zip(full_run.signals.position, paper_run.signals.position, strict=True):
        np.testing.assert_allclose(np.array(mine), np.array(other), rtol=0, atol=1e-13)


def test_constraints_hold_for_twenty_seconds(paper_run, full_run):
    for run in (paper_run, full_run):
        assert np.abs(np.array(run.signals.constraint_residual)).max() < 1e-9


def test_tracking_settles(paper_run):
    """Platforms within about 3 s, arms at the pace of K_a."""
    errors = np.abs(tracking_errors(paper_run)).reshape(2, 4, -1)
    assert errors[:, :3, 3000:].max() < 1e-3
    assert errors[:, 3, 8000:].max() < 2e-4


def test_contact_force_settles_near_fifteen_newtons(paper_run):
    error = np.array(paper_run.signals.force_error)[0]
    assert np.abs(error[3000:]).max() < 3.0
    assert np.sqrt(np.mean(error[15000:] ** 2)) < 1.5


def test_contact_opens_at_the_start_only_under_projected_feedforward(paper_run, full_run):
    normal, guide = np.array(paper_run.signals.constraint_force)[[0, 2]]
    assert normal.min() == pytest.approx(-93.5, abs=0.05)
    assert paper_run.t[normal.argmin()] == pytest.approx(0.09, abs=0.01)
    assert np.abs(guide).max() == pytest.approx(613, abs=0.5)
    normal, guide = np.array(full_run.signals.constraint_force)[[0, 2]]
    assert normal.min() == pytest.approx(-0.4, abs=0.05)
    assert full_run.t[normal.argmin()] == pytest.approx(0.23, abs=0.01)
    assert np.abs(guide).max() == pytest.approx(50, abs=0.5)


def central_difference(values, step):
    """Sixth-order derivative of equidistant values, without the three samples at each end."""
    weights = np.array([-1.0, 9.0, -45.0, 0.0, 45.0, -9.0, 1.0]) / (60 * step)
    return np.convolve(values, weights[::-1], mode="valid")


@pytest.mark.parametrize("parameters", [PAPER, OTHER], ids=["paper", "other plant"])
def test_energy_balance(programs, parameters):
    """d(T + U)/dt is the power of actuators and disturbances; the constraint forces do no work."""
    plant, step = parameters.plant, 1e-3
    run = programs(Structure())(parameters, step, 1000)
    assert run.health.status == 0
    q = poses(run.signals.position)
    energy, power = 0.0, 0.0
    for i in range(2):
        u = np.array(run.signals.velocity[i]).T
        torque = np.array(run.signals.torque[i]) - np.array(disturbing(parameters.disturbance, run.t).torque[i])
        own = partial(lagrangian.energy, plant.geometry[i], plant.inertia[i], plant.gravity)
        B = jax.vmap(partial(lagrangian.input_matrix, plant.geometry[i]))(q[:, i])
        energy = energy + np.asarray(jax.vmap(own)(q[:, i], u))
        power = power + np.einsum("ti,tij,jt->t", u, B, torque)
    rate = central_difference(energy, step)
    assert np.abs(rate - power[3:-3]).max() < 1e-8 * np.abs(power).max()


def test_constraint_forces_do_no_work(paper_run):
    signals, q = paper_run.signals, poses(paper_run.signals.position)
    u = np.concatenate([np.array(robot) for robot in signals.velocity])
    for sample in range(0, 1000, 100):
        _, J, _ = lagrangian.constraint_terms(PAPER.plant, ALL_ROWS, q[sample], u[:, sample])
        work = forces(signals, sample) * (J @ u[:, sample])
        assert np.abs(work).max() < 5e-13


@pytest.mark.parametrize("sample", [0, 400])
def test_compiled_loop_agrees_with_one_evaluated_operation_by_operation(paper_run, sample):
    at = jax.tree.map(lambda x: float(x[sample]), paper_run.signals)
    independent = (*at.velocity[0][:3], *at.velocity[1][:3])
    state = State(at.position, independent, ControllerState(*at.controller))
    _, signals = closed_loop(Structure(), build_model(PAPER), float(paper_run.t[sample]), state)
    for mine, compiled in zip(jax.tree.leaves(signals), jax.tree.leaves(at), strict=True):
        assert float(mine) == pytest.approx(compiled, rel=1e-11, abs=1e-12)


def test_drift_off_the_constraints_decays():
    """Along the rates of the positions dphi/dt = -DRIFT_RATE phi, wherever the state is."""
    rng = np.random.default_rng(0)
    plant, q = random_pair(rng)
    _, u = admissible(ALL_ROWS, plant, q, rng)
    model = build_model(Parameters(plant=plant, nominal=(random_inertia(rng), random_inertia(rng))))
    controller = ControllerState((0.0,) * 2, (0.0,) * 2, (1.0,) * 5, (0.0,) * 4)
    independent = tuple(u[control_law.INDEPENDENT].tolist())
    rates, _ = closed_loop(Structure(), model, 0.0, State(positions(q), independent, controller))
    u_of_rates = np.array([float(x) for r in rates.position for x in (r.z1, r.z3, *r[3:])])
    phi, J, _ = lagrangian.constraint_terms(plant, ALL_ROWS, q, u)
    assert np.abs(phi).min() > 1e-2
    assert_close(J @ u_of_rates, -DRIFT_RATE * phi, 2e-15)
