"""References that the robots cannot follow, refused before a run; and those that teach the law too little, warned of.

>>> from coopmm_jax.scenario.scenario import load_scenario
>>> check_reference(load_scenario("paper"))
"""

from __future__ import annotations

import functools
import warnings
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from coopmm_jax.errors import Notice, Remark, UserError
from coopmm_jax.kinds.controllers import lateral
from coopmm_jax.parameters import Geometry, Parameters, PathReference, PhaseSchedule, Pose, Surface
from coopmm_jax.status import SPEED_LIMIT

if TYPE_CHECKING:
    from coopmm_jax.scenario.scenario import Scenario

SAMPLES = 1000  # of a run
SLOWEST = 1e-6  # |dr/dp| of a path [m]
FLATTEST = 0.2  # |n . e1|, cosine between arm I and the normal of the object's surface
ROUNDING = 1e-9  # of a surface's level [m]
PERSISTENT = 5.0  # exp(-5) of a lateral error is left after a run
STRONGEST = 1e9  # [N], far beyond what any arm can press, and small enough for squares to be summed
STRAIGHTEST = 100.0  # [m], turning radius of a platform on two axles
LONG = 5.0  # [s] of a run in which errors are meant to settle


class Course(NamedTuple):
    """A reference at the samples of a run (SAMPLES,)."""

    t: np.ndarray  # [s]
    phase: np.ndarray
    stretch: np.ndarray  # |dr/dp| [m]
    turn: np.ndarray  # u_d1 [rad/s]
    speed: np.ndarray  # of the faster platform [m/s]
    reach: np.ndarray  # of arm I [m]
    incidence: np.ndarray  # n . e1
    distance: np.ndarray  # of the desired contact point from the object's surface [m]
    height: np.ndarray  # of the object [m]
    force: np.ndarray  # desired contact force [N]
    radius: np.ndarray  # of the path's curvature, positive to the left [m]
    across: np.ndarray  # of the path, to the right of the origin along its heading [m]
    ahead: np.ndarray  # likewise ahead of it [m]


def check_reference(scenario: Scenario) -> None:
    """Refuse a reference that cannot be followed or gone by, and warn of one along which lateral errors stay.

    Raises:
        UserError: a path that stands still in its parameter or is left at an end, a contact point out of reach or
            behind the surface's edge, speeds beyond [rad/s, m/s] of ``status.SPEED_LIMIT``, forces beyond any that
            arms press with [N], or gains that change with a phase that does not.

    Warns:
        Notice: of too little turning, and how well a path fits the points that it was made from.
    """
    parameters = scenario.parameters()
    if isinstance(parameters.schedule, PhaseSchedule):
        check_phase(scenario, "schedule.phases")
    if parameters.plant.surface.shape is not None:
        _check_surface(parameters.plant.surface.shape)
    if not isinstance(parameters.reference, PathReference):
        for i, radius in enumerate(parameters.reference.radius):
            rho, still = np.array([float(radius)]), np.zeros(1)
            _check_turning(parameters, i, "reference.radius", rho, still, np.array([[float(radius)], [0.0]]))
        return
    course = _course(parameters.reference, parameters.plant.surface, scenario.simulation.duration)
    _check_path(parameters.reference, course)
    _check_arms(parameters, course)
    for i, offset in enumerate(parameters.reference.offset):
        place = np.stack([course.across + float(offset), course.ahead])
        _check_turning(parameters, i, "reference.path", course.radius + float(offset), course.t, place)
    _check_sizes(course)
    deviation = getattr(parameters.reference.path, "deviation", None)
    if deviation is not None:
        text = f"reference.path: its curve is up to {1e3 * deviation:.2g} mm away from the spline through its points"
        warnings.warn(Remark(text), stacklevel=3)
    if not getattr(parameters.gains, "lateral", ""):  # a controller that removes lateral errors in another way
        return
    duration = scenario.simulation.duration
    powers = {2 if geometry.front is None else 4 for geometry in parameters.plant.geometry}  # 2 l of u_d1^(2 l)
    turning = min(float(np.mean(course.turn**power)) for power in powers)
    persistence = float(lateral(parameters.gains)) * turning * duration
    if persistence < PERSISTENT and duration >= LONG:
        text = f"reference: turns too little (persistence {persistence:.2g}, at least {PERSISTENT:g}) to remove"
        warnings.warn(Notice(f"{text} lateral errors within the run"), stacklevel=3)


def check_phase(scenario: Scenario, field: str) -> None:
    """Refuse a reference whose phase stands still where gains are to change with it.

    Raises:
        UserError: of ``field``.
    """
    import jax

    from coopmm_jax.control.reference import phase

    reference, t = scenario.parameters().reference, np.linspace(0.0, scenario.simulation.duration, SAMPLES)
    with jax.enable_x64(True):
        phases = np.asarray(jax.vmap(lambda t: phase(reference, t) + 0.0 * t)(t))
    if np.ptp(phases) == 0.0:
        raise UserError(field, "left out where the desired motion stands still", f"a phase of {phases[0]:g} throughout")


def _course(reference: PathReference, surface: Surface, duration: float) -> Course:
    import jax

    with jax.enable_x64(True):
        t = np.linspace(0.0, duration, SAMPLES)
        values = _compiled()(reference, surface, t)
        return Course(t, *(np.broadcast_to(np.asarray(x), t.shape) for x in values))


@functools.cache
def _compiled() -> Callable[..., Any]:
    """Compiled function of all samples: one program for all numbers of a reference, whatever else a scenario has."""
    import jax

    return jax.jit(jax.vmap(_sample, in_axes=(None, None, 0)))


def _sample(reference: PathReference, surface: Surface, t: Any) -> tuple[Any, ...]:
    """Entries of ``Course`` but the time, at t [s]."""
    import jax
    import jax.numpy as jnp

    from coopmm_jax.control.path_motion import aim_at
    from coopmm_jax.kinds.courses import current
    from coopmm_jax.kinds.paths import bent_frame
    from coopmm_jax.mechanics.surfaces import shape_of

    shape = shape_of(surface)
    aim, phase = aim_at(reference, t), reference.timing.phase(t)
    at = (shape.along(aim.contact), aim.contact)
    slope = jax.grad(lambda point: shape.level(*point))(at)
    along = (at[0] + reference.offset[0]) * slope[0] + at[1] * slope[1]
    incidence = along / (aim.reach.value * jnp.hypot(*slope))
    speeds = [jnp.abs(aim.advance + aim.turn.value * (aim.across + offset)) for offset in reference.offset]
    distance = shape.level(*at) / jnp.hypot(*slope)
    height = current(surface.guide_height, t)
    fastest = functools.reduce(jnp.maximum, speeds)
    at_phase, curvature = bent_frame(reference.path, phase)
    lengths = (aim.reach.value, incidence, distance, height)
    place = (1.0 / curvature, aim.across, aim.ahead)
    return phase, at_phase.stretch, aim.turn.value, fastest, *lengths, aim.force, *place


def _check_surface(shape: Any) -> None:
    """Check that a level vanishes at the object, with a slope of -1 along arm II and none across it."""
    import jax

    with jax.enable_x64(True):
        value, slope = jax.value_and_grad(lambda point: shape.level(*point))((0.0, 0.0))
    found = tuple(map(float, (value, *slope)))
    if not np.allclose(found, (0.0, -1.0, 0.0), rtol=0.0, atol=ROUNDING):
        was = f"{found[0]:.3g}, with a gradient of ({found[1]:.3g}, {found[2]:.3g})"
        raise UserError("coupling.surface", "of level 0 at the object, with a gradient of (-1, 0)", was)


def _check_path(reference: PathReference, course: Course) -> None:
    from coopmm_jax.kinds.paths import OPEN, span

    slowest = course.stretch.argmin()
    if not course.stretch[slowest] > SLOWEST:
        must = f"a path that moves on by more than {SLOWEST:g} m per unit of its phase"
        was = f"{course.stretch[slowest]:.3g} m at {course.t[slowest]:.3g} s"
        raise UserError("reference.path", must, was)
    first, last = course.phase.min(), course.phase.max()
    if span(reference.path) == OPEN and not (first > OPEN[0] - SLOWEST and last < OPEN[1] + SLOWEST):
        raise UserError("reference.timing", "within the open path's phases, -1 to 1", f"{first:.3g} to {last:.3g}")


def _check_sizes(course: Course) -> None:
    fastest = max(np.abs(course.turn).max(), course.speed.max())
    if not fastest < SPEED_LIMIT:
        raise UserError("reference.timing", f"slow enough for {SPEED_LIMIT:g} rad/s and m/s", f"up to {fastest:.3g}")
    strongest = np.abs(course.force).max()
    if not strongest < STRONGEST:
        raise UserError("reference.force", f"less than {STRONGEST:g} N to either side", f"up to {strongest:.3g}")


def _check_turning(
    parameters: Parameters, robot: int, field: str, rho: np.ndarray, t: np.ndarray, place: np.ndarray
) -> None:
    """Check that a platform on two axles can turn as it should, in its chart.

    Args:
        parameters: of the rollout.
        robot: 0 or 1.
        field: to name.
        rho: distance of the centre of turning to its left (n,) [m].
        t: times (n,) [s].
        place: of the platform along its own lateral and forward axes (2, n) [m].

    Raises:
        UserError: of ``field``: straight ahead the chained form is singular, in the polar chart it is towards or away
            from the origin, and towards a right angle the steering.
    """
    front = parameters.plant.geometry[robot].front
    if front is None:
        return
    nearest, name = float(front.wheelbase), ("I", "II")[robot]
    if front.chart is not None:
        cosine = place[0] / np.hypot(*place)
        beyond = ~((np.abs(rho) > nearest) & (cosine > FLATTEST))
        if beyond.any():
            must = f"such that platform {name}, in the chart logpolar, runs round the origin to the left,"
            must += f" at a cosine of {FLATTEST:g} or more to circles and turning radii from {nearest:g} m"
            was = f"cosine {cosine[beyond][0]:.2g}, radius {rho[beyond][0]:.3g} m at {t[beyond][0]:.3g} s"
            raise UserError(field, must, was)
        return
    beyond = ~((np.abs(rho) > nearest) & (np.abs(rho) < STRAIGHTEST) & (np.sign(rho) == np.sign(rho[0])))
    if beyond.any():
        must = f"such that platform {name}, on two axles, turns to one side, at {nearest:g} to {STRAIGHTEST:g} m"
        raise UserError(field, must, f"a radius of {rho[beyond][0]:.3g} m at {t[beyond][0]:.3g} s")


def _stretch(geometry: Geometry, start: Pose, reach: np.ndarray, height: np.ndarray) -> tuple[np.ndarray, float, float]:
    """Distance that the last two joints of an arm have to bridge (n,), and the least and most that they can [m].

    Args:
        geometry: of the robot.
        start: its pose, as the joints before these stay where they start.
        reach: of the tip along the arm (n,) [m].
        height: of the tip (n,) [m].
    """
    rise, joints, half = height - 2.0 * float(geometry.l1), start.joints, (geometry.l2, geometry.l3)
    if geometry.arm is not None:
        half = geometry.arm.l_links
        lift, joints = joints[: len(joints) - len(half)], joints[len(joints) - len(half) :]
        if len(half) == 1:  # a lift brings it to any height
            return np.abs(reach), -1.0, 2.0 * float(half[0]) if lift else np.inf
        rise = rise - sum(map(float, lift))
    pitches = np.cumsum(np.array(joints[:-2], dtype=float))
    before = 2.0 * np.array(half[:-2], dtype=float)
    lower, upper = 2.0 * float(half[-2]), 2.0 * float(half[-1])
    distance = np.hypot(reach - before @ np.cos(pitches), rise - before @ np.sin(pitches))
    return distance, abs(lower - upper), lower + upper


def _check_arms(parameters: Parameters, course: Course) -> None:
    reference = parameters.reference
    assert isinstance(reference, PathReference)
    across = course.incidence
    worst = np.abs(across).argmin()
    if not np.isfinite(across).all():
        t = course.t[~np.isfinite(across)][0]
        raise UserError("reference.contact", "on the object's surface", f"beyond its edge at {t:.3g} s")
    farthest = np.abs(course.distance).argmax()
    if not abs(course.distance[farthest]) < ROUNDING:
        must = "of level 0 where along(n) says that it is"
        was = f"{abs(course.distance[farthest]):.3g} m away at {course.t[farthest]:.3g} s"
        raise UserError("coupling.surface", must, was)
    for number, reach in zip(("I", "II"), (course.reach, float(reference.offset[1]) + 0.0 * course.t), strict=True):
        robot = int(number == "II")
        geometry, start = parameters.plant.geometry[robot], parameters.start[robot]
        distance, nearest, farthest = _stretch(geometry, start, reach, course.height)
        beyond = (distance <= nearest) | (distance >= farthest)
        if beyond.any():
            bounds = f"{nearest:g} to {farthest:g} m"
            was = f"{distance[beyond][0]:.3g} m at {course.t[beyond][0]:.3g} s"
            if len(start.joints) > 2:  # those before the last two stay where they start
                must = f"such that the last two links of arm {number} bridge what is left, {bounds}"
                raise UserError("initial.pitch", must, was)
            raise UserError("reference", f"within the reach of arm {number}, {bounds}", was)
    if not abs(across[worst]) >= FLATTEST:
        must = f"where arm I meets the surface at a cosine of {FLATTEST:g} or more with its normal"
        raise UserError("reference.contact", must, f"{abs(across[worst]):.2g} at {course.t[worst]:.3g} s")
