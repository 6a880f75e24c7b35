"""Guides: every row's J, dphi/dt and Jdot u against derivatives of its phi, at a state of the robots moving anyhow."""

import jax
import numpy as np
import pytest

from coopmm_jax.kinds.courses import Sine
from coopmm_jax.kinds.timings import Rate
from coopmm_jax.loop.closed_loop import closed_loop
from coopmm_jax.loop.start import initial_state
from coopmm_jax.mechanics.coordinates import Position
from coopmm_jax.mechanics.guide import carriage_step
from coopmm_jax.mechanics.model import build_model
from coopmm_jax.mechanics.partitioning import dependent_solution
from coopmm_jax.mechanics.plant import carriage_rate, plant_kinematics
from coopmm_jax.mechanics.robot_kinematics import arm_moved, chained, position_rates
from coopmm_jax.parameters import ALL_ROWS, Gains, MovingRail, Rail, Structure, Surface
from tests.beside_a_path import EIGHT, eight

T = 0.3
HEIGHT = Surface(guide_height=Sine(1.0, 0.05, 1.7, 0.3))
CASES = {
    "rail and height": (Rail(EIGHT, 0.5), HEIGHT),
    "moving": (MovingRail(EIGHT, Rate(0.7, 0.4, 0.2, 2.0, 0.1)), Surface()),
    "circle and height": (None, HEIGHT._replace(guide_radius=1.9)),
}


@pytest.fixture(scope="module", params=CASES)
def case(request):
    return Case(*CASES[request.param])


class Case:
    """The constrained motion at time T and a random u^1, from a state that meets the constraints."""

    def __init__(self, guide, surface):
        parameters = eight()
        self.structure = Structure()
        plant = parameters.plant._replace(guide=guide, surface=surface)
        self.model = build_model(parameters._replace(plant=plant))
        self.independent = tuple(np.random.default_rng(0).uniform(-1.0, 1.0, 6).tolist())
        self.position = tuple(chained(pose._replace(y=pose.y + 0.05)) for pose in parameters.start)
        self.carriage = (0.5,) if isinstance(guide, Rail) else ()
        for _ in range(8):
            k = self.kinematics(T, self.position, self.carriage)
            change = dependent_solution(k.reduction, k.reduction.rows.phi)
            self.position = tuple(map(arm_moved, self.position, change))
            self.carriage = tuple(s + carriage_step(k.bodies.guide) for s in self.carriage)
        self.k = self.kinematics(T, self.position, self.carriage)

    def kinematics(self, t, position, carriage):
        return plant_kinematics(self.structure, self.model, t, position, self.independent, carriage)

    def phi(self, t, position, carriage):
        return self.kinematics(t, position, carriage).reduction.rows.phi


def test_a_rail_that_no_row_asks_for_has_no_carriage():
    gains = Gains(K_sigma=(0.5,) * 9, K_lambda=(0.3,), K_I=(1.5,))
    parameters, structure = eight()._replace(gains=gains), Structure(rows=("contact_normal",), feedforward="full")
    model = build_model(parameters)
    start, *_ = jax.eval_shape(lambda: initial_state(structure, model, parameters))
    rates, signals = jax.eval_shape(lambda state: closed_loop(structure, model, T, state), start)
    assert start.carriage == rates.carriage == signals.carriage == ()
    assert len(rates.velocity) == 9


def test_jacobian(case):
    """Each column of J is the derivative of phi along one velocity."""

    @jax.jit
    @jax.vmap
    def along(u):
        rates = tuple(position_rates(p, tuple(own)) for p, own in zip(case.position, u, strict=True))
        return jax.jvp(lambda position: case.phi(T, position, case.carriage), (case.position,), (rates,))[1]

    columns = np.array(along(np.eye(10).reshape(10, 2, 5)))
    J = np.hstack([np.array(J.rows, float) for J in case.k.reduction.rows.J])
    np.testing.assert_allclose(columns, J, rtol=0, atol=2e-15)


def test_rows_stay_met_to_second_order(case):
    """With u of (10) and udot = Ldot u^1 neither dphi/dt nor d2phi/dt2 is left, the guide's own motion included."""
    k = case.k
    rates = tuple(map(position_rates, case.position, k.velocity))
    velocity, change = jax.tree.map(float, (k.velocity, k.L_rate))
    second = jax.jvp(lambda p, u: tuple(map(position_rates, p, u)), (case.position, velocity), (rates, change))[1]
    carriage = carriage_rate(case.structure, case.model, k)

    def phi(delay):
        position = tuple(
            Position(*(x + delay * (v + 0.5 * delay * a) for x, v, a in zip(*three, strict=True)))
            for three in zip(case.position, rates, second, strict=True)
        )
        along = tuple(s + delay * rate for s, rate in zip(case.carriage, carriage, strict=True))
        return case.phi(T + delay, position, along)

    first, then = jax.jvp(lambda d: jax.jvp(phi, (d,), (1.0,))[1], (0.0,), (1.0,))
    assert np.abs(np.array(case.k.reduction.rows.phi)).max() < 1e-14
    assert np.abs(np.array(first)).max() < 1e-14
    assert np.abs(np.array(then)).max() < 1e-13
    assert len(first) == len(ALL_ROWS)
