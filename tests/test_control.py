"""The control law against the identities of Theorem 3.1's proof and a second implementation on arrays."""

import itertools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from coopmm_jax.control import adaptive, backstepping, force, reference
from coopmm_jax.control.controller import Seen, known_to_controller
from coopmm_jax.control.robust_adaptive import ControllerState
from coopmm_jax.kinds.disturbances import Disturbance, Sine
from coopmm_jax.loop.closed_loop import closed_loop
from coopmm_jax.loop.state import State
from coopmm_jax.mechanics.constrained_kinematics import kinematics
from coopmm_jax.mechanics.coordinates import Position
from coopmm_jax.mechanics.disturbance import disturbing
from coopmm_jax.mechanics.model import build_model
from coopmm_jax.mechanics.robot_kinematics import chained_rates
from coopmm_jax.parameters import ALL_ROWS, Gains, Parameters, Reference, Structure
from tests.oracles import control_law, lagrangian
from tests.samples import admissible, assert_close, joined, positions, random_inertia, random_pair, vector

LAWS = [
    Structure(robust_term=robust, u26=u26, feedforward=feedforward)
    for robust, u26, feedforward in itertools.product(
        ("proof", "printed"), ("printed", "corrected"), ("projected", "full")
    )
]
T = 0.7  # time of the random states [s]


def random_gains(rng, delta_floor=0.0):
    """Gains that all differ from each other."""
    one = rng.uniform(0.5, 3.0, 8).tolist()
    many = {name: tuple(rng.uniform(0.2, 2.0, n).tolist()) for name, n in (("K_sigma", 6), ("gamma", 5), ("c_hat0", 5))}
    forces = {name: tuple(rng.uniform(0.2, 2.0, 4).tolist()) for name in ("K_lambda", "K_I")}
    names = ("k0", "k1", "k2", "k3", "K_a", "K_u", "beta", "lam_min")
    return Gains(**dict(zip(names, one, strict=True)), **many, **forces, delta_floor=delta_floor)


def random_sine(rng):
    wheel, joint, scale, *wave = rng.uniform(0.3, 2.0, 5).tolist()
    return Disturbance(Sine(*wave), scale, wheel, joint)


class Case:
    """The closed loop at one random state with J u = 0, with a wrong nominal model."""

    def __init__(self, seed, delta_floor=0.0):
        rng = np.random.default_rng(seed)
        plant, self.q = random_pair(rng)
        self.parameters = Parameters(
            plant=plant,
            nominal=(random_inertia(rng), random_inertia(rng)),
            gains=random_gains(rng, delta_floor),
            disturbance=(random_sine(rng),),
            reference=Reference(1.3, (2.4, 1.0), (1.5, 1.6), (0.5, 0.2), 0.8, 12.0),
        )
        self.terms, self.u = admissible(ALL_ROWS, plant, self.q, rng)
        self.controller = control_law.ControllerState(*(rng.uniform(0.2, 1.0, n) for n in (2, 2, 5, 4)))
        self.model = build_model(self.parameters)
        self.independent = tuple(self.u[control_law.INDEPENDENT].tolist())
        self.state = State(
            positions(self.q), self.independent, ControllerState(*(tuple(m.tolist()) for m in self.controller))
        )

    def simulated_command(self, law):
        k = kinematics(self.model, ALL_ROWS, self.state.position, self.independent)
        seen = Seen(law, known_to_controller(self.model), T, k, self.independent)
        return self.model.gains.command(seen, self.state.controller)

    def expected_command(self, law):
        return control_law.motion_control(law, self.parameters, T, self.q, self.u, self.controller)


@pytest.fixture(scope="module", params=[(0, 0.0), (2, 0.8)], ids=["no floor", "floor"])
def case(request):
    return Case(*request.param)


def curved_motion(t):
    """A desired motion that obeys the chained form with every derivative different from zero."""
    s, c = jnp.sin(t), jnp.cos(t)
    return reference.Desired(
        z1=t + 0.3 * s,
        z2=1.5 - 0.2 * c + 0.03 * s * s,
        z3=0.2 * s,
        u1=1 + 0.3 * c,
        u2=0.2 * c,
        u1_rate=-0.3 * s,
        arm=(1.0 + 0.4 * s,),
        arm_rate=(0.4 * c,),
    )


def along_the_motion(function, gains, seed):
    """A function of (desired, position, eta) and its rate while u = z + utilde, with what (25)-(32) are made of."""
    rng = np.random.default_rng(seed)
    position = Position(*rng.uniform(-1, 1, 6).tolist())
    eta, utilde = rng.uniform(-1, 1), rng.uniform(-1, 1, 3)
    desired = curved_motion(T)
    z = backstepping.reference_velocity(gains, desired, position, (position.a1,), eta)
    u = [float(a + b) for a, b in zip(z, utilde, strict=True)]
    rates = Position(*chained_rates(position, u[0], u[1]), u[2], 0.0, 0.0)
    eta_rate = backstepping.eta_rate(gains, desired, position, eta)

    def at(t, position, eta):
        return function(curved_motion(t), position, eta)

    _, rate = jax.jvp(at, (T, position, eta), (1.0, rates, eta_rate))
    return rate, desired, position, eta, utilde


@pytest.mark.parametrize("seed", range(3))
def test_backstepping_error_dynamics(seed):
    """(25), (26) and the corrected (27)."""
    gains = random_gains(np.random.default_rng(seed))

    def errors(desired, position, eta):
        return backstepping.backstepping_errors(gains, desired, position)[2:]

    rate, desired, position, eta, utilde = along_the_motion(errors, gains, seed)
    _, s2, s3 = errors(desired, position, eta)
    platform, u_d1 = eta + utilde[0], desired.u1
    expected = (
        platform,
        platform * position.z3 + s3 * u_d1 - gains.k2 * s2 * u_d1**2,
        platform * gains.k2 * u_d1 * position.z3 - gains.k3 * s3 - s2 * u_d1 + utilde[1],
    )
    assert_close(vector(rate), vector(expected), 1e-15)


@pytest.mark.parametrize("seed", range(3))
def test_first_lyapunov_function_decreases_but_for_the_velocity_error(seed):
    """(32)."""
    gains = random_gains(np.random.default_rng(seed))

    def V1(desired, position, eta):
        s = backstepping.backstepping_errors(gains, desired, position)
        return (s.s2**2 + s.s3**2 + gains.k1 * s.s1**2 + eta**2) / 2

    rate, desired, position, eta, utilde = along_the_motion(V1, gains, seed)
    s = backstepping.backstepping_errors(gains, desired, position)
    decrease = gains.k2 * s.s2**2 * desired.u1**2 + gains.k3 * s.s3**2 + gains.k0 * eta**2
    Lambda = vector(backstepping.coupling_signal(gains, desired, position))
    assert float(rate) == pytest.approx(float(utilde[:2] @ Lambda - decrease), rel=1e-14)


def test_arm_error_decays_at_its_own_gain():
    gains = random_gains(np.random.default_rng(0))

    def error(desired, position, eta):
        return position.a1 - desired.arm[0]

    rate, desired, position, eta, utilde = along_the_motion(error, gains, 0)
    assert float(rate) == pytest.approx(float(utilde[2] - gains.K_a * error(desired, position, eta)), rel=1e-14)


@pytest.mark.parametrize("robot", [0, 1])
def test_desired_motion_obeys_the_chained_form(robot):
    chosen = Reference(1.3, (2.4, 1.0), (1.5, 1.6), (0.5, 0.2), 0.8, 12.0)
    desired, rate = jax.jvp(lambda t: reference.desired_motion(chosen, t)[robot], (T,), (1.0,))
    assert vector(rate[:3]).tolist() == [desired.u1, desired.u1 * desired.z3, desired.u2]
    assert float(rate.u1) == desired.u1_rate
    assert float(desired.arm_rate[0]) == pytest.approx(float(rate.arm[0]), rel=1e-15)
    zeta, _ = control_law.desired_motion(chosen, T)
    assert_close(vector((*desired[:3], *desired.arm)), zeta[robot], 1e-15)


def test_only_the_contact_normal_is_asked_to_press():
    assert reference.desired_force(Reference(), ALL_ROWS, 2.0) == (15.0, 0.0, 0.0, 0.0)


@pytest.mark.parametrize("law", [LAWS[0], LAWS[1]], ids=["projected", "full"])
def test_filtered_error_dynamics(law):
    """(30) with an exact model: the nudot that the law uses is the derivative of u^1 - sigma along the flow."""
    case = Case(0)
    parameters = case.parameters._replace(nominal=case.parameters.plant.inertia)
    model = build_model(parameters)
    flow = closed_loop(law, model, T, case.state)[0]
    sigma, rate = jax.jvp(
        lambda t, state: closed_loop(law, model, t, state)[1].computed["sigma"], (T, case.state), (1.0, flow)
    )
    command = control_law.motion_control(law, parameters, T, case.q, case.u, case.controller)
    Mr, _ = lagrangian.reduced_terms(ALL_ROWS, case.terms)
    L, _ = lagrangian.velocity_basis(ALL_ROWS, case.terms)
    D = L.T @ case.terms.B @ joined(disturbing(parameters.disturbance, T).torque)
    expected = -np.array(parameters.gains.K_sigma) * vector(sigma) + np.linalg.solve(Mr, command.U2 - D)
    assert_close(vector(rate), expected, 1e-13)


@pytest.mark.parametrize("law", LAWS, ids=lambda law: "-".join(law[1:4]))
def test_motion_control(case, law):
    command, expected = case.simulated_command(law), case.expected_command(law)
    assert_close(joined(command.force), expected.force, 5e-14)
    rates = command.rates((1.0, 2.0, 3.0, 4.0))
    assert_close(vector(command.signals["sigma"]), expected.sigma, 7e-15)
    assert_close(vector(rates.integral), expected.integral_rate, 3e-15)
    assert_close(vector(rates.eta), expected.eta_rate, 3e-15)
    assert_close(vector(rates.c_hat), expected.c_hat_rate, 6e-15)
    assert rates.force_integral == (1.0, 2.0, 3.0, 4.0)
    L, _ = lagrangian.velocity_basis(ALL_ROWS, case.terms)
    assert_close(L.T @ joined(command.force), expected.U1 + expected.U2, 6e-14)


def robust_force(sigma, Lambda, utilde_b, u26="printed", c_hat=0.0, f=1.0, robust_term="proof", t=T):
    """U2 of (19) with gains of one, and equal chat_k and f_k; with chat = 0 it is U26 alone."""
    return vector(
        adaptive.robust_force(
            Structure(u26=u26, robust_term=robust_term),
            Gains(),
            adaptive.Regressors(*(f,) * 5),
            tuple(sigma),
            (c_hat,) * 5,
            tuple(utilde_b),
            tuple(Lambda),
            t,
        )
    )


@pytest.mark.parametrize("scale", [1e-3, 1.0, 1e3])
def test_robust_term_of_the_proof_dominates_its_uncertainty(scale):
    """(34): c f |sigma| + sigma U2k <= delta_k, five times over."""
    sigma = scale * np.random.default_rng(0).normal(size=6)
    uncertainty = 5 * 0.7 * 2.0 * np.linalg.norm(sigma)
    left = uncertainty + sigma @ robust_force(sigma, np.zeros(4), np.zeros(4), c_hat=0.7, f=2.0)
    assert 0 < left <= 5 * adaptive.schedule(T)


@pytest.mark.parametrize("scale", [1e-3, 1.0, 1e3])
def test_corrected_u26_satisfies_39(scale):
    rng = np.random.default_rng(0)
    sigma, Lambda = scale * rng.normal(size=6), 50 * rng.normal(size=4)
    utilde_b = np.linalg.norm(sigma) * Lambda / np.linalg.norm(Lambda)  # the worst that |utilde_b| <= |sigma| allows
    assert utilde_b @ Lambda + sigma @ robust_force(sigma, Lambda, utilde_b, "corrected") <= adaptive.schedule(T)


def test_printed_u26_violates_39():
    Lambda = np.array([1e4, 0.0, 0.0, 0.0])
    size = np.sqrt(adaptive.schedule(T) / 1e4)
    sigma, utilde_b = size * np.eye(6)[0], size * np.eye(4)[0]
    left = utilde_b @ Lambda + sigma @ robust_force(sigma, Lambda, utilde_b, "printed")
    assert left == pytest.approx(np.sqrt(adaptive.schedule(T) * 1e4) / 2, rel=1e-6)
    assert left > 80 * adaptive.schedule(T)


def test_printed_robust_term_needs_an_estimate_of_one():
    """(19) as printed and as (34) needs it agree only where chat = 1."""
    sigma, none = np.arange(1.0, 7.0), np.zeros(4)
    proof, printed = (
        [robust_force(sigma, none, none, c_hat=c, f=2.0, robust_term=term)[0] for c in (0.5, 1.0)]
        for term in ("proof", "printed")
    )
    assert printed[1] == pytest.approx(proof[1], rel=1e-15)
    assert printed[0] == pytest.approx(printed[1] / 2, rel=1e-15)
    assert abs(printed[0] / proof[0] - 1) > 1e-3


def test_schedule_vanishes_and_is_held_up_by_its_floor():
    gains = Gains(delta_floor=0.01)
    assert adaptive.schedule(1.0) == 0.25
    assert float(adaptive.boundary_layer(gains, 1.0)) == 0.25
    assert float(adaptive.boundary_layer(gains, 20.0)) == 0.01
    assert float(adaptive.boundary_layer(Gains(), 20.0)) == 1 / 441


def test_force_error_closes_the_algebraic_loop():
    rng = np.random.default_rng(0)
    gains = random_gains(rng)
    free, desired, integral = (tuple(rng.uniform(-20, 20, 4).tolist()) for _ in range(3))
    feedback = force.pi_feedback(gains.K_lambda, gains.K_I, integral)
    error = force.ideal_force_error(feedback, free, desired)
    lambda_h = vector(force.force_command(feedback, desired, error))
    K_lambda, K_I = np.array(gains.K_lambda), np.array(gains.K_I)
    assert_close(lambda_h, np.array(desired) - K_lambda * vector(error) - K_I * np.array(integral), 1e-15)
    assert_close(vector(error) + np.array(desired), np.array(free) + lambda_h - np.array(desired), 1e-15)


@pytest.mark.parametrize("law", [LAWS[0], LAWS[1]], ids=["projected", "full"])
def test_commanded_torque_gives_the_force_it_was_computed_from(case, law):
    """The constraint forces under B (tau - d), by the oracle, are those that entered tau as feedback."""
    rates, signals = closed_loop(law, case.model, T, case.state)
    torque = joined(signals.torque)
    opposing = joined(disturbing(case.parameters.disturbance, T).torque)
    u_dot, lam = lagrangian.multiplier_solution(case.terms, case.terms.B @ (torque - opposing))
    assert_close(vector(signals.constraint_force), lam, 5e-14)
    assert_close(vector(rates.velocity), u_dot[control_law.INDEPENDENT], 5e-14)

    gains, desired = case.parameters.gains, np.array([12.0, 0.0, 0.0, 0.0])
    error = lam - desired
    lambda_h = desired - np.array(gains.K_lambda) * error - np.array(gains.K_I) * case.controller.force_integral
    expected = case.expected_command(law).force - case.terms.J.T @ lambda_h
    assert_close(case.terms.B @ torque, expected, 5e-14)
    assert_close(vector(signals.force_error), error, 5e-14)
    assert_close(vector(rates.controller.force_integral), error, 5e-14)
