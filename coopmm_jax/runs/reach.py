"""Distance by which an arm misses what a start asks of it.

Platforms and independent joints stand where the start has them; the dependent joints are tried all round, then ever
closer to the best ones. Robot II comes first, as its guide does not see robot I.
"""

from __future__ import annotations

from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np

from coopmm_jax.algebra.matrix import dot, norm
from coopmm_jax.algebra.types import Pair, Scalar, Vector
from coopmm_jax.control.standing import standing_start
from coopmm_jax.kinds.paths import span
from coopmm_jax.mechanics.arc_contact import ArcContact
from coopmm_jax.mechanics.constraints import bodies, constraint_rows
from coopmm_jax.mechanics.coordinates import AnyPosition, arm_of, platform_of
from coopmm_jax.mechanics.guide import guide_at, needs_carriage
from coopmm_jax.mechanics.level_contact import LevelContact
from coopmm_jax.mechanics.model import Model, build_model
from coopmm_jax.mechanics.partitioning import partition
from coopmm_jax.mechanics.robot import PLATFORM, YAW
from coopmm_jax.parameters import LiftedArm, Parameters, Structure

_POINTS = 33  # tried of each number at once; odd, so that the best one of before is among them
_ROUNDS, _CLOSER = 12, 0.25  # of the range, from round to round
_HIGHEST = 5.0  # [m] of a lift that is tried
_LEAST = 1e-3  # [m] that is told


def missed(structure: Structure, parameters: Parameters) -> dict[str, float]:
    """Distance [m] between an arm's tip and where the start asks it to be, of each robot that cannot bridge it.

    Args:
        structure: static choices.
        parameters: of the rollout.

    >>> from coopmm_jax.parameters import PAPER_START
    >>> away = Parameters(start=(PAPER_START[0], PAPER_START[1]._replace(x=3.0)))
    >>> missed(Structure(), away)["II"] > 0.2
    True
    """
    with jax.enable_x64(True):
        model = build_model(parameters)
        position, found = standing_start(model, parameters, 0.0), {}
        for robot, name in ((1, "II"), (0, "I")):
            distance, position = _nearest(structure, model, position, robot)
            if distance > _LEAST:
                found[name] = distance
    return found


def _nearest(
    structure: Structure, model: Model, position: Pair[AnyPosition], robot: int
) -> tuple[float, Pair[AnyPosition]]:
    """Least distance of one robot from what its rows ask for [m], and the positions at which it is so near."""
    own = partition(structure.rows, structure.joints).dependent[robot]
    lifts = isinstance(model.geometry[robot].arm, LiftedArm)
    ranges = [(0.0, _HIGHEST if lifts and joint == YAW + 1 else np.pi) for joint in own]
    if robot == 1 and needs_carriage(structure.rows, model):
        first, last = span(model.guide.path)
        ranges.append((0.5 * (first + last), 0.5 * (last - first)))

    def moved(joints: Vector) -> Pair[AnyPosition]:
        here = position[robot]
        arm = dict(enumerate(arm_of(here), PLATFORM)) | dict(zip(own, joints, strict=True))
        there = type(here)(*here[: platform_of(here)], *arm.values())
        return (there, position[1]) if robot == 0 else (position[0], there)

    def distance(*tried: Scalar) -> Scalar:
        return norm(_missing(structure, model, moved(tried[: len(own)]), tried[len(own) :], robot))

    if not own:
        return 0.0, position
    best, least = _least(jax.jit(jax.vmap(distance)), np.array(ranges))
    return least, moved(tuple(best[: len(own)]))


def _missing(structure: Structure, model: Model, position: Pair[AnyPosition], carriage: Vector, robot: int) -> Vector:
    """Residuals [m] of the rows of one robot; along a rail also how far it is from its carriage."""
    needed = needs_carriage(structure.rows, model)
    guide = guide_at(structure.rows, model, 0.0, carriage if carriage or not needed else (0.0,))
    surface = model.surface if guide.lift is None else model.surface._replace(guide_height=guide.lift.height)
    b = bodies(surface, model.geometry, position, guide.track)
    rows = constraint_rows(surface, structure.rows, b)
    phi = dict(zip(structure.rows, rows.phi, strict=True))
    phi["contact_normal"] = _from_surface(b.contact, phi["contact_normal"])
    if b.guide is None and "guide_radial" in phi:
        phi["guide_radial"] = norm(b.contact.tip2) - surface.guide_radius
    if robot == 0:
        return tuple(phi.values())[: rows.contacts]
    along = (dot(b.guide.tangent, b.guide.off),) if carriage and b.guide is not None else ()
    return (*tuple(phi.values())[rows.contacts :], *along)


def _from_surface(contact: ArcContact | LevelContact, phi: Scalar) -> Scalar:
    """Distance of tip I from the object's surface [m], along arm II where it is on the far half of a closed level.

    The row vanishes there too.
    """
    if isinstance(contact, ArcContact):  # its row is a distance close to the arc alone, as that of the circle is
        e, n = contact.D2
        return jnp.where(contact.facing > 0.0, norm(contact.D2) - contact.radius, jnp.hypot(e, abs(n) - contact.radius))
    e, n = contact.point
    behind = jnp.abs(e - contact.shape.along(n))
    return jnp.where((contact.facing > 0.0) | ~jnp.isfinite(behind), phi, behind)


def _least(function: Callable[..., jax.Array], ranges: np.ndarray) -> tuple[np.ndarray, float]:
    """Place (n,) of a function's least value, and this: of n numbers, in ranges (n, 2) given by middle and half."""
    place, half, least = ranges[:, 0], ranges[:, 1], np.inf
    steps = np.meshgrid(*(np.linspace(-1.0, 1.0, _POINTS),) * len(ranges), indexing="ij")
    grid = np.array([step.ravel() for step in steps]).reshape(len(ranges), -1)
    for _ in range(_ROUNDS):
        tried = place[:, None] + half[:, None] * grid
        values = np.asarray(function(*tried))
        best = int(np.argmin(values))
        place, half, least = tried[:, best], _CLOSER * half, float(values[best])
    return place, least
