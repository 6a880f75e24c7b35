"""Places of everything visible at chosen instants of a run, in world coordinates [m]; outlines of the platforms."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from coopmm_jax.algebra.types import Pair
from coopmm_jax.animation.surface import DrawnSurface, normals, shifts
from coopmm_jax.parameters import Car, Geometry, LiftedArm
from coopmm_jax.plotting.motion import midpoints

if TYPE_CHECKING:
    from coopmm_jax.runs.trajectory import Trajectory

BODY_HALF_WIDTH = 0.8  # of the half track
REAR, NOSE = 0.7, 0.6  # body behind the axle, and ahead of the platform's centre, in wheel radii
WHEEL_HALF_THICKNESS = 0.12  # of the wheel's radius


class FrontAxles(NamedTuple):
    """Front axles of one robot at F instants."""

    midpoint: np.ndarray  # (F, 2)
    forward: np.ndarray  # (F, 2) unit vector of its heading


class Skeleton(NamedTuple):
    """Both robots, the contact and its force at F instants. The robot dimension is the one of length 2 after F."""

    t: np.ndarray  # (F,) [s]
    q: np.ndarray  # (F, 2, 6), as in Trajectory
    forward: np.ndarray  # (F, 2, 2) unit vector of each platform's heading
    joints: np.ndarray  # (F, 2, k, 3): foot and top of the column, elbows, tip, which a shorter arm has repeatedly
    desired: np.ndarray  # (F, 2, 2): desired axle midpoints
    frame: np.ndarray  # (F, 2, 2) unit vectors along arm II and across it: the object's frame
    surface: DrawnSurface  # in the object's frame
    shift: np.ndarray  # (F,) by which the surface has given way [m]
    normal: np.ndarray  # (F, 2) horizontal unit vector out of the surface at the contact, away from robot I
    force: np.ndarray  # (F,) lambda_n [N], along the normal on the object: it presses if positive
    front: tuple[FrontAxles | None, FrontAxles | None] = (None, None)  # of platforms on two axles

    @property
    def along(self) -> np.ndarray:
        """Unit vector e of arm II (F, 2)."""
        return self.frame[:, 0]


def skeleton(trajectory: Trajectory, instants: np.ndarray) -> Skeleton:
    """Skeleton of a run at some of its samples.

    Args:
        trajectory: the run.
        instants: indices of samples (F,).
    """
    plant = trajectory.scenario.parameters().plant
    t, q = trajectory.t[instants], trajectory.q[instants]
    joints = _alike([_joints(geometry, q[:, i]) for i, geometry in enumerate(plant.geometry)])
    along = _ahead(q[:, 1, 2] + q[:, 1, 3])
    frame = np.stack([along, np.stack([-along[:, 1], along[:, 0]], axis=-1)], axis=1)
    touched = np.einsum("fij,fj->fi", frame, joints[:, 0, -1, :2] - joints[:, 1, -1, :2])
    return Skeleton(
        t=t,
        q=q,
        forward=_ahead(q[..., 2]),
        joints=joints,
        desired=midpoints(trajectory.zeta_desired[instants]),
        frame=frame,
        surface=DrawnSurface(trajectory, touched),
        shift=shifts(trajectory, t),
        normal=np.einsum("fij,fi->fj", frame, normals(plant.surface, touched)),
        force=trajectory.constraint_force[instants, trajectory.rows.index("contact_normal")],
        front=_front_axles(plant.geometry, q, trajectory.steering[instants]),
    )


def _front_axles(geometry: Pair[Geometry], q: np.ndarray, steering: np.ndarray) -> tuple[Any, Any]:
    """Front axles at q (F, 2, 6), with as many angles (F, s) as there are."""
    angles = iter(steering.T)

    def of_robot(i: int) -> FrontAxles | None:
        front, th = geometry[i].front, q[:, i, 2]
        if front is None:
            return None
        return FrontAxles(q[:, i, :2] + front.wheelbase * _ahead(th), _ahead(th + next(angles)))

    return of_robot(0), of_robot(1)


def _ahead(angle: np.ndarray) -> np.ndarray:
    """Unit vectors (..., 2) of the forward axis at platform angles th, or of e at th + a1."""
    return np.stack([-np.sin(angle), np.cos(angle)], axis=-1)


def _joints(geometry: Geometry, q: np.ndarray) -> np.ndarray:
    """Column's foot and top, elbows and tip (F, k, 3) of one robot at q (F, 3 + joints)."""
    nothing, lift, half = np.zeros(len(q)), np.zeros(len(q)), (geometry.l2, geometry.l3)
    pitch = q[:, 4:]
    if geometry.arm is not None:
        half = geometry.arm.l_links
        if isinstance(geometry.arm, LiftedArm):
            lift, pitch = pitch[:, 0], pitch[:, 1:]
    lengths = 2 * np.array(half)[:, None]
    pitches = np.cumsum(pitch[:, : len(half)], axis=1).T
    reach = np.cumsum(lengths * np.cos(pitches), axis=0)
    rise = np.cumsum(lengths * np.sin(pitches), axis=0)
    reaches = np.stack([nothing, nothing, *reach], axis=-1)
    heights = np.stack([nothing, *(2 * geometry.l1 + lift + x for x in (nothing, *rise))], axis=-1)
    mount = q[:, :2] + geometry.mount_offset * _ahead(q[:, 2])
    horizontal = mount[:, None] + reaches[..., None] * _ahead(q[:, 2] + q[:, 3])[:, None]
    return np.concatenate([horizontal, heights[..., None]], axis=-1)


def _alike(joints: list[np.ndarray]) -> np.ndarray:
    """Joints of both robots (F, 2, k, 3), the tip of the shorter arm repeated."""
    longest = max(each.shape[1] for each in joints)
    return np.stack([each[:, np.minimum(np.arange(longest), each.shape[1] - 1)] for each in joints], axis=1)


def body_outline(geometry: Geometry) -> np.ndarray:
    """Platform seen from above (k, 2) [m] along its lateral and forward axes, from the axle midpoint; pointed ahead."""
    half, rear = BODY_HALF_WIDTH * geometry.l, -REAR * geometry.r
    nose = _nose(geometry)
    shoulder = nose - 0.7 * half
    right = [(half, rear), (half, shoulder), (0.25 * half, nose)]
    return np.array(right + [(-lateral, forward) for lateral, forward in reversed(right)])


def _nose(geometry: Geometry) -> float:
    """Foremost point of a body ahead of its axle [m]: a car's is above its steered wheels, a trailer's half way."""
    front = geometry.front
    if front is None:
        return float(max(geometry.d, 0.0) + NOSE * geometry.r)
    return float(front.wheelbase + NOSE * front.r_f if isinstance(front, Car) else 0.5 * front.wheelbase)


def wheel_outlines(geometry: Geometry) -> np.ndarray:
    """Right and left wheel seen from above (2, 4, 2) [m], like ``body_outline``."""
    thick, r = WHEEL_HALF_THICKNESS * geometry.r, geometry.r
    wheel = np.array([(-thick, -r), (thick, -r), (thick, r), (-thick, r)])
    aside = np.array([geometry.l, 0.0])
    return np.stack([wheel + aside, wheel - aside])


def front_geometry(geometry: Geometry) -> Geometry:
    """Lengths of a front axle as those of a platform, for the outlines above; a car's wheels stand apart."""
    front = geometry.front
    assert front is not None
    return Geometry(d=front.d_f, l=front.l_f or BODY_HALF_WIDTH * geometry.l, r=front.r_f)


def axle_outline(geometry: Geometry) -> np.ndarray:
    """Bar between two wheels seen from above (4, 2) [m], like ``body_outline``: a steered axle has no body."""
    half, thick = geometry.l, WHEEL_HALF_THICKNESS * geometry.r
    return np.array([(half, -thick), (half, thick), (-half, thick), (-half, -thick)])


def placed(outline: np.ndarray, midpoint: np.ndarray, forward: np.ndarray) -> np.ndarray:
    """World coordinates of an outline (..., 2) given along the axes of a platform.

    >>> placed(np.array([0.0, 1.0]), np.array([5.0, 0.0]), np.array([-1.0, 0.0])).tolist()
    [4.0, 0.0]
    """
    lateral = np.array([forward[1], -forward[0]])
    return midpoint + outline[..., :1] * lateral + outline[..., 1:] * forward
