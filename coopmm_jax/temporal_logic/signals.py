"""Signals that sentences of [requirements] speak of: name, unit, meaning; known without JAX.

``metrics/signal_values.py`` computes them. A plugin adds signals of its own by ``@register("signal", name)``; the
quantity of a plugin's metric is a signal, too. Joints beyond the third, of arms that have more, are known by name and
not listed.

>>> SIGNALS["torque_1[joint_2]"].unit, "torque_1[joint_8]" in SIGNALS, "torque_1[joint_8]" in list(SIGNALS)
('N m', True, False)
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping
from typing import NamedTuple

from coopmm_jax.errors import UserError
from coopmm_jax.kinds.metrics import of_plugins
from coopmm_jax.kinds.signals import TAKEN, added

# Typical sizes by unit, by which margins are divided where no limit gives a size.
_SIZES = {"N": 1.0, "N m": 1.0, "m": 0.01, "rad": 0.01, "rad, m": 0.01}


class SignalAbout(NamedTuple):
    """One signal of a rollout, a number at each sample."""

    name: str
    unit: str
    meaning: str


_ROBOTS = {"1": "robot I", "2": "robot II"}
LISTED, MOST = 3, 8  # joints of the paper's arms; of an arm with a yaw, a lift and six links
_JOINTS = range(1, MOST + 1)
_PLATFORM = {"z1": "rad", "z2": "m", "z3": "m"}
_RATES = {"u1": "rad/s", "u2": "m/s"}
RATES = (*_RATES, *(f"a{k}_rate" for k in _JOINTS))
ACTUATORS = ("right_wheel", "left_wheel", *(f"joint_{k}" for k in _JOINTS))
_OF_JOINT = re.compile(r"(?:position|velocity|torque|commanded)_([12])\[(?:a|joint_)(\d+)(?:_rate)?\]")


def _errors() -> Iterator[SignalAbout]:
    yield SignalAbout("tracking_error", "rad, m", "norm of all heading, position and arm errors")
    for i, robot in _ROBOTS.items():
        yield SignalAbout(f"heading_error_{i}", "rad", f"size of platform angle z1 of {robot} less the desired one")
        yield SignalAbout(f"position_error_{i}", "m", f"distance of (z2, z3) of {robot} from the desired ones")
        yield SignalAbout(f"arm_error_{i}", "rad", f"size of arm yaw a1 of {robot} less the desired one")
    yield SignalAbout("object_error", "m", "distance of the object from its desired point")
    yield SignalAbout("relative_tip_error", "m", "distance of tip I from its desired point on the object's surface")


def _by_entry() -> Iterator[SignalAbout]:
    for i, robot in _ROBOTS.items():
        for entry, unit in _PLATFORM.items():
            yield SignalAbout(f"position_{i}[{entry}]", unit, f"{entry} of {robot}")
        yield from _angles(i, _JOINTS[:LISTED])
        for entry, unit in (*_PLATFORM.items(), ("a1", "rad")):
            about = f"desired {entry} of {robot}" + (", on the robot's own turn" if entry in ("z1", "a1") else "")
            yield SignalAbout(f"desired_{i}[{entry}]", unit, about)
        for entry, unit in _RATES.items():
            yield SignalAbout(f"velocity_{i}[{entry}]", unit, f"{entry} of {robot}")
        yield from _rates(i, _JOINTS[:LISTED])
        yield from _torques(i, ACTUATORS[: -(MOST - LISTED)])


def _of_further_joints() -> Iterator[SignalAbout]:
    for i in _ROBOTS:
        yield from _angles(i, _JOINTS[LISTED:])
        yield from _rates(i, _JOINTS[LISTED:])
        yield from _torques(i, ACTUATORS[-(MOST - LISTED) :])


def _angles(i: str, joints: Iterable[int]) -> Iterator[SignalAbout]:
    for k in joints:
        yield SignalAbout(f"position_{i}[a{k}]", "rad", f"a{k} of {_ROBOTS[i]}")


def _rates(i: str, joints: Iterable[int]) -> Iterator[SignalAbout]:
    for k in joints:
        yield SignalAbout(f"velocity_{i}[a{k}_rate]", "rad/s", f"a{k}_rate of {_ROBOTS[i]}")


def _torques(i: str, actuators: Iterable[str]) -> Iterator[SignalAbout]:
    for actuator in actuators:
        about = f"{actuator.replace('_', ' ')} of {_ROBOTS[i]}"
        yield SignalAbout(f"torque_{i}[{actuator}]", "N m", f"torque of {about}")
        yield SignalAbout(f"commanded_{i}[{actuator}]", "N m", f"torque of {about} before limits and lag")


def joint_of(name: str) -> tuple[int, int] | None:
    """Robot, from 0, and joint, from 1 at the yaw, that a signal belongs to; None of others.

    >>> joint_of("torque_2[joint_3]"), joint_of("velocity_1[a4_rate]"), joint_of("torque_1[left_wheel]")
    ((1, 3), (0, 4), None)
    """
    match = _OF_JOINT.fullmatch(name)
    return None if match is None else (int(match[1]) - 1, int(match[2]))


def check_joint(name: str, joints: tuple[int, int], field: str) -> None:
    """Check that a signal is not of a joint that a robot lacks.

    Args:
        name: of the signal.
        joints: number of each robot's velocities u, two of its platform among them.
        field: to blame.

    Raises:
        UserError: it is.
    """
    robot, joint = joint_of(name) or (0, 0)
    has = joints[robot] - len(_RATES)
    if joint > has:
        raise UserError(field, f"of joints that {_ROBOTS[str(robot + 1)]} has, 1 to {has}", name)


_TABLE = (
    SignalAbout("t", "s", "time"),
    *_errors(),
    SignalAbout("contact_force", "N", "normal contact force; positive where it presses"),
    SignalAbout("desired_force", "N", "desired normal contact force"),
    SignalAbout("force_error", "N", "normal contact force less the desired one"),
    SignalAbout("internal_force", "N", "largest size of the other constraint forces; 0 if there are no other rows"),
    SignalAbout("gap", "m", "distance of the tip from a compliant surface; 0 in contact, and of a rigid one"),
    SignalAbout("torque", "N m", "largest size of all actuators' torques"),
    SignalAbout("c_hat", "-", "largest estimate c_hat of an uncertainty bound; 0 of a controller without"),
    SignalAbout("constraint_residual", "m", "largest size of a constraint residual phi"),
    SignalAbout("determinant", "-", "smallest |det J_dep| of an arm over its first: 0 where an arm is singular"),
    *_by_entry(),
)
# Margins of the proof of Theorem 3.1, which need the whole motion: known after a rollout, where a sentence asks for
# them.
_STEPS = {
    "34": "of the inertia's step",
    "35": "of the Coriolis terms'",
    "36": "of gravity's",
    "37": "of the disturbance's",
}
_STEPS |= {"39": "of the coupling signal's", "40": "of the bound on the Lyapunov function's rate"}
AFTERWARDS = {
    f"proof_{n}": SignalAbout(f"proof_{n}", "1/s", f"margin {what}, ({n}): right less left side; at most 401 instants")
    for n, what in _STEPS.items()
}
_TABLE += tuple(AFTERWARDS.values())
_LISTED = {signal.name: signal for signal in _TABLE}
BUILT_IN = _LISTED | {signal.name: signal for signal in _of_further_joints()}
TAKEN.update(name.partition("[")[0] for name in BUILT_IN)


class _Signals(Mapping[str, SignalAbout]):
    """Signals by name, built-in ones first; those of plugins are there once they are loaded."""

    def __getitem__(self, name: str) -> SignalAbout:
        if name in BUILT_IN:
            return BUILT_IN[name]
        made = (added().get(name) or of_plugins()[name]).made
        return SignalAbout(name, made.unit, made.meaning)

    def __iter__(self) -> Iterator[str]:
        return iter(dict.fromkeys((*_LISTED, *added(), *of_plugins())))

    def __len__(self) -> int:
        return len(list(iter(self)))


SIGNALS = _Signals()


def typical_size(unit: str) -> float:
    """Scale of margins [unit] where no limit gives one.

    >>> typical_size("N"), typical_size("furlong")
    (1.0, 1.0)
    """
    return _SIZES.get(unit, 1.0)
