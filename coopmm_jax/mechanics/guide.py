"""Guide that holds the object: a rail along any path, one that moves with time, and the height over time.

A rail has a carriage, whose coordinate, a phase of the path, is one more state of the robots; so a path may cross
itself. A moving rail is the paper's rheonomic constraint: the object's desired trajectory itself. All vectors are
horizontal, along arm II's axes (e, n).
"""

from __future__ import annotations

from typing import NamedTuple

from coopmm_jax.algebra.derivative import derivatives
from coopmm_jax.algebra.matrix import dot, minus, plus, scaled
from coopmm_jax.algebra.sincos import sincos
from coopmm_jax.algebra.types import Scalar, Vector
from coopmm_jax.kinds.courses import is_course, value_and_rates
from coopmm_jax.kinds.paths import Frame, bent_frame
from coopmm_jax.mechanics.coordinates import Position
from coopmm_jax.mechanics.model import Model
from coopmm_jax.parameters import MovingRail, Rail


class Track(NamedTuple):
    """Path that guides the object, in the world, where the object is on it."""

    at: Frame
    curvature: Scalar  # positive to the left [1/m]
    motion: TrackMotion | None = None  # None: it stands still


class TrackMotion(NamedTuple):
    """Motion of a moving rail's frame."""

    turn: Scalar  # [rad/s]
    turn_rate: Scalar  # [rad/s^2]
    speed: Scalar  # of its point, along its tangent [m/s]


class Lift(NamedTuple):
    """Height of the guide now and its rates [m, m/s, m/s^2]."""

    height: Scalar
    rate: Scalar
    acceleration: Scalar


class Guide(NamedTuple):
    """Guide at one instant, as far as it is not the circle at a constant height."""

    track: Track | None = None
    lift: Lift | None = None


class GuideFrame(NamedTuple):
    """Place of the object on its track, along arm II's axes (e, n)."""

    off: Vector  # (2,) from the track's point to the object [m]
    normal: Vector  # (2,) the track's right normal
    tangent: Vector  # (2,)
    track: Track


def guide_at(rows: tuple[str, ...], model: Model, t: Scalar, carriage: Vector) -> Guide:
    """Guide at t [s], with the rail's carriage (1,) or none (0,) as ``needs_carriage`` says."""
    if "guide_radial" not in rows:
        return Guide()
    height = model.surface.guide_height
    lift = Lift(*value_and_rates(height, t)) if is_course(height) else None
    if isinstance(model.guide, Rail):
        return Guide(Track(*bent_frame(model.guide.path, carriage[0])), lift)
    if isinstance(model.guide, MovingRail):
        return Guide(_moving_track(model.guide, t), lift)
    return Guide(None, lift)


def needs_carriage(rows: tuple[str, ...], model: Model) -> bool:
    """True if the object runs on a rail, whose carriage is a state of its own."""
    return "guide_radial" in rows and isinstance(model.guide, Rail)


def first_phase(rail: Rail, zero: Scalar) -> Scalar:
    """Phase at which the search for a rail's carriage begins, a scalar; ``zero`` is the time of the start [s]."""
    return rail.start.phase(zero) if hasattr(rail.start, "phase") else rail.start


def _moving_track(rail: MovingRail, t: Scalar) -> Track:
    def moving(t: Scalar) -> tuple[Frame, Scalar, Scalar, Scalar]:
        phase, rate = derivatives(rail.timing.phase, t, 1)
        at, curvature = bent_frame(rail.path, phase)
        speed = at.stretch * rate
        return at, curvature, curvature * speed, speed

    (at, curvature, turn, speed), (_, _, turn_rate, _) = derivatives(moving, t, 1)
    return Track(at, curvature, TrackMotion(turn, turn_rate, speed))


def guide_frame(track: Track, position: Position, tip: Vector) -> GuideFrame:
    """Track as seen along arm II's axes.

    Args:
        track: in the world.
        position: of robot II.
        tip: of robot II (2,), along its arm's axes [m].
    """
    s, c = sincos(position.z1 + position.a1)

    def along_arm(vector: Vector) -> Vector:
        x, y = vector
        return c * y - s * x, -(c * x + s * y)

    tangent = along_arm(track.at.forward)
    normal = (tangent[1], -tangent[0])
    return GuideFrame(minus(tip, along_arm(track.at.point)), normal, tangent, track)


def sideways(f: GuideFrame) -> Scalar:
    """Residual phi of the row ``guide_radial`` [m]: how far the object is off the track, to its right."""
    return dot(f.normal, f.off)


def sideways_row(f: GuideFrame, e2: Vector, n2: Vector) -> Vector:
    """Row (5,) of J in body rates, from those of the tip along e and n."""
    return plus(scaled(f.normal[0], e2), scaled(f.normal[1], n2))


def sideways_rate(f: GuideFrame) -> Scalar:
    """dphi/dt at fixed robots [m/s]; 0 of a rail that stands still, as its carriage follows the object."""
    return 0 if f.track.motion is None else f.track.motion.turn * dot(f.tangent, f.off)


def sideways_bias(f: GuideFrame, velocity: Vector, acceleration: Vector) -> Scalar:
    """Second derivative of phi when udot = 0 [m/s^2], from velocity (2,) and bias acceleration (2,) of the tip."""
    along, bias = dot(f.tangent, velocity), dot(f.normal, acceleration)
    motion = f.track.motion
    if motion is None:
        return bias + f.track.curvature * along * along
    turning = motion.turn_rate * dot(f.tangent, f.off) - motion.turn * motion.turn * sideways(f)
    return bias + motion.turn * (2.0 * along - motion.speed) + turning


def carriage_step(f: GuideFrame | None) -> Scalar:
    """Change of a carriage's coordinate, a scalar, that brings it beside the object; 0 without a track."""
    return 0.0 if f is None else (1.0 / f.track.at.stretch) * dot(f.tangent, f.off)


def in_rows(rows: tuple[str, ...], values: dict[str, Scalar]) -> Vector:
    """Values by name as a vector (m,) over the rows in force; structural zeros elsewhere."""
    return tuple(values.get(name, 0) for name in rows)


def tip_velocity(tip: tuple[Vector, ...], body_rates: Vector) -> Vector:
    """Velocity (2,) of a tip along its arm's axes [m/s]."""
    return tuple(dot(row, body_rates) for row in tip[:2])
