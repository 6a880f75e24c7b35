"""Contact that can open: its force, the plant against the Lagrangian, and general.md E3's figures."""

from types import SimpleNamespace
from unittest import mock

import jax
import numpy as np
import pytest

from coopmm_jax.kinds.disturbances import Disturbance, Sine
from coopmm_jax.loop import start
from coopmm_jax.loop.rollout import Plan, rollout
from coopmm_jax.mechanics import plant, robot_kinematics
from coopmm_jax.mechanics.compliant_contact import contact_force, pressed_in
from coopmm_jax.mechanics.model import build_model
from coopmm_jax.parameters import Features, Gains, Hardware, Parameters, Structure
from coopmm_jax.status import Status
from tests import surface_results
from tests.oracles import hardware, lagrangian
from tests.samples import ROW_SETS, SHAPES, assert_close, at_surface, joined, positions, vector

SOFT = Hardware(penetration=1e-3, contact_damping=2.0)
NOW = 0.7  # [s]
PAPER = Parameters(gains=Gains(delta_floor=0.1))
COMPLIANT = Structure(feedforward="full", contact="compliant")


def test_force_is_that_of_hunt_and_crossley():
    k = 15.0 / 1e-3**1.5
    for gap, rate in ((-4e-4, 0.0), (-1e-3, 0.2), (-2e-3, -0.3)):
        expected = k * (-gap) ** 1.5 * (1.0 - 2.0 * rate)
        assert float(contact_force(SOFT, gap, rate)) == pytest.approx(expected, rel=1e-14)


def test_force_never_pulls_and_has_a_gradient_where_the_tip_lands():
    assert float(contact_force(SOFT, -1e-3, 0.6)) == 0.0  # the surface cannot follow so fast
    assert float(contact_force(SOFT, 1e-6, -1.0)) == 0.0
    for gap in (0.0, 1e-9, -1e-12):
        assert np.isfinite(jax.grad(contact_force, argnums=(0, 1, 2))(SOFT, gap, -0.1)[1])
    assert abs(float(jax.grad(contact_force, argnums=1)(SOFT, -1e-300, 0.0))) < 1e-100


def test_depth_is_the_inverse_of_the_force():
    for force in (0.1, 15.0, 90.0):
        assert float(contact_force(SOFT, -pressed_in(SOFT, force), 0.0)) == pytest.approx(force, rel=1e-13)
    assert float(pressed_in(SOFT, -3.0)) == 0.0


class Case:
    """Simulator's answer at a random state, with the tip pressed into a surface that moves and rubs."""

    def __init__(self, rows, shape, seed):
        rng = np.random.default_rng(seed)
        pair, self.q = at_surface(SHAPES[shape] if shape else None, seed)
        real = SOFT._replace(tip_friction=0.4, slip_speed=0.3, surface_amplitude=5e-4, surface_frequency=3.0)
        self.parameters = Parameters(plant=pair, disturbance=(Disturbance(Sine(phase=0.3), scale=2.0),), hardware=real)
        features = Features(tip_friction=True, surface_motion=True)
        self.structure = Structure(rows=rows, features=features, contact="compliant")
        self.q[0, 5] -= rng.uniform(2e-3, 3e-3)  # into the surface
        model = build_model(self.parameters)
        independent = tuple(rng.uniform(-0.3, 0.3, 10 - len(self.structure.plant_rows)).tolist())
        k = plant.plant_kinematics(self.structure, model, NOW, positions(self.q), independent)
        self.u, self.touch = joined(k.velocity), k.touch
        self.torque = rng.uniform(-20, 20, (2, 5))
        pairs = zip(pair.geometry, positions(self.q), self.torque, strict=True)
        force = tuple(robot_kinematics.actuator_force(g, p, tuple(torque.tolist())) for g, p, torque in pairs)
        moved = plant.respond(self.structure, model, NOW, k, force)
        self.independent, self.u_dot = vector(moved.independent), joined(moved.full)
        self.lam = vector(moved.multipliers)
        self.plant = hardware.plant_now(pair, real, NOW)


CASES = [(rows, None, seed) for seed, rows in enumerate(ROW_SETS)] + [(ROW_SETS[0], "hollow ellipse", 9)]


@pytest.fixture(scope="module", params=CASES, ids=str)
def case(request):
    return Case(*request.param)


def test_gap_and_its_rate_are_those_of_the_normal_row(case):
    rows, parameters = case.structure.rows, case.parameters
    phi, J, _ = lagrangian.constraint_terms(case.plant, rows, case.q, case.u)
    rate = J[0] @ case.u + float(hardware.surface_rates(case.plant, parameters.hardware, NOW, case.q)[0])
    if case.plant.surface.shape is None:  # of the arc's row the oracle leaves the motion out
        Rc, now = 0.7, 0.7 + float(hardware.surface_shift(parameters.hardware, NOW))
        phi[0] += (now**2 - Rc**2) / (2 * Rc)
    assert float(case.touch.gap) == pytest.approx(phi[0], rel=1e-9)
    assert float(case.touch.gap) < 0.0
    k = 15.0 / SOFT.penetration**1.5
    assert case.lam[0] == pytest.approx(k * (-phi[0]) ** 1.5 * max(0.0, 1.0 - SOFT.contact_damping * rate), rel=1e-8)


def test_acceleration_solves_the_dynamics_under_the_contact_force(case):
    rows = case.structure.rows
    terms = lagrangian.coupled_terms(case.plant, rows, case.q, case.u)
    parameters = case.parameters._replace(plant=case.plant)
    driving = np.asarray(hardware.driving_force(parameters, NOW, case.q, case.u, case.torque, case.lam[0]))
    assert_close(terms.M @ case.u_dot, driving - terms.h + terms.J.T @ case.lam, 1e-9)
    np.testing.assert_allclose((terms.J @ case.u_dot + terms.J_dot_u)[1:], 0.0, atol=1e-10)
    dependent = [4] * ("contact_height" in rows) + [8, 9] * ("guide_radial" in rows)
    assert_close(case.independent, case.u_dot[[i for i in range(10) if i not in dependent]], 1e-14)


def test_energy_goes_into_the_surface_and_is_lost_there(case):
    """Robots, and 2/5 k d^2.5 of the surface; what is missing is k d^1.5 phidot (1 - max(0, 1 - c phidot)) >= 0."""
    parameters = case.parameters._replace(plant=case.plant)
    rate = hardware.energy_rate(case.plant, case.q, case.u, case.u_dot)
    power = float(hardware.power(parameters, NOW, case.q, case.u, case.torque, case.lam[0]))
    J = lagrangian.constraint_terms(case.plant, case.structure.rows, case.q, case.u)[1]
    widens = J[0] @ case.u + float(hardware.surface_rates(case.plant, parameters.hardware, NOW, case.q)[0])
    elastic = 15.0 * (-float(case.touch.gap) / SOFT.penetration) ** 1.5
    stored, lost = -elastic * widens, elastic * widens * (1.0 - max(0.0, 1.0 - SOFT.contact_damping * widens))
    assert float(rate) + stored + lost == pytest.approx(power, rel=1e-9)
    assert lost >= 0.0


STEPS = 10_000


@jax.jit
def rollout_from(share, parameters, step, steps):
    """From a start that is pressed in by a ``share`` of what holds the desired force: one program for all starts."""
    pressed = start._pressed_in
    with mock.patch.object(start, "_pressed_in", lambda *given: tuple(share * depth for depth in pressed(*given))):
        return rollout(COMPLIANT, parameters, step, steps, Plan.batch(STEPS), record=True).record


def compliant(parameters, step=1e-3, steps=STEPS, share=1.0):
    """Times and signals (steps + 1,)."""
    record = jax.device_get(rollout_from(share, parameters, step, steps))
    return SimpleNamespace(**dict(zip(("t", "signals"), jax.tree.map(lambda x: x[: steps + 1], record), strict=True)))


@pytest.fixture(scope="module")
def run():
    return compliant(PAPER, 5e-4, 2000)


def test_figures_of_the_study_with_a_contact_that_can_open(run):
    """general.md E3; its third digit of the guide's force depends on how the start is pressed in."""
    lam = [float(x[-1]) for x in run.signals.constraint_force]
    np.testing.assert_allclose(lam, [12.8874, 0.5586, -12.5917, 3.7373], rtol=0, atol=2e-4)
    position = [float(x[-1]) for x in run.signals.position[0][:4]]
    np.testing.assert_allclose(position, [0.993068, 2.405048, -0.023436, 1.232574], rtol=0, atol=2e-6)
    assert np.sum(run.signals.constraint_residual[0] > 0.0) * 5e-4 == pytest.approx(0.0625, abs=1e-9)
    assert run.signals.constraint_force[0].min() == 0.0


def test_a_finer_step_gives_the_same(run):
    finer = compliant(PAPER, 2.5e-4, 4000)
    for coarse, fine in zip(run.signals.constraint_force, finer.signals.constraint_force, strict=True):
        assert coarse[-1] == pytest.approx(fine[-1], abs=1e-4)


@pytest.fixture(scope="module")
def slopes():
    return {name: np.array(values) for name, values in surface_results.results().items()}


def test_an_undamped_surface_keeps_the_tip_bouncing():
    """From a start that is pressed in: off the surface 4 % of 10 s, peaks of 49 N."""
    elastic = PAPER._replace(hardware=Hardware(penetration=1e-3, contact_damping=0.0))
    run = compliant(elastic)
    gap, force = run.signals.constraint_residual[0], run.signals.constraint_force[0]
    assert np.mean(gap > 0.0) == pytest.approx(0.041, abs=0.002)
    assert force.max() == pytest.approx(49.1, abs=0.5)
    assert np.sum((gap[:-1] > 0.0) & (gap[1:] <= 0.0) & (run.t[1:] > 5.0)) > 10  # landings
    damped = compliant(elastic._replace(hardware=Hardware(penetration=1e-3, contact_damping=2.0)))
    assert np.all(damped.signals.constraint_residual[0][500:] < 0.0)


def test_a_tip_that_touches_without_pressing_bounces_higher():
    """general.md E2, whose start this is: off the surface 7 % of 5 s, peaks of 57 N.

    The first one is nearly that of a mass which a constant force F pushes onto the spring k d^1.5 from rest: where it
    turns back, F d = (2/5) k d^2.5, so that the spring pushes with 5/2 F, whatever mass and stiffness are. The rest is
    the motion controller, which lets the tip give way.
    """
    elastic = PAPER._replace(hardware=Hardware(penetration=1e-3, contact_damping=0.0))
    signals = compliant(elastic, steps=5000, share=0.0).signals
    gap, force = signals.constraint_residual[0], signals.constraint_force[0]
    assert np.mean(gap > 0.0) == pytest.approx(0.069, abs=0.002)
    assert force.max() == pytest.approx(56.6, abs=0.3)
    first = force[: 1 + np.argmax(np.diff(force) < 0.0)].max()
    assert first == pytest.approx(2.5 * 15.0, rel=0.05)


def test_the_papers_own_law_loses_the_contact_for_good(short_programs):
    """general.md E3: lost at 6 ms, gap 10 mm at 0.030 s and 100 mm at 0.063 s, the arm singular at 0.12 s."""
    run = short_programs(Structure(contact="compliant"))(Parameters(), steps=200)
    gap = run.signals.constraint_residual[0][: int(run.health.step)]
    first = [run.t[np.argmax(gap > limit)] for limit in (0.0, 0.01, 0.1)]
    np.testing.assert_allclose(first, [0.006, 0.030, 0.063], rtol=0, atol=1e-9)
    assert np.all(gap[7:] > 0.0)
    assert Status(int(run.health.status)) is Status.SINGULAR_CONTACT
    assert run.health.step == 120


@pytest.mark.parametrize(("part", "tolerance"), [("pressed", 2e-5), ("landed", 5e-6)])
def test_gradients_by_surface_and_contact(slopes, part, tolerance):
    """Forward mode against central differences, which lose digits to the smallest slopes and across the landing."""
    np.testing.assert_allclose(slopes[part], slopes[f"{part}_central"], rtol=tolerance)
    assert np.all(slopes[part] != 0.0)
