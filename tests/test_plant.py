"""The robots under given torques, with friction and a moving surface, against the Lagrangian, for all sets of rows."""

from functools import partial

import numpy as np
import pytest

from coopmm_jax.kinds.disturbances import Disturbance, Sine, Step
from coopmm_jax.kinds.surfaces import Conic
from coopmm_jax.mechanics import plant, robot_kinematics
from coopmm_jax.mechanics.constraints import sliding_rows
from coopmm_jax.mechanics.contact_surface import surface_motion
from coopmm_jax.mechanics.model import build_model
from coopmm_jax.parameters import ALL_ROWS, Features, Hardware, Parameters, Structure
from tests.oracles import hardware, lagrangian
from tests.samples import (
    ROW_SETS,
    SHAPES,
    assert_close,
    at_surface,
    joined,
    on_rows,
    positions,
    random_pair,
    vector,
)

REAL = Hardware(
    wheel_viscous=0.3,
    joint_viscous=0.2,
    wheel_coulomb=0.7,
    joint_coulomb=0.4,
    friction_speed=0.5,
    tip_friction=0.4,
    slip_speed=0.3,
    surface_amplitude=0.05,
    surface_frequency=3.0,
    surface_phase=0.4,
)
NOW = 0.7  # [s]


# On both robots alike, on each wheel and joint by itself, and on the object.
DISTURBANCES = (
    Disturbance(Sine(phase=0.3), scale=2.0),
    Disturbance(
        Step(0.1), 3.0, wheel=(0.4, -0.7), joint=0.2, left_wheel=(1.0, 2.0), joint_3=0.9, force=(3.0, -4.0, 5.0)
    ),
)


class Case:
    """Simulator's answer at a random state, time and torque, with all that the plant can have switched on."""

    def __init__(self, rows, seed, shape=None):
        rng = np.random.default_rng(seed)
        pair, self.q = at_surface(BENT[shape], seed) if shape else random_pair(rng)
        if shape:
            self.q = on_rows(pair, self.q, surface_motion(REAL, NOW))
        self.parameters = Parameters(plant=pair, nominal=pair.inertia, disturbance=DISTURBANCES, hardware=REAL)
        self.structure = Structure(rows=rows, features=Features(friction=True, tip_friction=True, surface_motion=True))
        self.model = build_model(self.parameters)
        self.plant = hardware.plant_now(pair, REAL, NOW)
        independent = tuple(rng.uniform(-1, 1, 10 - len(rows)).tolist())
        self.kinematics = plant.plant_kinematics(self.structure, self.model, NOW, positions(self.q), independent)
        self.u = joined(self.kinematics.velocity)
        self.torque = rng.uniform(-20, 20, (2, 5))
        force = (
            robot_kinematics.actuator_force(g, p, tuple(torque.tolist()))
            for g, p, torque in zip(pair.geometry, positions(self.q), self.torque, strict=True)
        )
        self.moved = plant.respond(self.structure, self.model, NOW, self.kinematics, tuple(force))
        self.lam = vector(self.moved.multipliers)


# The plane as a conic, which shares the ellipse's programs; test_constrained_dynamics.py has surfaces of other kinds.
BENT = {"plane": Conic(), "hollow ellipse": SHAPES["hollow ellipse"]}
CASES = [(rows, seed) for rows in ROW_SETS for seed in range(2)]
CASES += [(ALL_ROWS, 0, shape) for shape in BENT]


@pytest.fixture(scope="module", params=CASES, ids=str)
def case(request):
    return Case(*request.param)


def test_velocity_follows_the_moving_surface(case):
    rows = case.structure.rows
    _, J, _ = lagrangian.constraint_terms(case.plant, rows, case.q, case.u)
    expected = np.zeros(len(rows))
    expected[0] = -hardware.surface_rates(case.plant, REAL, NOW, case.q)[0]
    np.testing.assert_allclose(J @ case.u, expected, rtol=0, atol=1e-13)


def test_acceleration_and_multipliers_solve_the_constrained_dynamics(case):
    rows, u_dot = case.structure.rows, joined(case.moved.full)
    parameters = case.parameters._replace(plant=case.plant)
    terms = lagrangian.coupled_terms(case.plant, rows, case.q, case.u)
    driving = np.asarray(hardware.driving_force(parameters, NOW, case.q, case.u, case.torque, case.lam[0]))
    assert_close(terms.M @ u_dot, driving - terms.h + terms.J.T @ case.lam, 1e-12)
    surface = np.zeros(len(rows))
    surface[0] = hardware.surface_acceleration(case.plant, REAL, NOW, case.q, case.u)
    assert_close(terms.J @ u_dot + terms.J_dot_u, -surface, 1e-12)
    independent = [i for i in range(10) if i not in lagrangian.dependent_joints(rows)]
    assert_close(vector(case.moved.independent), u_dot[independent], 1e-14)


def test_power_balance(case):
    """Constraint forces do no work, but for lambda_n on the moving surface; friction takes energy out."""
    rate = hardware.energy_rate(case.plant, case.q, case.u, joined(case.moved.full))
    power = partial(hardware.power, t=NOW, q=case.q, u=case.u, torque=case.torque, normal=case.lam[0])
    parameters = case.parameters._replace(plant=case.plant)
    assert float(rate) == pytest.approx(float(power(parameters)), rel=1e-11)
    smooth = Hardware(surface_amplitude=0.05, surface_frequency=3.0, surface_phase=0.4)
    assert float(rate) < float(power(parameters._replace(hardware=smooth)))


def test_sliding_rows(case):
    rows = joined(sliding_rows(case.kinematics.bodies))
    speed, gradient = hardware.sliding_row(case.plant, case.q, case.u)
    assert_close(rows, np.asarray(gradient), 1e-14)
    assert rows @ case.u == pytest.approx(float(speed), rel=1e-12)
