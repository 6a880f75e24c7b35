"""Checks of the paper along simulated motions, for ``paper_checks.py``."""

from __future__ import annotations

from functools import cache
from typing import TYPE_CHECKING, Any

import jax
import jax.numpy as jnp
import numpy as np

import coopmm_jax as cm
from coopmm_jax.mechanics import partitioning
from coopmm_jax.mechanics.constrained_kinematics import kinematics
from coopmm_jax.mechanics.model import build_model
from coopmm_jax.proof import lyapunov
from coopmm_jax.proof import terms as proof_terms

if TYPE_CHECKING:
    from coopmm_jax.runs.trajectory import Trajectory

Figures = dict[str, Any]  # name, with its unit -> one value or several

# Step times eigenvalue, on the negative real axis, up to which RK4 is stable.
RK4_LIMIT = 2.785


@cache
def simulated(*changes: tuple[str, Any]) -> Trajectory:
    """Study with some fields changed."""
    return cm.simulate(cm.load_scenario("paper").with_overrides(dict(changes)))


def robust_rate(trajectory: Trajectory) -> np.ndarray:
    """Rate |U2| / |sigma| over Mr's least eigenvalue [1/s], every 20th sample, at which the robust term turns sigma."""
    structure, parameters = trajectory.scenario.structure(), trajectory.scenario.parameters()
    terms = proof_terms.proof_terms(structure, parameters, *lyapunov.states_of(trajectory, every=20))
    gain = np.linalg.norm(terms.robust.sum(axis=1), axis=1) / np.linalg.norm(terms.sigma, axis=1)
    return gain / np.linalg.eigvalsh(terms.plant.M)[:, 0]


def coupling_blocks() -> Figures:
    """Map L of (10) along the study: the block that the paper has as zero, and the effect of leaving it out."""
    run = simulated()
    structure, model = run.scenario.structure(), build_model(run.scenario.parameters())
    t, state = lyapunov.states_of(run, every=10)
    with jax.enable_x64(True):
        position, velocity = jax.tree.map(jnp.asarray, (state.position, state.velocity))
        k = kinematics(model, structure.rows, position, velocity)
        (L1, _), (J1, _) = partitioning.velocity_maps(k.reduction), k.reduction.rows.J
        dependent = k.reduction.part.dependent[0]
        block = np.array([[np.broadcast_to(x, t.shape) for x in L1.rows[joint][3:]] for joint in dependent])
        missing = [sum(x * u for x, u in zip(L1.rows[joint][3:], velocity[3:], strict=True)) for joint in dependent]
        gap = [sum(row[j] * x for j, x in zip(dependent, missing, strict=True)) for row in J1.rows[:2]]
    size = np.linalg.norm(np.moveaxis(block, -1, 0), 2, axis=(1, 2))
    return {
        "|L_12|, least and largest": [size.min(), size.max()],
        "|J u| if L_12 were 0, largest, normal and height [m/s]": [np.abs(rate).max() for rate in gap],
        "|lambda| of the four rows, largest [N]": np.abs(run.constraint_force).max(axis=0),
    }


def stability() -> Figures:
    """Properties 2.1, 2.2 and (40) along the study, beta = lam_min = 1."""
    found = lyapunov.report(lyapunov.analyse(simulated(), every=2))
    corrected = lyapunov.report(lyapunov.analyse(simulated(("law.u26", "corrected")), every=2))
    return {
        "eigenvalues of Mr": found["inertia_eigenvalues"],
        "largest |Mr|, |Cr|, |Gr|": list(found["largest_norms"].values()),
        "c_k": found["c"],
        "V at the start, at the end": [found["V_start"], found["V_end"]],
        "share of the time in which V rises": found["share_V_rises"],
        "(40), left less right side, when [s], share of the time": list(found["bound_40"].values()),
        "the same with the corrected U26": list(corrected["bound_40"].values()),
        **_steps(found),
    }


def true_range() -> Figures:
    """Study with beta = 127 and lam_min = 0.62, the true range of Mr's eigenvalues: bound (40), and its price."""
    bounds = (("gains.beta", 127.0), ("gains.lam_min", 0.62))
    coarse = simulated(*bounds)
    fine = simulated(*bounds, ("simulation.step", 2e-5), ("simulation.duration", 0.4))
    found = lyapunov.report(lyapunov.analyse(fine, every=4))
    return {
        "step 1 ms: status, when [s]": [coarse.status.name, coarse.status_time],
        "step 0.02 ms, 0.4 s: status": fine.status.name,
        "eigenvalues of Mr": found["inertia_eigenvalues"],
        "(40), left less right side, when [s], share of the time": list(found["bound_40"].values()),
        **_steps(found),
        "fastest rate of the robust term, study and true range [1/s]": [
            robust_rate(simulated()).max(),
            robust_rate(fine).max(),
        ],
        "RK4's limit at 1 ms, 0.02 ms [1/s]": [RK4_LIMIT / 1e-3, RK4_LIMIT / 2e-5],
    }


def _steps(report: dict[str, Any]) -> Figures:
    return {f"{step}, likewise": list(found.values()) for step, found in report["steps"].items()}


def printed_law() -> Figures:
    """Study with (19) as the proof needs it, and as printed."""
    proof, printed = simulated(), simulated(("law.robust_term", "printed"))

    def both(metric: str) -> list[float]:
        return [run.metrics[metric] for run in (proof, printed)]

    return {
        "largest difference of zeta between them [rad, m]": np.abs(proof.zeta - printed.zeta).max(),
        "largest chat": both("c_hat_max"),
        "lowest contact force [N]": both("force_min"),
        "late tracking error": both("error_late"),
        "wheel torques' total variation after 15 s [N m]": both("wheel_torque_variation_late"),
    }


def contact() -> Figures:
    """Contact force with both readings of the feed-forward."""
    figures: Figures = {}
    for reading in ("projected", "full"):
        run = simulated(("law.feedforward", reading))
        normal = run.constraint_force[:, 0]
        figures[f"{reading}: lowest [N], when [s]"] = [normal.min(), run.t[normal.argmin()]]
        figures[f"{reading}: time without contact [s]"] = run.metrics["contact_loss_time"]
        figures[f"{reading}: other constraint forces, largest [N]"] = run.metrics["internal_force_max"]
        error = np.abs(normal - 15.0)
        figures[f"{reading}: |lambda_n - 15|, largest from 5 to 10 s, from 15 to 20 s [N]"] = [
            error[(run.t >= start) & (run.t <= start + 5.0)].max() for start in (5.0, 15.0)
        ]
    return figures


def opening() -> Figures:
    """Study with a contact that can open, with both readings of the feed-forward; full with a floor of 0.1."""
    leaves = ("contact.model", "compliant")
    projected = simulated(leaves)
    gap = projected.constraint_residual[:, 0]
    full, rigid = (simulated(("law.feedforward", "full"), ("law.delta_floor", 0.1), *more) for more in ((leaves,), ()))
    measured = full.metrics
    return {
        "projected: gap above 0, 10, 100 mm [s]": [projected.t[np.argmax(gap > limit)] for limit in (0.0, 0.01, 0.1)],
        "projected: contact after 10 ms, 1 if ever": float(np.any(gap[projected.t > 0.01] <= 0.0)),
        "projected: status, when [s]": [projected.status.name, projected.status_time],
        "full: time off the surface [s], largest gap [m]": [measured["airborne_time"], measured["gap_max"]],
        "full: landings, largest force within 10 ms of one [N]": [measured["impacts"], measured["impact_force_max"]],
        "full: largest difference of zeta from the rigid contact's [rad, m]": np.abs(full.zeta - rigid.zeta).max(),
        "full: largest difference of lambda_n after 1 s [N]": np.abs(full.constraint_force - rigid.constraint_force)[
            full.t > 1.0, 0
        ].max(),
    }


def chatter() -> Figures:
    """Robust term as delta -> 0: total variation of robot I's wheel torques from 15 s to 20 s."""
    figures: Figures = {}
    for floor in (0.0, 0.01, 0.1):
        run = simulated(("law.delta_floor", floor))
        figures[f"floor {floor:g}: right and left wheel [N m]"] = _variation(run)
        figures[f"floor {floor:g}: late tracking error"] = run.metrics["error_late"]
        figures[f"floor {floor:g}: fastest rate of the robust term [1/s]"] = robust_rate(run).max()
    fine = simulated(("simulation.step", 2.5e-4), ("simulation.record_every", 4))
    figures["floor 0, step 0.25 ms: right and left wheel [N m]"] = _variation(fine)
    return figures


def _variation(run: Trajectory) -> np.ndarray:
    return np.abs(np.diff(run.torque[run.t >= 15.0, 0, :2], axis=0)).sum(axis=0)


CHECKS = (coupling_blocks, stability, true_range, printed_law, contact, opening, chatter)
