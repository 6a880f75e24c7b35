"""The coupled robots' dynamics (11): accelerations, multipliers, reduced inertia.

Robot II with its guide is one chain and robot I, whose drives towards the contact are left free, another; each has an
inertia matrix of its own, and what ties them is one force for each of these drives. That takes three quarters of the
operations of forming the reduced inertia (6 x 6) and solving with it.
"""

from __future__ import annotations

from typing import NamedTuple

import jax.numpy as jnp

from coopmm_jax.algebra.matrix import Matrix, cholesky_solve, congruence, identity, minus, plus, scaled, sub
from coopmm_jax.algebra.types import Pair, Vector
from coopmm_jax.mechanics import partitioning, robot_dynamics
from coopmm_jax.mechanics.constrained_kinematics import Kinematics
from coopmm_jax.mechanics.model import Model
from coopmm_jax.mechanics.robot import per_robot
from coopmm_jax.mechanics.robot_dynamics import AnyLumped, Dynamics, inertial_force, inverse_dynamics


class Accelerations(NamedTuple):
    """Solution of the constrained dynamics at one instant."""

    independent: Vector  # du^1/dt (n,)
    full: Pair[Vector]  # udot of each robot (5,)
    multipliers: Vector  # lambda (m,) [N]


def both_dynamics(lumped: Pair[AnyLumped], k: Kinematics) -> Pair[Dynamics]:
    """Inertia and bias of both robots, for the plant's or the controller's lumped parameters."""
    return per_robot(robot_dynamics.dynamics, lumped, k.factors, k.bodies.T, k.T_rate, k.front)


def required_force(dynamics: Pair[Dynamics], acceleration: Pair[Vector]) -> Pair[Vector]:
    """M udot + C u + G of each robot (5,)."""
    return per_robot(inverse_dynamics, dynamics, acceleration)


def reduced_inertia(k: Kinematics, dynamics: Pair[Dynamics]) -> Matrix:
    """Mr = L^T M L (n x n) of (11), as (T L)^T M (T L) with M in body rates, where it is sparsest."""
    maps = partitioning.velocity_maps(k.reduction)
    first, second = per_robot(lambda L, d: congruence(d.T @ L, d.inertia), maps, dynamics)
    return first + second


def constrained_accelerations(
    model: Model,
    k: Kinematics,
    force: Pair[Vector],
    friction: Pair[Vector] | None = None,
) -> Accelerations:
    """(11) under a generalised force (B tau - d of each robot, constraint forces left out), and lambda of (9).

    Args:
        model: lumped parameters.
        k: kinematics of the plant.
        force: on each robot (5,).
        friction: further force of each robot (5,) for each newton of |lambda_n|: Coulomb friction of the contact.
    """
    dynamics = both_dynamics(model.plant, k)
    at_rest = per_robot(minus, force, required_force(dynamics, k.L_rate))
    pushes = (at_rest,) if friction is None else (at_rest, friction)
    moved = _moved_from_rest(k.reduction, dynamics, pushes)
    lam = tuple(
        partitioning.multipliers(k.reduction, _left(dynamics, m, p)) for m, p in zip(moved, pushes, strict=True)
    )
    full, forces = moved[0], lam[0]
    if friction is not None:
        # lambda = free + |lambda_n| per_newton is piecewise linear in lambda_n, whose sign is that of its free value.
        free, per_newton = lam
        load = jnp.abs(free[0]) / (1.0 - jnp.sign(free[0]) * per_newton[0])
        full = per_robot(lambda a, b: plus(a, scaled(load, b)), *moved)
        forces = plus(free, scaled(load, per_newton))
    independent, _ = partitioning.parted(k.reduction.part, full)
    return Accelerations(independent, per_robot(plus, full, k.L_rate), forces)


def _left(dynamics: Pair[Dynamics], acceleration: Pair[Vector], push: Pair[Vector]) -> Pair[Vector]:
    """M udot less the push: what the constraints have to exert."""
    return per_robot(lambda d, a, p: minus(inertial_force(d, a), p), dynamics, acceleration, push)


class _Chain(NamedTuple):
    """One robot with the contact opened, in coordinates v of its own."""

    joints: Matrix  # from v (5 x v)
    gap: Matrix  # its share of what has to vanish to close the contact (drives x v)


def _opened(reduction: partitioning.Reduction) -> Pair[_Chain]:
    """Robot I by its independent joints and minus its drives, robot II by its independent joints."""
    part, (N1, N2) = reduction.part, reduction.N
    n1, n2 = map(len, part.independent)
    R1, R2 = partitioning.of_each_robot(reduction, reduction.R.rows)
    driven = tuple((*(0,) * n1, *(sub(0, x) for x in row)) for row in N1.rows)
    guided = (N2 @ Matrix([row[n1:] for row in R2])).rows
    free = (*identity(n1 + len(R1)).rows[:n1], *identity(n2).rows)
    first, second = partitioning.joined(part, free, (driven, guided))
    return (
        _Chain(Matrix(first), Matrix([row[:n1] for row in R1]).beside(identity(len(R1)))),
        _Chain(Matrix(second), Matrix([row[n1:] for row in R1])),
    )


def _moved_from_rest(
    reduction: partitioning.Reduction, dynamics: Pair[Dynamics], pushes: tuple[Pair[Vector], ...]
) -> list[Pair[Vector]]:
    """L u1dot of each robot (5,) for each push on its joints: both chains alone, then what closes the contact."""
    chains = _opened(reduction)
    drives = len(chains[0].gap.rows)
    closing, free = [], []  # accelerations of both chains: per unit force at each drive, under each push
    for i, (chain, d) in enumerate(zip(chains, dynamics, strict=True)):
        inertia = congruence(d.T @ chain.joints, d.inertia)
        solved = cholesky_solve(inertia, *chain.gap.rows, *(chain.joints.T @ push[i] for push in pushes))
        closing.append(Matrix(solved[:drives]).T)
        free.append(solved[drives:])
    if not drives:  # nothing ties the chains: the contact is compliant, and no groove levels the tips
        return [per_robot(lambda c, v, i=i: c.joints @ v[i], chains, free) for i in range(len(pushes))]
    first, second = (chain.gap @ each for chain, each in zip(chains, closing, strict=True))
    gaps = (plus(*(chain.gap @ v for chain, v in zip(chains, both, strict=True))) for both in zip(*free, strict=True))
    forces = cholesky_solve(first + second, *gaps)
    return [
        per_robot(lambda c, v, each, i=i, force=force: c.joints @ minus(v[i], each @ force), chains, free, closing)
        for i, force in enumerate(forces)
    ]
