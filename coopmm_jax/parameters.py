"""Physical parameters, gains and settings of one rollout, as pytrees of scalars.

Every field is a scalar (or a tuple of scalars, one per robot, channel or constraint row), so that one
rollout is written on scalars and ``jax.vmap`` adds the batch axis. Defaults are section IV of the paper.

>>> Inertia().m_p
5.0
"""

from __future__ import annotations

import math
from typing import NamedTuple

from coopmm_jax.algebra.types import Pair, PyTree, Scalar, Vector
from coopmm_jax.kinds.disturbances import Disturbance
from coopmm_jax.kinds.robust_adaptive import Gains


class LogPolar(NamedTuple):
    """Chart of a platform on two axles about the world's origin (``mechanics/log_polar.py``)."""


class Trailer(NamedTuple):
    """Tractor with a differential drive that pulls the platform: lengths of its axle, ahead of the platform's [m]."""

    wheelbase: Scalar = 0.5  # between the axles
    d_f: Scalar = 0.5  # centre of the tractor ahead of its axle
    l_f: Scalar = 0.5  # half track of the tractor
    r_f: Scalar = 0.5  # radius of its wheels, which drive
    unit: PyTree = None  # of length in the chained form; None: that of the desired motion's turning radius
    chart: LogPolar | None = None  # None: from the heading, as in (6)


class Car(NamedTuple):
    """Steered axle ahead of the platform's, whose wheels drive: lengths [m]."""

    wheelbase: Scalar = 0.5  # between the axles
    d_f: Scalar = 0.0  # centre of the steered axle ahead of its pivot
    l_f: Scalar = 0.0  # from a steered wheel to the axis that it turns about
    r_f: Scalar = 0.25  # radius of the steered wheels
    unit: PyTree = None  # as of a trailer
    chart: LogPolar | None = None  # likewise


Front = Trailer | Car


class FrontInertia(NamedTuple):
    """Masses [kg] and moments of inertia [kg m^2] of a platform's front axle: a tractor, or a steered axle."""

    m_f: Scalar = 5.0
    I_f: Scalar = 2.5  # yaw, about its centre
    I_wf: Scalar = 1.0  # one wheel, about its axle


class Arm(NamedTuple):
    """Arm with any number of pitch links on its column, in the place of links 2 and 3."""

    l_links: Vector  # half lengths (N,), from the column to the tip [m]


class LiftedArm(NamedTuple):
    """Arm whose column lifts its pitch links: a joint between yaw and pitch, without a mass of its own."""

    l_links: Vector  # as of an arm without


AnyArm = Arm | LiftedArm


class LinkInertia(NamedTuple):
    """Masses [kg] and moments of inertia [kg m^2] of an arm's pitch links."""

    m_links: Vector  # (N,)
    I_links: Vector  # about the centre across the rod (N,)


class Geometry(NamedTuple):
    """Lengths of one robot [m]; known to the controller (the paper assumes B known below (2))."""

    d: Scalar = 0.5  # centre of the platform ahead of the axle
    l: Scalar = 0.5  # half track  # noqa: E741 - the paper's symbol
    r: Scalar = 0.5  # wheel radius
    l1: Scalar = 0.5  # half height of the column
    l2: Scalar = 0.25  # half length of link 2
    l3: Scalar = 0.25  # half length of link 3
    mount_offset: Scalar = 0.0  # arm mount ahead of the axle
    front: Front | None = None  # axle ahead; None: the wheels of the only axle drive it
    arm: AnyArm | None = None  # None: links 2 and 3 above


class Inertia(NamedTuple):
    """Masses [kg] and moments of inertia [kg m^2] of one robot."""

    m_p: Scalar = 5.0  # platform
    m1: Scalar = 1.0  # column
    m2: Scalar = 0.5  # link 2
    m3: Scalar = 0.5  # link 3
    m_obj: Scalar = 0.0  # point mass carried at the tip (robot II: 0.5)
    I_w: Scalar = 1.0  # one driven wheel, about its axle
    I_p: Scalar = 2.5  # platform, about its centre
    I1: Scalar = 1.0  # column, yaw
    I2: Scalar = 0.5  # link 2, about its centre across the rod
    I3: Scalar = 0.5  # link 3, likewise
    front: FrontInertia | None = None  # of a platform on two axles
    links: LinkInertia | None = None  # of an arm that is described link by link


MASS_NAMES = tuple(name for name in Inertia._fields if name not in ("front", "links"))


class Surface(NamedTuple):
    """The coupling's geometry [m]: the object's surface and the guide that holds the object."""

    contact_radius: Scalar = 0.7  # Rc of the concave arc
    guide_radius: Scalar = 1.7  # radius of the object's circle
    guide_height: PyTree = 1.0  # height of the object; a number, or one over time (``kinds/courses.py``)
    shape: PyTree = None  # of another surface than the arc (``kinds/surfaces.py``)


class Rail(NamedTuple):
    """Guide along a path, on which the object runs freely."""

    path: PyTree  # of ``kinds/paths.py``
    start: PyTree = 0.0  # phase at which the search for the carriage begins, or a timing that begins there


class MovingRail(NamedTuple):
    """Guide that holds the object abreast of a point that moves along a path: the paper's rheonomic constraint."""

    path: PyTree  # of ``kinds/paths.py``
    timing: PyTree  # of ``kinds/timings.py``


class Plant(NamedTuple):
    """Plant that is simulated: two robots, their coupling, gravity [m/s^2]."""

    geometry: Pair[Geometry] = (Geometry(), Geometry())
    inertia: Pair[Inertia] = (Inertia(), Inertia(m_obj=0.5))
    surface: Surface = Surface()
    gravity: Scalar = 9.81
    guide: PyTree = None  # Rail or MovingRail; None: the circle of ``surface``


class Reference(NamedTuple):
    """Desired motion and force of section IV."""

    rate: Scalar = 1.0  # u_d1, platform yaw rate [rad/s]
    radius: Pair[Scalar] = (2.4, 1.0)  # z_d2 of each robot [m]
    arm_centre: Pair[Scalar] = (math.pi / 2, math.pi / 2)  # [rad]
    arm_swing: Pair[Scalar] = (math.pi / 6, 0.0)  # a1_d = centre - swing cos(arm_rate t) [rad]
    arm_rate: Scalar = 1.0  # [rad/s]
    contact_force: PyTree = (
        15.0  # lambda_d of the contact normal [N]; a number, or one over time (``kinds/courses.py``)
    )
    unit: Pair[PyTree] = (None, None)  # of length in the chained form of each platform on two axles [m], or its chart


class PathReference(NamedTuple):
    """Desired motion along a path of the object, with both platforms beside it."""

    path: PyTree  # of the object, see ``kinds/paths.py``
    timing: PyTree  # see ``kinds/timings.py``
    offset: Pair[Scalar] = (0.7, -0.7)  # of each platform to the right of the path [m]
    contact: PyTree = 0.0  # n_d, place of the contact across the object [m]; a number, or one over time
    contact_force: PyTree = 15.0  # lambda_d of the contact normal [N]; likewise
    surface: Surface = Surface()  # of the object, as far as the controller knows
    unit: Pair[PyTree] = (None, None)  # as in ``Reference``


class Pose(NamedTuple):
    """Initial coordinates of one robot; a2 and a3 start Newton's iteration for the constraints."""

    x: Scalar  # [m]
    y: Scalar
    th: Scalar  # [rad]
    a1: Scalar
    a2: Scalar
    a3: Scalar
    steer: PyTree = None  # angle of a front axle, None: as the desired motion turns [rad]
    arm: PyTree = None  # joints after the yaw, lift [m] before pitches [rad], of an arm link by link; None: a2 and a3

    @property
    def joints(self) -> Vector:
        """Joints of the arm after its yaw (k,) [rad], a lift [m]."""
        return (self.a2, self.a3) if self.arm is None else self.arm


class Hardware(NamedTuple):
    """Differences of a real loop from the paper's: every default is the ideal. See ``Features``."""

    force_lag: Scalar = 0.0  # time constant of the force sensor [s]
    force_bias: Scalar = 0.0  # of every measured row [N]
    force_noise: Scalar = 0.0  # standard deviations, per sample [N]
    encoder_noise: Scalar = 0.0  # of z1, z2, z3 and the joint angles [rad, m]
    velocity_noise: Scalar = 0.0  # of the independent velocities [rad/s, m/s]
    noise_seed: Pair[Scalar] = (0.0, 0.0)  # the run's seed: upper and lower 16 bits, so exact in float32 too
    noise_stream: Scalar = 0.0  # which of the seed's streams (a sweep's sample), a whole number below 2^24
    wheel_limit: Scalar = math.inf  # torque limits [N m]
    joint_limit: Scalar = math.inf
    actuator_lag: Scalar = 0.0  # time constant of every actuator [s]
    wheel_viscous: Scalar = 0.0  # [N m s]
    joint_viscous: Scalar = 0.0
    wheel_coulomb: Scalar = 0.0  # [N m]
    joint_coulomb: Scalar = 0.0
    friction_speed: Scalar = 0.01  # below which Coulomb friction fades [rad/s]
    tip_friction: Scalar = 0.0  # Coulomb coefficient of the sliding contact [-]
    slip_speed: Scalar = 0.01  # below which it fades [m/s]
    surface_amplitude: Scalar = 0.0  # of the arc's radius, Rc + amplitude sin(frequency t + phase) [m]
    surface_frequency: Scalar = 1.0  # [rad/s]
    surface_phase: Scalar = 0.0  # [rad]
    penetration: Scalar = 1e-4  # of the tip into a compliant surface at 15 N [m]
    contact_damping: Scalar = 20.0  # of a compliant surface: share of its force for each m/s [s/m]


PAPER_START = (Pose(2.5, 0.0, 0.0, 0.5253, -0.9273, 1.8546), Pose(1.2, 0.0, 0.0, 1.57, 2.62, 1.05))


class Schedule(NamedTuple):
    """Gains that change over time: piecewise linear between K knots, at least two, and constant outside them."""

    times: Vector  # (K,) [s], each later than the one before
    values: dict[str, tuple]  # by name of the gain, at every knot (K,): a scalar, or a vector as in ``Gains``


class PhaseSchedule(NamedTuple):
    """Gains that change with the phase of the desired motion, between knots as in ``Schedule``.

    Along an open path they are constant before the first knot and after the last; round a closed one, and on circles,
    whose phase is the platforms' desired yaw, the last knot is followed by the first.
    """

    phases: Vector  # (K,), each higher than the one before; of a closed path within one turn of 2 pi
    values: dict[str, tuple]  # as in ``Schedule``


class Parameters(NamedTuple):
    """Everything numeric a rollout depends on: differentiate or vmap over any part of it."""

    plant: Plant = Plant()
    nominal: Pair[Inertia] = (Inertia(), Inertia(m_obj=0.5))  # the controller's model
    gains: PyTree = Gains()  # of the controller, whose class says which one it is
    disturbance: tuple[Disturbance, ...] = (Disturbance(),)
    reference: Reference | PathReference = Reference()
    start: Pair[Pose] = PAPER_START
    hardware: Hardware = Hardware()
    schedule: Schedule | PhaseSchedule | None = (
        None  # in the place of the gains that it has; None adds nothing to a program
    )


ALL_ROWS = ("contact_normal", "contact_height", "guide_radial", "guide_height")


class Features(NamedTuple):
    """Parts of ``Hardware`` in force: each adds terms or states, so the ideal loop does without any."""

    force_lag: bool = False
    force_bias: bool = False
    noise: bool = False
    torque_limits: bool = False  # clipped
    smooth_limits: bool = False  # smoothly limited, for gradients
    actuator_lag: bool = False
    friction: bool = False  # of wheels and joints
    tip_friction: bool = False
    surface_motion: bool = False

    @property
    def limits(self) -> bool:
        """True if torques are limited, in either form."""
        return self.torque_limits or self.smooth_limits


class Structure(NamedTuple):
    """The choices that change the equations themselves; hashable, static under jit.

    They are static because each one adds or removes whole terms and states, so a traced switch would make every
    rollout pay for all of them.
    """

    rows: tuple[str, ...] = ALL_ROWS  # constraint rows in force (``mechanics/constraints.py``)
    robust_term: str = "proof"  # proof | printed: where chat stands in (19)
    u26: str = "printed"  # printed | corrected: U26 of (19)
    feedforward: str = "projected"  # projected | full: how U1 + U2 becomes a force on all joints
    substeps: int = 0  # integration steps per control period; 0: the controller runs in continuous time
    force_delay: int = 0  # whole samples by which the measured force is late
    features: Features = Features()
    contact: str = "rigid"  # rigid | compliant: a constraint, or a stiff surface that the tip can leave
    joints: Pair[int] = (5, 5)  # velocities u of each robot: two of the platform, those of the arm's joints

    @property
    def compliant(self) -> bool:
        """True if the contact's normal row is a row of the controller only, and a stiff surface in the plant."""
        return self.contact == "compliant"

    @property
    def plant_rows(self) -> tuple[str, ...]:
        """Constraint rows of the plant; the controller's are ``rows``."""
        return tuple(name for name in self.rows if name != "contact_normal") if self.compliant else self.rows
