"""Metrics of a rollout: names, units and meanings, known without JAX. ``metrics/observer.py`` computes them.

>>> METRICS["force_min"][0]
'N'
"""

from __future__ import annotations

LATE = 0.75  # "late" is from the sample nearest to this fraction of the horizon on
SETTLED = 0.01  # tracking error above which a rollout has not settled

ERRORS = {  # each a vector; its name in METRICS takes a statistic in place of {}
    "heading_{}_1": ("rad", "platform angle z1 of robot I less the desired one"),
    "heading_{}_2": ("rad", "platform angle z1 of robot II less the desired one"),
    "position_{}_1": ("m", "(z2, z3) of robot I less the desired ones"),
    "position_{}_2": ("m", "(z2, z3) of robot II less the desired ones"),
    "arm_{}_1": ("rad", "arm yaw a1 of robot I less the desired one"),
    "arm_{}_2": ("rad", "arm yaw a1 of robot II less the desired one"),
    "object_{}": ("m", "object (tip II) less the desired point on its guide circle"),
    "relative_tip_{}": ("m", "tip I less the desired point on the object's arc, both seen from arm II"),
}
TRACKING = tuple(ERRORS)[:6]
_STATISTICS = {"rms": "root mean square of the norm of", "max": "largest norm of", "final": "last norm of"}

# name -> (unit, meaning). Samples are the steps (control periods of a sampled loop) 0, 1, ..., up to the horizon or a
# failure.
METRICS: dict[str, tuple[str, str]] = {
    **{
        error.format(statistic): (unit, f"{words} {meaning}")
        for error, (unit, meaning) in ERRORS.items()
        for statistic, words in _STATISTICS.items()
    },
    "error_late": ("rad, m", "tracking error (norm of all heading, position and arm errors): largest, late"),
    "settling_time": ("s", f"end of the last sample with a tracking error above {SETTLED}; at most the duration"),
    "force_error_rms": ("N", "normal contact force less the desired one: root mean square"),
    "force_error_rms_late": ("N", "normal contact force less the desired one: root mean square, late"),
    "force_error_final": ("N", "normal contact force less the desired one: last size"),
    "force_min": ("N", "normal contact force: smallest (negative: the contact would open)"),
    "force_max": ("N", "normal contact force: largest"),
    "force_min_late": ("N", "normal contact force: smallest, late"),
    "force_max_late": ("N", "normal contact force: largest, late"),
    "contact_loss_fraction": ("-", "samples with a negative normal contact force, of all samples"),
    "contact_loss_time": ("s", "number of samples with a negative normal contact force, times the step"),
    "contact_loss_depth": ("N", "largest pull that would be needed to keep the contact; 0 without contact loss"),
    "internal_force_max": ("N", "largest size of the other constraint forces; 0 if there are no other rows"),
    "torque_rms": ("N m", "torques of all ten actuators: root mean square"),
    "torque_peak": ("N m", "torques of all ten actuators: largest size"),
    "saturation_fraction": ("-", "torques commanded beyond an actuator's limit, of all samples of all ten actuators"),
    "torque_variation": ("N m", "torques of all ten actuators: sum of their total variations"),
    "wheel_torque_variation_late": ("N m", "torques of the four wheels: sum of their total variations, late"),
    "c_hat_max": ("-", "largest estimate c_hat of an uncertainty bound"),
    "constraint_residual_max": ("m", "largest size of a constraint residual phi"),
    "singularity_margin": ("-", "smallest |det J_dep| of an arm over its first: 0 where an arm is singular"),
}

# Those that tell at a glance whether a run is any good.
SHOWN = (
    *("error_late", "settling_time", "force_error_rms_late", "force_min", "force_max", "contact_loss_time"),
    *("internal_force_max", "torque_peak", "wheel_torque_variation_late", "constraint_residual_max"),
)
LOW_IS_BAD = ("force_min", "force_min_late", "singularity_margin")  # of all others the largest value is the worst
