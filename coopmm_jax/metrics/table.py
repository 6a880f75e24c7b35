"""Metrics of a rollout, one entry each: name, unit, meaning, and how its value comes about; known without JAX.

``metrics/sample.py`` computes the quantities of one sample, ``metrics/observer.py`` reduces them along a rollout. A new
metric is one more entry here, and one more quantity there if none fits.

>>> METRICS["force_min"].unit
'N'
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping
from typing import Any, NamedTuple

from coopmm_jax.errors import UserError
from coopmm_jax.kinds.metrics import LATE, WHOLE, of_plugins
from coopmm_jax.kinds.registry import known, register_constants
from coopmm_jax.kinds.signals import added

LATE_FROM = 0.75  # the late window begins with the sample nearest to this fraction of the horizon
IMPACT = 0.01  # [s] from a landing of the tip on
SETTLED = 0.01  # tracking error above which a rollout has not settled


class Metric(NamedTuple):
    """One number that says how good a rollout was; NaN if the rollout failed before its window."""

    name: str
    unit: str
    meaning: str
    quantity: str  # of ``sample.quantities``
    reduction: str  # of ``observer.REDUCTIONS``
    window: str = WHOLE


def _of_error(stem: str, robot: str, unit: str, meaning: str) -> Iterator[Metric]:
    """Three metrics of the norm of one error, given as its square."""
    quantity = f"{stem}{robot}_squared"
    yield Metric(f"{stem}_rms{robot}", unit, f"root mean square of the norm of {meaning}", quantity, "root_mean")
    yield Metric(f"{stem}_max{robot}", unit, f"largest norm of {meaning}", quantity, "root_max")
    yield Metric(f"{stem}_final{robot}", unit, f"last norm of {meaning}", quantity, "root_last")


_TRACKING = "tracking error (norm of all heading, position and arm errors)"
_FORCE, _FORCE_ERROR = "normal contact force", "normal contact force less the desired one"
_LOST = f"samples with a negative {_FORCE}, or the tip off a compliant surface"
_TORQUES = "torques of all actuators"
_WHEELS, _JOINTS = "torques of the wheels", "torques of the arm joints"
_YIELDS = "a compliant surface; 0 of a rigid one"

# Samples are the steps (control periods of a sampled loop) 0, 1, ..., up to the horizon or a failure.
_TABLE = (
    *_of_error("heading", "_1", "rad", "platform angle z1 of robot I less the desired one"),
    *_of_error("heading", "_2", "rad", "platform angle z1 of robot II less the desired one"),
    *_of_error("position", "_1", "m", "(z2, z3) of robot I less the desired ones"),
    *_of_error("position", "_2", "m", "(z2, z3) of robot II less the desired ones"),
    *_of_error("arm", "_1", "rad", "arm yaw a1 of robot I less the desired one"),
    *_of_error("arm", "_2", "rad", "arm yaw a1 of robot II less the desired one"),
    *_of_error("object", "", "m", "object (tip II) less the desired point on its circle or path"),
    *_of_error("relative_tip", "", "m", "tip I less the desired point on the object's surface, both seen from arm II"),
    Metric("error_late", "rad, m", f"{_TRACKING}: largest, late", "tracking_squared", "root_max", LATE),
    Metric(
        "settling_time",
        "s",
        f"end of the last sample with a tracking error above {SETTLED}; at most the duration",
        "unsettled_until",
        "time_if_complete",
    ),
    Metric("force_error_rms", "N", f"{_FORCE_ERROR}: root mean square", "force_error_squared", "root_mean"),
    Metric(
        "force_error_rms_late",
        "N",
        f"{_FORCE_ERROR}: root mean square, late",
        "force_error_squared",
        "root_mean",
        LATE,
    ),
    Metric("force_error_final", "N", f"{_FORCE_ERROR}: last size", "force_error_squared", "root_last"),
    Metric("force_min", "N", f"{_FORCE}: smallest (negative: the contact would open)", "contact_force", "min"),
    Metric("force_max", "N", f"{_FORCE}: largest", "contact_force", "max"),
    Metric("force_min_late", "N", f"{_FORCE}: smallest, late", "contact_force", "min", LATE),
    Metric("force_max_late", "N", f"{_FORCE}: largest, late", "contact_force", "max", LATE),
    Metric(
        "contact_loss_fraction",
        "-",
        f"{_LOST}, of all samples",
        "contact_lost",
        "mean",
    ),
    Metric(
        "contact_loss_time",
        "s",
        f"number of {_LOST}, times the step",
        "contact_lost",
        "time",
    ),
    Metric(
        "contact_loss_depth",
        "N",
        "largest pull that would be needed to keep the contact; 0 without contact loss",
        "pull",
        "max",
    ),
    Metric("airborne_time", "s", f"number of samples with the tip off {_YIELDS}, times the step", "airborne", "time"),
    Metric("gap_max", "m", f"largest distance of the tip from {_YIELDS}", "gap", "max"),
    Metric("impacts", "-", f"number of times that the tip lands on {_YIELDS}", "landing", "count"),
    Metric(
        "impact_force_max",
        "N",
        f"largest {_FORCE} within {IMPACT:g} s of the tip's landing on {_YIELDS}",
        "impact_force",
        "max",
    ),
    Metric(
        "internal_force_max",
        "N",
        "largest size of the other constraint forces; 0 if there are no other rows",
        "internal_force",
        "max",
    ),
    Metric("torque_rms", "N m", f"{_TORQUES}: root mean square", "torque_squared", "root_mean"),
    Metric("torque_peak", "N m", f"{_TORQUES}: largest size", "torque_size", "max"),
    Metric(
        "saturation_fraction",
        "-",
        "torques commanded beyond an actuator's limit, of all samples of all actuators",
        "saturated",
        "mean",
    ),
    Metric("torque_variation", "N m", f"{_TORQUES}: sum of their total variations", "torque_change", "variation"),
    Metric(
        "wheel_torque_variation_late",
        "N m",
        f"{_WHEELS}: sum of their total variations, late",
        "wheel_torque_change",
        "variation",
        LATE,
    ),
    Metric(
        "joint_torque_variation_late",
        "N m",
        f"{_JOINTS}: sum of their total variations, late",
        "joint_torque_change",
        "variation",
        LATE,
    ),
    Metric(
        "persistence",
        "-",
        "k2 times the integral of u_d1 squared: of lateral errors exp(-persistence) is left; 0 of a law without k2",
        "persistence",
        "time",
    ),
    Metric(
        "c_hat_max", "-", "largest estimate c_hat of an uncertainty bound; 0 of a controller without", "c_hat", "max"
    ),
    Metric("constraint_residual_max", "m", "largest size of a constraint residual phi", "constraint_residual", "max"),
    Metric(
        "singularity_margin",
        "-",
        "smallest |det J_dep| of an arm over its first: 0 where an arm is singular",
        "determinant",
        "min",
    ),
)

# Those that tell at a glance whether a run is any good.
SHOWN = (
    *("error_late", "settling_time", "force_error_rms_late", "force_min", "force_max", "contact_loss_time"),
    *("internal_force_max", "torque_peak", "saturation_fraction", "wheel_torque_variation_late"),
    *("joint_torque_variation_late", "constraint_residual_max"),
)
_LOW_IS_BAD = ("force_min", "force_min_late", "singularity_margin")  # of all others the largest value is the worst


def _register(metric: Metric) -> None:
    def quantity(self: Any, sample: Any) -> Any:
        return sample.quantities[metric.quantity]  # computed together, in ``sample.quantities``

    constants = {
        "unit": metric.unit,
        "meaning": metric.meaning,
        "reduction": metric.reduction,
        "window": metric.window,
        "low_is_bad": metric.name in _LOW_IS_BAD,
        "shown": metric.name in SHOWN,
        "shares": metric.quantity,
    }
    register_constants("metric", metric.name, metric.meaning, quantity=quantity, **constants)


for _metric in _TABLE:
    _register(_metric)


class _Metrics(Mapping[str, Metric]):
    """Metrics by name, built-in ones first; those of plugins are there once they are loaded."""

    def __getitem__(self, name: str) -> Metric:
        made = known("metric")[name].made
        shared = getattr(made, "shares", None)  # of the built-in ones: metrics of one quantity share what is gathered
        return Metric(name, made.unit, made.meaning, shared or f"metric {name}", made.reduction, made.window)

    def __iter__(self) -> Iterator[str]:
        return iter(known("metric"))

    def __len__(self) -> int:
        return len(known("metric"))


METRICS = _Metrics()


def registered() -> tuple[tuple[str, type], ...]:
    """Names and kinds of all metrics and signals: what a compiled program that measures them depends on."""
    return tuple((name, kind.made) for kinds in (known("metric"), added()) for name, kind in kinds.items())


def shown() -> tuple[str, ...]:
    """Names of the metrics that commands print."""
    added = (name for name, kind in known("metric").items() if kind.plugin and kind.made.shown)
    return (*SHOWN, *added)


def low_is_bad(name: str) -> bool:
    """True if the smallest value of a metric is the worst."""
    return known("metric")[name].made.low_is_bad


def check_finite(values: Mapping[str, Any], completed: Any, sentences: Iterable[str] = ()) -> None:
    """Refuse a plugin's metric, or a sentence over its signals, that is not finite over a rollout that completes.

    Args:
        values: of the metrics by name, NumPy arrays (...,).
        completed: whether each rollout completed (...,).
        sentences: names of those among them.

    Raises:
        UserError: one is not.
    """
    labels = {name: f"{kind.label}: quantity" for name, kind in of_plugins().items()}
    labels |= {name: f"requirements.{name}: robustness" for name in sentences}
    for name, label in labels.items():
        for value, whole in zip(values[name].ravel().tolist(), completed.ravel().tolist(), strict=True):
            if whole and not math.isfinite(value):
                raise UserError(label, "finite in every rollout that completes", value)


def as_text(value: float, form: str) -> str:
    """Metric in its unit for a reader, as [N]: by a format, or "-" where there is none.

    >>> as_text(0.25, ".4g"), as_text(math.nan, ".4g")
    ('0.25', '-')
    """
    return "-" if math.isnan(value) else format(value, form)
