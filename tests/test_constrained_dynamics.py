"""The coupled robots against the Lagrangian with multipliers, for every set of constraint rows that makes sense."""

import numpy as np
import pytest

from coopmm_jax.kinds.surfaces import Conic
from coopmm_jax.mechanics import constrained_dynamics, constraints, partitioning
from coopmm_jax.mechanics.constrained_kinematics import kinematics
from coopmm_jax.parameters import ALL_ROWS
from tests.oracles import lagrangian
from tests.samples import (
    ROW_SETS,
    SHAPES,
    admissible,
    assert_close,
    at_surface,
    joined,
    linear_map,
    model_of,
    pair,
    positions,
    random_pair,
    vector,
)


class Case:
    """The simulator and the Lagrangian at one random state with J u = 0."""

    def __init__(self, rows, seed, shape=None):
        self.rng = np.random.default_rng(seed)
        self.plant, self.q = at_surface(BENT[shape], seed) if shape else random_pair(self.rng)
        self.terms, self.u = admissible(rows, self.plant, self.q, self.rng)
        self.rows, self.n = rows, 10 - len(rows)
        self.L, self.L_dot_u1 = lagrangian.velocity_basis(rows, self.terms)
        independent = [i for i in range(10) if i not in lagrangian.dependent_joints(rows)]
        self.model = model_of(self.plant)
        u1 = tuple(self.u[independent].tolist())
        self.kinematics = kinematics(self.model, rows, positions(self.q), u1)
        self.reduction = self.kinematics.reduction

    def simulators_L(self):
        return linear_map(lambda u1: joined(partitioning.expand(self.reduction, u1)), self.n)

    def simulators_J(self):
        return linear_map(lambda lam: joined(partitioning.constraint_force(self.reduction, lam)), len(self.rows)).T


# The plane as a conic, which shares the others' programs.
BENT = SHAPES | {"plane": Conic()}
CASES = [(rows, seed) for rows in ROW_SETS for seed in range(2)] + [(ALL_ROWS, 0, shape) for shape in BENT]


@pytest.fixture(scope="module", params=CASES, ids=str)
def case(request):
    return Case(*request.param)


def test_constraint_rows(case):
    phi, J, _ = lagrangian.constraint_terms(case.plant, case.rows, case.q, case.u)
    np.testing.assert_allclose(vector(case.reduction.rows.phi), phi, rtol=0, atol=1e-14)
    assert_close(case.simulators_J(), J, 3e-15)


def test_convective_acceleration(case):
    k = case.kinematics
    both = constraints.convective(case.model.surface, case.model.geometry, case.rows, k.bodies, k.velocity, k.T_rate)
    assert_close(vector(both), case.terms.J_dot_u, 1e-14)


def test_velocity_map(case):
    assert_close(case.simulators_L(), case.L, 8e-15)
    assert_close(joined(case.kinematics.velocity), case.u, 1e-14)
    assert_close(joined(case.kinematics.L_rate), case.L_dot_u1, 2e-14)


def test_admissible_velocities_are_orthogonal_to_the_constraint_forces(case):
    assert np.abs(case.simulators_L().T @ case.simulators_J().T).max() < 1e-12


def test_restriction_is_the_transpose_of_the_velocity_map(case):
    transposed = linear_map(lambda force: vector(partitioning.restrict(case.reduction, pair(force))), 10)
    assert_close(transposed, case.simulators_L().T, 1e-15)


def test_reduced_inertia(case):
    terms = constrained_dynamics.both_dynamics(case.model.plant, case.kinematics)
    Mr = constrained_dynamics.reduced_inertia(case.kinematics, terms)
    assert_close(np.array(Mr.rows, dtype=float), lagrangian.reduced_terms(case.rows, case.terms)[0], 5e-15)


def test_accelerations_and_multipliers(case):
    force = case.rng.uniform(-20, 20, 10)
    u_dot, lam = lagrangian.multiplier_solution(case.terms, force)
    moved = constrained_dynamics.constrained_accelerations(case.model, case.kinematics, pair(force))
    independent = [i for i in range(10) if i not in lagrangian.dependent_joints(case.rows)]
    assert_close(vector(moved.independent), u_dot[independent], 8e-14)
    assert_close(joined(moved.full), u_dot, 8e-14)
    assert_close(vector(moved.multipliers), lam, 6e-14)


def test_multipliers_recover_what_the_constraints_exert(case):
    lam = tuple(case.rng.uniform(-20, 20, len(case.rows)).tolist())
    force = partitioning.constraint_force(case.reduction, lam)
    assert_close(vector(partitioning.multipliers(case.reduction, force)), lam, 2e-14)


def test_spread_is_the_least_force(case):
    F = case.rng.uniform(-20, 20, case.n)
    on_joints = partitioning.spread(case.reduction, tuple(F.tolist()))
    assert_close(vector(partitioning.restrict(case.reduction, on_joints)), F, 3e-15)
    assert_close(joined(on_joints), np.linalg.pinv(case.L.T) @ F, 4e-14)


def test_least_equivalent_force(case):
    force = case.rng.uniform(-20, 20, 10)
    least = joined(partitioning.least_equivalent(case.reduction, pair(force)))
    assert_close(least, case.L @ np.linalg.lstsq(case.L, force)[0], 2e-14)


def test_heights_that_are_held_drive_nothing(case):
    """Basis of the loop's speed: one drive for each robot in the full set, and no more than rows in any."""
    held = {"contact_height", "guide_height"}
    driving = [name for name in case.rows if not (name in held and held <= set(case.rows))]
    assert len(case.reduction.R.rows) == len([name for name in driving if name != "guide_height"])


def test_velocity_map_multiplied_out(case):
    L = np.vstack([np.array(each.rows, dtype=float) for each in partitioning.velocity_maps(case.reduction)])
    assert_close(L, case.L, 8e-15)
    assert float(partitioning.velocity_map_norm(case.reduction)) == pytest.approx(np.linalg.norm(case.L), rel=2e-15)


def test_dependent_joints_take_up_a_residual(case):
    residual = case.rng.uniform(-1, 1, len(case.rows))
    change = joined(partitioning.dependent_solution(case.reduction, tuple(residual.tolist())))
    dependent = lagrangian.dependent_joints(case.rows)
    assert_close(case.terms.J @ change, -residual, 1e-14)
    assert set(np.flatnonzero(change)) <= set(dependent)


def test_determinants_are_those_of_the_dependent_blocks(case):
    contacts = case.reduction.rows.contacts
    dependent = lagrangian.dependent_joints(case.rows)
    J = case.terms.J
    blocks = [J[:contacts][:, dependent[:contacts]], J[contacts:][:, dependent[contacts:]]]
    assert_close(vector(case.reduction.determinants), [np.linalg.det(b) for b in blocks if b.size], 4e-15)


def test_object_motion_moves_robot_ones_dependent_joints():
    """L is not block diagonal, unlike below (10): model.md section 2."""
    L = Case(ROW_SETS[0], 0).simulators_L()
    assert np.abs(L[3:5, 3:]).min() > 1e-3
    assert np.all(L[5:, :3] == 0)
