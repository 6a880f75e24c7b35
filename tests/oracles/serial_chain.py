"""A platform with any serial chain of joints on it, by Newton's and Euler's equations on rotation matrices.

Joints turn about, or move along, any axis; links have any centre and inertia tensor. Velocities are
v = (V, w, joint rates) with joint angles from one link to the next, forces those that go with them.

>>> import numpy as np
>>> from coopmm_jax.parameters import Arm, Geometry, Inertia, LinkInertia
>>> arm = Geometry(arm=Arm((0.2, 0.3, 0.4))), Inertia(links=LinkInertia((0.5,) * 3, (0.1,) * 3))
>>> inverse_dynamics(*arm, 9.81, np.zeros(4), np.zeros(6), np.zeros(6)).shape
(6,)
"""

from __future__ import annotations

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from coopmm_jax.parameters import Geometry, Inertia, LiftedArm

LATERAL, FORWARD, UP = np.eye(3)


class Joint(NamedTuple):
    """A joint and the link behind it, in axes that go with the link."""

    turns: bool  # else it slides
    axis: np.ndarray  # (3,)
    offset: np.ndarray  # from the joint before (3,) [m]
    mass: float
    centre: np.ndarray  # (3,)
    tensor: np.ndarray  # (3, 3) about the centre


def joints_of(geometry: Geometry, inertia: Inertia) -> list[Joint]:
    """Joints of an arm from its yaw to its last link, which carries the object."""
    arm, links, nothing = geometry.arm, inertia.links, np.zeros((3, 3))
    yaw = Joint(True, UP, geometry.mount_offset * FORWARD, inertia.m1, 0 * UP, inertia.I1 * np.diag(UP))
    chain, place = [yaw], 2 * geometry.l1 * UP
    if isinstance(arm, LiftedArm):
        chain, place = [*chain, Joint(False, UP, place, 0.0, 0 * UP, nothing)], 0 * UP
    for half, mass, moment in zip(arm.l_links, *links, strict=True):
        chain.append(Joint(True, LATERAL, place, mass, half * FORWARD, moment * np.diag(LATERAL + UP)))
        place = 2 * half * FORWARD
    last = chain[-1]
    return [*chain[:-1], last, Joint(True, 0 * UP, place, inertia.m_obj, 0 * UP, nothing)]


def _turned(axis, angle):
    x, y, z = axis
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross


def inverse_dynamics(geometry: Geometry, inertia: Inertia, gravity: float, q, v, v_dot):
    """Forces that go with v: M v_dot + h, at joint coordinates q (k,) of the arm."""
    (V, w), (V_dot, w_dot) = v[:2], v_dot[:2]
    joints = joints_of(geometry, inertia)
    angles, rates, changes = (np.append(x, 0.0) for x in (q, v[2:], v_dot[2:]))  # the object does not move on its link
    turn, turn_dot = w * UP, w_dot * UP
    speeding = V_dot * FORWARD - w * V * LATERAL + gravity * UP
    axes, place = np.eye(3), np.zeros(3)
    at, of_links = [], []
    for joint, angle, rate, change in zip(joints, angles, rates, changes, strict=True):
        axis = axes @ joint.axis
        step = axes @ (joint.offset + (0 if joint.turns else angle) * joint.axis)
        place = place + step
        speeding = speeding + np.cross(turn_dot, step) + np.cross(turn, np.cross(turn, step))
        if joint.turns:
            turn_dot = turn_dot + np.cross(turn, axis) * rate + axis * change
            turn = turn + axis * rate
            axes = axes @ _turned(joint.axis, angle)
        else:
            speeding = speeding + 2 * np.cross(turn, axis) * rate + axis * change
        arm, tensor = axes @ joint.centre, axes @ joint.tensor @ axes.T
        force = joint.mass * (speeding + np.cross(turn_dot, arm) + np.cross(turn, np.cross(turn, arm)))
        moment = tensor @ turn_dot + np.cross(turn, tensor @ turn)
        at.append((joint.turns, axis, place))
        of_links.append((place + arm, force, moment))
    pull = inertia.m_p * (V_dot - geometry.d * w**2) + 2 * inertia.I_w / geometry.r**2 * V_dot
    yaw = (inertia.I_p + 2 * inertia.I_w * (geometry.l / geometry.r) ** 2) * w_dot
    yaw += inertia.m_p * geometry.d * (geometry.d * w_dot + w * V)
    pull += sum(force for _, force, _ in of_links) @ FORWARD
    yaw += sum(np.cross(where, force) + moment for where, force, moment in of_links) @ UP
    found = [pull, yaw]
    for i, (turns, axis, here) in enumerate(at[:-1]):
        behind = of_links[i:]
        total = sum(np.cross(where - here, force) + moment if turns else force for where, force, moment in behind)
        found.append(axis @ total)
    return np.array(found)


def energy(geometry: Geometry, inertia: Inertia, gravity, q, q_dot):
    """T and U [J] at q, q_dot (4 + k,) with q = (x, y, th, a1, lift, pitches), from the bodies' places."""
    links, lifts = inertia.links, isinstance(geometry.arm, LiftedArm)

    def forward(angle):
        return jnp.stack([-jnp.sin(angle), jnp.cos(angle), 0 * angle])

    def places(q):
        base = jnp.stack([q[0], q[1], 0 * q[0]])
        mount, e = base + geometry.mount_offset * forward(q[2]), forward(q[2] + q[3])
        rods = [e * jnp.cos(a) + UP * jnp.sin(a) for a in jnp.cumsum(q[4 + lifts :])]
        end, centres = mount + UP * (2 * geometry.l1 + (q[4] if lifts else 0.0)), []
        for half, rod in zip(geometry.arm.l_links, rods, strict=True):
            centres, end = [*centres, end + half * rod], end + 2 * half * rod
        return base + geometry.d * forward(q[2]), mount, jnp.stack(centres), end, jnp.stack(rods)

    _, (platform, mount, centres, tip, rods) = jax.jvp(places, (q,), (q_dot,))
    rolling = q_dot[:2] @ forward(q[2])[:2]
    wheels = jnp.stack([rolling + geometry.l * q_dot[2], rolling - geometry.l * q_dot[2]]) / geometry.r
    twice = inertia.m_p * platform @ platform + inertia.I_p * q_dot[2] ** 2 + inertia.I_w * wheels @ wheels
    twice += inertia.m1 * mount @ mount + inertia.I1 * (q_dot[2] + q_dot[3]) ** 2 + inertia.m_obj * tip @ tip
    twice += jnp.array(links.m_links) @ (centres**2).sum(1) + jnp.array(links.I_links) @ (rods**2).sum(1)
    _, _, now, end, _ = places(q)
    return twice / 2, gravity * (jnp.array(links.m_links) @ now[:, 2] + inertia.m_obj * end[2])


def chained_basis(q):
    """S (n, n - 1): q_dot = S u with u = (u1, u2, joint rates)."""
    lateral = q[0] * jnp.cos(q[2]) + q[1] * jnp.sin(q[2])
    ahead = jnp.stack([-jnp.sin(q[2]), jnp.cos(q[2])])
    n = len(q)
    S = jnp.zeros((n, n - 1)).at[:2, 0].set(lateral * ahead).at[:2, 1].set(ahead).at[2, 0].set(1.0)
    return S.at[jnp.arange(3, n), jnp.arange(2, n - 1)].set(1.0)
