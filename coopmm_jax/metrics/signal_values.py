"""Values of signals at one sample, as ``temporal_logic/signals.py`` describes them."""

from __future__ import annotations

from collections.abc import Callable, Iterable

import jax.numpy as jnp

from coopmm_jax.algebra.sincos import wrapped
from coopmm_jax.algebra.types import Scalar
from coopmm_jax.control.reference import AnyReference, at_instant, desired_force, desired_motion
from coopmm_jax.kinds.metrics import of_plugins
from coopmm_jax.kinds.probe import number_of
from coopmm_jax.kinds.signals import added
from coopmm_jax.metrics.sample import Sample, root
from coopmm_jax.temporal_logic.signals import ACTUATORS, BUILT_IN, RATES, check_joint


def signal_values(sample: Sample, names: Iterable[str]) -> dict[str, Scalar]:
    """Values of some signals at a sample by name, scalars.

    Args:
        sample: with the quantities of the built-in metrics.
        names: of ``SIGNALS``.

    Raises:
        UserError: a signal of a joint that a robot does not have.
    """
    return {name: jnp.asarray(_value(sample, name), jnp.result_type(float)) for name in names}


def _value(sample: Sample, name: str) -> Scalar:
    if name not in BUILT_IN:
        own = added().get(name)
        if own is not None:
            return number_of(own, "value", sample)
        return number_of(of_plugins()[name], "quantity", sample)
    if name in _QUANTITIES:
        return sample.quantities[_QUANTITIES[name]]
    if name.partition("_error")[1] and name != "force_error":
        return root(sample.quantities[_squared(name)])
    if name in _ALONE:
        return _ALONE[name](sample)
    stem, entry = name.removesuffix("]").split("[")
    kind, robot = stem.rsplit("_", 1)
    check_joint(name, sample.structure.joints, "requirements")
    return _BY_ENTRY[kind](sample, int(robot) - 1, entry)


# Signals that are quantities of the metrics under another name, or the same.
_QUANTITIES = {
    "contact_force": "contact_force",
    "internal_force": "internal_force",
    "gap": "gap",
    "torque": "torque_size",
    "c_hat": "c_hat",
    "constraint_residual": "constraint_residual",
    "determinant": "determinant",
}


def _squared(name: str) -> str:
    """Quantity that is an error's square: "heading_error_1" is the root of "heading_1_squared"."""
    stem, _, robot = name.partition("_error")
    return f"{stem}{robot}_squared"


def _contact(sample: Sample) -> int:
    return sample.structure.rows.index("contact_normal")


def _reference(sample: Sample) -> AnyReference:
    return at_instant(sample.parameters.reference, sample.t, sample.signals.aim)


_ALONE: dict[str, Callable[[Sample], Scalar]] = {
    "t": lambda sample: sample.t,
    "desired_force": lambda sample: desired_force(_reference(sample), sample.structure.rows, sample.t)[
        _contact(sample)
    ],
    "force_error": lambda sample: sample.signals.force_error[_contact(sample)],
}


def _desired(sample: Sample, robot: int, entry: str) -> Scalar:
    desired, position = desired_motion(_reference(sample), sample.t)[robot], sample.signals.position[robot]
    wanted = desired.arm[0] if entry == "a1" else getattr(desired, entry)
    if entry in ("z1", "a1"):  # along a path headings are known modulo a turn
        now = getattr(position, entry)
        return now - wrapped(now - wanted)
    return wanted


_BY_ENTRY: dict[str, Callable[[Sample, int, str], Scalar]] = {
    "position": lambda sample, robot, entry: getattr(sample.signals.position[robot], entry),
    "desired": _desired,
    "velocity": lambda sample, robot, entry: sample.signals.velocity[robot][RATES.index(entry)],
    "torque": lambda sample, robot, entry: sample.signals.torque[robot][ACTUATORS.index(entry)],
    "commanded": lambda sample, robot, entry: sample.signals.commanded[robot][ACTUATORS.index(entry)],
}
