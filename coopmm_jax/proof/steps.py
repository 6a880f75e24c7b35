"""The steps (34)-(37) and (39) towards the bound (40), and the bounds of Assumption 3.2, from the terms of the proof.

Written for NumPy and JAX alike: a run that is analysed has NumPy's arrays, a rollout that is traced has JAX's.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from jax.core import Tracer

from coopmm_jax.errors import UserError
from coopmm_jax.kinds.controllers import name_of
from coopmm_jax.kinds.robust_adaptive import Gains
from coopmm_jax.parameters import Parameters, Structure
from coopmm_jax.proof.terms import ProofTerms, Reduced

STEPS = ("(34)", "(35)", "(36)", "(37)", "(39)")
_ADAPTED = ((0,), (1, 2), (3,), (4,))  # bounds c_k that the first four steps are about


def check_loop(structure: Structure, parameters: Parameters) -> None:
    """Refuse what the proof is not about.

    Raises:
        UserError: another controller than the paper's, sampled control, devices that are not ideal, scheduled gains, or
            an adaptation rate gamma of zero (V2 of (31) divides by it).
    """
    check_controller(parameters.gains)
    if structure.substeps or structure.force_delay or any(structure.features) or parameters.schedule:
        raise UserError("scenario", "the proof's loop: continuous control, ideal devices, constant gains", "another")
    if any(not isinstance(x, Tracer) and x <= 0 for x in parameters.gains.gamma):
        raise UserError("gains.gamma", "positive for the Lyapunov function (31)", parameters.gains.gamma)


def check_controller(gains: Any) -> None:
    """Refuse a controller that the proof is not about.

    Raises:
        UserError: it is another than the paper's.
    """
    if type(gains) is not Gains:
        raise UserError("law.controller", "robust_adaptive, which the proof is about", name_of(gains))


def uncertainty_of(terms: ProofTerms) -> Reduced:
    """Uncertainty of the reduced dynamics: plant less nominal model, (T, ...)."""
    return Reduced(*(plant - nominal for plant, nominal in zip(terms.plant, terms.nominal, strict=True)))


def bounds_at(xp: Any, terms: ProofTerms, uncertainty: Reduced, spectral: Callable[[Any], Any]) -> Any:
    """Least bounds c_1 ... c_5 of Assumption 3.2 at each instant (5, T); those of a motion are their largest.

    Args:
        xp: numpy, or jax.numpy.
        terms: of the proof.
        uncertainty: of the model.
        spectral: norms (T,) of matrices (T, n, n).
    """
    per_speed = spectral(uncertainty.C) / terms.speed
    gravity = xp.sqrt(xp.sum(uncertainty.G**2, axis=1))
    return xp.stack([spectral(uncertainty.M), 0.0 * terms.speed, per_speed, gravity, terms.disturbance_size])


def sides(
    xp: Any, gains: Gains, terms: ProofTerms, uncertainty: Reduced, c: Any, solve: Callable[[Any, Any], Any]
) -> tuple[dict, dict]:
    """Left and right sides (T,) of each of STEPS.

    Args:
        xp: numpy, or jax.numpy.
        gains: of the controller.
        terms: of the proof.
        uncertainty: of the model.
        c: bounds (5,).
        solve: x (T, n) of M x = b, from M (T, n, n) and b (T, n).
    """
    gamma, c = xp.stack([xp.asarray(x) for x in gains.gamma])[None], c[None]
    toward = solve(terms.plant.M, terms.sigma)  # Mr^-1 sigma
    robust = xp.einsum("ti,tki->kt", toward, terms.robust)
    adaptation = ((terms.c_hat - c) / gamma * terms.c_hat_rate).T
    leak = terms.alpha[:, None] / gamma
    right = (-leak * (terms.c_hat - 0.5 * c) ** 2 + leak * c**2 / 4).T + (terms.delta / gains.lam_min)[None]
    against = (
        -xp.einsum("ti,tij,tj->t", toward, uncertainty.M, terms.acceleration),
        -xp.einsum("ti,tij,tj->t", toward, uncertainty.C, terms.independent),
        -xp.einsum("ti,ti->t", toward, uncertainty.G),
        -xp.einsum("ti,ti->t", toward, terms.disturbance),
    )
    left = [x + sum(robust[k] + adaptation[k] for k in of) for x, of in zip(against, _ADAPTED, strict=True)]
    most = [sum(right[k] for k in of) for of in _ADAPTED]
    both = ([*left, terms.cross + robust[5]], [*most, terms.delta])
    return dict(zip(STEPS, both[0], strict=True)), dict(zip(STEPS, both[1], strict=True))
