"""MuJoCo's inertia matrix and bias forces of one robot's kinematic tree, projected onto the quasi-velocities.

The tree's coordinates are (x, y, th, right wheel, left wheel, a1, a2, a3). Each wheel is a joint whose armature is I_w:
armature is inertia about that axle and nothing else, which is all model.md gives a wheel.

>>> import numpy as np
>>> from coopmm_jax.parameters import Geometry, Inertia
>>> q, v = np.array([2.4, 0.0, 0.0, 1.57, -0.8, 1.6]), np.ones(5)
>>> M, h = quasi_velocity_terms(Geometry(), Inertia(), 9.81, q, v)
>>> M.shape, h.shape
((5, 5), (5,))
"""

from __future__ import annotations

import mujoco
import numpy as np

from coopmm_jax.parameters import Geometry, Inertia, LiftedArm

# MuJoCo refuses a moving body with less than 1e-15 of mass or inertia; this much moves no result by more than rounding.
NEARLY_NOTHING = 1e-14
LATERAL, FORWARD, UP = np.eye(3)  # body axes at th = 0
HINGE, SLIDE = mujoco.mjtJoint.mjJNT_HINGE, mujoco.mjtJoint.mjJNT_SLIDE


def _body(parent: mujoco.MjsBody, pos: np.ndarray, mass: float, moments: list[float], centre: np.ndarray):
    return parent.add_body(pos=pos, mass=mass, inertia=moments, ipos=centre, explicitinertial=True)


def _rod(
    parent: mujoco.MjsBody, pos: np.ndarray, mass: float, inertia: float, half_length: float, lifted: bool = False
):
    """A slender rod along forward, pitching upwards about lateral."""
    rod = _body(parent, pos, mass, [inertia, NEARLY_NOTHING, inertia], half_length * FORWARD)
    if lifted:
        rod.add_joint(type=SLIDE, axis=UP)
    rod.add_joint(type=HINGE, axis=LATERAL)
    return rod


def build_model(geometry: Geometry, inertia: Inertia, gravity: float) -> mujoco.MjModel:
    """The tree of one robot."""
    return build_tree(geometry, inertia, gravity)[0].compile()


def build_tree(geometry: Geometry, inertia: Inertia, gravity: float) -> tuple[mujoco.MjSpec, mujoco.MjsBody]:
    """The tree of one robot, to be compiled, and its platform."""
    spec = mujoco.MjSpec()
    spec.option.gravity = -gravity * UP
    # Platform and column only yaw, so their other two moments are free: they repeat the first.
    platform = _body(spec.worldbody, np.zeros(3), inertia.m_p, [inertia.I_p] * 3, geometry.d * FORWARD)
    platform.add_joint(type=SLIDE, axis=LATERAL)
    platform.add_joint(type=SLIDE, axis=FORWARD)
    platform.add_joint(type=HINGE, axis=UP)
    for side in (1, -1):
        add_wheel(platform, side * geometry.l, inertia.I_w)
    column = _body(platform, geometry.mount_offset * FORWARD, inertia.m1, [inertia.I1] * 3, geometry.l1 * UP)
    column.add_joint(type=HINGE, axis=UP)
    half, masses, moments = (geometry.l2, geometry.l3), (inertia.m2, inertia.m3), (inertia.I2, inertia.I3)
    if geometry.arm is not None:
        half, masses, moments = geometry.arm.l_links, *inertia.links
    link, place = column, 2 * geometry.l1 * UP
    for i, (length, mass, moment) in enumerate(zip(half, masses, moments, strict=True)):
        link = _rod(link, place, mass, moment, length, lifted=i == 0 and isinstance(geometry.arm, LiftedArm))
        place = 2 * length * FORWARD
    _body(link, place, inertia.m_obj, [0.0] * 3, np.zeros(3))
    return spec, platform


def add_wheel(body: mujoco.MjsBody, aside: float, inertia: float) -> None:
    """Add a wheel to a body: a joint about its lateral axis with an armature and nothing else."""
    wheel = _body(body, aside * LATERAL, NEARLY_NOTHING, [NEARLY_NOTHING] * 3, np.zeros(3))
    wheel.add_joint(type=HINGE, axis=-LATERAL, armature=inertia)


def rolling_basis(geometry: Geometry, th: float, joints: int = 3) -> np.ndarray:
    """R (8, 5) of (3) with the wheels' rows: no side slip, and wheels that roll; rows of more or fewer joints last."""
    R = np.zeros((5 + joints, 2 + joints))
    R[:2, 0] = -np.sin(th), np.cos(th)
    R[2, 1] = 1.0
    R[3:5, 0] = 1 / geometry.r
    R[3:5, 1] = geometry.l / geometry.r, -geometry.l / geometry.r
    R[5:, 2:] = np.eye(joints)
    return R


def quasi_velocity_terms(
    geometry: Geometry, inertia: Inertia, gravity: float, q: np.ndarray, v: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """M_v (5, 5) and h_v (5,) at q (6,), v (5,): M_v vdot + h_v = R^T (forces), gravity in h_v; of [arm] likewise."""
    model = build_model(geometry, inertia, gravity)
    data = mujoco.MjData(model)
    R = rolling_basis(geometry, q[2], len(q) - 3)
    data.qpos[[0, 1, 2, *range(5, len(q) + 2)]] = q
    data.qvel[:] = R @ v
    mujoco.mj_forward(model, data)
    M = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, data, M)
    R_dot_v = np.zeros(model.nv)
    R_dot_v[:2] = -v[0] * v[1] * np.array([np.cos(q[2]), np.sin(q[2])])
    return R.T @ M @ R, R.T @ (M @ R_dot_v + data.qfrc_bias)
