"""Stability along a motion: the Lyapunov function (31), the bound (40), and Properties 2.1 and 2.2.

(40) follows from (32) and from the steps (34)-(37) and (39), and those from Assumption 3.2 and Property 2.2. All of
them speak about one instant, so each is evaluated at every sample: by how much its left side exceeds its right.

What the paper leaves open is chosen as follows. Matrix norms are spectral, vector norms Euclidean; Cr is the one
matrix that is linear in the velocities and symmetric as a bilinear map. The bounds c_k of Assumption 3.2 are the least
that hold along the given motion; as Cr vanishes at rest, c_2 = 0 and c_3 = sup |Cr - Cr0| / |zetadot|. d_L is the
disturbance d of both robots in u, because (37) needs |L^T d| <= |L| c_5.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import jax
import numpy as np

from coopmm_jax.control.robust_adaptive import ControllerState
from coopmm_jax.errors import UserError
from coopmm_jax.loop.state import State
from coopmm_jax.mechanics import partitioning
from coopmm_jax.mechanics.coordinates import Position, at_place
from coopmm_jax.mechanics.model import build_model
from coopmm_jax.mechanics.robot import CHAINED, PLATFORM, ROBOTS, per_robot
from coopmm_jax.mechanics.robot_kinematics import in_platform, unplaced
from coopmm_jax.parameters import Parameters, Structure
from coopmm_jax.proof.steps import STEPS, bounds_at, check_controller, check_loop, sides, uncertainty_of
from coopmm_jax.proof.terms import proof_terms


class Analysis(NamedTuple):
    """(31)-(40) at T samples of a motion; numpy arrays."""

    t: np.ndarray  # (T,) [s]
    V1: np.ndarray  # (T,)
    V2: np.ndarray  # (T,)
    V_rate: np.ndarray  # (T,) derivative of V = V1 + V2 along the flow, exact [1/s]
    bound: np.ndarray  # (T,) right side of (40) [1/s]
    excess: dict[str, np.ndarray]  # of STEPS, (T,) each: left minus right side; together V_rate - bound
    c: np.ndarray  # (5,) bounds of Assumption 3.2
    eigenvalues: np.ndarray  # (T, n) of Mr, ascending
    norms: dict[str, np.ndarray]  # |Mr|, |Cr|, |Gr|, (T,) each

    @property
    def V(self) -> np.ndarray:
        """(31), (T,)."""
        return self.V1 + self.V2


def analyse(trajectory: Any, every: int = 1) -> Analysis:
    """(31)-(40) and Properties 2.1, 2.2 along a simulated motion.

    Args:
        trajectory: what ``simulate`` returns.
        every: use one sample in so many.

    Raises:
        UserError: another controller than the paper's, no sample,
            ``every`` below 1, an adaptation rate gamma of zero (V2 of (31) divides by it), sampled
            control or devices that are not ideal (the proof has neither).

    >>> import coopmm_jax as cm
    >>> trajectory = cm.simulate(cm.load_scenario("paper", simulation={"duration": 0.01}))
    >>> analyse(trajectory).c[:4].tolist()  # the paper's controller knows the plant
    [0.0, 0.0, 0.0, 0.0]
    """
    if every < 1:
        raise UserError("every", "1 or more", every)
    structure, parameters = trajectory.scenario.structure(), trajectory.scenario.parameters()
    return analyse_states(structure, parameters, *states_of(trajectory, every))


def analyse_states(structure: Structure, parameters: Parameters, t: np.ndarray, states: State) -> Analysis:
    """``analyse`` for any states: as (40) is about one instant, they need not follow from one another.

    Args:
        structure: static choices.
        parameters: of the rollout.
        t: (T,) [s].
        states: a ``State`` with leaves (T,).

    Raises:
        UserError: as ``analyse``.
    """
    gains = parameters.gains
    check_loop(structure, parameters)
    if len(t) == 0:
        raise UserError("trajectory", "at least one sample long", "empty")
    terms = proof_terms(structure, parameters, t, states)
    uncertainty = uncertainty_of(terms)
    c = bounds_at(np, terms, uncertainty, _spectral).max(axis=1)
    gamma, estimate_error = np.array(gains.gamma), terms.c_hat - c
    left, right = sides(np, gains, terms, uncertainty, c, _solve)
    V2_rate = _dot(terms.sigma, terms.sigma_rate) + _dot(estimate_error / gamma, terms.c_hat_rate)
    return Analysis(
        t=np.asarray(t),
        V1=terms.V1,
        V2=0.5 * _dot(terms.sigma, terms.sigma) + 0.5 * _dot(estimate_error / gamma, estimate_error),
        V_rate=terms.V1_rate + V2_rate,
        bound=sum(right.values()) - terms.decay - _dot(np.array(gains.K_sigma) * terms.sigma, terms.sigma),
        excess={step: left[step] - right[step] for step in STEPS},
        c=c,
        eigenvalues=np.linalg.eigvalsh(terms.plant.M),
        norms={
            "M": _spectral(terms.plant.M),
            "C": _spectral(terms.plant.C),
            "G": np.linalg.norm(terms.plant.G, axis=1),
        },
    )


def report(analysis: Analysis) -> dict[str, Any]:
    """The figures of an analysis worth keeping, as JSON has them.

    V at the start, at its largest and at the end; the largest excess of (40)'s left side and of every step towards it,
    and when [s]; c_k; the eigenvalue range of Mr; the largest norms.
    """
    return {
        "V_start": float(analysis.V[0]),
        "V_max": float(analysis.V.max()),
        "V_end": float(analysis.V[-1]),
        "share_V_rises": float(np.mean(analysis.V_rate > 0)),
        "bound_40": _largest(analysis.t, analysis.V_rate - analysis.bound),
        "steps": {step: _largest(analysis.t, excess) for step, excess in analysis.excess.items()},
        "c": analysis.c.tolist(),
        "inertia_eigenvalues": [float(analysis.eigenvalues.min()), float(analysis.eigenvalues.max())],
        "largest_norms": {name: float(values.max()) for name, values in analysis.norms.items()},
    }


def _largest(t: np.ndarray, excess: np.ndarray) -> dict[str, float]:
    """The largest excess (a negative one is a margin), when, and the share of the samples that exceed."""
    worst = int(np.argmax(excess))
    return {"excess": float(excess[worst]), "t": float(t[worst]), "share": float(np.mean(excess > 0))}


def _dot(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return np.einsum("ti,ti->t", a, b)


def _solve(matrices: np.ndarray, right: np.ndarray) -> np.ndarray:
    """x (T, n) of M x = b, from M (T, n, n) and b (T, n)."""
    return np.linalg.solve(matrices, right[..., None])[..., 0]


def _spectral(matrices: np.ndarray) -> np.ndarray:
    return np.linalg.norm(matrices, 2, axis=(1, 2))


def states_of(trajectory: Any, every: int = 1) -> tuple[np.ndarray, State]:
    """Times (T,) [s] and states, leaves (T,), of one sample in ``every`` of a trajectory; in float64.

    Raises:
        UserError: another controller than the paper's.
    """
    check_controller(trajectory.scenario.parameters().gains)
    joints = trajectory.scenario.structure().joints
    part = partitioning.partition(trajectory.rows, joints)

    def columns(values: np.ndarray) -> tuple[Any, ...]:  # arrays in the place of scalars
        return tuple(np.moveaxis(np.asarray(values, np.float64)[::every], 0, -1))

    numbers = per_robot(lambda count: CHAINED + count - PLATFORM, joints)
    place = per_robot(lambda i, n: _chained(*columns(np.asarray(trajectory.q)[:, i, :n])), range(ROBOTS), numbers)
    with jax.enable_x64(True):
        geometry = build_model(trajectory.scenario.parameters()).geometry
        position = unplaced(geometry, place, columns(np.asarray(trajectory.steering)))
    velocity = per_robot(lambda i, count: columns(np.asarray(trajectory.velocity)[:, i, :count]), range(ROBOTS), joints)
    independent, _ = partitioning.parted(part, velocity)
    integral, eta, c_hat, force_integral = map(
        columns, (trajectory.integral, trajectory.eta, trajectory.c_hat, trajectory.force_integral)
    )
    controller = ControllerState(integral, (eta[0], eta[1]), c_hat, force_integral)
    state = State(position, independent, controller, carriage=columns(trajectory.carriage))
    return np.asarray(trajectory.t, np.float64)[::every], state


def _chained(x: Any, y: Any, th: Any, *arm: Any) -> Position:
    return at_place((th, *in_platform(x, y, (np.sin(th), np.cos(th)))), arm)
